//! Parameters of the wheeled robot's estimator.

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

/// Most steps of the integrator per sample that can be asked for.
pub(super) const MOST_SUBSTEPS: i32 = 1000;

variables! {
    /// Noise of what the wheel-force observer is given (one standard deviation), for wheel_force_x_*_std.
    pub struct ObserverMeasurementStd {
        /// Of a wheel's speed.
        wheel_speed: f64 = 0.03, "rad/s", [0.0, 1e4], tunable;
        /// Of a torque.
        torque: f64 = 0.05, "N.m", [0.0, 1e6], tunable;
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
        steepness: f64 = 0.08130081300813008, "s/rad", [0.0, 1e5], tunable;
        /// Rate of the low-passed nominal force (lambda); at most a quarter of gain + amplitude * steepness is well damped, 0 switches it off.
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
        /// Measurement noise.
        measurement_std: ObserverMeasurementStd;
        /// Standard deviation of a constant error of the torques, which no measurement shows, for wheel_force_x_*_std.
        torque_bias_std: f64 = 0.05, "N.m", [0.0, 1e6], tunable;
        /// Relative error of the wheel's inertia (one standard deviation), for wheel_force_x_*_std.
        inertia_error: f64 = 0.0, "1", [0.0, 1.0], tunable;
    }
}

variables! {
    /// Process noise: power spectral densities of white noise.
    pub struct ProcessPsd {
        /// Density of the unmodelled longitudinal acceleration.
        speed_x: f64 = 0.04, "m2/s3", [0.0, 1e8], tunable, process_noise;
        /// Density of the unmodelled lateral acceleration.
        speed_y: f64 = 0.04, "m2/s3", [0.0, 1e8], tunable, process_noise;
        /// Density of the unmodelled yaw acceleration.
        yaw_rate: f64 = 0.04, "rad2/s3", [0.0, 1e8], tunable, process_noise;
    }
}

variables! {
    /// Measurement noise (one standard deviation).
    pub struct MeasurementStd {
        /// Of the longitudinal acceleration, errors of the model's force included.
        accel_x: f64 = 0.1, "m/s2", [1e-6, 1e4], tunable, measurement_noise;
        /// Of the lateral acceleration, errors of the model's force included except what the steering angle's noise adds.
        accel_y: f64 = 0.1, "m/s2", [1e-6, 1e4], tunable, measurement_noise;
        /// Of the yaw rate.
        gyro_z: f64 = 0.01, "rad/s", [1e-6, 1e3], tunable, measurement_noise;
        /// Of the longitudinal speed, from the wheels or the reference; from wheels it contains their slip.
        speed: f64 = 0.05, "m/s", [1e-6, 1e3], tunable, measurement_noise;
        /// Standard deviation of the time by which a measured speed over ground comes late, which counts in speed_x_std. Receivers of satellite navigation take 0.05 to 0.2 s.
        speed_delay: f64 = 0.05, "s", [0.0, 1.0], tunable;
        // Not flagged as noise to be tuned: the innovations show only its sum with that of accel_y.
        /// Of the steering angle. Through the front tyres it moves the lateral acceleration that the model expects by 2 tire.front.stiffness / vehicle.mass times this, which adds to the measurement noise in squares.
        steering_angle: f64 = 0.003, "rad", [0.0, 1.0], tunable;
        /// Of a constant error of the steering angle, and of the direction in which the rear wheels roll, which count in the estimates' deviations.
        steering_angle_bias: f64 = 0.005, "rad", [0.0, 1.0], tunable;
    }
}

variables! {
    /// Cubature filter.
    pub struct Filter {
        /// Which measurements it uses.
        channels: Channels = Channels::WheelSpeed, "1", essential;
        /// Whether the input speed is a measured reference that replaces the speed from the wheels.
        use_speed: bool = false, "1";
        /// The axle whose wheels give the speed, best an undriven one; the other one steps in when it has no sample.
        speed_axle: Axle = Axle::Rear, "1";
        /// Process noise.
        process_psd: ProcessPsd;
        /// Measurement noise.
        measurement_std: MeasurementStd;
        /// All channels of a sample are rejected when nis exceeds this; 0 rejects none. After ten rejections in a row samples are let through until one agrees.
        gate: f64 = 16.0, "1", [0.0, 1e9], tunable;
        /// Whether accelerations, yaw rate and speed count as noisier than declared while they are: white noise shows in their third differences.
        adaptive: bool = true, "1", tunable;
        /// Speed below which slip angles are taken as if at this speed (v_min).
        minimum_speed: f64 = 0.5, "m/s", [1e-3, 50.0];
        /// How the equations of motion are made discrete.
        integrator: Method = Method::Euler, "1";
        /// Most steps of the integrator per sample, fewer at higher speed. Euler needs (lateral rate at the minimum speed) * sample_period <= substeps. 0: three, or as many as it needs.
        substeps: i32 = 0, "1", [0, MOST_SUBSTEPS];
    }
}

variables! {
    /// Place of the inertial sensor.
    pub struct Imu {
        /// Forward of the centre of gravity.
        x: f64 = 0.0, "m", [-50.0, 50.0];
        /// Left of the centre of gravity.
        y: f64 = 0.0, "m", [-50.0, 50.0];
        /// Standard deviation of a constant error of accel_x, of an inclined road's share of gravity too, which counts in the estimates' deviations.
        accel_x_bias_std: f64 = 0.2, "m/s2", [0.0, 100.0], tunable;
        /// Standard deviation of a constant error of accel_y, of a banked road's share of gravity too, which counts in the estimates' deviations.
        accel_y_bias_std: f64 = 0.2, "m/s2", [0.0, 100.0], tunable;
        /// Standard deviation of a constant error of gyro_z, which counts in that of the yaw rate.
        gyro_z_bias_std: f64 = 0.005, "rad/s", [0.0, 10.0], tunable;
        /// Relative standard deviation of gyro_z's scale, which counts in that of the yaw rate.
        gyro_z_scale_std: f64 = 0.02, "1", [0.0, 1.0], tunable;
        /// Standard deviation of the time by which the samples of gyro_z come late, which counts in that of the yaw rate. A longer one that they show beside the wheels takes its place, unless it is 0.
        gyro_z_delay_std: f64 = 0.015, "s", [0.0, 1.0], tunable;
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
        sample_period: f64 = 0.01, "s", [1e-5, 1.0], essential;
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
        2.0 * self.tire.front.stiffness * self.filter.measurement_std.steering_angle / self.vehicle.mass
    }
}
