//! `identify estimate` and `identify bench`: maximum a posteriori estimation over any body tree.

use super::words::vehicle_parser;
use super::{Outcome, Refusal, keep_inputs, print};
use crate::estimate;
use crate::log::Log;
use crate::output::Outputs;
use crate::progress::Progress;
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify estimate human-dynamics log.csv --model body.urdf --sensors sensors.toml --out result.csv")]
pub(super) struct EstimateArgs {
    /// The machine; human-dynamics.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
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
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    /// The body as URDF.
    #[arg(long, value_name = "F.urdf")]
    model: PathBuf,
    /// The sensors and their variances.
    #[arg(long, value_name = "S.toml")]
    sensors: PathBuf,
    /// Number of steps of each kind.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
}

pub(super) fn estimate(args: &EstimateArgs) -> Result<Outcome, Refusal> {
    known(args.vehicle, "estimate")?;
    Outputs::check(&args.out)?;
    let inputs = [args.log.clone(), args.model.clone(), args.sensors.clone()];
    keep_inputs(Some(&args.out), &inputs)?;
    let progress = Progress::terminal();
    let mut setup = estimate::setup(&args.model, &args.sensors)?;
    for warning in &setup.warnings {
        eprintln!("{}: warning: {warning}", super::program());
    }
    let log = Log::read(&args.log, None, &progress)?;
    super::tell(std::slice::from_ref(&log));
    let result = estimate::run(&mut setup, &log, &progress)?;
    let mut outputs = Outputs::new();
    outputs.file(&args.out, |file| result.write(&args.out, file))?;
    outputs.commit()?;
    let joints = setup.body.equations().tree().dof();
    print(&format!("{}: {} samples, {joints} joints\n", args.out.display(), result.len()));
    let mut outcome = Outcome::Done;
    for (line, warns) in estimate::gyroscope::report(&setup, &result) {
        print(&format!("{}{line}\n", if warns { "warning: " } else { "" }));
        outcome = if warns { Outcome::Warnings } else { outcome };
    }
    Ok(outcome)
}

pub(super) fn bench(args: &BenchArgs) -> Result<Outcome, Refusal> {
    known(args.vehicle, "bench")?;
    let mut setup = estimate::setup(&args.model, &args.sensors)?;
    let timing = estimate::bench::run(&mut setup, args.steps as usize)?;
    print(&(serde_json::to_string(&timing)? + "\n"));
    Ok(Outcome::Done)
}

fn known(vehicle: &Vehicle, command: &str) -> Result<(), Refusal> {
    if vehicle.body_tree { Ok(()) } else { Err(Refusal(format!("{command} is not available for {vehicle}"))) }
}
