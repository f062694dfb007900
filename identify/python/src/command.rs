//! The command `wheelstate`: the code of the programs `identify` and `pack`.

use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use wheelstate_fmu::pack::command as pack;
use wheelstate_fmu::pack::library::Library;
use wheelstate_identify::cli;

const NAME: &str = "wheelstate";
/// What the other packages add to the commands of `identify`.
const OTHERS: &[(&str, &str)] = &[("pack", "Write estimators as FMI 2.0 co-simulation FMUs")];

/// Runs a command line without the program's name and gives the exit code; `library` is an FMU with the libraries to pack.
#[pyfunction]
pub fn command(py: Python, arguments: Vec<OsString>, library: PathBuf) -> u8 {
    let with_name = |name: &str, arguments: Vec<OsString>| std::iter::once(name.into()).chain(arguments);
    py.detach(|| {
        let words: Vec<_> = arguments.iter().map(|word| word.to_str().unwrap_or_default()).collect();
        let of_pack = match words.as_slice() {
            ["pack", ..] => Some(arguments[1..].to_vec()),
            ["help", "pack", ..] => Some(vec!["--help".into()]),
            _ => None,
        };
        match of_pack {
            Some(rest) => {
                pack::main("wheelstate pack", with_name("wheelstate pack", rest), || Library::of_fmu(&library))
            }
            None => cli::run(NAME, with_name(NAME, arguments), OTHERS),
        }
    })
}
