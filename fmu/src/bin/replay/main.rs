//! `replay`: runs an FMU over a log through the `fmi` crate.
//!
//! The library of the FMU is loaded as any other program would load it; nothing of the estimators
//! is linked here. So that the library itself stays free of the `fmi` crate, all code of this
//! program is below this file.

mod master;
mod messages;

use clap::Parser;
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use wheelstate_log::output::Outputs;
use wheelstate_log::progress::Progress;
use wheelstate_log::{ColumnMap, Log, guard};

const EXAMPLES: &str = "\
Examples:
  replay MODEL.fmu ride.csv --out result.csv
  replay MODEL.fmu trip.csv --columns car.toml --set sample_period=0.1
  replay MODEL.fmu run.mf4 --out result.parquet

Logs are CSV, Parquet, MDF4, MCAP or CAN files: a column `time` in s, the others named as the FMU's
inputs; empty or nan is a missing sample. The ending of the result chooses its format: .csv,
.parquet or .mf4. The inputs of a row hold until the time of the next one. The result has the
outputs at the start and at the end of every row. If the rows are further apart than the FMU's
sample_period, sample_period is set to their distance, so that no row counts twice; --set overrides
this.

Exit codes: 0 done, 2 refused.";

/// Run an FMU over a log and write its outputs.
#[derive(Parser)]
#[command(name = "replay", version, after_help = EXAMPLES)]
struct Arguments {
    /// The FMU
    #[arg(value_name = "MODEL.FMU")]
    model: PathBuf,
    /// The log: .csv, .parquet, .mf4, .mcap, .blf, .asc or .log
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// Column map for logs with other names and units
    #[arg(long, value_name = "MAP.TOML")]
    columns: Option<PathBuf>,
    /// A parameter, or an input that the log does not have (repeatable)
    #[arg(long = "set", value_name = "NAME=VALUE")]
    settings: Vec<String>,
    /// Where the result goes [default: standard output, as CSV]
    #[arg(long, value_name = "RESULT")]
    out: Option<PathBuf>,
}

fn main() -> ExitCode {
    messages::collect();
    guard::quiet();
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("replay: {}", error.to_string().replace(['\n', '\r'], " "));
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    if let Some(path) = &arguments.out {
        Outputs::check(path)?;
    }
    let progress = Progress::terminal();
    let map = arguments.columns.as_deref().map(ColumnMap::read).transpose()?;
    // An infinite sample is for the FMU to judge.
    let log = Log::read_verbatim(&arguments.log, map.as_ref(), &progress)?;
    for note in &log.notes {
        eprintln!("replay: note: {}: {}", log.source, note.replace(['\n', '\r'], " "));
    }
    let result = master::run(&arguments.model, &log, &arguments.settings, &progress)?;
    let Some(path) = &arguments.out else {
        return Ok(result.write_csv(std::io::stdout().lock())?);
    };
    let mut outputs = Outputs::new();
    outputs.file(path, |file| result.write(path, file))?;
    Ok(outputs.commit()?)
}
