//! Slow adaptation of measurement noise and fast adaptation of one scale of process noise.
//!
//! Fitting both to the same innovations is not identifiable. So the measurement noise follows slowly
//! and within bounds, and of the process noise only one scale is adapted, by the colour of the
//! innovations: white innovations leave it alone, innovations that keep their sign raise it.
//! Erratum: the paper names its filter adaptive and gives no law (eq. 43-54).

use serde::{Deserialize, Serialize};

/// Measurement variances estimated from residuals, `R <- (1 - d) R + d (residual^2 + h P h^T)`, with
/// `d = (1 - b) / (1 - b^(k+1))` at the `k`-th sample, counting those that teach nothing. The residual
/// form cannot become negative.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasurementNoise<const M: usize> {
    /// Present variances; the first `M` channels of the filter.
    #[serde(with = "super::array")]
    pub variance: [f64; M],
    /// `b^(k+1)`.
    remaining: f64,
}

/// What [`MeasurementNoise`] is adapted with.
#[derive(Clone, Copy, Debug)]
pub struct MeasurementAdaptation {
    /// Forgetting factor `b` per sample, < 1.
    pub memory: f64,
    /// Bounds of the variance relative to its nominal value.
    pub bounds: (f64, f64),
}

impl<const M: usize> MeasurementNoise<M> {
    /// At the nominal variances.
    pub fn new(nominal: &[f64; M]) -> Self {
        Self { variance: *nominal, remaining: 1.0 }
    }

    /// Counts a sample, whether or not its residuals are used.
    pub fn count(&mut self, adaptation: &MeasurementAdaptation) {
        self.remaining *= adaptation.memory;
    }

    /// Updates, once counted, with the residuals after the update (sample minus posterior) and the posterior
    /// variances of what the channels show.
    pub fn learn(
        &mut self,
        adaptation: &MeasurementAdaptation,
        nominal: &[f64; M],
        used: &[bool; M],
        residual: &[f64; M],
        posterior: &[f64; M],
    ) {
        let share = (1.0 - adaptation.memory) / (1.0 - self.remaining);
        for i in (0..M).filter(|&i| used[i]) {
            let fresh = residual[i] * residual[i] + posterior[i];
            let (low, high) = (adaptation.bounds.0 * nominal[i], adaptation.bounds.1 * nominal[i]);
            self.variance[i] = ((1.0 - share) * self.variance[i] + share * fresh).clamp(low, high);
        }
    }

    /// Whether the numbers, which are finite, can have come from [`learn`](Self::learn).
    pub fn is_valid(&self) -> bool {
        self.variance.iter().all(|v| *v > 0.0) && (0.0..=1.0).contains(&self.remaining)
    }
}

/// Scale of the process noise from the running mean of the normalised innovations. For white unit
/// innovations `mean^2 (2 - a) / a` is chi-squared with one degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProcessScale<const M: usize> {
    /// Present scale, 1 if nothing is unusual.
    pub scale: f64,
    #[serde(with = "super::array")]
    mean: [f64; M],
}

impl<const M: usize> Default for ProcessScale<M> {
    fn default() -> Self {
        Self { scale: 1.0, mean: [0.0; M] }
    }
}

impl<const M: usize> ProcessScale<M> {
    /// Updates with the innovations over their standard deviations. `time` is the memory, s, and
    /// `highest` bounds the scale.
    pub fn learn(&mut self, used: &[bool; M], normalised: &[f64; M], dt: f64, time: f64, highest: f64) {
        let a = 1.0 - (-dt / time).exp();
        let mut scale: f64 = 1.0;
        for i in (0..M).filter(|&i| used[i]) {
            self.mean[i] += a * (normalised[i] - self.mean[i]);
            scale = scale.max(self.mean[i] * self.mean[i] * (2.0 - a) / a);
        }
        self.scale = scale.min(highest);
    }

    /// Whether the numbers, which are finite, can have come from [`learn`](Self::learn).
    pub fn is_valid(&self) -> bool {
        self.scale >= 1.0
    }
}
