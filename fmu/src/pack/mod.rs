//! Writes `.fmu` archives: the same input gives the same bytes.

mod archive;
pub mod command;
pub mod fit;
pub mod library;
pub mod params;
mod reference;
pub mod ssv;
pub mod verify;

use crate::describe::{self, page, start_values, terminals};
use crate::model::{Model, models};
use fit::Baked;
use library::Library;
use params::Params;
use std::path::{Path, PathBuf};

/// Why nothing was written; the message names the file or the parameter.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct PackError(pub String);

/// Reads a text file as what `parse(source, text)` makes of it.
fn read<T>(path: &Path, parse: impl Fn(&str, &str) -> Result<T, PackError>) -> Result<T, PackError> {
    let source = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|error| PackError(format!("{source}: {error}")))?;
    parse(&source, &text)
}

/// The model of this name, spelt as the FMU (in camel case) or as on the command line (in lower case with dashes).
pub fn model(name: &str) -> Result<Model, PackError> {
    models(&|known| same_name(known, name)).pop().ok_or_else(|| {
        let known: Vec<_> = models(&|_| true).iter().map(Model::command_name).collect();
        PackError(format!("there is no model '{name}'; there are: {}, all", known.join(", ")))
    })
}

/// Whether both are spellings of one model's name.
fn same_name(one: &str, other: &str) -> bool {
    let plain = |text: &str| text.to_lowercase().replace(['-', '_'], "");
    plain(one) == plain(other)
}

/// Every picture with the name of its model.
const PICTURES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/pictures.rs"));

/// The picture that tools show for a model; a model without one is shown as the tool likes.
pub fn picture(model: &Model) -> Option<&'static [u8]> {
    PICTURES.iter().find(|(name, _)| *name == model.name).map(|(_, picture)| *picture)
}

/// Sets the start values of a model: those of a fit or a parameter set, then those given as `name=value`.
pub fn prepare(
    model: &mut Model,
    params: Option<&Params>,
    unidentified: bool,
    settings: &[String],
) -> Result<Baked, PackError> {
    let baked = params.map_or(Ok(Baked::default()), |params| params.bake(model, unidentified))?;
    let settings = settings.iter().map(|text| fit::setting(model, text)).collect::<Result<Vec<_>, _>>()?;
    model.bake(&settings).map_err(PackError)?;
    Ok(baked)
}

/// Writes `<out>/<Model>.fmu` and gives its path. The archive appears whole or not at all.
pub fn write(model: &Model, libraries: &[Library], out: &Path) -> Result<PathBuf, PackError> {
    let mut files = vec![
        ("modelDescription.xml".to_owned(), describe::xml(model).into_bytes(), false),
        ("terminalsAndIcons/terminalsAndIcons.xml".to_owned(), terminals::xml(model).into_bytes(), false),
        ("documentation/index.html".to_owned(), page::html(model).into_bytes(), false),
        (format!("resources/{}.ssv", model.name), ssv::text(model).into_bytes(), false),
    ];
    files.extend(reference::files(model)?.into_iter().map(|(path, text)| (path, text.into_bytes(), false)));
    if let Some(picture) = picture(model) {
        files.push(("model.png".to_owned(), picture.to_vec(), false));
    }
    for (name, text) in [
        ("license.txt", include_str!("../../assets/license.txt")),
        ("LICENSE-MIT.txt", include_str!("../../../LICENSE-MIT")),
        ("LICENSE-APACHE.txt", include_str!("../../../LICENSE-APACHE")),
    ] {
        files.push((format!("documentation/licenses/{name}"), text.as_bytes().to_vec(), false));
    }
    let starts = start_values::differences(model, &self::model(model.name)?);
    for library in libraries {
        let mut bytes = library.read()?;
        if !starts.is_empty() {
            let text = starts.to_json();
            if library.is_signed() {
                files.push((format!("resources/{}", start_values::FILE), text.into_bytes(), false));
            } else {
                let failed = |why| PackError(format!("library {}: {why}", library.path.display()));
                start_values::embed(&mut bytes, &text).map_err(failed)?;
            }
        }
        for folder in library.folders(libraries) {
            files.push((format!("binaries/{folder}/{}{}", model.name, library.suffix()), bytes.clone(), true));
        }
    }
    files.sort();
    files.dedup();
    let path = out.join(format!("{}.fmu", model.name));
    let failed = |error: &dyn std::fmt::Display| PackError(format!("{}: {error}", path.display()));
    let bytes = archive::zip(files).map_err(|error| failed(&error))?;
    std::fs::create_dir_all(out).map_err(|error| failed(&error))?;
    let temporary = out.join(format!(".{}.fmu.{}", model.name, std::process::id()));
    let written = std::fs::write(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, &path));
    if let Err(error) = written {
        // what is left of it is of no use; the first error is the one to report
        let _ = std::fs::remove_file(&temporary);
        return Err(failed(&error));
    }
    Ok(path)
}
