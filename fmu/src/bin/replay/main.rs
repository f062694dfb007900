//! `replay`: runs an FMU over a log through the `fmi` crate.
//!
//! The library of the FMU is loaded as any other program would load it; nothing of the estimators
//! is linked here. So that the library itself stays free of the `fmi` crate, all code of this
//! program is below this file.

#[allow(dead_code)] // `identify` uses all of it
#[path = "../../../../identify/src/log/columns/mod.rs"]
mod columns;
mod log_file;
mod master;
mod messages;

use clap::Parser;
use columns::ColumnMap;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  replay NursingRobot.fmu ride.csv --out result.csv
  replay NursingRobot.fmu trip.csv --columns car.toml --set robot.mass=1195 --set mass.law=fixed
  identify convert nursing-robot ride.mf4 --out ride.csv && replay NursingRobot.fmu ride.csv

The log is CSV: a column time in s, the others named as the FMU's inputs; empty or nan is a missing
sample. Every row's inputs hold from its time to that of the next. The result has the outputs at the
start and at the end of every row. If the rows of the log are further apart than the FMU's
sample_period, it is set to their distance, so that no row counts twice; --set overrides this.

Exit codes: 0 done, 2 refused.";

/// Run an FMU over a log and write its outputs as CSV.
#[derive(Parser)]
#[command(name = "replay", version, after_help = EXAMPLES)]
struct Arguments {
    /// The FMU
    #[arg(value_name = "MODEL.FMU")]
    model: PathBuf,
    /// The log, CSV
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// Column map for logs with other names and units
    #[arg(long, value_name = "MAP.TOML")]
    columns: Option<PathBuf>,
    /// A parameter, or an input that the log does not have (repeatable)
    #[arg(long = "set", value_name = "NAME=VALUE")]
    settings: Vec<String>,
    /// Where the result goes [default: standard output]
    #[arg(long, value_name = "RESULT.CSV")]
    out: Option<PathBuf>,
}

fn main() -> ExitCode {
    messages::collect();
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("replay: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let map = arguments.columns.as_deref().map(ColumnMap::read).transpose().map_err(|error| error.to_string())?;
    let log = log_file::read(&arguments.log, map.as_ref())?;
    let result = master::run(&arguments.model, &log, &arguments.settings)?;
    match &arguments.out {
        Some(path) => log_file::write_whole(path, &result),
        None => log_file::write(std::io::stdout().lock(), &result).map_err(|error| error.to_string()),
    }
}
