//! Time and measurement update of the motion `(vx, vy, r)`.

use super::parameters::Parameters;
use super::{RobotMachine, State};
use crate::filter::innovation::{Gate, Innovation};
use crate::filter::srckf;
use crate::model::wheeled_robot::{Drive, Driven, Motion, specific_force_at};
use nalgebra::{Vector3, Vector4};

/// Rejections in a row after which the gate lets samples through.
const PATIENCE: u32 = 10;

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
    pub(super) fn predict(&self, state: &mut State, (steps, h): (u32, f64)) {
        let driven = self.model.driven(&Drive::new(state.steering, state.forces.force));
        let q = &self.parameters.filter.process_psd;
        let process = Vector3::new(q.speed_x, q.speed_y, q.yaw_rate).map(|density| (density * h).sqrt());
        for _ in 0..steps {
            let speed = state.belief.mean[0];
            srckf::predict(&mut state.belief, &process, |x: &[Vector3<f64>; 6]| {
                self.integration.advance(&driven, x.map(Motion::from), h, speed).map(Vector3::from)
            });
        }
    }

    /// Measurement update. A speed that nothing determines must not be moved by noise: it is considered, not updated.
    pub(super) fn correct(&self, state: &mut State, z: &Vector4<f64>, driven: &Driven) -> Innovation<4> {
        let imu = &self.parameters.imu;
        let expected = |x: &[Vector3<f64>; 6]| {
            let accelerations = driven.accelerations_of(&x.map(Motion::from));
            std::array::from_fn(|k| {
                let (ax, ay) = specific_force_at(accelerations[k], x[k][2], imu.x, imu.y);
                Vector4::new(ax, ay, x[k][2], x[k][0])
            })
        };
        let considered = [z[3].is_nan() && state.speed.is_unobservable(), false, false];
        srckf::correct(&mut state.belief, z, &self.noise, (self.gate, &mut state.rejections), considered, expected)
    }

    /// Difference between measured and estimated accelerations, squared, mean over those measured; nothing without any.
    pub(super) fn output_error(&self, x: &Motion, accelerations: [f64; 3], z: &Vector4<f64>) -> Option<f64> {
        let (ax, ay) = specific_force_at(accelerations, x[2], self.parameters.imu.x, self.parameters.imu.y);
        let errors = [z[0] - ax, z[1] - ay].into_iter().filter(|error| error.is_finite());
        let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| (sum + error * error, count + 1.0));
        (count > 0.0).then(|| sum / count)
    }
}
