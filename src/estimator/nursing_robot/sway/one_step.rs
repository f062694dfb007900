//! What the sway filter expected of a sample, and how its belief led there.

use super::motion::Step;
use super::{SwayBelief, SwayEstimator, SwaySample, SwayState};
use crate::estimator::one_step::{Belief, OneStepPrediction, PredictedMeasurement, Transition, dynamic};
use crate::filter::gaussian::Gaussian;
use crate::filter::sigma_points::robust_cholesky;
use crate::filter::ukf;
use nalgebra::SMatrix;

impl SwayEstimator {
    /// The channels of a sample.
    pub const CHANNELS: [(&'static str, &'static str); 3] = [("speed", "m/s"), ("tilt", "rad"), ("tilt_rate", "rad/s")];

    /// What is expected of the sample that comes `dt` seconds after the last one, with `mass` kg of load.
    pub fn predict_one_step(
        &self,
        before: &SwayState,
        sample: &SwaySample,
        mass: f64,
        dt: f64,
        into: &mut OneStepPrediction,
    ) {
        let mut state = *before;
        let step = self.begin(&mut state, sample, mass, dt);
        match state.belief {
            SwayBelief::Two(belief) => self.expect::<2, 5>(&state, belief, &step, sample.channels, into),
            SwayBelief::Three(belief) => self.expect::<3, 7>(&state, belief, &step, sample.channels, into),
            SwayBelief::Four(belief) => self.expect::<4, 9>(&state, belief, &step, sample.channels, into),
        }
    }

    fn expect<const N: usize, const P: usize>(
        &self,
        state: &SwayState,
        mut belief: Gaussian<N>,
        step: &Step,
        mut z: [f64; 3],
        into: &mut OneStepPrediction,
    ) {
        if step.held {
            belief.mean[0] = 0.0;
            z[0] = f64::NAN;
        }
        if step.dt > 0.0 {
            let cross = self.cross_covariance(&belief, step);
            let moved = ukf::predict(&mut belief, &self.transform, |x: &[_; P]| step.propagate_all(x)).is_some();
            self.add_noise(&mut belief, step, state.scale.scale);
            // That held wheels do not turn is put into the state and is no measurement of it.
            if let (true, false, Some(cross)) = (moved, step.held, cross) {
                into.transition = Some(Transition { predicted: (&belief).into(), cross: dynamic(&cross) });
            }
        }
        let mut noise = state.noise;
        noise.count(&self.adaptation);
        for (i, (channel, unit)) in Self::CHANNELS.into_iter().enumerate() {
            let index = if i < N { i } else { 0 };
            let sample = if self.use_channel[i] { z[i] } else { f64::NAN };
            let variance = belief.covariance[(index, index)] + noise.variance[i];
            into.expected.push(PredictedMeasurement::new(channel, unit, sample, sample - belief.mean[index], variance));
        }
    }

    /// Covariance of the state before the step with that after it, from the sigma points of the step.
    fn cross_covariance<const N: usize>(&self, belief: &Gaussian<N>, step: &Step) -> Option<SMatrix<f64, N, N>> {
        let (root, _) = robust_cholesky(&belief.covariance)?;
        let mut cross = SMatrix::<f64, N, N>::zeros();
        for j in 0..N {
            let offset = root.column(j) * self.transform.distance;
            let (forward, backward) =
                (step.propagate(&(belief.mean + offset)), step.propagate(&(belief.mean - offset)));
            cross += offset * (forward - backward).transpose() * self.transform.outer;
        }
        Some(cross)
    }
}

impl SwayState {
    /// Mean and covariance, whatever the number of states.
    pub fn belief(&self) -> Belief {
        match &self.belief {
            SwayBelief::Two(belief) => belief.into(),
            SwayBelief::Three(belief) => belief.into(),
            SwayBelief::Four(belief) => belief.into(),
        }
    }

    /// Puts another belief in the place of the filter's.
    pub fn put(&mut self, belief: &Belief) {
        match &mut self.belief {
            SwayBelief::Two(own) => belief.copy_to(own),
            SwayBelief::Three(own) => belief.copy_to(own),
            SwayBelief::Four(own) => belief.copy_to(own),
        }
    }
}
