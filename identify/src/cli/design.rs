//! `identify design`.

use super::check;
use super::settings::{self, Pair, Setting};
use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_logs};
use crate::design::{self, DesignRequest, table};
use crate::finding::Finding;
use crate::output::Outputs;
use crate::progress::Progress;
use crate::values;
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify design wheelchair ride.csv --for chair.yaw_inertia
  identify design wheeled-robot fit.json a.csv b.csv --limit plant.lateral=1..3 --out plan.csv
  identify design wheel-loader --set loader.mass=5400 --for initial.cg_ratio --json

Machines that the fit of the present logs allows are drawn. Each drives each manoeuvre on the built-in plant; the present
logs and the new one are fitted together, and the standard error of that fit is promised: its median, and the range that
90 % of drives lie in. '?' marks what most of these fits do not identify: the range
then has no lower end. The best manoeuvre comes first, with what driving
it twice and four times would give. Parameters that nothing is known of are supposed between half and twice
their value (of fit.json, --set or the declaration); --prior says better. Without logs the promise is that of the new log
alone. Without --limit the settings of a manoeuvre are those of `identify simulate`; --list shows what can be searched.
Sensors are those of the simulation: --set noise.accel=0.2 says that yours are noisier. --set, --prior, --sensor and --exact
are to be given as to the fit.

Exit code 0: a manoeuvre helps; 1: none makes a standard error 5 % smaller; 2: refused.")]
pub(super) struct DesignArgs {
    /// The machine.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    /// The present logs; before them, if there is one, a fit.json or {"name": value, ...} with what is known.
    #[arg(value_name = "[FIT.json] LOG")]
    files: Vec<PathBuf>,
    /// Column map of the logs, as of `identify fit`.
    #[arg(long, value_name = "[PATTERN=]MAP.toml")]
    columns: Vec<String>,
    /// A parameter of interest; may be repeated. Without it those that the fit does not identify, or else the one with
    /// the widest interval relative to its value.
    #[arg(long = "for", value_name = "NAME")]
    parameters: Vec<String>,
    /// A setting of the manoeuvre that is searched within these limits; may be repeated, up to three.
    #[arg(long = "limit", value_name = "NAME=LOW..HIGH", value_parser = settings::parse_bound, allow_hyphen_values = true)]
    limits: Vec<Pair>,
    /// Only this manoeuvre; may be repeated.
    #[arg(long = "scenario", value_name = "NAME")]
    scenarios: Vec<String>,
    /// List manoeuvres and their settings, and stop.
    #[arg(long)]
    list: bool,
    /// A known parameter by its FMU name, or a setting of the simulation; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = settings::parse)]
    settings: Vec<Setting>,
    /// A value with its standard deviation, as of `identify fit`; may be repeated.
    #[arg(long = "prior", visible_alias = "known", value_name = "NAME=VALUE+-STD", value_parser = settings::parse_prior)]
    priors: Vec<Pair>,
    /// Standard deviation of a sensor's gain, bias or delay, as of `identify fit`; may be repeated.
    #[arg(long = "sensor", value_name = "CHANNEL.gain_std=X", value_parser = settings::parse)]
    sensors: Vec<Setting>,
    /// Sensors and known values are exact but for noise, as of `identify fit`.
    #[arg(long)]
    exact: bool,
    #[command(flatten)]
    allowed: check::Allowed,
    /// How many machines are drawn for a promise; its range holds with the probability (N - 1) / (N + 1).
    #[arg(long, value_name = "N", default_value_t = DesignRequest::default().draws)]
    draws: usize,
    /// Seed of every random draw.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print the comparison as JSON.
    #[arg(long)]
    json: bool,
    /// Write the commanded inputs of the best manoeuvre as a log: .csv, .parquet or .mf4.
    #[arg(long, value_name = "PLAN")]
    out: Option<PathBuf>,
}

pub(super) fn run(args: &DesignArgs) -> Result<Outcome, Refusal> {
    if args.list {
        print(&list(args.vehicle));
        return Ok(Outcome::Done);
    }
    if let Some(out) = &args.out {
        keep_inputs(Some(out), &args.files)?;
        Outputs::check(out)?;
    }
    let is_json = |path: &PathBuf| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"));
    let (known, logs): (Vec<PathBuf>, Vec<PathBuf>) = args.files.iter().cloned().partition(is_json);
    let (fit, start) = match known.as_slice() {
        [] => (None, Vec::new()),
        [path] => {
            let source = path.display().to_string();
            let text = std::fs::read_to_string(path).map_err(|e| Refusal(format!("{source}: {e}")))?;
            values::known(args.vehicle, &source, &text).map_err(Refusal)?
        }
        [_, second, ..] => return Err(Refusal(format!("{}: one .json file says what is known", second.display()))),
    };
    let pairs = |pairs: &[Pair]| -> Vec<(String, f64, f64)> {
        pairs.iter().map(|pair| (pair.name.clone(), pair.numbers.0, pair.numbers.1)).collect()
    };
    let request = DesignRequest {
        fit,
        start,
        settings: settings::numbers(args.vehicle, &args.settings)?,
        known: pairs(&args.priors),
        parameters: args.parameters.iter().map(|name| name.trim().to_owned()).collect(),
        limits: pairs(&args.limits),
        scenarios: args.scenarios.clone(),
        sensors: settings::numbers(args.vehicle, &args.sensors)?,
        exact: args.exact,
        allow: args.allowed.codes.clone(),
        draws: args.draws,
        seed: args.seed,
    };
    let progress = Progress::terminal();
    let reads = args.vehicle.reads();
    let logs = read_logs(args.vehicle, &LogArgs { logs, columns: args.columns.clone() }, &reads, &progress)?;
    let warn = |finding: &Finding| eprintln!("{}: warning: {finding}", super::program());
    let plan = design::design(args.vehicle, logs, &request, warn, &progress);
    progress.finish();
    let plan = plan?;
    if let (Some(out), Some(log)) = (&args.out, &plan.inputs) {
        let mut outputs = Outputs::new();
        outputs.file(out, |file| log.write(out, file))?;
        outputs.commit()?;
    }
    print(&if args.json { serde_json::to_string_pretty(&plan)? + "\n" } else { table(&plan) });
    Ok(if plan.helps { Outcome::Done } else { Outcome::Warnings })
}

/// The manoeuvres and what can be searched.
fn list(vehicle: &Vehicle) -> String {
    let simulation = &vehicle.simulation;
    let manoeuvres = &simulation.manoeuvres;
    let chosen = simulation.scenarios.iter().filter(|scenario| manoeuvres.scenarios.contains(&scenario.name));
    let mut lines: Vec<(String, String)> =
        chosen.map(|scenario| (scenario.name.to_owned(), scenario.about.to_owned())).collect();
    let declared = (manoeuvres.settings)();
    for knob in manoeuvres.knobs {
        let Some(variable) = declared.iter().find(|variable| variable.name == knob.name) else { continue };
        let unit = if variable.unit == "1" { String::new() } else { format!(" {}", variable.unit) };
        let (low, high) = variable.range;
        let of = if knob.scenarios.is_empty() { String::new() } else { format!("; of {}", knob.scenarios.join(", ")) };
        let about = variable.description.trim_end_matches('.');
        lines.push((format!("--limit {}=LOW..HIGH", knob.name), format!("{about}, within {low}..{high}{unit}{of}")));
    }
    let width = lines.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    lines.iter().map(|(name, about)| format!("{name:width$}  {about}\n")).collect()
}
