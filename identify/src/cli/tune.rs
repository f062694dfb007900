//! `identify tune`.

use super::settings::{self, Setting};
use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_logs};
use crate::output::Outputs;
use crate::progress::Progress;
use crate::report;
use crate::tune::{Objective, TuneRequest};
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify tune wheeled-robot log.csv --out tune.json
  identify tune wheeled-robot sine.csv steps.csv --held-out lane.csv --seed 3 --pop 30 --iters 60 --out tune.json
  identify tune wheeled-robot log.csv --floors off --only filter.process_psd.speed_y")]
pub(super) struct TuneArgs {
    /// The machine.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
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
    /// Known parameters: a fit.json or {"name": value, ...}.
    #[arg(long, value_name = "START.json")]
    params: Option<PathBuf>,
    /// Number of beetles.
    #[arg(long, value_name = "N", default_value_t = 30)]
    pop: usize,
    /// Number of generations.
    #[arg(long, value_name = "N", default_value_t = 60)]
    iters: usize,
    /// Physical floors: no measurement better than 0.7 of its start value, no model better than its known
    /// errors; on by default for nll, off for rmse.
    #[arg(long, value_name = "on|off", value_parser = switch)]
    floors: Option<bool>,
    /// A floor of one noise setting; may be repeated.
    #[arg(long, value_name = "NAME=VALUE", value_parser = settings::parse)]
    floor: Vec<Setting>,
    /// Tune only these noise settings.
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    only: Vec<String>,
    /// A log that only judges the result; may be repeated.
    #[arg(long, value_name = "LOG")]
    held_out: Vec<PathBuf>,
    /// Seconds at the start of each log that do not count.
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    skip: f64,
    /// Threads; 0 takes as many as there are processors. The result does not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Write the result, in the shape of fit.json.
    #[arg(long, value_name = "TUNE.json")]
    out: Option<PathBuf>,
}

pub(super) fn run(args: &TuneArgs) -> Result<Outcome, Refusal> {
    if let Some(out) = &args.out {
        keep_inputs(Some(out), &args.logs.logs)?;
        Outputs::check(out)?;
    }
    let known = args.params.as_deref().map_or(Ok(Vec::new()), |path| settings::start_values(args.vehicle, path))?;
    let progress = Progress::terminal();
    let logs = read_logs(args.vehicle, &args.logs, &args.vehicle.reads(), &progress)?;
    let held_out = LogArgs { logs: args.held_out.clone(), columns: args.logs.columns.clone() };
    let held_out = read_logs(args.vehicle, &held_out, &args.vehicle.reads(), &progress)?;
    let request = TuneRequest {
        objective: args.objective,
        seed: args.seed,
        population: args.pop,
        iterations: args.iters,
        threads: args.threads,
        settings: known.into_iter().chain(settings::numbers(args.vehicle, &args.settings)?).collect(),
        only: args.only.iter().map(|name| name.trim().to_owned()).collect(),
        floors: args.floors,
        floor: settings::numbers(args.vehicle, &args.floor)?,
        skip: args.skip,
    };
    let result = args.vehicle.tune(&logs, &held_out, &request, &progress);
    progress.finish();
    let result = result?;
    let mut outputs = Outputs::new();
    if let Some(path) = &args.out {
        outputs.text(path, &result.to_json()?)?;
    }
    outputs.commit()?;
    print(&report::table(&result.fit));
    Ok(if result.fit.has_warnings() { Outcome::Warnings } else { Outcome::Done })
}

fn switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("on or off is expected".to_owned()),
    }
}
