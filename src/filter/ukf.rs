//! Unscented Kalman filter of static size with additive process noise and direct measurements of
//! single states.
//!
//! A measurement that is one of the states is linear, for which the unscented transform is exact. So
//! its covariances are read off the predicted covariance, no second set of sigma points is needed, and
//! independent channels can be taken one after the other without inverting a matrix.
//! Yang et al., eq. (44)-(54). Errata: (46) and (47) print the noise of the wrong instants, Q belongs
//! to the step and R to the sample; the points would have to be redrawn after Q has been added.

use super::gaussian::{Gaussian, add_square};
use super::innovation::{Gate, Innovation, Verdict};
use super::sigma_points::{UnscentedTransform, robust_cholesky};
use nalgebra::{SMatrix, SVector};

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

/// Moves the belief through `f` (process noise is added by the caller). Returns whether the
/// covariance had to be repaired; `None`, with the belief unchanged, if it is not finite.
///
/// `f` takes all `P = 2N + 1` points at once, the mean first, which a processor may evaluate side by side.
pub fn predict<const N: usize, const P: usize>(
    belief: &mut Gaussian<N>,
    transform: &UnscentedTransform,
    f: impl Fn(&[SVector<f64, N>; P]) -> [SVector<f64, N>; P],
) -> Option<bool> {
    const { assert!(P == 2 * N + 1, "there are two points per state, and the mean") };
    let (root, repaired) = robust_cholesky(&belief.covariance)?;
    let mut points = [belief.mean; P];
    for j in 0..N {
        let offset = root.column(j) * transform.distance;
        points[1 + j] += offset;
        points[1 + N + j] -= offset;
    }
    let moved = f(&points);
    let (centre, forward, backward) = (moved[0], &moved[1..=N], &moved[1 + N..]);
    let mut mean = centre * transform.mean;
    for j in 0..N {
        mean += (forward[j] + backward[j]) * transform.outer;
    }
    let from_centre = centre - mean;
    let mut covariance = SMatrix::<f64, N, N>::zeros();
    add_square(&mut covariance, transform.covariance, &from_centre);
    for j in 0..N {
        add_square(&mut covariance, transform.outer, &(forward[j] - mean));
        add_square(&mut covariance, transform.outer, &(backward[j] - mean));
    }
    *belief = Gaussian { mean, covariance };
    Some(repaired)
}

/// Measurement update with the channels that have a sample, all of them or, beyond the gate, none.
///
/// Independent channels are taken one after the other, which equals taking them jointly. The gate judges the
/// normalised innovation squared per channel; `in_a_row` counts its rejections. Innovations and noise are in the
/// channels' units; a rejected or missing channel leaves the belief as it was.
pub fn correct<const N: usize, const M: usize>(
    belief: &mut Gaussian<N>,
    channels: &[Channel; M],
    gate: Gate,
    in_a_row: &mut u32,
) -> Innovation<M> {
    let mut posterior = *belief;
    let mut innovation = Innovation::none();
    let mut determinant = 1.0;
    let available = channels.map(|channel| !channel.sample.is_nan());
    for (i, channel) in channels.iter().enumerate().filter(|(i, _)| available[*i]) {
        innovation.residual[i] = channel.sample - belief.mean[channel.index];
        let (residual, variance) = condition(&mut posterior, channel);
        innovation.count(i, residual / variance.sqrt(), variance, &mut determinant);
    }
    if innovation.dof == 0 {
        return innovation;
    }
    if gate.judge(innovation.nis_per_row(), in_a_row) == Verdict::Rejected {
        innovation.rejected = available;
    } else {
        innovation.used = available;
        *belief = posterior;
    }
    innovation.with_determinant(determinant)
}

/// Conditions the belief on one sample; returns the sample's residual and its variance.
fn condition<const N: usize>(belief: &mut Gaussian<N>, channel: &Channel) -> (f64, f64) {
    let cross: SVector<f64, N> = belief.covariance.column(channel.index).into();
    let variance = cross[channel.index] + channel.variance;
    let inverse = 1.0 / variance;
    let residual = channel.sample - belief.mean[channel.index];
    belief.mean += cross * (residual * inverse);
    add_square(&mut belief.covariance, -inverse, &cross);
    (residual, variance)
}
