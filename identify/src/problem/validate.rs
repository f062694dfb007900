//! What a fit is worth: its predictions of logs that it did not see, and its first part compared with the whole.

use super::findings::{Effect, Findings};
use super::fit::{Doubts, Fit};
use super::log_set::LogSet;
use super::{FitError, Known, Prediction, TRAINING_SHARE};
use crate::assess::validation::signal_fit;
use crate::log::Log;
use crate::progress::Progress;
use crate::result::{SignalFit, Trace, Validation};

/// A first part of the logs that differs by so many standard errors from the whole contradicts it.
const UNSTEADY: f64 = 4.5;
/// A prediction of what was fitted that is so much worse than a constant, in percent, is none.
const NO_MODEL: f64 = -20.0;
/// Errors of the held-out part over those of the fitted part beyond which the fit does not predict.
const UNPREDICTED: f64 = 2.5;
/// Fewest values that a prediction is judged by.
const JUDGED: usize = 6;

/// A fit and what the validation has said of it so far.
pub struct Judge<'a> {
    /// The fit.
    pub fit: &'a Fit<'a>,
    /// Its estimates.
    pub findings: &'a Findings,
    /// What considered causes do to them.
    pub effects: &'a [Effect],
    /// Reasons against estimates.
    pub doubts: Doubts,
    /// How well held-out signals are predicted.
    pub validation: Validation,
    /// The predictions.
    pub traces: Vec<Trace>,
}

impl Judge<'_> {
    /// Predicts the logs that are held out by the whole fit, or without them the last 40 % of each log by the first 60 %:
    /// of all logs together, or of each by itself where logs have values of their own.
    pub fn validate(
        &mut self,
        set: &LogSet,
        used: &[Log],
        each_by_itself: bool,
        progress: &Progress,
    ) -> Result<(), FitError> {
        let held_out = self.fit.held_out;
        if !held_out.is_empty() {
            let known = set.first_known().with(self.findings.values()).with_delays(&self.findings.delays);
            self.predict(held_out, used, &known);
            self.validation.held_out = 1.0;
            return Ok(());
        }
        let (training, held_out): (Vec<Log>, Vec<Log>) = used.iter().map(split).unzip();
        let size = if each_by_itself { 1 } else { used.len() };
        let parts = training.chunks(size).zip(held_out.chunks(size));
        for ((training, held_out), first) in parts.zip(set.chosen.iter().step_by(size)) {
            let known = &set.known[*first];
            // The first part alone may not suffice: then there is nothing to validate with.
            let decisions = self.findings.decisions_of_parts();
            let Ok(early) = self.fit.run_as(training, known, &decisions, &Progress::none()) else { continue };
            progress.check()?;
            if size == used.len() {
                self.compare_parts(&early);
            }
            self.predict(held_out, training, &known.with(early.values()).with_delays(&early.delays));
        }
        self.validation.held_out = 1.0 - TRAINING_SHARE;
        Ok(())
    }

    /// Doubts about estimates of which the first part of the logs says something else than the whole.
    fn compare_parts(&mut self, early: &Findings) {
        for (found, error) in self.findings.found.iter().zip(self.findings.errors(self.effects)) {
            let Some(before) = early.get(&found.name).filter(|before| before.spread > 0.0) else { continue };
            // The whole contains the part: the variance of their difference is the difference of their variances.
            let apart =
                (before.own_error().powi(2) - found.own_error().powi(2)).max(0.4 * before.own_error().powi(2)).sqrt();
            let difference = (before.value - found.value).abs();
            let limits = found.judgement.limits;
            let matters = 0.1 * limits.absolute_error.unwrap_or(limits.relative_error * found.value.abs());
            if error.is_finite() && difference > UNSTEADY * apart && difference > error.max(matters) {
                self.doubts.entry(found.name.clone()).or_default().push(format!(
                    "the first {:.0} % of the logs say {:.4} +- {:.2}, the whole {:.4}",
                    100.0 * TRAINING_SHARE,
                    before.value,
                    before.own_error(),
                    found.value
                ));
            }
        }
    }

    /// Predicts logs that were not fitted, and those that were; a signal that is not predicted is a doubt about every
    /// parameter that its prediction depends on.
    fn predict(&mut self, held_out: &[Log], training: &[Log], known: &Known) {
        let predicted = self.fit.predict(held_out, known);
        let trained: Vec<SignalFit> = self.fit.predict(training, known).iter().map(signal_fit).collect();
        let mut failed = Vec::new();
        for (index, prediction) in predicted.iter().enumerate() {
            let mut signal = signal_fit(prediction);
            let same = trained.iter().find(|other| other.name == signal.name && other.log == signal.log);
            let same = same.or_else(|| trained.iter().find(|other| other.name == signal.name));
            if let Some(same) = same {
                signal.fit_percent_training = same.fit_percent;
                signal.rmse_training = same.rmse;
                failed.extend(failure(&signal, same).map(|reason| (index, reason)));
            }
            self.validation.signals.push(signal);
        }
        if !failed.is_empty() {
            self.doubt(&failed, held_out, &predicted, known);
        }
        self.traces.extend(predicted.into_iter().map(|prediction| prediction.trace));
    }

    /// Doubts the parameters that the failed predictions depend on: those that move when a parameter does.
    fn doubt(&mut self, failed: &[(usize, String)], held_out: &[Log], predicted: &[Prediction], known: &Known) {
        for (found, error) in self.findings.found.iter().zip(self.findings.errors(self.effects)) {
            let mut moved = known.clone();
            moved.assume(&found.name, found.value + error.max(0.02 * found.value.abs()).max(1e-9));
            let other = self.fit.predict(held_out, &moved);
            for (index, reason) in failed {
                let (now, then) = (&predicted[*index].trace.predicted, other.get(*index).map(|p| &p.trace.predicted));
                if then.is_some_and(|then| now.iter().zip(then).any(|(a, b)| (a - b).abs() > 1e-9 * a.abs())) {
                    let all = self.doubts.entry(found.name.clone()).or_default();
                    if !all.contains(reason) {
                        all.push(reason.clone());
                    }
                }
            }
        }
    }
}

/// The part of a log that the validation's fit sees and the rest, both without the references
/// (`true_*`) that no fit looks at: they may be most of a simulated log.
fn split(log: &Log) -> (Log, Log) {
    let at = (log.len() as f64 * TRAINING_SHARE).round() as usize;
    let part = |samples: std::ops::Range<usize>| log.slice(samples, |name| !name.starts_with("true_"));
    (part(0..at), part(at..log.len()))
}

/// Why a prediction of a signal is none, compared with that of the part that was fitted.
fn failure(held_out: &SignalFit, fitted: &SignalFit) -> Option<String> {
    let name = &held_out.name;
    if held_out.samples < JUDGED || fitted.samples < JUDGED {
        None
    } else if fitted.fit_percent < NO_MODEL {
        let percent = fitted.fit_percent;
        Some(format!("{name} is predicted worse than by a constant ({percent:.0} %) even where it was fitted"))
    } else if held_out.fit_percent < 0.0 && held_out.rmse > UNPREDICTED * fitted.rmse {
        Some(format!(
            "{name} is not predicted where it was not fitted ({:.0} %, error {:.1} times that of the fitted part)",
            held_out.fit_percent,
            held_out.rmse / fitted.rmse
        ))
    } else {
        None
    }
}
