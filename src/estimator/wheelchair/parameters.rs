//! Parameters of the wheelchair's estimator and the chair that they describe.

use super::ekf::{Limits, Noise};
use crate::filter::innovation::Gate;
use crate::model::STANDARD_GRAVITY;
use crate::model::wheelchair::{
    Accelerometer, Chair, ChairParameters, Dynamics, Gyro, ImuParameters, RollingParameters,
};
use crate::{ParameterError, Variables};
use std::f64::consts::PI;

crate::choice! {
    /// Equations of motion and sensors.
    pub enum Model { Paper = "paper", Full = "full" }
}

crate::choice! {
    /// State of the filter.
    pub enum Kind {
        Basic = "basic",
        Bias = "bias",
        AccelerationInput = "acceleration_input",
        GravityVector = "gravity_vector",
    }
}

crate::choice! {
    /// What the wheel angles count from.
    pub enum Zero { Auto = "auto", Absolute = "absolute", FirstSample = "first_sample" }
}

crate::variables! {
    /// What is known at the start.
    pub struct InitialParameters {
        /// Heading at the start relative to the slope's contour line, counter-clockwise; pi/2 climbs straight.
        heading: f64 = 0.0, "rad", [-1e4, 1e4], essential;
        /// Forward speed at the start.
        speed: f64 = 0.0, "m/s", [-20.0, 20.0];
        /// Slope at the start, positive uphill.
        slope: f64 = 0.0, "rad", [-1.5, 1.5];
        /// Bias of the gyro: where the kind estimates it, its start, otherwise subtracted.
        gyro_bias: f64 = 0.0, "rad/s", [-10.0, 10.0];
        /// Bias of the forward accelerometer: where the kind estimates it, its start, otherwise subtracted.
        accel_x_bias: f64 = 0.0, "m/s2", [-10.0, 10.0];
        /// Bias of the leftward accelerometer: where the kind estimates it, its start, otherwise subtracted.
        accel_y_bias: f64 = 0.0, "m/s2", [-10.0, 10.0];
        /// Bias of the upward accelerometer: where the kind estimates it, its start, otherwise subtracted.
        accel_z_bias: f64 = 0.0, "m/s2", [-10.0, 10.0];
        /// Standard deviation of the distance at the start.
        distance_std: f64 = 0.005, "m", [1e-9, 1e3];
        /// Standard deviation of the heading at the start.
        heading_std: f64 = 0.02, "rad", [1e-9, 10.0];
        /// Standard deviation of the speed at the start.
        speed_std: f64 = 0.02, "m/s", [1e-9, 100.0];
        /// Standard deviation of the yaw rate at the start.
        yaw_rate_std: f64 = 0.02, "rad/s", [1e-9, 100.0];
        /// Standard deviation of the slope at the start.
        slope_std: f64 = 0.01, "rad", [1e-9, 10.0];
        /// Standard deviation of the slope's rate at the start.
        slope_rate_std: f64 = 0.02, "rad/s", [1e-9, 100.0];
        /// Standard deviation of the gyro's bias.
        gyro_bias_std: f64 = 0.02, "rad/s", [1e-9, 10.0];
        /// Standard deviation of the accelerometer's bias, per axis.
        accel_bias_std: f64 = 0.1, "m/s2", [1e-9, 10.0];
        /// Standard deviation of the heading at which the encoders read zero. If it is not small use the kind gravity_vector, which needs no heading.
        heading_offset_std: f64 = 1e-6, "rad", [1e-9, 10.0];
        /// Standard deviation of the drive force's relative error, that of the mass included; 0 = exact. With the kinds bias, gravity_vector and (standard deviations only) basic.
        force_gain_std: f64 = 0.1, "1", [0.0, 10.0];
        /// Standard deviation of an unmodelled force, such as unknown rolling resistance or a push; 0 = none. With the kinds bias, gravity_vector and (standard deviations only) basic.
        force_offset_std: f64 = 3.0, "N", [0.0, 1e4];
        /// Standard deviation of an unmodelled moment, such as hands that steer; 0 = none. Where the heading comes from gravity, and in the standard deviations of basic.
        moment_offset_std: f64 = 3.0, "N.m", [0.0, 1e4];
        /// Standard deviation of rolling.coefficient, which counts in those of slope, pitch and a heading that gravity gives: more rolling resistance takes the drive force that a slope takes.
        rolling_coefficient_std: f64 = 0.0075, "1", [0.0, 1.0], tunable;
    }
}

crate::variables! {
    /// The wheel encoders.
    pub struct EncoderParameters {
        /// Whether the encoders count rotation relative to the frame, so that pitching of the body counts as travel.
        counts_body_pitch: bool = true, "1";
        /// What the wheel angles count from: absolute = zero at distance 0 and the initial heading, first_sample = the first reading is that zero, auto = absolute if the first reading is near it.
        zero: Zero = Zero::Auto, "1";
    }
}

crate::variables! {
    /// Process noise: power spectral densities of white noise.
    pub struct ProcessParameters {
        /// Density of the unmodelled acceleration along the heading.
        speed: f64 = 1e-3, "m2/s3", [0.0, 1e3], tunable, process_noise;
        /// Density of the unmodelled yaw acceleration.
        yaw_rate: f64 = 4e-3, "rad2/s3", [0.0, 1e3], tunable, process_noise;
        /// Density of the slope's second derivative.
        slope_rate: f64 = 0.5, "rad2/s3", [0.0, 1e3], tunable, process_noise;
        /// Density of the drift of the gyro's bias.
        gyro_bias: f64 = 1e-8, "rad2/s3", [0.0, 1.0], tunable, process_noise;
        /// Density of the drift of the accelerometer's bias.
        accel_bias: f64 = 1e-6, "m2/s5", [0.0, 1.0], tunable, process_noise;
        /// Density of the drift of the heading relative to the encoders, from slipping wheels.
        heading_offset: f64 = 0.0, "rad2/s", [0.0, 1.0], tunable, process_noise;
        /// Density of the drift of an unmodelled force; with the kinds bias and gravity_vector.
        force_offset: f64 = 4.0, "N2/s", [0.0, 1e6], tunable, process_noise;
        /// Density of the drift of an unmodelled moment; where the heading comes from gravity.
        moment_offset: f64 = 1.0, "N2.m2/s", [0.0, 1e6], tunable, process_noise;
    }
}

crate::variables! {
    /// Measurement noise: standard deviations per sample.
    pub struct MeasurementParameters {
        /// Standard deviation of one wheel angle.
        encoder: f64 = 3e-3, "rad", [1e-9, 10.0], tunable, measurement_noise;
        /// Standard deviation of the gyro.
        gyro: f64 = 5e-3, "rad/s", [1e-9, 10.0], tunable, measurement_noise;
        /// Standard deviation of the accelerometer, per axis.
        accel: f64 = 0.05, "m/s2", [1e-9, 100.0], tunable, measurement_noise;
        /// Standard deviation of the slope's second derivative, which the accelerometer feels through its lever.
        slope_acceleration: f64 = 1.0, "rad/s2", [0.0, 1e3], tunable, measurement_noise;
        /// Standard deviation of the time by which the samples of encoders and gyro come late, which counts in the deviations of distance, heading and slope rate. A longer one that the encoders show beside the accelerometer takes its place, and counts in that of the speed, unless it is 0.
        delay: f64 = 0.015, "s", [0.0, 1.0], tunable;
        /// Standard deviation of the speed of a chair that stands still.
        standstill_speed: f64 = 2e-3, "m/s", [1e-9, 1.0], tunable, measurement_noise;
        /// Standard deviation of the yaw rate and the tilt rates of a chair that stands still.
        standstill_rate: f64 = 2e-3, "rad/s", [1e-9, 1.0], tunable, measurement_noise;
    }
}

crate::variables! {
    /// The filter.
    pub struct FilterParameters {
        /// Equations: full = Newton-Euler with resistance terms, paper = those of Oh and Hori, corrected.
        model: Model = Model::Full, "1";
        /// State: basic = 6 states, bias = with biases of the sensors and errors of the drive force, acceleration_input = with biases of the sensors and the measured acceleration in place of the drive force, gravity_vector = as bias, without need of an initial heading.
        kind: Kind = Kind::Bias, "1", essential;
        /// Whether a chair that does not move is recognised, for which brakes and static friction are then allowed.
        detect_standstill: bool = true, "1", tunable;
        /// Whether the slope is reported as not negative, the heading then by half a turn around.
        canonical_slope: bool = false, "1", tunable;
        /// Rejects a channel beyond this many standard deviations of its prediction; 0 = never.
        gate: f64 = 0.0, "1", [0.0, 1e6], tunable;
        /// Beyond this many standard deviations of its prediction an accelerometer's sample is down-weighted, the more the further off it is, as on a kerb or a ramp's edge; 0 = never. Without effect if a gate is set.
        outlier_threshold: f64 = 4.0, "1", [0.0, 1e6], tunable;
        /// After this many rejections in a row one sample is accepted.
        gate_patience: i32 = 10, "1", [0, 1_000_000], tunable;
        /// Process noise.
        process_psd: ProcessParameters;
        /// Measurement noise.
        measurement_std: MeasurementParameters;
    }
}

crate::variables! {
    /// When a chair stands still: bands of about 2.5 steps of the encoders.
    pub struct StandstillParameters {
        /// Time without motion after which the chair stands still.
        time: f64 = 0.3, "s", [0.0, 1e3], tunable;
        /// Largest change of the distance at standstill.
        distance_band: f64 = 1.2e-3, "m", [1e-9, 1.0], tunable;
        /// Largest change of the heading at standstill.
        heading_band: f64 = 4e-3, "rad", [1e-9, 1.0], tunable;
        /// Largest pitch rate at standstill.
        gyro_band: f64 = 0.05, "rad/s", [1e-9, 10.0], tunable;
        /// Largest deviation of the forward and leftward accelerometer from its mean at standstill.
        accel_band: f64 = 0.25, "m/s2", [1e-9, 100.0], tunable;
    }
}

crate::variables! {
    /// Plausibility: beyond these a sample counts as missing.
    pub struct LimitParameters {
        /// Largest specific force per axis; beyond, the accelerometer is saturated.
        accel: f64 = 39.2, "m/s2", [0.1, 1e4];
        /// Largest pitch rate; beyond, the gyro is saturated.
        gyro: f64 = 8.7, "rad/s", [0.1, 1e4];
        /// Largest deviation of a wheel angle from where speed and yaw rate put it; if it persists, the counter has restarted.
        wheel_step: f64 = 0.5, "rad", [0.01, 1e6];
        /// Largest drive force.
        drive_force: f64 = 5e3, "N", [1.0, 1e6];
        /// Largest drive moment.
        drive_moment: f64 = 2e3, "N.m", [1.0, 1e6];
        /// Largest speed; beyond it the filter has diverged and restarts.
        speed: f64 = 20.0, "m/s", [0.1, 1e3];
        /// Largest yaw rate; beyond it the filter has diverged and restarts.
        yaw_rate: f64 = 30.0, "rad/s", [0.1, 1e3];
        /// Standard deviation of the slope above which the estimates are not healthy.
        healthy_slope_std: f64 = 0.03, "rad", [1e-6, 10.0];
        /// Standard deviation of the speed above which the estimates are not healthy.
        healthy_speed_std: f64 = 0.1, "m/s", [1e-6, 100.0];
    }
}

crate::variables! {
    /// Parameters of the wheelchair's estimator.
    pub struct Parameters {
        /// Time between two samples.
        sample_period: f64 = 0.01, "s", [1e-5, 1.0], essential;
        /// Gravity.
        gravity: f64 = STANDARD_GRAVITY, "m/s2", [0.1, 30.0];
        /// The chair with its user.
        chair: ChairParameters;
        /// Rolling resistance.
        rolling: RollingParameters;
        /// Where the accelerometer sits.
        imu: ImuParameters;
        /// The wheel encoders.
        encoder: EncoderParameters;
        /// What is known at the start.
        initial: InitialParameters;
        /// The filter.
        filter: FilterParameters;
        /// When a chair stands still.
        standstill: StandstillParameters;
        /// Plausibility.
        limit: LimitParameters;
    }
}

impl Parameters {
    /// The chair that these parameters describe.
    pub fn chair(&self) -> Chair {
        let (dynamics, gyro, accelerometer) = match self.filter.model {
            Model::Paper => (Dynamics::Paper, Gyro::Paper, Accelerometer::Paper),
            Model::Full => (Dynamics::Full, Gyro::Body, Accelerometer::Rigid),
        };
        Chair {
            gravity: self.gravity,
            heading_reference: self.initial.heading,
            pitch_travel: if self.encoder.counts_body_pitch { self.chair.wheel_radius } else { 0.0 },
            dynamics,
            gyro,
            accelerometer,
            ..Chair::new(self.chair, self.rolling, self.imu)
        }
    }

    /// Noise of process and measurements.
    pub fn noise(&self) -> Noise {
        let (process, measured) = (&self.filter.process_psd, &self.filter.measurement_std);
        Noise {
            speed: process.speed,
            yaw_rate: process.yaw_rate,
            slope_rate: process.slope_rate,
            gyro_bias: process.gyro_bias,
            accel_bias: process.accel_bias,
            heading_offset: process.heading_offset,
            force_offset: process.force_offset,
            moment_offset: process.moment_offset,
            encoder: measured.encoder,
            gyro: measured.gyro,
            accel: measured.accel,
            slope_acceleration: measured.slope_acceleration,
            standstill_speed: measured.standstill_speed,
            standstill_rate: measured.standstill_rate,
        }
    }

    /// Limits of sensors and steps.
    pub fn limits(&self) -> Limits {
        Limits { outlier_threshold: self.filter.outlier_threshold, substep: 0.02, longest_step: 1.0 }
    }

    /// The gate of the filter: `filter.gate` standard deviations, `filter.gate_patience` rejections in a row.
    pub fn gate(&self) -> Gate {
        Gate { deviations: self.filter.gate, patience: self.filter.gate_patience.max(0) as u32 }
    }

    /// What the declarations cannot say alone.
    pub(super) fn check(&self) -> Result<(), ParameterError> {
        self.validate()?;
        let refuse = |name: &str, value, reason: &str| {
            let declared = Self::declare();
            let variable = declared.iter().find(|v| v.name == name);
            Err(ParameterError {
                name: name.to_owned(),
                value,
                unit: variable.map_or("1", |v| v.unit),
                reason: reason.to_owned(),
            })
        };
        if self.filter.kind == Kind::GravityVector && self.filter.model == Model::Paper {
            let reason = "goes with filter.model = full only; the paper's gyro equation needs a heading";
            return refuse("filter.kind", 3.0, reason);
        }
        if self.filter.kind == Kind::GravityVector && self.initial.slope.abs() > 0.5 * PI - 0.1 {
            return refuse("initial.slope", self.initial.slope, "is too steep for filter.kind = gravity_vector");
        }
        Ok(())
    }
}
