//! Prediction of data that were not fitted.

use crate::result::{SignalFit, Trace};

/// A measured signal and its prediction, compared by the validation.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// The signal.
    pub trace: Trace,
    /// Samples from one independent value to the next: 1 for a signal with white noise, the number of
    /// windows that overlap for windows.
    pub independent: usize,
}

/// Compares a measured signal with its prediction, where both are finite.
///
/// `fit_percent = 100 (1 - |measured - predicted| / |measured - mean|)`; the residual correlation is
/// the autocorrelation of the error at the lag of one independent sample.
pub fn signal_fit(prediction: &Prediction) -> SignalFit {
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

/// Autocorrelation at a lag, about the mean; NaN if there are too few values.
pub fn autocorrelation(values: &[f64], lag: usize) -> f64 {
    if values.len() < lag + 2 {
        return f64::NAN;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let product: f64 = values.iter().zip(&values[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum();
    product / values.iter().map(|a| (a - mean).powi(2)).sum::<f64>()
}
