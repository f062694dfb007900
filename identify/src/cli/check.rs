//! `identify check`, and the same checks before a fit.

use super::settings::{self, Setting};
use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, print, read_each, tell};
use crate::finding::{Finding, Severity};
use crate::log::Log;
use crate::problem::FitError;
use crate::progress::Progress;
use crate::vehicle::Vehicle;
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  identify check nursing-robot log.csv
  identify check wheel-loader run*.csv --columns loader.toml --set loader.mass=5400 --json

Looks at the sample period, gaps and scatter of the times; at channels that are missing, constant,
frozen, clipped, coarse or wrapped; and at channels that say the same in two ways (the slope of an
angle and its rate, wheel speed and speed, acceleration and speed), which shows wrong units, wrong
signs and delays where the log excites them. Of a log that is not refused it tells the standard error
that a fit would give each parameter, and the part of the log that tells most about it.

Exit code 0: nothing found; 1: warnings; 2: what spoils a fit for certain. identify/README.md has
the list of codes.")]
pub(super) struct CheckArgs {
    /// The machine.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    #[command(flatten)]
    logs: LogArgs,
    /// A known parameter by its FMU name; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = settings::parse)]
    settings: Vec<Setting>,
    /// Known parameters: a fit.json or {"name": value, ...}.
    #[arg(long, value_name = "START.json")]
    params: Option<PathBuf>,
    /// Say what to expect of a fit for logs of any length: standard errors, and the part of the log that tells most.
    #[arg(long)]
    parameters: bool,
    /// Print the findings as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    allowed: Allowed,
}

/// Findings that the user knows of.
#[derive(Debug, Args)]
pub(super) struct Allowed {
    /// Findings with this code are notes only, whatever they are otherwise; may be repeated.
    #[arg(long = "allow", value_name = "CODE")]
    codes: Vec<String>,
}

impl Allowed {
    /// What the user knows of is no more than a note.
    fn apply(&self, findings: &mut [Finding]) {
        for finding in findings.iter_mut().filter(|finding| self.codes.contains(&finding.code)) {
            finding.severity = Severity::Note;
        }
    }
}

/// The shape of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    vehicle: &'a str,
    findings: &'a [Finding],
}

/// All findings of the logs.
pub(super) fn findings(
    vehicle: &Vehicle,
    logs: &[Log],
    settings: &[(String, f64)],
    allowed: &Allowed,
) -> Result<Vec<Finding>, Refusal> {
    let mut all = Vec::new();
    for log in logs {
        all.extend(vehicle.check(log, settings)?);
    }
    allowed.apply(&mut all);
    Ok(all)
}

/// Says what was found before a fit, one line each; what spoils it for certain refuses it.
pub(super) fn tell_fit(findings: &[Finding]) -> Result<(), Refusal> {
    let refusals: Vec<_> = findings.iter().filter(|finding| finding.severity == Severity::Refusal).collect();
    if let Some(first) = refusals.first() {
        let more = match refusals.len() {
            1 => String::new(),
            count => format!(" (and {} more, which identify check lists)", count - 1),
        };
        return Err(Refusal(format!("{first}{more}; if you know better, --allow {}", first.code)));
    }
    for finding in findings.iter().filter(|finding| finding.severity == Severity::Warning) {
        eprintln!("identify: warning: {finding}");
    }
    Ok(())
}

/// What the log tells about each parameter; nothing if no fit can be made of it.
fn expected(
    vehicle: &Vehicle,
    log: &Log,
    known: &[(String, f64)],
    progress: &Progress,
) -> Result<Vec<Finding>, Refusal> {
    match vehicle.information(log, known, progress) {
        Err(FitError::Interrupted(stop)) => Err(stop.into()),
        told => Ok(told.unwrap_or_default()),
    }
}

/// The worst of the findings.
fn worst(findings: &[Finding]) -> Severity {
    findings.iter().map(|finding| finding.severity).max().unwrap_or(Severity::Note)
}

pub(super) fn run(args: &CheckArgs) -> Result<Outcome, Refusal> {
    let start = args.params.as_deref().map_or(Ok(Vec::new()), |path| settings::start_values(args.vehicle, path))?;
    let known: Vec<_> = start.into_iter().chain(settings::numbers(args.vehicle, &args.settings)?).collect();
    let progress = Progress::terminal();
    let mut all = Vec::new();
    read_each(args.vehicle, &args.logs, &progress, |path, log| {
        match log {
            Ok(log) => {
                tell(&log);
                let found = findings(args.vehicle, std::slice::from_ref(&log), &known, &args.allowed)?;
                let usable = worst(&found) < Severity::Refusal;
                all.extend(found);
                if usable && (args.parameters || log.len() <= args.vehicle.checks.quick) {
                    all.extend(expected(args.vehicle, &log, &known, &progress)?);
                }
            }
            Err(error) => all.push(Finding {
                file: path.display().to_string(),
                channel: String::new(),
                time: None,
                code: "unreadable-log".to_owned(),
                severity: Severity::Refusal,
                message: error.to_string().trim_start_matches(&format!("{}: ", path.display())).to_owned(),
                suggestion: "mend the file, or a column map if it has one".to_owned(),
            }),
        }
        Ok(())
    })?;
    args.allowed.apply(&mut all);
    progress.finish();
    if args.json {
        print(&(serde_json::to_string_pretty(&Report { vehicle: args.vehicle.name, findings: &all })? + "\n"));
    } else {
        let lines = all.iter().map(|finding| format!("{}: {finding}\n", finding.severity.word()));
        print(&lines.collect::<String>());
        let count = |severity| all.iter().filter(|finding| finding.severity == severity).count();
        let logs = args.logs.logs.len();
        print(&format!(
            "{logs} log{}: {} refusals, {} warnings, {} notes\n",
            if logs == 1 { "" } else { "s" },
            count(Severity::Refusal),
            count(Severity::Warning),
            count(Severity::Note)
        ));
    }
    Ok(match worst(&all) {
        Severity::Note => Outcome::Done,
        Severity::Warning => Outcome::Warnings,
        Severity::Refusal => Outcome::Refused,
    })
}
