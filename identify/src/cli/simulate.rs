//! `identify simulate`.

use super::settings::{self, Setting};
use super::words::vehicle_parser;
use super::{Outcome, Refusal, print};
use crate::output::Outputs;
use crate::simulate::Request;
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Settings are parameters of the machine by their FMU names, or plant.* and noise.* of the simulation.

Examples:
  identify simulate nursing-robot --list
  identify simulate nursing-robot --scenario identification --seed 7 --out log.csv
  identify simulate wheelchair --scenario climb --set chair.mass=120 --out climb.parquet")]
pub(super) struct SimulateArgs {
    /// The machine.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    /// What happens; --list shows what there is.
    #[arg(long, required_unless_present = "list")]
    scenario: Option<String>,
    /// List the scenarios of the vehicle and stop.
    #[arg(long)]
    list: bool,
    /// Seed of every random draw; the same seed makes the same log.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// A parameter or a setting of the simulation; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = settings::parse)]
    settings: Vec<Setting>,
    /// The log to write: .csv, .parquet or .mf4.
    #[arg(long, value_name = "LOG", required_unless_present = "list")]
    out: Option<PathBuf>,
}

pub(super) fn run(args: &SimulateArgs) -> Result<Outcome, Refusal> {
    let known = args.vehicle.simulation.scenarios;
    let (Some(scenario), Some(out)) = (&args.scenario, &args.out) else {
        let width = known.iter().map(|scenario| scenario.name.len()).max().unwrap_or(0);
        let lines = known.iter().map(|scenario| format!("{:width$}  {}\n", scenario.name, scenario.about));
        print(&lines.collect::<String>());
        return Ok(Outcome::Done);
    };
    Outputs::check(out)?;
    let settings = settings::numbers(args.vehicle, &args.settings)?;
    let request = Request { scenario: scenario.clone(), seed: args.seed, settings };
    let log = args.vehicle.simulate(&request)?;
    let mut outputs = Outputs::new();
    outputs.file(out, |file| log.write(out, file))?;
    for (ending, text) in args.vehicle.companions(&request)? {
        outputs.text(&out.with_extension(ending), &text)?;
    }
    outputs.commit()?;
    let (samples, channels) = (log.len(), log.channels.len());
    print(&format!("{}: {samples} samples, {:.2} s, {channels} channels\n", out.display(), log.duration()));
    Ok(Outcome::Done)
}
