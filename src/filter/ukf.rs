//! Unscented Kalman filter of static size with additive process noise and direct measurements of
//! single states.
//!
//! A measurement that is one of the states is linear, for which the unscented transform is exact. So
//! its covariances are read off the predicted covariance, no second set of sigma points is needed, and
//! independent channels can be taken one after the other without inverting a matrix.
//! Yang et al., eq. (44)-(54). Errata: (46) and (47) print the noise of the wrong instants, Q belongs
//! to the step and R to the sample; the points would have to be redrawn after Q has been added.

use super::belief::{Belief, add_square};
use super::sigma_points::{Weights, robust_cholesky};
use nalgebra::{SMatrix, SVector};
use std::f64::consts::TAU;

/// A measured channel that shows one state: `sample = state[index] + noise`.
#[derive(Clone, Copy, Debug)]
pub struct Channel {
    /// Which state it shows.
    pub index: usize,
    /// The sample; NaN if there is none.
    pub sample: f64,
    /// Variance of its noise.
    pub variance: f64,
}

/// What the samples say before they are used.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<const M: usize> {
    /// Sample minus prediction per channel; 0 for a missing one.
    pub residual: [f64; M],
    /// Variance of the residual per channel.
    pub variance: [f64; M],
    /// Number of channels with a sample.
    pub available: usize,
    /// Normalised innovation squared, summed over the available channels jointly.
    pub nis: f64,
    /// Logarithm of the likelihood, 0 without a sample.
    pub log_likelihood: f64,
}

/// Moves the belief through `f` (process noise is added by the caller). Returns whether the
/// covariance had to be repaired; `None`, with the belief unchanged, if it is not finite.
pub fn predict<const N: usize>(
    belief: &mut Belief<N>,
    weights: &Weights,
    f: impl Fn(&SVector<f64, N>) -> SVector<f64, N>,
) -> Option<bool> {
    let (root, repaired) = robust_cholesky(&belief.covariance)?;
    let scale = weights.spread.sqrt();
    let centre = f(&belief.mean);
    let mut ahead = [SVector::<f64, N>::zeros(); N];
    let mut behind = [SVector::<f64, N>::zeros(); N];
    let mut mean = centre * weights.mean;
    for j in 0..N {
        let offset = root.column(j) * scale;
        ahead[j] = f(&(belief.mean + offset));
        behind[j] = f(&(belief.mean - offset));
        mean += (ahead[j] + behind[j]) * weights.outer;
    }
    let from_centre = centre - mean;
    let mut covariance = SMatrix::<f64, N, N>::zeros();
    add_square(&mut covariance, weights.covariance, &from_centre);
    for j in 0..N {
        add_square(&mut covariance, weights.outer, &(ahead[j] - mean));
        add_square(&mut covariance, weights.outer, &(behind[j] - mean));
    }
    *belief = Belief { mean, covariance };
    Some(repaired)
}

/// What the samples make of this prediction: the posterior, and the innovation by which the caller may
/// decide to leave it. Independent channels are taken one after the other, which equals taking them
/// jointly.
pub fn updated<const N: usize, const M: usize>(
    prior: &Belief<N>,
    channels: &[Channel; M],
) -> (Belief<N>, Innovation<M>) {
    let mut after = *prior;
    let mut innovation =
        Innovation { residual: [0.0; M], variance: [0.0; M], available: 0, nis: 0.0, log_likelihood: 0.0 };
    let mut determinant = 1.0;
    for (i, channel) in channels.iter().enumerate() {
        innovation.variance[i] = prior.covariance[(channel.index, channel.index)] + channel.variance;
        if channel.sample.is_nan() {
            continue;
        }
        innovation.residual[i] = channel.sample - prior.mean[channel.index];
        innovation.available += 1;
        let (square, variance) = take(&mut after, channel);
        innovation.nis += square;
        determinant *= TAU * variance;
    }
    innovation.log_likelihood = -0.5 * (innovation.nis + determinant.ln());
    (after, innovation)
}

/// Takes one sample and returns its squared normalised innovation and the innovation's variance.
fn take<const N: usize>(belief: &mut Belief<N>, channel: &Channel) -> (f64, f64) {
    let cross: SVector<f64, N> = belief.covariance.column(channel.index).into();
    let variance = cross[channel.index] + channel.variance;
    let inverse = 1.0 / variance;
    let residual = channel.sample - belief.mean[channel.index];
    belief.mean += cross * (residual * inverse);
    add_square(&mut belief.covariance, -inverse, &cross);
    (residual * residual * inverse, variance)
}
