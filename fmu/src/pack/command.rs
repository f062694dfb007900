//! The command line of `pack`.

use super::library::Library;
use super::params::Params;
use super::{PackError, model, prepare, verify, write};
use crate::model::models;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pack                                         all models into the current directory
  pack MODEL --params fit.json                 identified values become start values
  pack MODEL --params values.ssv               or those of a parameter set (SSP 1.0)
  pack MODEL --set sample_period=0.02 --out out
  pack all --targets win64=wheelstate_fmu.dll  with a second platform
  pack all --libraries OUT                     for the platforms that fmu/targets.sh OUT built
  pack verify MODEL.fmu                        runs the experiment that the FMU carries on this machine

An unknown MODEL is answered with the list of models.

Exit codes: 0 done, 1 done with warnings (a value of the fit was not taken over), 2 refused.";

/// Write estimators as FMI 2.0 co-simulation FMUs.
#[derive(Parser)]
#[command(name = "pack", version, after_help = EXAMPLES, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Models, spelt as the FMU or as the vehicle of `identify`, or all [default: the vehicle of the fit, else all]
    #[arg(value_name = "MODEL")]
    models: Vec<String>,
    /// Result of `identify fit` or `identify tune`, whose identified values become start values, or a parameter set (.ssv)
    #[arg(long, value_name = "FIT.JSON|SET.SSV")]
    params: Option<PathBuf>,
    /// Take over values that the data did not identify, too
    #[arg(long, requires = "params")]
    include_unidentified: bool,
    /// A start value of your own; it takes precedence over --params (repeatable)
    #[arg(long = "set", value_name = "NAME=VALUE")]
    settings: Vec<String>,
    /// Directory for the .fmu files
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Folder with a library per platform, as fmu/targets.sh fills it; they take the place of the one beside this program
    #[arg(long, value_name = "DIR")]
    libraries: Option<PathBuf>,
    /// Libraries for further platforms, as win64=FILE (repeatable)
    #[arg(long, value_name = "PLATFORM=LIBRARY", value_parser = Library::parse, num_args = 1..)]
    targets: Vec<Library>,
}

#[derive(Subcommand)]
enum Command {
    /// Run the reference experiment of FMUs with their libraries on this machine
    Verify {
        /// The FMUs
        #[arg(value_name = "MODEL.FMU", required = true)]
        fmus: Vec<PathBuf>,
    },
}

/// Runs a command line, the program's name first, and gives the exit code. The program calls itself `name`; `own` are
/// the libraries that are packed if no others are named.
pub fn main(
    name: &'static str,
    arguments: impl IntoIterator<Item = OsString>,
    own: impl FnOnce() -> Result<Vec<Library>, PackError>,
) -> u8 {
    let examples = EXAMPLES.replace("\n  pack", &format!("\n  {name}"));
    // Where `pack` is a command of another program, so are those of `identify`.
    let other = name.strip_suffix(" pack").unwrap_or("identify");
    let renamed = |argument: clap::Arg| match argument.get_help().map(ToString::to_string) {
        Some(help) => argument.help(help.replace("`identify", &format!("`{other}"))),
        None => argument,
    };
    let parser = Arguments::command().name(name).bin_name(name).after_help(examples).mut_args(renamed);
    let matches = parser.try_get_matches_from(arguments);
    let arguments = match matches.and_then(|matches| Arguments::from_arg_matches(&matches)) {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => {
            eprintln!("{name}: {}", usage(&error.to_string()));
            return 2;
        }
        Err(help) => {
            let _ = help.print(); // a reader that has gone away is no error
            return 0;
        }
    };
    let done = match &arguments.command {
        Some(Command::Verify { fmus }) => verify_all(fmus),
        None => run(&arguments, own),
    };
    match done {
        Ok(warned) => u8::from(warned),
        Err(error) => {
            eprintln!("{name}: {error}");
            2
        }
    }
}

// As `usage` and `print` of the other package's commands, which this one does not import.
/// What is wrong with the command line, in one line: the first paragraph of the parser's text.
fn usage(text: &str) -> String {
    let lines = text.lines().map(str::trim).take_while(|line| !line.is_empty());
    lines.collect::<Vec<_>>().join(" ").trim_start_matches("error: ").to_owned() + "; --help shows the usage"
}

/// Prints to stdout; a reader that has gone away is no error.
fn print(text: &str) {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Verifies; an FMU that differs is refused.
fn verify_all(fmus: &[PathBuf]) -> Result<bool, PackError> {
    for fmu in fmus {
        let verdict = verify::run(fmu)?;
        let (deviation, worst, tolerance) = (verdict.deviation, &verdict.worst, verdict.tolerance);
        let of = if worst.is_empty() { String::new() } else { format!(" of {worst}") };
        let found = format!("{} steps, largest deviation {deviation:.1e}{of}, allowed {tolerance:.0e}", verdict.steps);
        if !verdict.is_good() {
            return Err(PackError(format!("{}: it differs from the reference: {found}", fmu.display())));
        }
        print(&format!("{}: verified: {found}\n", fmu.display()));
    }
    Ok(false)
}

/// Packs; gives whether there were warnings. Nothing is written before every model is ready.
fn run(arguments: &Arguments, own: impl FnOnce() -> Result<Vec<Library>, PackError>) -> Result<bool, PackError> {
    let mut libraries = match &arguments.libraries {
        Some(folder) => Library::all(folder)?,
        None => own()?,
    };
    for library in &arguments.targets {
        libraries.retain(|other| other.platform != library.platform);
        libraries.push(library.clone());
    }
    let params = arguments.params.as_deref().map(Params::read).transpose()?;
    let all = arguments.models.iter().any(|name| name == "all");
    let mut selected = match &params {
        _ if all => models(&|_| true),
        Some(params) if arguments.models.is_empty() => vec![params.model()?],
        None if arguments.models.is_empty() => models(&|_| true),
        _ => arguments.models.iter().map(|name| model(name)).collect::<Result<_, _>>()?,
    };
    if let Some(params) = &params
        && all
    {
        params.model()?;
    }
    let mut warned = false;
    let mut reports = Vec::new();
    for model in &mut selected {
        let params = params.as_ref().filter(|params| !all || params.is_of(model));
        let baked = prepare(model, params, arguments.include_unidentified, &arguments.settings)?;
        let taken = baked.taken.iter().map(|line| format!("  {line}\n"));
        let warnings = baked.warnings.iter().map(|line| format!("  warning: {line}\n"));
        reports.push(taken.chain(warnings).collect::<String>());
        warned |= !baked.warnings.is_empty();
    }
    for (model, report) in selected.iter().zip(reports) {
        print(&format!("{}\n{report}", write(model, &libraries, &arguments.out)?.display()));
    }
    Ok(warned)
}
