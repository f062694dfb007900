//! What the filter expected of a sample, and how its belief led there.

use super::belief::{Belief as Motions, STATES};
use super::filter::{Channels, LoaderFilter};
use super::prediction::hold;
use super::supervision::Mode;
use super::{Inputs, LoaderMachine, State, drive, mean};
use crate::Status;
use crate::estimator::Elapsed;
use crate::estimator::one_step::{Belief, OneStepPrediction, PredictedMeasurement, Transition, dynamic};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::square_root::{block, set_block};
use crate::model::wheel_loader::Drive;
use nalgebra::Vector3;

/// The channels of a sample.
const CHANNELS: [(&str, &str); 3] = [("speed", "m/s"), ("wheel_speed_front", "rad/s"), ("wheel_speed_rear", "rad/s")];

/// The states that the filter has, with or without the radii.
fn motion_and_unknowns(belief: &Motions) -> FactoredGaussian<6> {
    FactoredGaussian { mean: block(&belief.mean, 0, 0), factor: block(&belief.factor, 0, 0) }
}

impl LoaderMachine {
    /// See [`Machine::predict_one_step`](crate::estimator::Machine::predict_one_step).
    pub(super) fn predict_one_step(
        &self,
        before: &State,
        inputs: &Inputs,
        screened: Status,
        elapsed: Elapsed,
        into: &mut OneStepPrediction,
    ) {
        let mut state = before.clone();
        let mut y = Vector3::new(inputs.speed, inputs.wheel_speed_front, inputs.wheel_speed_rear);
        let (loader, angle) = (&self.filter.map.machine.loader, inputs.steering_angle);
        let since = if let Elapsed::Step(dt) = elapsed { Some(dt) } else { None };
        let path_std = state.steering.straighten(loader, angle, self.steering_std, &mut y, since);
        let (Some(dt), true) = (since, state.motion_known) else {
            return into.nothing_expected(&CHANNELS);
        };
        let now = drive(inputs);
        let drive = if self.interpolate_inputs { mean(&state.drive, &now) } else { now };
        state.drive = now;
        state.supervision.count(screened);
        if self.supervise {
            self.supervise(&mut state, &drive, &y, path_std, dt);
        } else {
            state.supervision.mode = Mode::Active;
        }
        let State { belief, channels, supervision, .. } = &mut state;
        let sample = (&y, path_std);
        if self.filter.radii {
            self.filter.expect::<STATES, 5>(*belief, channels, supervision.mode, &drive, sample, dt, into);
        } else {
            let belief = motion_and_unknowns(belief);
            self.filter.expect::<6, 3>(belief, channels, supervision.mode, &drive, sample, dt, into);
        }
    }

    /// The states that the filter has.
    pub(super) fn states(&self, state: &State) -> Belief {
        if self.filter.radii { (&state.belief).into() } else { (&motion_and_unknowns(&state.belief)).into() }
    }

    /// Puts another belief in the place of the filter's.
    pub(super) fn put(&self, state: &mut State, belief: &Belief) {
        let own = &mut state.belief;
        if self.filter.radii {
            belief.copy_to_factored(own);
        } else {
            let mut six = motion_and_unknowns(own);
            belief.copy_to_factored(&mut six);
            set_block(&mut own.mean, 0, 0, &six.mean);
            set_block(&mut own.factor, 0, 0, &six.factor);
        }
    }
}

impl LoaderFilter {
    #[expect(clippy::too_many_arguments, reason = "those of a sample, and where the result goes")]
    fn expect<const N: usize, const K: usize>(
        &self,
        mut belief: FactoredGaussian<N>,
        channels: &mut Channels,
        mode: Mode,
        drive: &Drive,
        (y, path_std): (&Vector3<f64>, f64),
        dt: f64,
        into: &mut OneStepPrediction,
    ) {
        let cross = (mode == Mode::Active).then(|| self.prediction.cross_covariance(&belief, &self.map, drive, dt));
        match mode {
            Mode::Held => hold(&mut belief, dt),
            Mode::Settling | Mode::Active => {
                self.prediction.predict::<N, K>(&mut belief, &self.map, drive, dt, mode == Mode::Active);
            }
        }
        // While the unknowns are held they are considered and not estimated: that is no conditioning.
        into.transition = cross.map(|cross| Transition { predicted: (&belief).into(), cross: dynamic(&cross) });
        let noise = self.noise.follow(&belief, (y, path_std), dt, &mut channels.roughness);
        for (i, (channel, unit)) in CHANNELS.into_iter().enumerate() {
            let variance = belief.std(i).powi(2) + noise.level[i] * noise.level[i];
            into.expected.push(PredictedMeasurement::new(channel, unit, y[i], y[i] - belief.mean[i], variance));
        }
    }
}
