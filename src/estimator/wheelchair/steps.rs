//! The steps of a sample: reading, time update, measurement update.

use super::belief::of_kind;
use super::ekf::{Drive, Sample};
use super::outliers::ACCEL_X;
use super::rest::Signs;
use super::wheels::{self, LONGEST_REPEAT};
use super::{ChairBelief, ChairMachine, Inputs, State};
use crate::Status;
use crate::estimator::{Elapsed, Outcome};
use crate::filter::ekf::NotPositiveDefinite;

/// How fast a chair may have moved without encoders otherwise than expected, m/s, and turned, rad/s (one standard deviation).
const UNSEEN_SPEED: f64 = 0.2;
const UNSEEN_YAW_RATE: f64 = 0.1;
/// Time in which it is forgotten that wheels stopped at once, s: what rolls on although its encoders say nothing any more.
const FORGETS_STOP: f64 = 3.0;

impl ChairMachine {
    /// The sample's measurements: wheel angles since their zero, inertial sensors without known biases.
    pub(super) fn read(&self, state: &mut State, inputs: &Inputs, dt: f64, status: &mut Status) -> Sample {
        let readings = state.wheels.read(
            &self.chair,
            [inputs.encoder_right, inputs.encoder_left],
            state.belief.motion(),
            dt,
            self.parameters.limit.wheel_step,
            self.parameters.encoder.zero,
        );
        status.raise_if(readings.implausible, Status::IMPLAUSIBLE);
        status.raise_if(readings.old, Status::MISSING);
        status.raise_if(readings.restarted, Status::RESTARTED);
        if state.stopped > 0.0 {
            state.stopped *= (-dt / FORGETS_STOP).exp();
        }
        if readings.stopped {
            state.stopped = state.stopped.max(state.belief.motion().0.abs());
        }
        let stood = readings.stopped.then_some(LONGEST_REPEAT);
        if let Some(unseen) = readings.guessed.or(stood).filter(|_| state.watch.has_begun()) {
            let moved = [UNSEEN_SPEED.max(state.stopped), UNSEEN_YAW_RATE].map(|rate| (rate * unseen).powi(2));
            for (zero, (known, moved)) in
                state.zeros.iter_mut().zip(state.belief.pose_variances().into_iter().zip(moved))
            {
                *zero += known + moved;
            }
            // Nor does anybody know how it moves.
            of_kind!(self, &mut state.belief, |filter, belief| filter.bridge_gap(belief, 0.0));
        }
        let inertial = [inputs.gyro_pitch, inputs.accel_x, inputs.accel_y, inputs.accel_z];
        let [gyro, accel @ ..]: [f64; 4] = std::array::from_fn(|k| inertial[k] - self.calibration[k]);
        wheels::sample(&self.chair, readings.angles, gyro, accel)
    }

    pub(super) fn is_still(&self, state: &mut State, sample: &Sample, dt: f64) -> bool {
        let [distance, heading, gyro, accel_x, accel_y, _] = sample.values.into();
        let quiet = state.rest.watch(&self.bands, &Signs { distance, heading, gyro, accel: [accel_x, accel_y] });
        state.standstill.update(quiet, self.parameters.standstill.time, dt)
    }

    /// Carries the belief from the last sample to this one, under the command of the last.
    pub(super) fn predict(&self, state: &mut State, sample: &Sample, elapsed: Elapsed, still: bool) {
        match elapsed {
            Elapsed::First => {
                self.widen_slope(state, [sample.values[3], sample.values[4]]);
            }
            Elapsed::Step(dt) => {
                let drive = Drive {
                    command: self.acting(state, state.command),
                    accel_x: state.accel_x,
                    vibration: state.watch.vibration.forward,
                    push: state.watch.push.density(),
                    turn: state.watch.turn.density(),
                    still,
                };
                let brake = &mut state.watch.brake;
                of_kind!(self, &mut state.belief, |filter, belief| filter.predict_watched(belief, brake, dt, &drive));
            }
            Elapsed::Gap(gap) => of_kind!(self, &mut state.belief, |filter, belief| filter.bridge_gap(belief, gap)),
        }
    }

    pub(super) fn correct(
        &self,
        state: &mut State,
        sample: &Sample,
        dt: f64,
        still: bool,
    ) -> Result<Outcome, NotPositiveDefinite> {
        let drive = Drive::reported(self.acting(state, state.command), still);
        // A brake that may hold since the start is known to be any.
        let followed = self.takes_force() && !still && !state.may_be_braked;
        let offset = state.belief.force_offset().filter(|_| followed);
        let State { belief, rejections, watch, .. } = state;
        let done = of_kind!(self, belief, |filter, belief| filter.correct_watched(
            belief,
            rejections,
            (watch, dt),
            sample,
            &drive
        ))?;
        match offset {
            Some(offset) if sample.values[ACCEL_X].is_finite() => {
                let mass = self.chair.inertial_mass();
                let variance = self.basic.noise.accel * self.basic.noise.accel + watch.vibration.forward;
                let force = mass * done.sensors.residual[ACCEL_X] + offset;
                watch.push.follow(force, mass * mass * variance, mass, dt);
            }
            _ => watch.push.interrupt(),
        }
        let mut status = Status::OK;
        status.raise_if(done.sensors.any_rejected(), Status::GATED);
        Ok(Outcome {
            status,
            nis: done.nis,
            channels: done.dof,
            log_likelihood: done.sensors.log_likelihood,
            used: done.sensors.used_count() > 0,
            ..Outcome::default()
        })
    }
}
