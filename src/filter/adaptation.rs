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

/// An acceleration that the model does not have, from the innovations of a measured speed: until the filter follows, only they
/// know of it.
///
/// An acceleration `a` that began `T` ago leaves innovations of about `a T`, until the corrections keep up with it: at the gain
/// `K` per sample they stay at `a dt / K`. The running mean of white innovations with the standard deviation `s` has the variance
/// `s^2 w / (2 - w)`; what its square is beyond that is taken for `(a T)^2`, with `T` the memory and how long it has been beyond.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UnmodelledAcceleration {
    /// Standard deviation of the acceleration, m/s2.
    pub std: f64,
    /// Running mean of the innovations over their standard deviations.
    mean: f64,
    /// How long the mean has been larger than that of white innovations, s.
    since: f64,
    /// The largest of late that was hardly chance, m/s2: it fades.
    largest: f64,
}

/// Deviations of the mean of white innovations beyond which an acceleration is hardly chance: 1 sample in 370.
const CHANCE: f64 = 3.0;
/// Time in which the largest of late fades, s: who has coughed is likely to cough again within seconds.
const FADING: f64 = 3.0;

impl UnmodelledAcceleration {
    /// Takes the innovation of a speed, `dt` seconds after the one before, with the variances of the predicted and of the
    /// measured speed. `time` is the memory, s.
    pub fn learn(&mut self, innovation: f64, predicted: f64, measured: f64, dt: f64, time: f64) {
        let share = 1.0 - (-dt / time).exp();
        let std = (predicted + measured).sqrt();
        self.mean += share * (innovation / std - self.mean);
        self.largest *= 1.0 - (dt / FADING).min(1.0);
        let chance = share / (2.0 - share);
        let beyond = self.mean * self.mean - chance;
        if beyond <= 0.0 {
            (self.since, self.std) = (0.0, 0.0);
            return;
        }
        self.since = (self.since + dt).min(1e3);
        // dt / K, as long as that is longer than the memory
        let followed = (dt * std * std / predicted.max(f64::MIN_POSITIVE)).max(time);
        self.std = beyond.sqrt() * std / (time + self.since).min(followed);
        if self.mean * self.mean > CHANCE * CHANCE * chance {
            self.largest = self.largest.max(self.std);
        }
    }

    /// Standard deviation of what nobody has noticed yet: as large as what was seen of late, it is three deviations away.
    pub fn again(&self) -> f64 {
        self.largest / 3.0
    }

    /// Its standard deviation if it has lasted for longer than `time`, s, as by chance it does not; else 0.
    pub fn lasting(&self, time: f64) -> f64 {
        if self.since > time { self.std } else { 0.0 }
    }

    /// Whether the numbers, which are finite, can have come from [`learn`](Self::learn).
    pub fn is_valid(&self) -> bool {
        self.std >= 0.0 && self.since >= 0.0 && self.largest >= 0.0
    }
}
