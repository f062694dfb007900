//! `identify tune`.

use super::settings::{self, Setting};
use super::{LogArgs, Outcome, Refusal, keep_inputs, read_logs};
use crate::output::Outputs;
use crate::progress::Progress;
use crate::vehicle::Vehicle;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// What a noise setting is judged by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Objective {
    /// Negative log-likelihood of the innovations.
    #[default]
    Nll,
    /// Root mean square of the innovations; degenerate: it cannot tell process noise from
    /// measurement noise, and the result carries a warning.
    Rmse,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify tune wheeled-robot log.csv --out tune.json
  identify tune wheeled-robot log.csv --objective nll --seed 3 --pop 30 --iters 60 --out tune.json")]
pub(super) struct TuneArgs {
    /// The machine.
    #[arg(value_enum)]
    vehicle: Vehicle,
    #[command(flatten)]
    logs: LogArgs,
    /// What a setting is judged by.
    #[arg(long, value_enum, default_value_t = Objective::Nll)]
    objective: Objective,
    /// Seed of the search; the same seed gives the same result.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// A known parameter by its FMU name; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = settings::parse)]
    settings: Vec<Setting>,
    /// Known parameters: a fit.json or {\"name\": value, ...}.
    #[arg(long, value_name = "START.json")]
    params: Option<PathBuf>,
    /// Number of beetles.
    #[arg(long, value_name = "N", default_value_t = 30)]
    pop: usize,
    /// Number of generations.
    #[arg(long, value_name = "N", default_value_t = 60)]
    iters: usize,
    /// Write the result, in the shape of fit.json.
    #[arg(long, value_name = "TUNE.json")]
    out: Option<PathBuf>,
}

pub(super) fn run(args: &TuneArgs) -> Result<Outcome, Refusal> {
    if let Some(out) = &args.out {
        keep_inputs(Some(out), &args.logs.logs)?;
        Outputs::check(out)?;
    }
    let start = args.params.as_deref().map_or(Ok(Vec::new()), |path| settings::start_values(args.vehicle, path))?;
    let settings = settings::numbers(args.vehicle, &args.settings)?;
    let logs = read_logs(args.vehicle, &args.logs, &Progress::terminal())?;
    let _ = (start, settings, logs, args.objective, args.seed, args.pop, args.iters);
    Err(Refusal::unavailable("tune", args.vehicle))
}
