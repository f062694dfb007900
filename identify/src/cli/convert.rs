//! `identify convert`.

use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_logs};
use crate::output::Outputs;
use crate::progress::Progress;
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
The result has a column `time` and the columns of the FMU's inputs, in SI units; columns that the map
does not use follow under their own names. A missing sample is `nan`.

Examples:
  identify convert nursing-robot trip.csv --columns bmw_i3.toml --out ride.csv
  identify convert wheelchair run.mf4 --out run.csv")]
pub(super) struct ConvertArgs {
    /// The machine whose inputs the columns are checked against.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    #[command(flatten)]
    logs: LogArgs,
    /// The log to write: .csv, .parquet or .mf4.
    #[arg(long, value_name = "LOG")]
    out: PathBuf,
}

pub(super) fn run(args: &ConvertArgs) -> Result<Outcome, Refusal> {
    keep_inputs(Some(&args.out), &args.logs.logs)?;
    Outputs::check(&args.out)?;
    let logs = read_logs(args.vehicle, &args.logs, &Progress::terminal())?;
    let [log] = logs.as_slice() else {
        return Err(Refusal(format!("convert takes one log at a time, not {}", logs.len())));
    };
    let mut outputs = Outputs::new();
    outputs.file(&args.out, |file| log.write(&args.out, file))?;
    outputs.commit()?;
    print(&format!("{}: {} samples, {} channels\n", args.out.display(), log.len(), log.channels.len()));
    Ok(Outcome::Done)
}
