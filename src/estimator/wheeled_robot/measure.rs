//! What a sample is held against, and whether its parts agree.

use super::agreement::{ACCELERATION, STEERING};
use super::constants::Slopes;
use super::forces::{Predicted, Readings, sampled};
use super::parameters::Channels;
use super::slip::Expectation;
use super::wheel_speed::Rolled;
use super::{Inputs, RobotMachine, State};
use crate::estimator::Elapsed;
use crate::filter::innovation::Gate;
use crate::filter::square_root::absorb_diagonal;
use crate::model::wheeled_robot::{Drive, Driven, Motion};
use crate::variable::root_sum_square;
use nalgebra::{Vector3, Vector4};

/// Longest step after which the gate judges a sample, s.
const LONGEST_JUDGED: f64 = 0.1;
/// Standard deviations by which the steered yaw rate must have changed since a reading of the gyro that repeats.
const TURNED: f64 = 3.0;

/// What a sample is held against: the measurements with their noise, and the model as it is driven then.
pub(super) struct Measured<'a> {
    pub slopes: Slopes,
    pub readings: Readings,
    /// The measured speed over ground.
    pub reference: Option<f64>,
    pub drive: Drive,
    pub driven: Driven<'a>,
    pub z: Vector4<f64>,
    /// Standard deviations of the measurements.
    pub noise: Vector4<f64>,
    /// Those of the errors of radius and slip in a speed from the wheels, m/s.
    pub rolled: [f64; 2],
    pub gate: Gate,
}

impl RobotMachine {
    /// Everything up to the measurement update: time update, wheel forces, measurements and their noise.
    #[inline]
    pub(super) fn measure(&self, state: &mut State, inputs: &Inputs, elapsed: Elapsed) -> Measured<'_> {
        let (steps, h) = self.steps(elapsed);
        let drive = Drive::new(state.steering, state.forces.force);
        let slopes = self.constants.slopes(
            &self.model,
            &state.belief.mean.into(),
            (&drive, state.forces.acceleration_std),
            &state.grip,
        );
        match elapsed {
            Elapsed::First => {}
            Elapsed::Step(_) => self.predict(state, &drive, &slopes, (steps, h)),
            Elapsed::Gap(gap) => self.bridge_gap(state, gap),
        }

        let readings = Readings::from(inputs);
        state.steering = inputs.steering_angle;
        let drive = Drive::new(state.steering, state.forces.force);
        let (load, lateral) = (state.grip.load, state.grip.lateral);
        let predicted = Predicted { x: state.belief.mean.into(), drive, load, lateral };
        self.observers.step(&mut state.forces, &readings, &self.model, &predicted, (steps, h));
        let reference = sampled(inputs.speed);
        let rolled = (reference.is_none() && self.parameters.filter.channels == Channels::WheelSpeed)
            .then(|| self.wheel_speed.speed(&readings, &state.forces, &predicted))
            .flatten();
        let speed = reference.or(rolled.map(|rolled| rolled.speed));
        if let Some(speed) = speed {
            self.start_at(state, speed, elapsed);
        }

        let drive = Drive::new(state.steering, state.forces.force);
        let driven = self.model.driven(&drive);
        // an acceleration that gave the forces is no measurement any more
        let accel_x = readings.accel_x.filter(|_| readings.torque_is_known);
        let gyro_z = if self.gyro_is_old(state, inputs.gyro_z, &drive) { f64::NAN } else { inputs.gyro_z };
        let z = Vector4::new(accel_x.unwrap_or(f64::NAN), inputs.accel_y, gyro_z, speed.unwrap_or(f64::NAN));
        if self.adapts_noise() {
            let noises = z.component_div(&self.declared_noise());
            state.noise.update(&noises, f64::from(steps) * h);
        }
        let mut noise = self.present_noise(state);
        let rolled = match rolled {
            Some(rolled) => self.watch_slip(state, &rolled, (&readings, &drive), &mut noise, f64::from(steps) * h),
            None => {
                state.slip.skip();
                [0.0; 2]
            }
        };
        // the inputs that held through a pause are not those of the pause
        let gate = if f64::from(steps) * h > LONGEST_JUDGED { Gate::OPEN } else { self.gate };
        Measured { slopes, readings, reference, drive, driven, z, noise, rolled, gate }
    }

    /// Looks whether the wheels slip, and makes the noise of their speed that of what it is worth; standard deviations of
    /// the errors of radius and slip, m/s.
    fn watch_slip(
        &self,
        state: &mut State,
        rolled: &Rolled,
        (readings, drive): (&Readings, &Drive),
        noise: &mut Vector4<f64>,
        dt: f64,
    ) -> [f64; 2] {
        let [vx, vy, r] = Motion::from(state.belief.mean);
        let errors = self.constants.rolled(vx, rolled.slip_std);
        let forced = || self.model.accelerations(&state.grip.lateral, drive)[0];
        let measured = readings.accel_x.map(|accel_x| accel_x + r * r * self.parameters.imu.x);
        let acceleration = match measured {
            Some(measured) => Some((measured + r * vy, noise[0])),
            None => readings.torque_is_known.then(|| (forced() + r * vy, 0.0)),
        };
        if let Some(measured) = measured.filter(|_| readings.torque_is_known && !state.slip.is_right(noise[3])) {
            // without the wheels' speed what the forces lack would add up
            let lacking = measured - forced();
            state.belief.mean[0] += lacking * dt;
            absorb_diagonal(&mut state.belief.factor, &Vector3::new(noise[0] * dt, 0.0, 0.0));
            self.constants.carried_on(&mut state.cross, dt);
        }
        let known = state.belief.variance_along(&Vector3::x()) + state.cross.row(0).norm_squared();
        let variance = known + noise[3] * noise[3] + errors[0] * errors[0] + errors[1] * errors[1];
        let expected = state.belief.mean[0];
        let bias = self.parameters.imu.accel_x_bias_std;
        let sample = Expectation { speed: rolled.speed, expected, variance, noise: noise[3], acceleration, bias };
        if let Some(unsure) = state.slip.update(&sample, dt) {
            absorb_diagonal(&mut state.belief.factor, &Vector3::new(unsure, 0.0, 0.0));
        }
        noise[3] = state.slip.noise(noise[3], dt);
        errors
    }

    /// Yaw rate per angle, 1/s, and yaw rate, rad/s, to which the steering turns a vehicle of this speed whose wheels do not slip.
    fn steered_yaw_rate(&self, speed: f64, drive: &Drive) -> (f64, f64) {
        let per_angle = speed / self.parameters.vehicle.wheelbase();
        (per_angle, per_angle * drive.steering_sin() / drive.steering_cos().max(0.1))
    }

    /// Whether the gyro repeats its reading although the vehicle is steered into another yaw rate than when that was new.
    fn gyro_is_old(&self, state: &mut State, gyro_z: f64, drive: &Drive) -> bool {
        let p = &self.parameters;
        let r = &p.filter.measurement_std;
        let (per_angle, steered) = self.steered_yaw_rate(state.belief.mean[0], drive);
        let by_speed = r.speed * drive.steering_sin() / p.vehicle.wheelbase();
        let noise = root_sum_square([r.gyro_z, per_angle * r.steering_angle, by_speed]);
        state.repetition.is_old(gyro_z, steered, TURNED * noise)
    }

    /// Compares the lateral acceleration with the yaw rate, and this with the steering, at the measured speed.
    pub(super) fn compare(&self, state: &mut State, (z, std): (&Vector4<f64>, &Vector4<f64>), drive: &Drive, dt: f64) {
        let p = &self.parameters;
        let [_, accel_y, gyro_z, speed]: [f64; 4] = (*z).into();
        let [_, accel_y_std, gyro_z_std, _]: [f64; 4] = (*std).into();
        let turning = (gyro_z * speed, gyro_z_std * speed);
        let [acceleration, steering] = &mut state.agreement;
        acceleration.update(&ACCELERATION, turning, (accel_y, accel_y_std), p.imu.accel_y_bias_std, dt);
        let (per_angle, steered) = self.steered_yaw_rate(speed, drive);
        let r = &p.filter.measurement_std;
        let steered = (steered, per_angle * r.steering_angle);
        let bias = (per_angle * r.steering_angle_bias).abs();
        steering.update(&STEERING, steered, (gyro_z, gyro_z_std), bias, dt);
    }
}
