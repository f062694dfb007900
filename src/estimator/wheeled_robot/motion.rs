//! Time and measurement update of the motion `(vx, vy, r)`.

use super::constants::Slopes;
use super::parameters::Parameters;
use super::{RobotMachine, State};
use crate::filter::innovation::{Gate, Innovation};
use crate::filter::signal_noise::LONGEST;
use crate::filter::srckf;
use crate::model::wheeled_robot::{Drive, Driven, Motion, specific_force_at};
use nalgebra::{Vector3, Vector4};

/// Rejections in a row after which the gate lets samples through.
const PATIENCE: u32 = 10;
/// Inflation of an accelerometer's variance before its noise has been seen: engines and rough ground shake it.
const UNSEEN: f64 = 1e3;

/// Standard deviations of the channels `(accel_x, accel_y, gyro_z, speed)`: the steering angle's noise moves the
/// lateral acceleration that the model expects.
pub(super) fn measurement_noise(p: &Parameters) -> Vector4<f64> {
    let r = &p.filter.measurement_std;
    let steered = p.steering_acceleration_std();
    Vector4::new(r.accel_x, (r.accel_y * r.accel_y + steered * steered).sqrt(), r.gyro_z, r.speed)
}

/// The gate over all channels of a sample.
pub(super) fn gate(p: &Parameters) -> Gate {
    Gate { deviations: p.filter.gate.max(0.0).sqrt(), patience: PATIENCE }
}

impl RobotMachine {
    /// Time update over `steps` steps of `h` seconds, with the inputs of the sample before.
    pub(super) fn predict(&self, state: &mut State, drive: &Drive, slopes: &Slopes, (steps, h): (u32, f64)) {
        let driven = self.model.driven(drive);
        self.constants.predict(&mut state.cross, slopes, &state.belief.mean.into(), (steps, h));
        let q = &self.parameters.filter.process_psd;
        let process = Vector3::new(q.speed_x, q.speed_y, q.yaw_rate).map(|density| (density * h).sqrt());
        for _ in 0..steps {
            let speed = state.belief.mean[0];
            srckf::predict(&mut state.belief, &process, |x: &[Vector3<f64>; 6]| {
                self.integration.advance(&driven, x.map(Motion::from), h, speed).map(Vector3::from)
            });
        }
    }

    /// Measurement update with the channels `z`, the standard deviations of their noise and the gate. A speed that nothing
    /// determines must not be moved by noise: it is considered, not updated. `rolled` are the standard deviations of
    /// the errors of radius and slip in a speed from the wheels, m/s.
    pub(super) fn correct(
        &self,
        state: &mut State,
        (z, noise, gate): (&Vector4<f64>, &Vector4<f64>, Gate),
        rolled: [f64; 2],
        slopes: &Slopes,
        driven: &Driven,
    ) -> Innovation<4> {
        let imu = &self.parameters.imu;
        let expected = |x: &[Vector3<f64>; 6]| {
            let accelerations = driven.accelerations_of(&x.map(Motion::from));
            std::array::from_fn(|k| {
                let (ax, ay) = specific_force_at(accelerations[k], x[k][2], imu.x, imu.y);
                Vector4::new(ax, ay, x[k][2], x[k][0])
            })
        };
        let considered = [z[3].is_nan() && state.speed.is_unobservable(), false, false];
        let x = Motion::from(state.belief.mean);
        let shown = self.constants.shown(&state.cross, slopes, &x, rolled);
        let gate = (gate, &mut state.rejections);
        let constants = (&mut state.cross, &shown);
        srckf::correct_considering(&mut state.belief, z, noise, gate, considered, constants, expected)
    }

    /// Standard deviations of the channels' noise now.
    pub(super) fn present_noise(&self, state: &State) -> Vector4<f64> {
        if !self.adapts_noise() {
            return self.noise;
        }
        let declared = self.declared_noise();
        Vector4::from_fn(|j, _| {
            let shaken = j < 2 && !state.noise.is_seen(j);
            let inflation = if shaken { UNSEEN } else { state.noise.inflation(j) };
            (self.noise[j] * self.noise[j] + declared[j] * declared[j] * (inflation - 1.0)).sqrt()
        })
    }

    /// Whether the samples are close enough to show noise, and it is to be seen.
    pub(super) fn adapts_noise(&self) -> bool {
        self.parameters.filter.adaptive && self.parameters.sample_period <= LONGEST
    }

    /// Declared standard deviations of the channels' own noise.
    pub(super) fn declared_noise(&self) -> Vector4<f64> {
        let r = &self.parameters.filter.measurement_std;
        Vector4::new(r.accel_x, r.accel_y, r.gyro_z, r.speed)
    }

    /// Difference between measured and estimated accelerations, squared, mean over those measured; nothing without any.
    pub(super) fn output_error(&self, x: &Motion, accelerations: [f64; 3], z: &Vector4<f64>) -> Option<f64> {
        let (ax, ay) = specific_force_at(accelerations, x[2], self.parameters.imu.x, self.parameters.imu.y);
        let errors = [z[0] - ax, z[1] - ay].into_iter().filter(|error| error.is_finite());
        let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| (sum + error * error, count + 1.0));
        (count > 0.0).then(|| sum / count)
    }
}
