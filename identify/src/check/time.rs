//! The time base: its period, its gaps, the scatter of its stamps.

use super::{Finding, Severity, Subject, finding, short};
use crate::log::Log;

/// A pause counts as a gap from so many periods, and from so long, s, about a window of a fit: shorter ones are harmless
/// but for their number. One that is longer than a machine's pauses separates runs that share a file.
const GAP_PERIODS: f64 = 5.0;
const SHORTEST_GAP: f64 = 1.0;
const BETWEEN_RUNS: f64 = 10.0;
/// Even steps over a log may not be more than so many times its samples: the clock was set while it was recorded.
const STRETCHED: f64 = 50.0;
/// Scatter of the stamps about an even clock, in periods, that moves what is derived from positions.
const SCATTER: f64 = 0.1;
/// Share of the log that may be lost.
const LOST: f64 = 0.1;
/// Units that times are recorded in, and what one of them is in s.
const UNITS: [(&str, f64); 5] = [("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0)];
/// Sample rates that sensors have, Hz.
const RATES: (f64, f64) = (5.0, 5000.0);

/// What is wrong with the times of a log of this period.
pub fn check(subject: &Subject, log: &Log, period: f64) -> Vec<Finding> {
    let mut found = Vec::new();
    // The times of a long log are in memory as long as they are looked at.
    let log = &log.slice(0..log.len(), |_| false);
    if !(period.is_finite() && period > 0.0) {
        return found;
    }
    found.extend(range(subject, log, period));
    found.extend(gaps(log, period));
    found.extend(scatter(log, period));
    found
}

/// The period compared with what estimator and fit can use.
fn range(subject: &Subject, log: &Log, period: f64) -> Option<Finding> {
    let declared = subject.known.declared("sample_period").map_or((0.0, f64::INFINITY), |variable| variable.range);
    let slowest = subject.checks.slowest.min(declared.1);
    let slack = 1.0 + 1e-6;
    if period >= declared.0 / slack && period <= slowest * slack {
        return None;
    }
    let rate = |(_, factor): &&(&str, f64)| (RATES.0..=RATES.1).contains(&(1.0 / (period * factor)));
    let unit = UNITS.iter().find(rate);
    let allowed = format!("{} to {} s", short(declared.0), short(slowest));
    let finding = finding(log, "period-out-of-range", Severity::Refusal, "time");
    let message = format!("the samples are {} s apart (median), but this fit needs {allowed}", short(period));
    Some(match unit {
        Some((unit, factor)) => {
            let real = short(period * factor);
            let hint = format!("if the times are in {unit} (then {real} s apart), a column map reads them so");
            finding.says(message, format!("{hint}: time = {{ column = \"...\", unit = \"{unit}\" }}"))
        }
        None => finding.says(message, "check the unit of the times, or record faster"),
    })
}

/// Pauses in which samples were lost.
fn gaps(log: &Log, period: f64) -> Option<Finding> {
    let longest = (GAP_PERIODS * period).max(SHORTEST_GAP);
    let pauses: Vec<(f64, f64)> =
        log.time.windows(2).map(|pair| (pair[0], pair[1] - pair[0])).filter(|(_, step)| *step > 1.5 * period).collect();
    if log.duration() > STRETCHED * period * log.len() as f64 {
        let (at, step) = pauses.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let message = format!("the time jumps by {} s, and the log has {} samples only", short(step), log.len());
        let what = "the clock seems to have been set while it was recorded: cut the log there";
        return Some(finding(log, "time-gap", Severity::Refusal, "time").at(at).says(message, what));
    }
    let (between, pauses): (Vec<_>, Vec<_>) =
        pauses.into_iter().partition(|(_, step)| *step > BETWEEN_RUNS.max(longest));
    let lost: f64 = pauses.iter().map(|(_, step)| step - period).sum();
    let gaps: Vec<&(f64, f64)> = pauses.iter().filter(|(_, step)| *step > longest).collect();
    let share = lost / (log.duration() - between.iter().map(|(_, step)| step).sum::<f64>());
    if let (Some(first), true) = (between.first(), gaps.is_empty() && share < LOST) {
        let message = format!(
            "the file holds {} runs with pauses of up to {} s",
            between.len() + 1,
            short(between.iter().map(|(_, step)| *step).fold(0.0, f64::max),)
        );
        let what = "nothing is taken from one run to the next";
        return Some(finding(log, "time-gap", Severity::Note, "time").at(first.0).says(message, what));
    }
    if gaps.is_empty() && share < LOST {
        return None;
    }
    let worst = gaps.iter().copied().chain(&pauses).max_by(|a, b| a.1.total_cmp(&b.1)).copied()?;
    let message = match gaps.len() {
        0 => format!("{:.0} % of the samples are missing, a few at a time", 100.0 * share),
        1 => format!("no samples for {} s", short(worst.1)),
        count => format!("{count} gaps, {} s in all; the longest lasts {} s", short(lost), short(worst.1)),
    };
    let what = "what happens in a gap is left out of the fit; if it should not be there, look at the recorder";
    Some(finding(log, "time-gap", Severity::Warning, "time").at(worst.0).says(message, what))
}

/// Scatter of stamps about an even clock, `t_k = k T + e_k`: then steps follow one another with the correlation -1/2,
/// which pauses of the sensor itself have not.
fn scatter(log: &Log, period: f64) -> Option<Finding> {
    let away = log.time.windows(2).map(|pair| pair[1] - pair[0] - period);
    // A lost sample is no scatter.
    let away = away.map(|away| if away > 0.75 * period { away - (away / period).round() * period } else { away });
    let (mut square, mut product, mut before) = (0.0, 0.0, 0.0);
    for away in away {
        square += away * away;
        product += before * away;
        before = away;
    }
    let count = log.len() - 1;
    if count < 20 || square == 0.0 || product / square > -0.25 {
        return None;
    }
    let std = (0.5 * square / count as f64).sqrt();
    if std < SCATTER * period {
        return None;
    }
    let message =
        format!("the time stamps scatter by {} ms about an even clock of {} ms", short(1e3 * std), short(1e3 * period));
    let what =
        "stamp samples where they are taken, or number them: times written after a bus or a queue are late by chance";
    Some(finding(log, "time-jitter", Severity::Warning, "time").says(message, what))
}
