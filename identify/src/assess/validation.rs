//! Prediction of data that were not fitted.

use crate::result::{SignalFit, Trace};
use std::collections::VecDeque;

/// A measured signal and its prediction, compared by the validation.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// The signal.
    pub trace: Trace,
    /// Samples from one independent value to the next: 1 for a signal with white noise, the number of
    /// windows that overlap for windows.
    pub independent: usize,
    /// What all values of the signal say, where the trace has some of them only.
    pub of_all: Option<SignalFit>,
}

impl Prediction {
    /// A prediction of which the trace has every value.
    pub fn new(trace: Trace, independent: usize) -> Self {
        Self { trace, independent, of_all: None }
    }
}

/// Compares a measured signal with its prediction, where both are finite.
///
/// `fit_percent = 100 (1 - |measured - predicted| / |measured - mean|)`; the residual correlation is
/// the autocorrelation of the error at the lag of one independent sample.
pub fn signal_fit(prediction: &Prediction) -> SignalFit {
    if let Some(fit) = &prediction.of_all {
        return fit.clone();
    }
    let trace = &prediction.trace;
    let pairs = || {
        let all = trace.measured.iter().zip(&trace.predicted);
        all.filter(|(measured, predicted)| measured.is_finite() && predicted.is_finite())
    };
    let mut errors = Vec::with_capacity(trace.measured.len());
    errors.extend(pairs().map(|(measured, predicted)| measured - predicted));
    let n = errors.len() as f64;
    let mean = pairs().map(|(measured, _)| measured).sum::<f64>() / n;
    let error: f64 = errors.iter().map(|e| e * e).sum();
    let spread: f64 = pairs().map(|(measured, _)| (measured - mean).powi(2)).sum();
    // A constant signal has no spread to explain.
    let size = pairs().map(|(measured, _)| measured.powi(2)).sum::<f64>();
    let spread = if spread > 1e-20 * size { spread } else { f64::NAN };
    SignalFit {
        name: trace.name.clone(),
        unit: trace.unit.clone(),
        log: trace.log.clone(),
        rmse_training: f64::NAN,
        samples: errors.len(),
        rmse: (error / n).sqrt(),
        fit_percent: 100.0 * (1.0 - (error / spread).sqrt()),
        fit_percent_training: f64::NAN,
        residual_correlation: autocorrelation(&errors, prediction.independent),
    }
}

/// Values that the trace of a long log has at most.
const KEPT: usize = 1 << 17;

/// A prediction that comes in parts of which none is kept, see [`signal_fit`].
#[derive(Clone, Debug)]
pub struct Parts {
    /// Every so many values one is kept.
    every: usize,
    kept: Trace,
    independent: usize,
    count: f64,
    /// Sums of measured values and their squares, of the errors and their squares; the measured values less the first one.
    sums: [f64; 4],
    first: f64,
    size: f64,
    /// Sum of the products of errors that stand so far apart; the first and the last of them.
    products: f64,
    heads: Vec<f64>,
    tails: VecDeque<f64>,
}

impl Parts {
    /// Begins with the first of so many parts.
    pub fn new(prediction: Prediction, parts: usize) -> Self {
        let Prediction { trace, independent, .. } = prediction;
        let every = (parts * trace.time.len()).div_ceil(KEPT).max(1);
        let [name, unit, log] = [&trace.name, &trace.unit, &trace.log].map(String::clone);
        let kept = Trace { name, unit, log, ..Trace::default() };
        let first = trace.measured.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
        let (heads, tails) = (Vec::new(), VecDeque::new());
        let (count, sums, size, products) = (0.0, [0.0; 4], 0.0, 0.0);
        let mut all = Self { every, kept, independent, count, sums, first, size, products, heads, tails };
        all.add(&trace);
        all
    }

    /// Whether it is the same signal.
    pub fn is_of(&self, prediction: &Prediction) -> bool {
        self.kept.name == prediction.trace.name && self.kept.log == prediction.trace.log
    }

    /// Adds the next part.
    pub fn add(&mut self, trace: &Trace) {
        let kept = (0..trace.time.len()).step_by(self.every);
        self.kept.time.extend(kept.clone().map(|k| trace.time[k]));
        self.kept.measured.extend(kept.clone().map(|k| trace.measured[k]));
        self.kept.predicted.extend(kept.map(|k| trace.predicted[k]));
        for (measured, predicted) in trace.measured.iter().zip(&trace.predicted) {
            if !(measured.is_finite() && predicted.is_finite()) {
                continue;
            }
            let (value, error) = (measured - self.first, measured - predicted);
            self.count += 1.0;
            self.size += measured * measured;
            for (sum, term) in self.sums.iter_mut().zip([value, value * value, error, error * error]) {
                *sum += term;
            }
            if self.heads.len() < self.independent {
                self.heads.push(error);
            }
            if self.tails.len() == self.independent {
                self.products += self.tails.pop_front().unwrap_or(0.0) * error;
            }
            self.tails.push_back(error);
        }
    }

    /// All of it.
    pub fn finish(self) -> Prediction {
        let Self { kept, independent, count: n, sums: [value, values, error, errors], size, .. } = self;
        let spread = values - value * value / n;
        let spread = if spread > 1e-20 * size { spread } else { f64::NAN };
        let (mean, pairs) = (error / n, n - independent as f64);
        // Errors that have one after them, and those that have one before.
        let (ahead, behind) = (error - self.tails.iter().sum::<f64>(), error - self.heads.iter().sum::<f64>());
        let together = self.products - mean * (ahead + behind) + pairs * mean * mean;
        let fit = SignalFit {
            name: kept.name.clone(),
            unit: kept.unit.clone(),
            log: kept.log.clone(),
            rmse_training: f64::NAN,
            samples: n as usize,
            rmse: (errors / n).sqrt(),
            fit_percent: 100.0 * (1.0 - (errors / spread).sqrt()),
            fit_percent_training: f64::NAN,
            residual_correlation: if pairs < 2.0 { f64::NAN } else { together / (errors - n * mean * mean) },
        };
        Prediction { trace: kept, independent, of_all: Some(fit) }
    }
}

/// Autocorrelation at a lag, about the mean; NaN if there are too few values.
pub fn autocorrelation(values: &[f64], lag: usize) -> f64 {
    if values.len() < lag + 2 {
        return f64::NAN;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let product: f64 = values.iter().zip(&values[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum();
    product / values.iter().map(|a| (a - mean).powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_say_what_the_whole_says() {
        let n = 3 * KEPT;
        let noise = |k: usize| ((k * 7919) % 1000) as f64 / 1000.0;
        let measured: Vec<f64> =
            (0..n).map(|k| if k % 977 == 5 { f64::NAN } else { 40.0 + (k as f64 / 50.0).sin() }).collect();
        let predicted = (0..n).map(|k| 40.0 + (k as f64 / 50.0).sin() + noise(k) + noise(k + 1)).collect();
        let time = (0..n).map(|k| k as f64).collect();
        let [name, unit, log] = ["tilt", "rad", "ride.csv"].map(str::to_owned);
        let whole = Prediction::new(Trace { name, unit, log, time, measured, predicted }, 12);
        let part = |from: usize, to: usize| {
            let cut = |values: &[f64]| values[from..to].to_vec();
            let Trace { time, measured, predicted, .. } = &whole.trace;
            Trace { time: cut(time), measured: cut(measured), predicted: cut(predicted), ..whole.trace.clone() }
        };
        let mut parts = Parts::new(Prediction::new(part(0, KEPT), 12), 3);
        assert!(parts.is_of(&whole));
        parts.add(&part(KEPT, KEPT + 5));
        parts.add(&part(KEPT + 5, n));
        let parts = parts.finish();
        assert!((KEPT - 3..=KEPT + 3).contains(&parts.trace.time.len()));
        let (some, all) = (signal_fit(&parts), signal_fit(&whole));
        assert_eq!(some.samples, all.samples);
        for (some, all) in [
            (some.rmse, all.rmse),
            (some.fit_percent, all.fit_percent),
            (some.residual_correlation, all.residual_correlation),
        ] {
            assert!((some - all).abs() < 1e-9 * all.abs(), "{some} {all}");
        }
    }
}
