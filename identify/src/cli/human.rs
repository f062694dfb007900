//! `identify estimate` and `identify bench`: maximum a posteriori estimation over any body tree.

use super::{Outcome, Refusal};
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify estimate human-dynamics log.csv --model body.urdf --sensors sensors.toml --out result.csv")]
pub(super) struct EstimateArgs {
    /// The machine; human-dynamics.
    #[arg(value_enum)]
    vehicle: Vehicle,
    /// The log: time, q_<joint>, qd_<joint> and the sensors' columns.
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// The body as URDF.
    #[arg(long, value_name = "F.urdf")]
    model: PathBuf,
    /// The sensors and their variances.
    #[arg(long, value_name = "S.toml")]
    sensors: PathBuf,
    /// The result: one row per row of the log.
    #[arg(long, value_name = "RESULT.csv")]
    out: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify bench human-dynamics --model body.urdf --sensors sensors.toml --steps 1000")]
pub(super) struct BenchArgs {
    /// The machine; human-dynamics.
    #[arg(value_enum)]
    vehicle: Vehicle,
    /// The body as URDF.
    #[arg(long, value_name = "F.urdf")]
    model: PathBuf,
    /// The sensors and their variances.
    #[arg(long, value_name = "S.toml")]
    sensors: PathBuf,
    /// Number of steps of each kind.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    steps: usize,
}

pub(super) fn estimate(args: &EstimateArgs) -> Result<Outcome, Refusal> {
    let _ = (&args.log, &args.model, &args.sensors, &args.out);
    Err(Refusal::unavailable("estimate", args.vehicle))
}

pub(super) fn bench(args: &BenchArgs) -> Result<Outcome, Refusal> {
    let _ = (&args.model, &args.sensors, args.steps);
    Err(Refusal::unavailable("bench", args.vehicle))
}
