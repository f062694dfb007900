//! Inputs and outputs of the wheeled robot's estimator.

use crate::estimator::Diagnostics;
use crate::variable::Estimate;

variables! {
    /// What is measured. Wheels: front left, front right, rear left, rear right.
    pub struct Inputs {
        /// Steering angle of the front wheels, to the left positive. NaN: the last value holds.
        steering_angle: f64 = f64::NAN, "rad", [-1.6, 1.6], held;
        /// Drive torque at the front left wheel, forward positive. NaN: the last value holds.
        drive_torque_fl: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Drive torque at the front right wheel, forward positive. NaN: the last value holds.
        drive_torque_fr: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Drive torque at the rear left wheel, forward positive. NaN: the last value holds.
        drive_torque_rl: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Drive torque at the rear right wheel, forward positive. NaN: the last value holds.
        drive_torque_rr: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Brake torque at the front left wheel, positive, against its rotation. NaN: the last value holds.
        brake_torque_fl: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Brake torque at the front right wheel, positive, against its rotation. NaN: the last value holds.
        brake_torque_fr: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Brake torque at the rear left wheel, positive, against its rotation. NaN: the last value holds.
        brake_torque_rl: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Brake torque at the rear right wheel, positive, against its rotation. NaN: the last value holds.
        brake_torque_rr: f64 = f64::NAN, "N.m", [-1e6, 1e6], held, optional;
        /// Speed of the front left wheel, forward positive. NaN: no sample.
        wheel_speed_fl: f64 = f64::NAN, "rad/s", [-1e5, 1e5], measured;
        /// Speed of the front right wheel, forward positive. NaN: no sample.
        wheel_speed_fr: f64 = f64::NAN, "rad/s", [-1e5, 1e5], measured;
        /// Speed of the rear left wheel, forward positive. NaN: no sample.
        wheel_speed_rl: f64 = f64::NAN, "rad/s", [-1e5, 1e5], measured;
        /// Speed of the rear right wheel, forward positive. NaN: no sample.
        wheel_speed_rr: f64 = f64::NAN, "rad/s", [-1e5, 1e5], measured;
        /// Longitudinal specific force at the inertial sensor, forward positive. NaN: no sample.
        accel_x: f64 = f64::NAN, "m/s2", [-200.0, 200.0], measured;
        /// Lateral specific force at the inertial sensor, to the left positive. NaN: no sample.
        accel_y: f64 = f64::NAN, "m/s2", [-200.0, 200.0], measured;
        /// Yaw rate, to the left positive; not used with filter.channels = patent. NaN: no sample.
        gyro_z: f64 = f64::NAN, "rad/s", [-100.0, 100.0], measured;
        /// Reference of the longitudinal speed, used if filter.use_speed. NaN: no sample.
        speed: f64 = f64::NAN, "m/s", [-200.0, 200.0], measured;
    }
}

variables! {
    /// What is estimated. Wheels: front left, front right, rear left, rear right. Standard deviations count
    /// the errors of tyres, radius and sensors that the parameters declare.
    pub struct Outputs {
        /// Longitudinal speed of the centre of gravity, forward positive.
        speed_x: Estimate = Estimate::NONE, "m/s";
        /// Lateral speed of the centre of gravity, to the left positive.
        speed_y: Estimate = Estimate::NONE, "m/s";
        /// Yaw rate, to the left positive.
        yaw_rate: Estimate = Estimate::NONE, "rad/s";
        /// Angle from the vehicle's axis to its velocity, to the left positive; 0 below the minimum speed.
        sideslip: Estimate = Estimate::NONE, "rad";
        /// Longitudinal force of the ground on the front left wheel, along the wheel, forward positive.
        wheel_force_x_fl: Estimate = Estimate::NONE, "N";
        /// Longitudinal force of the ground on the front right wheel, along the wheel, forward positive.
        wheel_force_x_fr: Estimate = Estimate::NONE, "N";
        /// Longitudinal force of the ground on the rear left wheel, forward positive.
        wheel_force_x_rl: Estimate = Estimate::NONE, "N";
        /// Longitudinal force of the ground on the rear right wheel, forward positive.
        wheel_force_x_rr: Estimate = Estimate::NONE, "N";
        /// Lateral force of the ground on the front left wheel, across the wheel, to the left positive.
        wheel_force_y_fl: Estimate = Estimate::NONE, "N";
        /// Lateral force of the ground on the front right wheel, across the wheel, to the left positive.
        wheel_force_y_fr: Estimate = Estimate::NONE, "N";
        /// Lateral force of the ground on the rear left wheel, to the left positive.
        wheel_force_y_rl: Estimate = Estimate::NONE, "N";
        /// Lateral force of the ground on the rear right wheel, to the left positive.
        wheel_force_y_rr: Estimate = Estimate::NONE, "N";
        /// Vertical load of the front left wheel. Its standard deviation is that from the accelerations' uncertainty.
        wheel_load_fl: Estimate = Estimate::NONE, "N";
        /// Vertical load of the front right wheel. Its standard deviation is that from the accelerations' uncertainty.
        wheel_load_fr: Estimate = Estimate::NONE, "N";
        /// Vertical load of the rear left wheel. Its standard deviation is that from the accelerations' uncertainty.
        wheel_load_rl: Estimate = Estimate::NONE, "N";
        /// Vertical load of the rear right wheel. Its standard deviation is that from the accelerations' uncertainty.
        wheel_load_rr: Estimate = Estimate::NONE, "N";
        /// Share of the longitudinal acceleration in the normalised innovation squared of the last sample: nis_accel_x, nis_accel_y, nis_gyro_z and nis_speed, each made independent of those before it, add up to nis times nis_channels. 0 without a sample.
        nis_accel_x: f64 = 0.0, "1", [0.0, f64::INFINITY];
        /// Share of the lateral acceleration, independent of nis_accel_x. 0 without a sample.
        nis_accel_y: f64 = 0.0, "1", [0.0, f64::INFINITY];
        /// Share of the yaw rate, independent of the accelerations. 0 without a sample.
        nis_gyro_z: f64 = 0.0, "1", [0.0, f64::INFINITY];
        /// Share of the speed, independent of the other three. 0 without a sample.
        nis_speed: f64 = 0.0, "1", [0.0, f64::INFINITY];
        /// Mean squared difference between the accelerations that were measured last and the estimated ones.
        output_error: f64 = 0.0, "m2/s4", [0.0, f64::INFINITY];
        /// What holds of the last sample.
        @flat diagnostics: Diagnostics;
    }
}

impl AsMut<Diagnostics> for Outputs {
    fn as_mut(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}
