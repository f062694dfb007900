//! Declared variables of the wheeled robot: parameters, inputs, outputs.

use crate::Status;
use crate::model::tire::TireSet;
use crate::model::wheeled_robot::{Rolling, Vehicle, Wheel};

choice! {
    /// Which measurements the filter uses, besides an optional reference speed.
    pub enum Channels {
        /// Longitudinal and lateral acceleration, the source's choice.
        Patent = "patent",
        /// These and the yaw rate.
        Gyro = "gyro",
        /// These and the longitudinal speed from the wheels.
        WheelSpeed = "wheel_speed",
    }
}

choice! {
    /// How the equations of motion are made discrete.
    pub enum Method {
        /// Explicit Euler.
        Euler = "euler",
        /// Runge-Kutta of fourth order.
        Rk4 = "rk4",
    }
}

choice! {
    /// The axle whose wheels give the longitudinal speed.
    pub enum Axle {
        /// The rear axle.
        Rear = "rear",
        /// The front axle.
        Front = "front",
    }
}

variables! {
    /// Wheel-force observer.
    pub struct Observer {
        /// Linear gain (k).
        gain: f64 = 10.0, "1/s", [0.0, 1e5], tunable;
        /// Amplitude of the smooth switching term (eps); with adaptation its start.
        amplitude: f64 = 246.0, "rad/s2", [0.0, 1e8], tunable;
        /// Steepness of the smooth switching term (a).
        width: f64 = 0.08130081300813008, "s/rad", [0.0, 1e5], tunable;
        /// Rate of the low-passed nominal force (lambda); at most a quarter of gain + amplitude * width is well damped, 0 switches it off.
        nominal_rate: f64 = 7.5, "1/s", [0.0, 1e5], tunable;
        /// Whether the nominal force contains the torque over the radius.
        feedforward: bool = false, "1", tunable;
        /// Largest longitudinal force of one wheel that is reported (f_max).
        force_limit: f64 = 1e9, "N", [1e-6, 1e12], tunable;
        /// Whether the amplitude adapts itself.
        adaptive: bool = false, "1", tunable;
        /// Rate of the adaptation (gamma).
        adaptation_rate: f64 = 200.0, "1/s2", [0.0, 1e8], tunable;
        /// Error of the wheel's speed below which the amplitude shrinks.
        dead_zone: f64 = 0.3, "rad/s", [0.0, 1e4], tunable;
        /// Least adapted amplitude.
        amplitude_min: f64 = 10.0, "rad/s2", [0.0, 1e8], tunable;
        /// Greatest adapted amplitude.
        amplitude_max: f64 = 300.0, "rad/s2", [0.0, 1e8], tunable;
        /// Wheel speed below which a brake's torque fades out, so that a brake held at rest makes no false force; 0 lets its sign jump.
        stop_speed: f64 = 0.5, "rad/s", [0.0, 1e3], tunable;
        /// Standard deviation of the wheel speeds' noise, for wheel_force_x_*_std.
        wheel_speed_std: f64 = 0.03, "rad/s", [0.0, 1e4], tunable;
        /// Standard deviation of the torques' noise, for wheel_force_x_*_std.
        torque_std: f64 = 0.05, "N.m", [0.0, 1e6], tunable;
        /// Standard deviation of a constant error of the torques, which no measurement shows, for wheel_force_x_*_std.
        torque_bias_std: f64 = 0.0, "N.m", [0.0, 1e6], tunable;
        /// Relative error of the wheel's inertia (one standard deviation), for wheel_force_x_*_std.
        inertia_error: f64 = 0.0, "1", [0.0, 1.0], tunable;
    }
}

variables! {
    /// Process noise per sample period (one standard deviation).
    pub struct ProcessStd {
        /// Of the longitudinal speed.
        speed_x: f64 = 0.02, "m/s", [0.0, 1e3], tunable;
        /// Of the lateral speed.
        speed_y: f64 = 0.02, "m/s", [0.0, 1e3], tunable;
        /// Of the yaw rate.
        yaw_rate: f64 = 0.02, "rad/s", [0.0, 1e3], tunable;
    }
}

variables! {
    /// Measurement noise (one standard deviation).
    pub struct MeasurementStd {
        /// Of the longitudinal acceleration, errors of the model's force included.
        accel_x: f64 = 0.1, "m/s2", [1e-6, 1e4], tunable;
        /// Of the lateral acceleration, errors of the model's force included except what filter.steering_std adds.
        accel_y: f64 = 0.1, "m/s2", [1e-6, 1e4], tunable;
        /// Of the yaw rate.
        gyro_z: f64 = 0.01, "rad/s", [1e-6, 1e3], tunable;
        /// Of the longitudinal speed, from the wheels or the reference; from wheels it contains their slip.
        speed: f64 = 0.05, "m/s", [1e-6, 1e3], tunable;
    }
}

variables! {
    /// Cubature filter.
    pub struct Filter {
        /// Which measurements it uses.
        channels: Channels = Channels::WheelSpeed, "1";
        /// Whether the input speed is a measured reference that replaces the speed from the wheels.
        use_speed: bool = false, "1";
        /// The axle whose wheels give the speed, best an undriven one; the other one steps in when it has no sample.
        speed_axle: Axle = Axle::Rear, "1";
        /// Process noise.
        process_std: ProcessStd;
        /// Measurement noise.
        measurement_std: MeasurementStd;
        /// Standard deviation of the steering angle's noise d: through the front tyres it moves the lateral acceleration that the model expects by 2 tire.front.stiffness d / vehicle.mass, which adds to the measurement noise in squares.
        steering_std: f64 = 0.003, "rad", [0.0, 1.0], tunable;
        /// A measurement is rejected when nis exceeds this; 0 accepts all. After ten rejections in a row the next one is accepted.
        gate: f64 = 0.0, "1", [0.0, 1e9], tunable;
        /// Speed below which slip angles are taken as if at this speed (v_min).
        minimum_speed: f64 = 0.5, "m/s", [1e-3, 50.0];
        /// How the equations of motion are made discrete.
        integrator: Method = Method::Euler, "1";
        /// Most steps of the integrator per sample, fewer at higher speed. Euler needs (lateral rate at the minimum speed) * sample_period <= substeps.
        substeps: i32 = 3, "1", [1, 1000];
    }
}

variables! {
    /// Place of the inertial sensor.
    pub struct Imu {
        /// Ahead of the centre of gravity.
        x: f64 = 0.0, "m", [-50.0, 50.0];
        /// Left of the centre of gravity.
        y: f64 = 0.0, "m", [-50.0, 50.0];
    }
}

variables! {
    /// Start of the estimates.
    pub struct Initial {
        /// Longitudinal speed; a measured speed of the first sample takes its place if it is far from it.
        speed_x: f64 = 0.0, "m/s", [-200.0, 200.0];
        /// Standard deviation of the longitudinal speed.
        speed_x_std: f64 = 0.5, "m/s", [0.0, 200.0];
        /// Standard deviation of the lateral speed.
        speed_y_std: f64 = 0.2, "m/s", [0.0, 200.0];
        /// Standard deviation of the yaw rate.
        yaw_rate_std: f64 = 0.2, "rad/s", [0.0, 100.0];
    }
}

variables! {
    /// Parameters. The defaults are a four-wheeled robot of 60 kg.
    pub struct Parameters {
        /// Time between two samples.
        sample_period: f64 = 0.01, "s", [1e-5, 1.0];
        /// Masses and lengths.
        vehicle: Vehicle;
        /// Wheels.
        wheel: Wheel;
        /// Tyres.
        tire: TireSet;
        /// Rolling resistance.
        rolling: Rolling;
        /// Wheel-force observer.
        observer: Observer;
        /// Cubature filter.
        filter: Filter;
        /// Inertial sensor.
        imu: Imu;
        /// Start of the estimates.
        initial: Initial;
    }
}

impl Parameters {
    /// Lateral acceleration by which the steering angle's noise moves the model through the front tyres, m/s^2 (one
    /// standard deviation).
    pub fn steering_acceleration_std(&self) -> f64 {
        2.0 * self.tire.front.stiffness * self.filter.steering_std / self.vehicle.mass
    }
}

variables! {
    /// What is measured; sensors that are not connected have no sample. Wheels: front left, front right, rear left,
    /// rear right.
    pub struct Inputs {
        /// Steering angle of the front wheels, to the left positive. NaN: the last one is used.
        steering_angle: f64 = 0.0, "rad", [-1.6, 1.6], measured;
        /// Drive torque at the front left wheel, forward positive. NaN: the last one is used.
        drive_torque_fl: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
        /// Drive torque at the front right wheel, forward positive. NaN: the last one is used.
        drive_torque_fr: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
        /// Drive torque at the rear left wheel, forward positive. NaN: the last one is used.
        drive_torque_rl: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
        /// Drive torque at the rear right wheel, forward positive. NaN: the last one is used.
        drive_torque_rr: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
        /// Brake torque at the front left wheel, positive, against its rotation. NaN: the last one is used.
        brake_torque_fl: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
        /// Brake torque at the front right wheel, positive, against its rotation. NaN: the last one is used.
        brake_torque_fr: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
        /// Brake torque at the rear left wheel, positive, against its rotation. NaN: the last one is used.
        brake_torque_rl: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
        /// Brake torque at the rear right wheel, positive, against its rotation. NaN: the last one is used.
        brake_torque_rr: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
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
        /// Yaw rate, to the left positive. NaN: no sample.
        gyro_z: f64 = f64::NAN, "rad/s", [-100.0, 100.0], measured;
        /// Reference of the longitudinal speed, used if filter.use_speed. NaN: no sample.
        speed: f64 = f64::NAN, "m/s", [-200.0, 200.0], measured;
    }
}

variables! {
    /// What is estimated. Wheels: front left, front right, rear left, rear right.
    pub struct Outputs {
        /// Longitudinal speed of the centre of gravity, forward positive.
        speed_x: f64 = 0.0, "m/s";
        /// Standard deviation of speed_x.
        speed_x_std: f64 = 0.0, "m/s";
        /// Lateral speed of the centre of gravity, to the left positive.
        speed_y: f64 = 0.0, "m/s";
        /// Standard deviation of speed_y, without errors of the tyre's parameters.
        speed_y_std: f64 = 0.0, "m/s";
        /// Yaw rate, to the left positive.
        yaw_rate: f64 = 0.0, "rad/s";
        /// Standard deviation of yaw_rate.
        yaw_rate_std: f64 = 0.0, "rad/s";
        /// Angle from the vehicle's axis to its velocity, to the left positive; 0 below the minimum speed.
        sideslip: f64 = 0.0, "rad";
        /// Standard deviation of sideslip.
        sideslip_std: f64 = 0.0, "rad";
        /// Longitudinal force of the ground on the front left wheel, along the wheel, forward positive.
        wheel_force_x_fl: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_x_fl.
        wheel_force_x_fl_std: f64 = 0.0, "N";
        /// Longitudinal force of the ground on the front right wheel, along the wheel, forward positive.
        wheel_force_x_fr: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_x_fr.
        wheel_force_x_fr_std: f64 = 0.0, "N";
        /// Longitudinal force of the ground on the rear left wheel, forward positive.
        wheel_force_x_rl: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_x_rl.
        wheel_force_x_rl_std: f64 = 0.0, "N";
        /// Longitudinal force of the ground on the rear right wheel, forward positive.
        wheel_force_x_rr: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_x_rr.
        wheel_force_x_rr_std: f64 = 0.0, "N";
        /// Lateral force of the ground on the front left wheel, across the wheel, to the left positive.
        wheel_force_y_fl: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_y_fl, without errors of the tyre's parameters.
        wheel_force_y_fl_std: f64 = 0.0, "N";
        /// Lateral force of the ground on the front right wheel, across the wheel, to the left positive.
        wheel_force_y_fr: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_y_fr, without errors of the tyre's parameters.
        wheel_force_y_fr_std: f64 = 0.0, "N";
        /// Lateral force of the ground on the rear left wheel, to the left positive.
        wheel_force_y_rl: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_y_rl, without errors of the tyre's parameters.
        wheel_force_y_rl_std: f64 = 0.0, "N";
        /// Lateral force of the ground on the rear right wheel, to the left positive.
        wheel_force_y_rr: f64 = 0.0, "N";
        /// Standard deviation of wheel_force_y_rr, without errors of the tyre's parameters.
        wheel_force_y_rr_std: f64 = 0.0, "N";
        /// Vertical load of the front left wheel.
        wheel_load_fl: f64 = 0.0, "N";
        /// Standard deviation of wheel_load_fl from the accelerations' uncertainty.
        wheel_load_fl_std: f64 = 0.0, "N";
        /// Vertical load of the front right wheel.
        wheel_load_fr: f64 = 0.0, "N";
        /// Standard deviation of wheel_load_fr from the accelerations' uncertainty.
        wheel_load_fr_std: f64 = 0.0, "N";
        /// Vertical load of the rear left wheel.
        wheel_load_rl: f64 = 0.0, "N";
        /// Standard deviation of wheel_load_rl from the accelerations' uncertainty.
        wheel_load_rl_std: f64 = 0.0, "N";
        /// Vertical load of the rear right wheel.
        wheel_load_rr: f64 = 0.0, "N";
        /// Standard deviation of wheel_load_rr from the accelerations' uncertainty.
        wheel_load_rr_std: f64 = 0.0, "N";
        /// Normalised innovation squared of the last measurement over its number of channels, 1 on average if the noise settings are right.
        nis: f64 = 0.0, "1";
        /// Squared innovation of the longitudinal acceleration over its variance.
        nis_accel_x: f64 = 0.0, "1";
        /// Squared innovation of the lateral acceleration over its variance.
        nis_accel_y: f64 = 0.0, "1";
        /// Squared innovation of the yaw rate over its variance.
        nis_gyro_z: f64 = 0.0, "1";
        /// Squared innovation of the speed over its variance.
        nis_speed: f64 = 0.0, "1";
        /// Logarithm of the likelihood of the last measurement, 0 without one.
        log_likelihood: f64 = 0.0, "1";
        /// Mean squared difference between the last measured and the estimated accelerations.
        output_error: f64 = 0.0, "m2/s4";
        /// Conditions of the last sample, one bit each.
        status: Status = Status::OK, "1";
        /// Whether speed_x, speed_y and yaw_rate are usable now.
        healthy: bool = false, "1";
    }
}
