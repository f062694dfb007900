//! A fit with the look at the logs before it, as the command line and the Python package do it.

use crate::finding::{Finding, Severity};
use crate::log::{LONG, Log, Store};
use crate::problem::{FitError, FitRequest};
use crate::progress::{Interrupted, Progress};
use crate::result::{FORMAT_VERSION, FitReport, LogEntry};
use crate::vehicle::Vehicle;
use rayon::prelude::*;
use std::path::Path;
use wheelstate::ParameterError;

/// Why there is no fit.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// What was asked for cannot be done, whatever the logs are.
    #[error("{0}")]
    Request(String),
    /// The logs cannot be used, or nothing could be fitted to them: [`FitReport::refused`] says why, and the rest what
    /// was read.
    #[error("{}", .0.refused.as_deref().unwrap_or_default())]
    Logs(Box<FitReport>),
    /// The user asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// What is wrong with logs; findings whose code the user allows are notes.
pub fn findings(
    vehicle: &Vehicle,
    logs: &[Log],
    known: &[(String, f64)],
    allowed: &[String],
) -> Result<Vec<Finding>, ParameterError> {
    let each = logs.par_iter().map(|log| vehicle.check(log, known));
    let mut all = each.collect::<Result<Vec<_>, _>>()?.concat();
    allow(&mut all, allowed);
    Ok(all)
}

/// What the user knows of is no more than a note.
pub fn allow(findings: &mut [Finding], allowed: &[String]) {
    for finding in findings.iter_mut().filter(|finding| allowed.contains(&finding.code)) {
        finding.severity = Severity::Note;
    }
}

/// What the log tells about each parameter; nothing if no fit can be made of it.
pub fn expected(
    vehicle: &Vehicle,
    log: &Log,
    known: &[(String, f64)],
    progress: &Progress,
) -> Result<Vec<Finding>, Interrupted> {
    match vehicle.information(log, known, progress) {
        Err(FitError::Interrupted(stop)) => Err(stop),
        told => Ok(told.unwrap_or_default()),
    }
}

/// The finding about a file that could not be read.
pub fn unreadable(path: &Path, error: &str) -> Finding {
    Finding {
        file: path.display().to_string(),
        channel: String::new(),
        time: None,
        code: "unreadable-log".to_owned(),
        severity: Severity::Refusal,
        message: error.trim_start_matches(&format!("{}: ", path.display())).to_owned(),
        suggestion: "mend the file, or a column map if it has one".to_owned(),
    }
}

/// The worst of the findings.
pub fn worst(findings: &[Finding]) -> Severity {
    findings.iter().map(|finding| finding.severity).max().unwrap_or(Severity::Note)
}

/// Keeps of a log the samples from one time to another, s, and takes those in the excluded spans as missing.
pub fn within(log: &mut Log, (from, to): (f64, f64), exclude: &[(f64, f64)]) -> Result<(), String> {
    if (from, to) == (f64::NEG_INFINITY, f64::INFINITY) && exclude.is_empty() {
        return Ok(());
    }
    // The times of a long log are in memory as long as they are looked at.
    let time = log.time.clone();
    let first = time.partition_point(|time| *time < from);
    let last = time.partition_point(|time| *time <= to);
    drop(time);
    if last < first + 2 {
        return Err(format!("{}: no samples between --from {from} and --to {to} s", log.source));
    }
    if last - first < log.len() {
        *log = log.slice(first..last, |_| true);
    }
    let time = log.time.clone();
    let missing = exclude
        .iter()
        .map(|(from, to)| time.partition_point(|time| time < from)..time.partition_point(|time| time <= to));
    let missing: Vec<_> = missing.collect();
    let store = if log.len() < LONG || missing.is_empty() { None } else { Store::new().ok() };
    for channel in log.channels.iter_mut().filter(|channel| !channel.name.starts_with("true_")) {
        missing.iter().for_each(|missing| channel.values[missing.clone()].fill(f64::NAN));
        if let Some(store) = &store {
            channel.values.put_away(store).map_err(|error| format!("{}: {error}", log.source))?;
        }
    }
    Ok(())
}

/// Looks at the logs, leaves out bad ones if [`FitRequest::skip_bad`] says so, and fits. `warn` gets the findings that
/// are warnings, before the fit begins.
pub fn fit(
    vehicle: &Vehicle,
    mut logs: Vec<Log>,
    mut request: FitRequest,
    allowed: &[String],
    mut warn: impl FnMut(&Finding),
    progress: &Progress,
) -> Result<FitReport, Refused> {
    let known: Vec<_> = request.start.iter().chain(&request.settings).cloned().collect();
    let mut found = findings(vehicle, &logs, &known, allowed).map_err(|error| Refused::Request(error.to_string()))?;
    let mut skipped = Vec::new();
    if request.skip_bad {
        let bad = |log: &Log| found.iter().find(|f| f.severity == Severity::Refusal && f.file == log.source);
        let keep: Vec<bool> = logs.iter().map(|log| bad(log).is_none()).collect();
        if keep.contains(&true) && keep.contains(&false) {
            skipped.extend(logs.iter().filter_map(|log| Some(format!("was left out: {}", bad(log)?))));
            found.retain(|finding| finding.severity != Severity::Refusal);
            request.of_log.retain(|(index, ..)| keep.get(*index).copied().unwrap_or(true));
            for (index, ..) in &mut request.of_log {
                *index -= keep.iter().take(*index).filter(|keep| !**keep).count();
            }
            let mut of = keep.iter();
            logs.retain(|_| of.next() == Some(&true));
        }
    }
    if let Some(what) = refusal(&found) {
        return Err(refused(vehicle, &logs, &request, what, found));
    }
    found.iter().filter(|finding| finding.severity == Severity::Warning).for_each(&mut warn);
    match vehicle.fit(&logs, &request, progress) {
        Ok(mut report) => {
            report.findings = found;
            report.warnings.splice(0..0, skipped);
            report.refer_to(&logs);
            Ok(report)
        }
        Err(error @ (FitError::Request(_) | FitError::UnknownTarget { .. } | FitError::Setting(_))) => {
            Err(Refused::Request(error.to_string()))
        }
        Err(FitError::Interrupted(stop)) => Err(stop.into()),
        Err(error) => Err(refused(vehicle, &logs, &request, error.to_string(), found)),
    }
}

/// What spoils a fit for certain, in one line.
fn refusal(findings: &[Finding]) -> Option<String> {
    let refusals: Vec<_> = findings.iter().filter(|finding| finding.severity == Severity::Refusal).collect();
    let first = refusals.first()?;
    let more = match refusals.len() {
        1 => String::new(),
        count => format!(" (and {} more, which the command check lists)", count - 1),
    };
    Some(format!("{first}{more}; if you know better, --allow {}", first.code))
}

/// What was read and what is wrong.
fn refused(vehicle: &Vehicle, logs: &[Log], request: &FitRequest, what: String, findings: Vec<Finding>) -> Refused {
    Refused::Logs(Box::new(FitReport {
        format_version: FORMAT_VERSION,
        vehicle: vehicle.name.to_owned(),
        loss: request.loss.word().to_owned(),
        logs: logs.iter().map(LogEntry::from).collect(),
        solver_status: "not run".to_owned(),
        warnings: vec![what.clone()],
        findings,
        refused: Some(what),
        ..FitReport::default()
    }))
}
