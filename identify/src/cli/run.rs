//! `identify run`.

use super::settings::{self, Setting};
use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_each, tell};
use crate::output::Outputs;
use crate::progress::Progress;
use crate::report;
use crate::run::{Assessment, Run, Sampling, Settings, assess};
use crate::vehicle::Vehicle;
use clap::{Args, ValueEnum};
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
#[command(after_help = "\
The result has the times of the log and, for each of them, every output of the FMU: estimates with
standard deviations (*_std), nis, status and healthy; then for each measured channel of the filter
measured_*, innovation_* and innovation_*_std.

With --clock fmu, the default, it is to 1e-12 what the FMU gives in fmpy with the same log and
parameters: every sample_period the inputs are those of the last row, and at the time of a row stand
the estimates from the samples before it. --clock log takes every row for one sample at its own time
and gives the estimates after it: right for logs with gaps and uneven times.

--smooth adds *_smoothed and *_smoothed_std, the best estimates once the ride is over, from samples
before and after (fixed-interval smoother); it implies --clock log. Where the filter begins anew or
is contradicted nothing is carried back.

Examples:
  identify run wheelchair ride.csv --params fit.json --out estimates.csv
  identify run wheel-loader shift.mf4 --params tune.json --set loader.mass=5400 --report run.html
  identify run nursing-robot trip*.csv --columns car.toml --out 'estimates/{stem}.parquet'")]
pub(super) struct RunArgs {
    /// The machine.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    #[command(flatten)]
    logs: LogArgs,
    /// Parameters as pack takes them: a fit.json, a tune.json or a parameter set (.ssv); or {"name": value, ...}.
    #[arg(long, value_name = "FIT.json|SET.ssv")]
    params: Option<PathBuf>,
    /// A parameter by its FMU name; may be repeated and overrides --params.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = settings::parse)]
    settings: Vec<Setting>,
    /// When the estimator samples the log.
    #[arg(long, value_enum, default_value_t = Sampling::AsFmu)]
    clock: Sampling,
    /// Add smoothed estimates.
    #[arg(long)]
    smooth: bool,
    /// Write the estimates: .csv, .parquet or .mf4; {stem} stands for the log's name.
    #[arg(long, value_name = "ESTIMATES")]
    out: Option<String>,
    /// Write a report: verdicts and plots, one HTML file; {stem} stands for the log's name.
    #[arg(long, value_name = "RUN.html")]
    report: Option<String>,
    /// Print the verdicts as JSON.
    #[arg(long)]
    json: bool,
}

impl ValueEnum for Sampling {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::AsFmu, Self::EveryRow]
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        use clap::builder::PossibleValue;
        Some(match self {
            Self::AsFmu => PossibleValue::new("fmu").help("Every sample_period, as the FMU in a host"),
            Self::EveryRow => PossibleValue::new("log").help("Every row is a sample at its own time"),
        })
    }
}

/// The shape of `--json`, one per log.
#[derive(Serialize)]
struct Verdicts<'a> {
    log: &'a str,
    model: &'a str,
    sample_period: f64,
    rows: usize,
    #[serde(flatten)]
    assessment: &'a Assessment,
}

pub(super) fn run(args: &RunArgs) -> Result<Outcome, Refusal> {
    let places = Places::new(args)?;
    let given = args.params.as_deref().map(|path| args.vehicle.read_parameters(path)).transpose()?.unwrap_or_default();
    for note in &given.notes {
        eprintln!("{}: note: {note}", super::program());
    }
    let set = settings::numbers(args.vehicle, &args.settings)?;
    let parameters = given.values.into_iter().chain(set).collect();
    let settings = Settings { parameters, sampling: args.clock, smooth: args.smooth };
    let progress = Progress::terminal();
    let mut outputs = Outputs::new();
    let (mut worst, mut objects) = (Outcome::Done, Vec::new());
    read_each(args.vehicle, &args.logs, &args.vehicle.reads(), &progress, |path, log| {
        let log = log?;
        tell(std::slice::from_ref(&log));
        let run = args.vehicle.run(&log, &settings, &progress)?;
        let assessment = assess(&run, &log);
        if !assessment.warnings.is_empty() {
            worst = Outcome::Warnings;
        }
        let verdicts = Verdicts {
            log: &run.source,
            model: run.model,
            sample_period: run.sample_period,
            rows: run.time.len(),
            assessment: &assessment,
        };
        if args.json {
            objects.push(serde_json::to_value(&verdicts)?);
        } else {
            print(&table(&run, &assessment));
        }
        if let Some(place) = places.of(args.report.as_deref(), path) {
            outputs.text(&place, &report::run(&run, &log, &assessment)?)?;
        }
        if let Some(out) = places.of(args.out.as_deref(), path) {
            outputs.file(&out, |file| run.into_log().write(&out, file))?;
        }
        Ok(())
    })?;
    progress.finish();
    outputs.commit()?;
    if args.json {
        print(&(serde_json::to_string_pretty(&objects)? + "\n"));
    }
    Ok(worst)
}

/// Where results go, one per log.
struct Places;

impl Places {
    /// Refuses what would be written twice, over a log, or nowhere, before anything is run.
    fn new(args: &RunArgs) -> Result<Self, Refusal> {
        let mut all: Vec<PathBuf> = Vec::new();
        for pattern in [args.out.as_deref(), args.report.as_deref()].into_iter().flatten() {
            if args.logs.logs.len() > 1 && !pattern.contains(STEM) {
                return Err(Refusal(format!("{pattern}: there are several logs; {STEM} stands for the name of each")));
            }
            for log in &args.logs.logs {
                let place = Self.of(Some(pattern), log).unwrap_or_default();
                if all.contains(&place) {
                    return Err(Refusal(format!("{}: two results have this name", place.display())));
                }
                keep_inputs(Some(&place), &args.logs.logs)?;
                Outputs::check(&place)?;
                all.push(place);
            }
        }
        Ok(Self)
    }

    fn of(&self, pattern: Option<&str>, log: &Path) -> Option<PathBuf> {
        let name = log.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let stem = name.split_once('.').map_or(name.as_str(), |(stem, _)| stem);
        pattern.map(|pattern| PathBuf::from(pattern.replace(STEM, stem)))
    }
}

/// What stands for the name of a log without its endings.
const STEM: &str = "{stem}";

/// The verdicts for the terminal.
fn table(run: &Run, all: &Assessment) -> String {
    let percent = |share: f64| if share.is_finite() { format!("{:.1} %", 100.0 * share) } else { "-".to_owned() };
    let mut text = format!(
        "{}: {}, {} rows, healthy {}, NIS {} per channel, within its 95 % bounds {}\n",
        run.source,
        run.model,
        run.time.len(),
        percent(all.healthy),
        if all.nis.is_finite() { format!("{:.2}", all.nis) } else { "-".to_owned() },
        percent(all.nis_within)
    );
    for warning in &all.warnings {
        text += &format!("warning: {warning}\n");
    }
    for note in &all.notes {
        text += &format!("note: {note}\n");
    }
    text
}
