//! Recursive least squares for one unknown, with adaptive forgetting, resets of its covariance,
//! rejection of outliers and a standard deviation that holds.
//!
//! Model: `measurement = regressor * estimate + noise`. The recursion (H is the inverse of the
//! forgetting-weighted sum of squared regressors):
//!
//! ```text
//! e = y - E m,   K = H E / (lambda + E H E),   m <- m + K e,   H <- (1 - K E) H / lambda
//! ```
//!
//! The estimate starts from the samples pooled after the start or a reset, `m = sum(E y) / sum(E^2)`.
//! Forgetting laws: Yang et al., eq. (34) and (35).
//! Erratum: eq. (37) of the paper starts from one sample, whose regressor may be near zero.

use serde::{Deserialize, Serialize};

/// How fast old samples are forgotten, given the size of the prediction error `e`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Forgetting {
    /// Always the same factor.
    Fixed(f64),
    /// `slow` below the error `low`, `fast` above `high`, linear between (eq. 34).
    Threshold {
        /// Factor at large errors.
        fast: f64,
        /// Factor at small errors.
        slow: f64,
        /// Error up to which the slow factor holds.
        low: f64,
        /// Error from which the fast factor holds.
        high: f64,
    },
    /// `fast + (slow - fast) exp(-rate (|e| - low))` above the error `low` (eq. 35).
    Exponential {
        /// Factor at large errors.
        fast: f64,
        /// Factor at small errors.
        slow: f64,
        /// Error up to which the slow factor holds.
        low: f64,
        /// How fast the factor falls with the error, 1 / unit of the error.
        rate: f64,
    },
}

impl Forgetting {
    /// Forgetting factor for a prediction error of size `error >= 0`.
    pub fn factor(&self, error: f64) -> f64 {
        match *self {
            Self::Fixed(factor) => factor,
            Self::Threshold { fast, slow, low, high } => {
                if error > high {
                    fast
                } else if error < low {
                    slow
                } else {
                    slow + (fast - slow) * (error - low) / (high - low)
                }
            }
            Self::Exponential { fast, slow, low, rate } => {
                fast + (slow - fast) * (-rate * (error - low).max(0.0)).exp()
            }
        }
    }
}

/// What stays the same while the filter runs.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Forgetting law.
    pub forgetting: Forgetting,
    /// Factor that is shown before the first error is known.
    pub initial_forgetting: f64,
    /// Smallest and largest H.
    pub covariance: (f64, f64),
    /// Smallest and largest estimate.
    pub bounds: (f64, f64),
    /// Prediction errors beyond this are rejected.
    pub gate: f64,
    /// Samples pooled into the first estimate after the start or a reset.
    pub pooled: u32,
    /// If positive: forget by the size of the signed mean error over this time, s, instead of by the
    /// single error, so that only errors of persistent sign count.
    pub persistence: f64,
    /// Residual to be expected before any is known, for the variance of the first estimates.
    pub expected_residual: f64,
}

/// What the filter did with a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Added to the pool of the first estimate.
    Pooled,
    /// Used.
    Used,
    /// The prediction error was beyond the gate; nothing changed.
    Rejected,
}

/// The running estimate. `D` constant disturbances are followed to say how they distort it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rls<const D: usize> {
    /// The estimate; meaningful once `valid`.
    pub estimate: f64,
    /// H, 1 / unit of the squared regressor.
    pub covariance: f64,
    /// Forgetting factor of the last used sample.
    pub forgetting: f64,
    /// Prediction error of the last used sample.
    pub innovation: f64,
    /// Whether there is an estimate.
    pub valid: bool,
    pooled: u32,
    sum_ee: f64,
    sum_ey: f64,
    #[serde(with = "super::array")]
    sum_ed: [f64; D],
    #[serde(with = "super::array")]
    sensitivity: [f64; D],
    noise: Noise,
    signed_error: f64,
}

/// Running moments of the residual and the variance that they imply for the estimate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Noise {
    weight: f64,
    power: f64,
    lagged: f64,
    last: f64,
}

/// Memory of the residual's moments, samples.
const NOISE_MEMORY: f64 = 300.0;

/// Number of samples that the expected residual counts for, and their correlation.
const PRIOR: (f64, f64) = (10.0, 0.9);

impl Noise {
    fn expected(residual: f64) -> Self {
        let power = PRIOR.0 * residual * residual;
        Self { weight: PRIOR.0, power, lagged: PRIOR.1 * power, last: 0.0 }
    }

    fn add(&mut self, residual: f64) {
        let keep = 1.0 - 1.0 / NOISE_MEMORY;
        self.weight = keep * self.weight + 1.0;
        self.power = keep * self.power + residual * residual;
        self.lagged = keep * self.lagged + residual * self.last;
        self.last = residual;
    }

    /// Variance of the residual and the number of samples that repeat the same information: filtered
    /// residuals resemble their neighbours. From the correlation `r` of neighbours that number is
    /// `(1 + r) / (1 - r)` for first-order noise and `4 / sqrt(2 (1 - r))` for the smoother noise behind
    /// a critically damped filter; the smaller one fits the noise at hand.
    fn moments(&self) -> (f64, f64) {
        if self.power <= 0.0 {
            return (0.0, 1.0);
        }
        let correlation = (self.lagged / self.power).clamp(0.0, 0.999);
        let first_order = (1.0 + correlation) / (1.0 - correlation);
        let second_order = 4.0 / (2.0 * (1.0 - correlation)).sqrt();
        (self.power / self.weight, first_order.min(second_order))
    }

    fn effective_variance(&self) -> f64 {
        let (variance, repeats) = self.moments();
        variance * repeats
    }
}

impl<const D: usize> Rls<D> {
    /// Without an estimate; `start` is held until there is one.
    pub fn new(config: &Config, start: f64) -> Self {
        Self {
            estimate: start,
            covariance: config.covariance.1,
            forgetting: config.initial_forgetting,
            innovation: 0.0,
            valid: false,
            pooled: 0,
            sum_ee: 0.0,
            sum_ey: 0.0,
            sum_ed: [0.0; D],
            sensitivity: [0.0; D],
            noise: Noise::expected(config.expected_residual),
            signed_error: 0.0,
        }
    }

    /// The quantity may have become another one: H is the largest again and the next samples are pooled into a
    /// new start. The estimate is held meanwhile.
    pub fn reset_covariance(&mut self, config: &Config) {
        self.covariance = config.covariance.1;
        self.pooled = 0;
        (self.sum_ee, self.sum_ey, self.sum_ed) = (0.0, 0.0, [0.0; D]);
    }

    /// The quantity may have changed by a random amount with the standard deviation `std`, in the unit of the estimate:
    /// adds that to the covariance, up to its largest value, and keeps the estimate.
    pub fn inflate(&mut self, config: &Config, std: f64) {
        let noise = self.noise.effective_variance();
        let added = if noise > 0.0 { std * std / noise } else { f64::INFINITY };
        self.covariance = (self.covariance + added).min(config.covariance.1);
    }

    /// Takes one sample, `dt` seconds after the one before. `disturbances` are the errors of the
    /// measurement per unit of each constant disturbance whose effect shall be followed.
    pub fn correct(
        &mut self,
        config: &Config,
        regressor: f64,
        measurement: f64,
        disturbances: &[f64; D],
        dt: f64,
    ) -> Verdict {
        let (e, (low, high)) = (regressor, config.bounds);
        if self.pooled < config.pooled {
            self.sum_ee += e * e;
            self.sum_ey += e * measurement;
            (0..D).for_each(|i| self.sum_ed[i] += e * disturbances[i]);
            self.pooled += 1;
            if self.pooled >= config.pooled && self.sum_ee > 0.0 {
                self.estimate = (self.sum_ey / self.sum_ee).clamp(low, high);
                self.covariance = (1.0 / self.sum_ee).clamp(config.covariance.0, config.covariance.1);
                self.sensitivity = self.sum_ed.map(|sum| sum / self.sum_ee);
                self.valid = true;
            }
            return Verdict::Pooled;
        }
        let innovation = measurement - e * self.estimate;
        if innovation.abs() > config.gate {
            return Verdict::Rejected;
        }
        self.innovation = innovation;
        self.forgetting = config.forgetting.factor(self.error_size(config, e, dt));
        let gain = self.covariance * e / (self.forgetting + e * self.covariance * e);
        self.estimate = (self.estimate + gain * innovation).clamp(low, high);
        self.covariance =
            ((1.0 - gain * e) * self.covariance / self.forgetting).clamp(config.covariance.0, config.covariance.1);
        for (error, disturbance) in self.sensitivity.iter_mut().zip(disturbances) {
            *error += gain * (disturbance - e * *error);
        }
        self.noise.add(innovation);
        Verdict::Used
    }

    fn error_size(&mut self, config: &Config, regressor: f64, dt: f64) -> f64 {
        if config.persistence <= 0.0 {
            return self.innovation.abs();
        }
        let share = 1.0 - (-dt / config.persistence).exp();
        // An error of the estimate gives innovations that change sign with the regressor.
        self.signed_error += share * (self.innovation * regressor.signum() - self.signed_error);
        self.signed_error.abs()
    }

    /// Whether the estimate sits on one of its bounds.
    pub fn at_bound(&self, config: &Config) -> bool {
        self.valid && (self.estimate <= config.bounds.0 || self.estimate >= config.bounds.1)
    }

    /// Variance of the estimate: the part that the residual's running variance explains plus the
    /// effect of constant disturbances with these standard deviations.
    pub fn variance(&self, disturbance_std: &[f64; D]) -> f64 {
        let systematic: f64 = self.sensitivity.iter().zip(disturbance_std).map(|(s, std)| (s * std).powi(2)).sum();
        self.covariance * self.noise.effective_variance() + systematic
    }

    /// Variance of the residual, and the number of samples that repeat the same information.
    pub fn residual_moments(&self) -> (f64, f64) {
        self.noise.moments()
    }

    /// Whether the numbers, which are finite, can have come from [`correct`](Self::correct).
    pub fn is_valid(&self) -> bool {
        self.covariance > 0.0 && self.forgetting > 0.0 && self.noise.weight > 0.0 && self.noise.power >= 0.0
    }
}
