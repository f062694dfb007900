//! What the filter expected of a sample, and how its belief led there.

use super::belief::of_kind;
use super::ekf::{ChairEkf, Drive, Form, Sample};
use super::vibration::{LARGEST, LARGEST_DRIVEN};
use super::{ChairBelief, ChairMachine, Inputs, State, Watch};
use crate::Status;
use crate::estimator::Elapsed;
use crate::estimator::one_step::{Belief, OneStepPrediction, PredictedMeasurement, Transition, dynamic};
use crate::filter::discretise::{runge_kutta_from, substeps, transition};
use crate::filter::gaussian::Gaussian;
use nalgebra::{SMatrix, SVector};

/// The rows of a sample.
const CHANNELS: [(&str, &str); 6] = [
    ("distance", "m"),
    ("heading", "rad"),
    ("gyro_pitch", "rad/s"),
    ("accel_x", "m/s2"),
    ("accel_y", "m/s2"),
    ("accel_z", "m/s2"),
];

impl ChairMachine {
    /// See [`Machine::predict_one_step`](crate::estimator::Machine::predict_one_step).
    pub(super) fn predict_one_step(
        &self,
        before: &State,
        inputs: &Inputs,
        elapsed: Elapsed,
        into: &mut OneStepPrediction,
    ) {
        let mut state = before.clone();
        let dt = elapsed.seconds();
        let sample = self.read(&mut state, inputs, dt, &mut Status::default());
        let was_still = state.standstill.is_still();
        let still = self.parameters.filter.detect_standstill && self.is_still(&mut state, &sample, dt);
        if was_still && !still {
            self.end_standstill(&mut state.belief);
        }
        let drive = Drive {
            command: self.acting(&state, state.command),
            accel_x: state.accel_x,
            vibration: state.watch.vibration.forward,
            push: state.watch.push.density(),
            turn: state.watch.turn.density(),
            still,
        };
        self.predict(&mut state, &sample, elapsed, still);
        if let Elapsed::Step(dt) = elapsed {
            // What a standstill that ends adds is noise: it is no part of the belief that moves.
            let cross = of_kind!(self, &before.belief, |filter, belief| filter.cross_covariance(belief, dt, &drive));
            into.transition = Some(Transition { predicted: of(&state.belief), cross });
        }
        let command = self.acting(&state, [inputs.drive_force, inputs.drive_moment]);
        let drive = Drive::reported(command, still);
        let State { belief, watch, .. } = &mut state;
        of_kind!(self, &*belief, |filter, belief| filter.expect(belief, (watch, dt), &sample, &drive, into));
    }

    /// Puts another belief in the place of the filter's.
    pub(super) fn put(state: &mut State, belief: &Belief) {
        match &mut state.belief {
            ChairBelief::Basic(own) => belief.copy_to(own),
            ChairBelief::Biased(own) => belief.copy_to(own),
            ChairBelief::Gravity(own) => belief.copy_to(own),
        }
    }
}

/// Mean and covariance, whatever their form.
pub(super) fn of(belief: &ChairBelief) -> Belief {
    match belief {
        ChairBelief::Basic(belief) => belief.into(),
        ChairBelief::Biased(belief) => belief.into(),
        ChairBelief::Gravity(belief) => belief.into(),
    }
}

impl<F> ChairEkf<F> {
    /// `P Phi^T` over `dt` seconds, [`predict`](Self::predict)'s transition from the same belief.
    fn cross_covariance<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &Gaussian<N>,
        dt: f64,
        drive: &Drive,
    ) -> nalgebra::DMatrix<f64>
    where
        F: Form<N, K, P>,
    {
        let steps = substeps(dt, self.limits.substep);
        let h = dt / steps as f64;
        let (mut mean, mut all) = (belief.mean, SMatrix::<f64, N, N>::identity());
        for _ in 0..steps {
            let (rate, jacobian) = self.form.linearise(&self.chair, &mean, drive);
            let mut step = SMatrix::<f64, N, N>::identity();
            step.fixed_rows_mut::<K>(0).copy_from(&transition(&jacobian, h));
            all = step * all;
            mean = runge_kutta_from(&mean, &rate, h, |x| self.form.derivative(&self.chair, x, drive));
        }
        dynamic(&(belief.covariance * all.transpose()))
    }

    /// The rows of a sample with what the predicted belief says of them.
    fn expect<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &Gaussian<N>,
        (watch, dt): (&mut Watch, f64),
        sample: &Sample,
        drive: &Drive,
        into: &mut OneStepPrediction,
    ) where
        F: Form<N, K, P>,
    {
        let mut rows = self.rows(belief, sample, drive);
        let largest = if self.form.takes_acceleration() { LARGEST_DRIVEN } else { LARGEST };
        let gated = self.gate.deviations > 0.0;
        watch.vibration.add(&mut rows, self.noise.accel * self.noise.accel, dt, largest, gated);
        self.add_turn(&mut rows, watch, dt);
        for (row, (channel, unit)) in CHANNELS.into_iter().enumerate() {
            let gradient = SVector::<f64, N>::from_fn(|i, _| rows.jacobian[(row, i)]);
            let variance = belief.variance_along(&gradient) + rows.noise[(row, row)];
            let measured = if rows.used[row] { sample.values[row] } else { f64::NAN };
            into.expected.push(PredictedMeasurement::new(channel, unit, measured, rows.innovation[row], variance));
        }
    }
}
