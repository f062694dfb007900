//! What the sway filter's belief says about the machine: forces and their standard deviations, also a
//! while after the last sample.

use super::sway::{SwayBelief, SwayEstimate, SwayEstimator, SwayState};
use crate::filter::gaussian::Gaussian;
use nalgebra::SVector;

/// Longest step of the model when it is carried ahead, s.
const AHEAD_STEP: f64 = 0.01;
/// Most steps ahead; what lies beyond is held.
const AHEAD_STEPS: f64 = 200.0;

impl SwayEstimator {
    /// The estimate `ahead` seconds after the last sample: its posterior, the mean carried forward
    /// under a drive force, held (the last one if it is NaN).
    pub fn estimate(&self, state: &SwayState, drive_force: f64, ahead: f64) -> SwayEstimate {
        match &state.belief {
            SwayBelief::Two(belief) => self.read(state, belief, drive_force, ahead),
            SwayBelief::Three(belief) => self.read(state, belief, drive_force, ahead),
            SwayBelief::Four(belief) => self.read(state, belief, drive_force, ahead),
        }
    }

    fn read<const N: usize>(&self, state: &SwayState, belief: &Gaussian<N>, force: f64, ahead: f64) -> SwayEstimate {
        let mut mean = belief.mean;
        let last = state.last_force();
        let mut step = self.step_of(state, last, 0.0);
        if ahead > 0.0 {
            step.force = if force.is_finite() { force } else { last };
            let span = ahead.min(AHEAD_STEP * AHEAD_STEPS);
            let steps = (span / AHEAD_STEP).ceil();
            step.dt = span / steps;
            for _ in 0..steps as usize {
                mean = step.propagate(&mean);
            }
            if mean.iter().any(|x| !x.is_finite()) {
                mean = belief.mean;
            }
        }

        let variance = belief.covariance.diagonal();
        let mut estimate = SwayEstimate::default();
        for i in 0..N {
            estimate.state[i] = mean[i];
            estimate.state_std[i] = variance[i].max(0.0).sqrt();
        }
        estimate.state_std[1] = estimate.state_std[1].hypot(step.planar.posture_by_rest() * self.rest_std());
        let (unmodelled, planar) = (self.torque_noise(state), &step.planar);
        estimate.force = step.sway_force(&mean);
        let gradient = gradient(&mean, estimate.force, |x| step.sway_force(x));
        let direct = planar.b * planar.hip_torque_response(mean[1]).1;
        estimate.force_std = (quadratic(belief, &gradient) + direct * direct * unmodelled).sqrt();
        let rate = if N > 2 { mean[2] } else { 0.0 };
        estimate.torque = planar.hip_torque(mean[1], rate);
        let gradient = SVector::<f64, N>::from_fn(|i, _| [0.0, planar.k, planar.c, 0.0][i]);
        estimate.torque_std = quadratic(belief, &gradient).sqrt();
        estimate
    }
}

/// Variance of a quantity with this gradient.
fn quadratic<const N: usize>(belief: &Gaussian<N>, gradient: &SVector<f64, N>) -> f64 {
    gradient.dot(&(belief.covariance * gradient)).max(0.0)
}

/// Forward differences over steps that are small for speeds, angles, rates and torques alike.
fn gradient<const N: usize>(x: &SVector<f64, N>, value: f64, f: impl Fn(&SVector<f64, N>) -> f64) -> SVector<f64, N> {
    const STEP: f64 = 1e-6;
    SVector::from_fn(|i, _| {
        let mut moved = *x;
        moved[i] += STEP;
        (f(&moved) - value) / STEP
    })
}
