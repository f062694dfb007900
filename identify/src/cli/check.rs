//! `identify check`, and the same checks before a fit.

use super::settings::{self, Setting};
use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, print, read_each, tell};
use crate::checked::{self, expected, findings, worst};
use crate::finding::{Finding, Severity};
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
signs and delays where the log excites them. For a log that is not refused it states the standard error
that a fit would give each parameter, and the part of the log that contributes most to it.

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
    /// Say what to expect of a fit for logs of any length: standard errors, and the part of the log that contributes most.
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
    pub(super) codes: Vec<String>,
}

/// The shape of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    vehicle: &'a str,
    findings: &'a [Finding],
}

pub(super) fn run(args: &CheckArgs) -> Result<Outcome, Refusal> {
    let start = args.params.as_deref().map_or(Ok(Vec::new()), |path| settings::start_values(args.vehicle, path))?;
    let known: Vec<_> = start.into_iter().chain(settings::numbers(args.vehicle, &args.settings)?).collect();
    let progress = Progress::terminal();
    let mut all = Vec::new();
    read_each(args.vehicle, &args.logs, &args.vehicle.reads(), &progress, |path, log| {
        match log {
            Ok(log) => {
                tell(std::slice::from_ref(&log));
                let found = findings(args.vehicle, std::slice::from_ref(&log), &known, &args.allowed.codes)?;
                let usable = worst(&found) < Severity::Refusal;
                all.extend(found);
                if usable && (args.parameters || log.len() <= args.vehicle.checks.quick) {
                    all.extend(expected(args.vehicle, &log, &known, &progress)?);
                }
            }
            Err(error) => all.push(checked::unreadable(path, &error.to_string())),
        }
        Ok(())
    })?;
    checked::allow(&mut all, &args.allowed.codes);
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
