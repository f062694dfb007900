//! The prediction of a sample from the one before, by a filter: the measured channels with the standard deviations of
//! their innovations, and the transition of the state, for reports and for smoothing once a ride is over.
//!
//! Both are worked out anew from the state before the sample, by the functions that the sample itself uses, so that no
//! step pays for them. They may allocate.

use crate::filter::gaussian::{FactoredGaussian, Gaussian};
use crate::filter::sigma_points::robust_cholesky;
use nalgebra::{DMatrix, DVector, SMatrix};

/// Why an estimator has no states to be smoothed, unless it says otherwise.
pub(super) const NO_STATES: &str = "each of its estimates is of one instant, and no state leads from one to the next";

/// A measured channel before its sample is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictedMeasurement {
    /// What is measured: an input, or what the filter makes of several.
    pub channel: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The sample; NaN if there is none.
    pub measured: f64,
    /// What the filter expects; the innovation is the difference. NaN if there is no sample.
    pub predicted: f64,
    /// Standard deviation of the innovation; NaN if there is no sample.
    pub std: f64,
}

impl PredictedMeasurement {
    /// A channel with its innovation and the innovation's variance; without a sample the innovation is not finite.
    pub fn new(channel: &'static str, unit: &'static str, measured: f64, innovation: f64, variance: f64) -> Self {
        if !(measured.is_finite() && innovation.is_finite()) {
            return Self { channel, unit, measured: f64::NAN, predicted: f64::NAN, std: f64::NAN };
        }
        Self { channel, unit, measured, predicted: measured - innovation, std: variance.max(0.0).sqrt() }
    }
}

/// Mean and covariance of the states that a filter estimates.
#[derive(Clone, Debug, PartialEq)]
pub struct Belief {
    /// Mean, in the filter's own coordinates.
    pub mean: DVector<f64>,
    /// Covariance.
    pub covariance: DMatrix<f64>,
}

impl Belief {
    /// Into a Gaussian of as many states; one of another number is left alone.
    pub(super) fn copy_to<const N: usize>(&self, to: &mut Gaussian<N>) {
        if self.mean.len() == N {
            to.mean.copy_from_slice(self.mean.as_slice());
            to.covariance.copy_from_slice(self.covariance.as_slice());
        }
    }

    /// The same with a factor of the covariance; one that has none, by rounding, is lifted as little as possible.
    pub(super) fn copy_to_factored<const N: usize>(&self, to: &mut FactoredGaussian<N>) {
        if self.mean.len() != N {
            return;
        }
        let covariance = SMatrix::<f64, N, N>::from_column_slice(self.covariance.as_slice());
        if let Some((factor, _)) = robust_cholesky(&covariance) {
            to.mean.copy_from_slice(self.mean.as_slice());
            to.factor = factor;
        }
    }
}

impl<const N: usize> From<&Gaussian<N>> for Belief {
    fn from(gaussian: &Gaussian<N>) -> Self {
        Self { mean: DVector::from_column_slice(gaussian.mean.as_slice()), covariance: dynamic(&gaussian.covariance) }
    }
}

impl<const N: usize> From<&FactoredGaussian<N>> for Belief {
    fn from(gaussian: &FactoredGaussian<N>) -> Self {
        let covariance = gaussian.factor * gaussian.factor.transpose();
        Self { mean: DVector::from_column_slice(gaussian.mean.as_slice()), covariance: dynamic(&covariance) }
    }
}

/// How a belief leads to the next sample, `x[k+1] = f(x[k]) + q`.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    /// Predicted mean and covariance at the next sample, before it is used.
    pub predicted: Belief,
    /// Covariance of the state now with the state then, one row per state now: `P F^T`, or that of the sigma points.
    pub cross: DMatrix<f64>,
}

/// The prediction of a sample, before it is used.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OneStepPrediction {
    /// The channels, always the same ones in the same order.
    pub expected: Vec<PredictedMeasurement>,
    /// How the belief leads to the sample; nothing where the filter makes a new start, or where what it does is no
    /// conditioning of its states, so that nothing that comes later may be carried back.
    pub transition: Option<Transition>,
}

impl OneStepPrediction {
    /// Nothing.
    pub fn clear(&mut self) {
        self.expected.clear();
        self.transition = None;
    }

    /// Channels, by name and unit, of which nothing is expected.
    pub(super) fn nothing_expected(&mut self, channels: &[(&'static str, &'static str)]) {
        let nothing = |(channel, unit): &(&'static str, &'static str)| {
            PredictedMeasurement::new(channel, unit, f64::NAN, f64::NAN, f64::NAN)
        };
        self.expected.extend(channels.iter().map(nothing));
    }
}

/// A matrix whose size is no longer part of its type.
pub(super) fn dynamic<const N: usize, const M: usize>(matrix: &SMatrix<f64, N, M>) -> DMatrix<f64> {
    DMatrix::from_column_slice(N, M, matrix.as_slice())
}
