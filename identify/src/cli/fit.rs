//! `identify fit`.

use super::check;
use super::settings::{self, Pair, Setting};
use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_each, tell};
use crate::checked::{self, Refused};
use crate::finding::Finding;
use crate::log::{LONG, Log, LogError, Store};
use crate::output::Outputs;
use crate::problem::FitRequest;
use crate::progress::Progress;
use crate::report;
use crate::result::FitReport;
use crate::solve::Loss;
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify fit nursing-robot log.csv --out fit.json
  identify fit nursing-robot log.csv --set human.nominal_mass=72 --refine --report fit.html
  identify fit nursing-robot trip*.csv --columns map.toml --only robot.mass,rolling.coefficient
  identify fit nursing-robot trip*.csv --columns map.toml --only robot.mass,rolling.coefficient,aero.drag_area \
      --per-log robot.mass --varies rolling.coefficient=ambient_C
  identify fit nursing-robot a.csv b.csv --set a.csv:human.nominal_mass=50 --set b.csv:human.nominal_mass=95
  identify fit wheelchair run1.csv run2.parquet --sensor drive_force.gain_std=0.005 --held-out run3.csv

A log without excitation ends with exit code 1 and the parameters marked; pack does not use those.")]
pub(super) struct FitArgs {
    /// The machine.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    #[command(flatten)]
    logs: LogArgs,
    /// Start values: a fit.json or {"name": value, ...}.
    #[arg(long, value_name = "START.json")]
    params: Option<PathBuf>,
    /// A known parameter by its FMU name; it holds and is not fitted. FILE:NAME=VALUE is known of one log. May be repeated.
    #[arg(long = "set", value_name = "[FILE:]NAME=VALUE", value_parser = settings::parse)]
    settings: Vec<Setting>,
    /// A value with its standard deviation: a prior of a fitted parameter, or a known value that may be so far off.
    #[arg(long = "prior", visible_alias = "known", value_name = "NAME=VALUE+-STD", value_parser = settings::parse_prior)]
    priors: Vec<Pair>,
    /// A range that a fitted parameter must stay in.
    #[arg(long = "bound", value_name = "NAME=LOW..HIGH", value_parser = settings::parse_bound, allow_hyphen_values = true)]
    bounds: Vec<Pair>,
    /// Standard deviation of a sensor's gain (relative), bias (in the channel's unit) or delay (s), in place of that of a
    /// good industrial one: CHANNEL.gain_std, CHANNEL.bias_std, CHANNEL.delay_std.
    #[arg(long = "sensor", value_name = "CHANNEL.gain_std=X", value_parser = settings::parse)]
    sensors: Vec<Setting>,
    /// Take sensors and known values as exact but for noise, and for what --sensor and --known say.
    #[arg(long)]
    exact: bool,
    /// Parameters that each log has a value of its own of.
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    per_log: Vec<String>,
    /// A parameter that differs from log to log, or with the mean of a channel over each log: its mean, its change with the
    /// channel and the scatter of the logs are fitted. May be repeated.
    #[arg(long = "varies", value_name = "NAME[=CHANNEL]")]
    varies: Vec<String>,
    /// Hold this parameter at values ever farther from its estimate and fit the others anew: its interval without the
    /// assumption that it is symmetric, the curve in the result and the report. May be repeated.
    #[arg(long, value_name = "NAME")]
    profile: Vec<String>,
    /// Fit only these parameters.
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    only: Vec<String>,
    /// Leave out logs that cannot be read or contradict the others, and name them.
    #[arg(long)]
    skip_bad: bool,
    /// A log that is not fitted and only judges the result; may be repeated.
    #[arg(long, value_name = "LOG")]
    held_out: Vec<PathBuf>,
    /// Use samples from this time on, s.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    from: Option<f64>,
    /// Use samples up to this time, s.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    to: Option<f64>,
    /// Take the samples of this time as missing, s; may be repeated.
    #[arg(long, value_name = "A..B", value_parser = settings::parse_span, allow_hyphen_values = true)]
    exclude: Vec<(f64, f64)>,
    /// Loss of the regression.
    #[arg(long, value_enum, default_value_t = Loss::Huber)]
    loss: Loss,
    /// Refine the regression by simulating the logs (output error).
    #[arg(long)]
    refine: bool,
    /// Subtract the bias that is estimated in any case and otherwise only widens the intervals: by sensor
    /// noise in the regressors and by what the regression neglects.
    #[arg(long)]
    correct: bool,
    /// Print a table with a line for each log: how well it is predicted, and the values that are its own.
    #[arg(long)]
    each_log: bool,
    #[command(flatten)]
    allowed: check::Allowed,
    /// Write the result; of a fit that is refused, what was read and what is wrong.
    #[arg(long, value_name = "FIT.json")]
    out: Option<PathBuf>,
    /// Write the identified values as an SSP parameter set.
    #[arg(long, value_name = "FIT.ssv")]
    ssv: Option<PathBuf>,
    /// Write a page with plots: one file, no network.
    #[arg(long, value_name = "FIT.html")]
    report: Option<PathBuf>,
    /// Write measured and predicted signals of the fitted logs.
    #[arg(long, value_name = "R.csv")]
    residuals: Option<PathBuf>,
}

pub(super) fn run(args: &FitArgs) -> Result<Outcome, Refusal> {
    let inputs: Vec<PathBuf> = args.logs.logs.iter().chain(&args.held_out).cloned().collect();
    for output in [&args.out, &args.ssv, &args.report, &args.residuals].into_iter().flatten() {
        keep_inputs(Some(output), &inputs)?;
        Outputs::check(output)?;
    }
    if let Some(out) = args.out.as_ref().filter(|out| out.extension().is_none_or(|ending| ending != "json")) {
        let name = out.display();
        return Err(Refusal(format!("--out {name}: the result is JSON; name it .json (--residuals writes CSV)")));
    }
    if !args.only.is_empty() && args.only.iter().all(|name| name.trim().is_empty()) {
        return Err(Refusal("--only: names no parameter".to_owned()));
    }
    let progress = Progress::terminal();
    let mut skipped = Vec::new();
    let (paths, logs) = read(args, &args.logs.logs, args.skip_bad, &mut skipped, &progress)?;
    let (_, held_out) = read(args, &args.held_out, false, &mut skipped, &progress)?;
    let request = request(args, &paths, held_out)?;
    let warn = |finding: &Finding| eprintln!("{}: warning: {finding}", super::program());
    let result = checked::fit(args.vehicle, logs, request, &args.allowed.codes, warn, &progress);
    progress.finish();
    let mut result = match result {
        Ok(result) => result,
        Err(Refused::Logs(report)) => return Err(refused(args.out.as_deref(), &report)),
        Err(error) => return Err(error.into()),
    };
    result.warnings.splice(0..0, skipped);
    if let Some(path) = &args.residuals {
        let mut outputs = Outputs::new();
        outputs.text(path, &report::residuals(&result))?;
        outputs.commit()?;
    }
    let outcome = deliver(&result, args.out.as_deref(), args.ssv.as_deref(), args.report.as_deref())?;
    if args.each_log {
        print(&report::each_log(&result));
    }
    Ok(outcome)
}

/// What is asked for, for logs of these paths.
fn request(args: &FitArgs, paths: &[PathBuf], held_out: Vec<Log>) -> Result<FitRequest, Refusal> {
    let trimmed = |names: &[String]| -> Vec<String> {
        names.iter().map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
    };
    let pairs = |pairs: &[Pair]| -> Vec<(String, f64, f64)> {
        pairs.iter().map(|pair| (pair.name.clone(), pair.numbers.0, pair.numbers.1)).collect()
    };
    let (general, own) = settings::by_log(&args.settings, paths)?;
    let mut of_log = Vec::new();
    for (index, setting) in own {
        let numbers = settings::numbers(args.vehicle, &[setting])?;
        of_log.extend(numbers.into_iter().map(|(name, value)| (index, name, value)));
    }
    Ok(FitRequest {
        start: args.params.as_deref().map_or(Ok(Vec::new()), |path| settings::start_values(args.vehicle, path))?,
        settings: settings::numbers(args.vehicle, &general)?,
        known: pairs(&args.priors),
        bounds: pairs(&args.bounds),
        per_log: trimmed(&args.per_log),
        varies: args.varies.iter().map(|text| settings::parse_law(text)).collect(),
        of_log,
        sensors: settings::numbers(args.vehicle, &args.sensors)?,
        exact: args.exact,
        skip_bad: args.skip_bad,
        held_out,
        residuals: args.residuals.is_some(),
        profile: trimmed(&args.profile),
        only: trimmed(&args.only),
        loss: args.loss,
        refine: args.refine,
        correct: args.correct,
    })
}

/// Reads logs and keeps the times that were asked for; with `skip` those that cannot be read are named instead.
fn read(
    args: &FitArgs,
    paths: &[PathBuf],
    skip: bool,
    skipped: &mut Vec<String>,
    progress: &Progress,
) -> Result<(Vec<PathBuf>, Vec<Log>), Refusal> {
    let (mut kept, mut logs) = (Vec::new(), Vec::new());
    if paths.is_empty() {
        return Ok((kept, logs));
    }
    let these = LogArgs { logs: paths.to_vec(), columns: args.logs.columns.clone() };
    let reads = args.vehicle.reads();
    let laws: Vec<_> = args.varies.iter().filter_map(|text| settings::parse_law(text).1).collect();
    let keep = |name: &str| reads(name) || laws.iter().any(|channel| channel == name);
    let span = (args.from.unwrap_or(f64::NEG_INFINITY), args.to.unwrap_or(f64::INFINITY));
    let mut shelf = Shelf::default();
    let all_read = read_each(args.vehicle, &these, &keep, progress, |path, log| {
        match log {
            Ok(mut log) => {
                checked::within(&mut log, span, &args.exclude).map_err(Refusal)?;
                logs.push(log);
                shelf.keep_few(&mut logs)?;
                kept.push(path.to_path_buf());
            }
            Err(error) if skip => skipped.push(format!("{} was left out: {error}", path.display())),
            Err(error) => return Err(error.into()),
        }
        Ok(())
    });
    tell(&logs);
    all_read?;
    if logs.is_empty() {
        return Err(Refusal(skipped.join("; ")));
    }
    Ok((kept, logs))
}

/// The file that many logs are put away in: a fit looks at one after the other.
#[derive(Default)]
struct Shelf {
    store: Option<Store>,
    samples: usize,
    /// Logs that are put away.
    away: usize,
}

impl Shelf {
    /// Puts logs away once they are as many samples as a long one. Without a file they stay in memory.
    fn keep_few(&mut self, logs: &mut [Log]) -> Result<(), LogError> {
        self.samples += logs.last().map_or(0, Log::len);
        if self.samples < LONG {
            return Ok(());
        }
        if self.store.is_none() {
            self.store = Store::new().ok();
        }
        let Some(store) = &self.store else { return Ok(()) };
        logs[self.away..].iter_mut().try_for_each(|log| log.put_away(store))?;
        self.away = logs.len();
        Ok(())
    }
}

/// The refusal of a fit whose logs were read; what was read and what is wrong is written all the same.
fn refused(out: Option<&Path>, report: &FitReport) -> Refusal {
    let refusal = Refusal(report.refused.clone().unwrap_or_default());
    let Some(path) = out else { return refusal };
    let write = || -> Result<(), Refusal> {
        let mut outputs = Outputs::new();
        outputs.text(path, &report.to_json()?)?;
        Ok(outputs.commit()?)
    };
    match write() {
        Ok(()) => refusal,
        Err(Refusal(more)) => Refusal(format!("{}; {more}", refusal.0)),
    }
}

/// Writes the result's files and prints its table.
pub(super) fn deliver(
    result: &FitReport,
    json: Option<&Path>,
    ssv: Option<&Path>,
    html: Option<&Path>,
) -> Result<Outcome, Refusal> {
    let mut outputs = Outputs::new();
    if let Some(path) = json {
        outputs.text(path, &result.to_json()?)?;
    }
    if let Some(path) = ssv {
        outputs.text(path, &report::ssv(result))?;
    }
    if let Some(path) = html {
        outputs.text(path, &report::html(result)?)?;
    }
    outputs.commit()?;
    print(&report::table(result));
    Ok(if result.has_warnings() { Outcome::Warnings } else { Outcome::Done })
}
