//! `identify fit`.

use super::check;
use super::settings::{self, Setting};
use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_logs};
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
  identify fit wheelchair run1.csv run2.parquet --loss l1 --ssv fit.ssv

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
    /// A known parameter by its FMU name; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = settings::parse)]
    settings: Vec<Setting>,
    /// Fit only these parameters.
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    only: Vec<String>,
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
    #[command(flatten)]
    allowed: check::Allowed,
    /// Write the result.
    #[arg(long, value_name = "FIT.json")]
    out: Option<PathBuf>,
    /// Write the identified values as an SSP parameter set.
    #[arg(long, value_name = "FIT.ssv")]
    ssv: Option<PathBuf>,
    /// Write a page with plots: one file, no network.
    #[arg(long, value_name = "FIT.html")]
    report: Option<PathBuf>,
}

pub(super) fn run(args: &FitArgs) -> Result<Outcome, Refusal> {
    for output in [&args.out, &args.ssv, &args.report].into_iter().flatten() {
        keep_inputs(Some(output), &args.logs.logs)?;
        Outputs::check(output)?;
    }
    if !args.only.is_empty() && args.only.iter().all(|name| name.trim().is_empty()) {
        return Err(Refusal("--only: names no parameter".to_owned()));
    }
    let request = FitRequest {
        start: args.params.as_deref().map_or(Ok(Vec::new()), |path| settings::start_values(args.vehicle, path))?,
        settings: settings::numbers(args.vehicle, &args.settings)?,
        only: args.only.iter().map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect(),
        loss: args.loss,
        refine: args.refine,
        correct: args.correct,
    };
    let progress = Progress::terminal();
    let logs = read_logs(args.vehicle, &args.logs, &progress)?;
    let known: Vec<_> = request.start.iter().chain(&request.settings).cloned().collect();
    let findings = check::findings(args.vehicle, &logs, &known, &args.allowed)?;
    check::tell_fit(&findings)?;
    let result = args.vehicle.fit(&logs, &request, &progress);
    progress.finish();
    let mut result = result?;
    result.refer_to(&logs);
    result.findings = findings;
    deliver(&result, args.out.as_deref(), args.ssv.as_deref(), args.report.as_deref())
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
