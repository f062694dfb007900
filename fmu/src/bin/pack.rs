//! `pack`: writes FMUs.

use clap::{Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;
use wheelstate_fmu::model::{Model, models};
use wheelstate_fmu::pack::fit::setting;
use wheelstate_fmu::pack::library::Library;
use wheelstate_fmu::pack::params::Params;
use wheelstate_fmu::pack::{self, PackError};

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

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => {
            eprintln!("pack: {}", usage(&error.to_string()));
            return ExitCode::from(2);
        }
        Err(help) => help.exit(),
    };
    let done = match &arguments.command {
        Some(Command::Verify { fmus }) => verify(fmus),
        None => run(&arguments),
    };
    match done {
        Ok(false) => ExitCode::SUCCESS,
        Ok(true) => ExitCode::from(1),
        Err(error) => {
            eprintln!("pack: {error}");
            ExitCode::from(2)
        }
    }
}

/// What is wrong with the command line, in one line: the first paragraph of the parser's text.
fn usage(text: &str) -> String {
    let lines = text.lines().map(str::trim).take_while(|line| !line.is_empty());
    lines.collect::<Vec<_>>().join(" ").trim_start_matches("error: ").to_owned() + "; --help shows the usage"
}

/// Verifies; an FMU that differs is refused.
fn verify(fmus: &[PathBuf]) -> Result<bool, PackError> {
    for fmu in fmus {
        let verdict = pack::verify::run(fmu)?;
        let (deviation, worst, tolerance) = (verdict.deviation, &verdict.worst, verdict.tolerance);
        let of = if worst.is_empty() { String::new() } else { format!(" of {worst}") };
        let found = format!("{} steps, largest deviation {deviation:.1e}{of}, allowed {tolerance:.0e}", verdict.steps);
        if !verdict.is_good() {
            return Err(PackError(format!("{}: it differs from the reference: {found}", fmu.display())));
        }
        println!("{}: verified: {found}", fmu.display());
    }
    Ok(false)
}

/// Packs; gives whether there were warnings. Nothing is written before every model is ready.
fn run(arguments: &Arguments) -> Result<bool, PackError> {
    let mut libraries = match &arguments.libraries {
        Some(folder) => Library::all(folder)?,
        None => vec![Library::own()?],
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
        _ => arguments.models.iter().map(|name| pack::model(name)).collect::<Result<_, _>>()?,
    };
    if let Some(params) = &params
        && all
    {
        params.model()?;
    }
    let mut warned = false;
    let mut reports = Vec::new();
    for model in &mut selected {
        let (report, warnings) =
            prepare(model, arguments, params.as_ref().filter(|params| !all || params.is_of(model)))?;
        reports.push(report);
        warned |= warnings;
    }
    for (model, report) in selected.iter().zip(reports) {
        println!("{}", pack::write(model, &libraries, &arguments.out)?.display());
        print!("{report}");
    }
    Ok(warned)
}

/// Sets the start values of one model.
fn prepare(model: &mut Model, arguments: &Arguments, params: Option<&Params>) -> Result<(String, bool), PackError> {
    let mut report = String::new();
    let mut warned = false;
    if let Some(params) = params {
        let baked = params.bake(model, arguments.include_unidentified)?;
        for line in &baked.taken {
            report += &format!("  {line}\n");
        }
        for line in &baked.warnings {
            report += &format!("  warning: {line}\n");
        }
        warned = !baked.warnings.is_empty();
    }
    let settings = arguments.settings.iter().map(|text| setting(model, text)).collect::<Result<Vec<_>, _>>()?;
    model.bake(&settings).map_err(PackError)?;
    Ok((report, warned))
}
