//! Parameters of the nursing robot's estimator.

use crate::model::nursing_robot::{Aero, Human, Robot, Rolling};
use crate::{ParameterError, Variables};

choice! {
    /// Law of the mass filter's forgetting factor.
    pub enum Law {
        /// Forgets faster the larger the prediction error (eq. 35).
        Exponential = "exponential",
        /// Linear between two thresholds of the prediction error (eq. 34).
        Threshold = "threshold",
        /// Constant forgetting factor.
        Fixed = "fixed",
    }
}

choice! {
    /// Whether the load can change while the machine moves.
    pub enum LoadChange {
        /// `at_stops` if mass.use_accelerometer (a road vehicle), else `any_time`.
        Auto = "auto",
        /// Large errors make the filter forget; every stop resets the covariance.
        AnyTime = "any_time",
        /// Errors are noise; only a long stop lets the mass change.
        AtStops = "at_stops",
    }
}

choice! {
    /// Model of the sway filter.
    pub enum SwayModel {
        /// `sound_torque` if tilt or tilt rate is used; otherwise off with mass.use_accelerometer, whose road may slope as
        /// no model of the sway does, and `sound` without it.
        Auto = "auto",
        /// As printed in the source; for comparison only.
        PaperRaw = "paper_raw",
        /// The source's model with its units corrected; for comparison only.
        Paper = "paper",
        /// Speed, pitch and pitch rate.
        Sound = "sound",
        /// Speed, pitch, pitch rate and the person's active hip torque.
        SoundTorque = "sound_torque",
    }
}

variables! {
    /// The mass filter.
    pub struct MassParameters {
        /// How old samples are forgotten.
        law: Law = Law::Exponential, "1", tunable;
        /// Whether the force of the swaying upper body is computed from the acceleration and taken into the regressor. Off: the plain regressor of the source.
        compensate_sway: bool = true, "1", tunable;
        /// Whether accel_x (specific force, with gravity) replaces the derivative of the speed for the masses that move along, so that slopes cancel. The sway filter is then off unless a tilt sensor is used or sway.model names a model.
        use_accelerometer: bool = false, "1";
        /// Forgetting factor per sample at large errors.
        forgetting_fast: f64 = 0.97, "1", [0.5, 1.0], tunable;
        /// Forgetting factor per sample at small errors.
        forgetting_slow: f64 = 0.998, "1", [0.5, 1.0], tunable;
        /// Forgetting factor per sample of the law fixed.
        forgetting_fixed: f64 = 0.99, "1", [0.5, 1.0], tunable;
        /// Prediction error per kilogram of robot mass up to which forgetting is slow; the start value is 5 N for 160 kg.
        error_low: f64 = 0.03125, "m/s2", [0.0, 100.0], tunable;
        /// Prediction error per kilogram of robot mass from which forgetting is fast (law threshold); the start value is 30 N for 160 kg.
        error_high: f64 = 0.1875, "m/s2", [1e-6, 100.0], tunable;
        /// Fall of the forgetting factor with the prediction error per kilogram of robot mass (law exponential); the start value is 0.05 per newton for 160 kg.
        error_rate: f64 = 8.0, "s2/m", [0.0, 1e4], tunable;
        /// If positive, forgetting reacts only to errors that keep their sign over this time.
        error_persistence: f64 = 0.0, "s", [0.0, 100.0], tunable;
        /// When the load can change. A person on a robot moves about and is exchanged at any stop; people in a car get in and out at long stops only.
        load_change: LoadChange = LoadChange::Auto, "1";
        /// Forgetting factor per sample if the load changes at stops only.
        forgetting_steady: f64 = 0.9998, "1", [0.5, 1.0], tunable;
        /// If the load changes at stops only: shortest stop in which it may change.
        change_time: f64 = 30.0, "s", [0.0, 1e5], tunable;
        /// If the load changes at stops only: standard deviation of the change.
        change_std: f64 = 75.0, "kg", [0.0, 1e5], tunable;
        /// Speed above which the machine counts as moving; 0.5 km/h.
        minimum_speed: f64 = 0.1388888888888889, "m/s", [0.0, 50.0], tunable;
        /// Acceleration above which a sample is informative about the mass.
        minimum_acceleration: f64 = 0.1, "m/s2", [1e-3, 10.0], tunable;
        /// Corner frequency of the filter that force, speed and acceleration pass alike.
        cutoff: f64 = 2.0, "Hz", [0.01, 100.0], tunable;
        /// Largest scaled covariance, also the one after a reset.
        covariance_high: f64 = 10.0, "s4/m2", [1e-9, 1e6], tunable;
        /// Smallest scaled covariance.
        covariance_low: f64 = 1e-6, "s4/m2", [1e-15, 1e6], tunable;
        /// Number of samples pooled into the first estimate after a start.
        pooled_samples: i32 = 10, "1", [1, 10000], tunable;
        /// Standing at least this long allows the load to have changed, by human.nominal_mass_std: the next start resets the covariance.
        stop_time: f64 = 0.5, "s", [0.0, 1e4], tunable;
        /// Time after a missing or rejected sample during which the mass is held.
        block_time: f64 = 0.4, "s", [0.0, 100.0], tunable;
        /// Relative standard deviation of rolling.coefficient, for load_mass_std: floors and tyres of one kind differ by 0.2. identify fit finds it.
        rolling_uncertainty: f64 = 0.2, "1", [0.0, 10.0], tunable;
        /// Relative standard deviation of the drive force (torque scale, efficiency), for load_mass_std.
        force_uncertainty: f64 = 0.01, "1", [0.0, 10.0], tunable;
        /// Relative standard deviation of the computed sway force, for load_mass_std.
        sway_uncertainty: f64 = 0.3, "1", [0.0, 10.0], tunable;
        /// Standard deviation of a constant error of accel_x, such as a mounting that is not level, for load_mass_std; with mass.use_accelerometer.
        accel_x_bias_std: f64 = 0.05, "m/s2", [0.0, 10.0], tunable;
    }
}

variables! {
    /// Process noise of the sway filter: power spectral densities of white noise.
    pub struct ProcessParameters {
        /// Density of the unmodelled acceleration along the path.
        speed: f64 = 1e-5, "m2/s3", [0.0, 1e3], tunable, process_noise;
        /// Density of the unmodelled pitch rate.
        pitch: f64 = 1e-8, "rad2/s", [0.0, 1e3], tunable, process_noise;
        /// Density of the unmodelled pitch acceleration.
        pitch_rate: f64 = 1e-6, "rad2/s3", [0.0, 1e3], tunable, process_noise;
        /// Density of the unmodelled hip torque of the model sound.
        hip_torque: f64 = 1.0, "N2.m2.s", [0.0, 1e6], tunable, process_noise;
        /// Density of the unmodelled hip torque of the model sound_torque, beside its slow active torque.
        hip_torque_fast: f64 = 0.1, "N2.m2.s", [0.0, 1e6], tunable, process_noise;
        /// Density of what drives the active torque of the model sound_torque.
        active_torque: f64 = 500.0, "N2.m2/s", [0.0, 1e6], tunable, process_noise;
        /// Density of the unmodelled acceleration in the models paper and paper_raw.
        paper_speed: f64 = 1e-4, "m2/s3", [0.0, 1e3], tunable, process_noise;
        /// Density of the pitch rate in the models paper and paper_raw, which have no equation of the pitch.
        paper_pitch: f64 = 0.02, "rad2/s", [0.0, 1e3], tunable, process_noise;
    }
}

variables! {
    /// Measurement noise of the sway filter: standard deviations per sample.
    pub struct MeasurementParameters {
        /// Standard deviation of the measured speed.
        speed: f64 = 0.005, "m/s", [1e-6, 10.0], tunable, measurement_noise;
        /// Standard deviation of the measured tilt.
        tilt: f64 = 0.01, "rad", [1e-6, 1.0], tunable, measurement_noise;
        /// Standard deviation of the measured tilt rate.
        tilt_rate: f64 = 0.01, "rad/s", [1e-6, 10.0], tunable, measurement_noise;
    }
}

variables! {
    /// What is known at the start: the first measured speed and the relaxed posture.
    pub struct InitialParameters {
        /// Standard deviation of the speed at the start.
        speed_std: f64 = 0.01, "m/s", [1e-6, 10.0];
        /// Standard deviation of the pitch at the start.
        pitch_std: f64 = 0.2, "rad", [1e-6, 1.0];
        /// Standard deviation of the pitch rate at the start.
        pitch_rate_std: f64 = 0.5, "rad/s", [1e-6, 10.0];
        /// Standard deviation of the active torque at the start.
        active_torque_std: f64 = 5.0, "N.m", [1e-6, 1e3];
    }
}

variables! {
    /// The sway filter.
    pub struct SwayParameters {
        /// Model of the sway filter. auto = sound_torque if tilt or tilt rate is used; otherwise off with mass.use_accelerometer, since roads slope and the model's floor is level, and sound without it.
        model: SwayModel = SwayModel::Auto, "1";
        /// Whether measurement and process noise are adapted.
        adaptive: bool = true, "1", tunable;
        /// Whether the measured tilt is used. Without it a kept lean cannot be seen.
        use_tilt: bool = false, "1", essential;
        /// Whether the measured tilt rate is used.
        use_tilt_rate: bool = false, "1", essential;
        /// Standard deviation of a constant error of the tilt, as of the sensor's mounting, which counts in the estimates' deviations.
        tilt_bias_std: f64 = 0.01, "rad", [0.0, 1.0], tunable;
        /// Standard deviation of a constant error of the tilt rate, which counts in that of the pitch rate.
        tilt_rate_bias_std: f64 = 0.005, "rad/s", [0.0, 10.0], tunable;
        /// Standard deviation of the time by which the samples of tilt and tilt rate come late, which counts in those of pitch and pitch rate. A longer one that they show beside each other takes its place, unless it is 0.
        tilt_delay_std: f64 = 0.015, "s", [0.0, 1.0], tunable;
        /// Relative standard deviation of the speed's scale, such as the wheels' radius, which counts in that of the estimated speed.
        speed_scale_std: f64 = 0.01, "1", [0.0, 1.0], tunable;
        /// Standard deviation of the time by which the samples of the speed come late, which counts in that of the estimated speed.
        speed_delay_std: f64 = 0.015, "s", [0.0, 1.0], tunable;
        /// Process noise.
        process_psd: ProcessParameters;
        /// Measurement noise.
        measurement_std: MeasurementParameters;
        /// Time constant of the active torque of the model sound_torque.
        active_torque_time: f64 = 5.0, "s", [0.01, 1e4], tunable;
        /// Spread of the sigma points.
        alpha: f64 = 1.0, "1", [1e-3, 10.0];
        /// Prior knowledge of the distribution; 2 for a Gaussian.
        beta: f64 = 2.0, "1", [0.0, 10.0];
        /// Secondary scaling of the sigma points.
        kappa: f64 = 0.0, "1", [-1.0, 10.0];
        /// Normalised innovation squared per channel above which a sample is rejected; the fourth in a row resets the speed to its measurement.
        gate: f64 = 16.0, "1", [1.0, 1e6], tunable;
        /// Forgetting factor of the adapted measurement noise.
        noise_memory: f64 = 0.995, "1", [0.5, 0.999999], tunable;
        /// Smallest adapted measurement variance, relative to the nominal one.
        noise_low: f64 = 0.25, "1", [1e-3, 1.0], tunable;
        /// Largest adapted measurement variance, relative to the nominal one.
        noise_high: f64 = 25.0, "1", [1.0, 1e4], tunable;
        /// Memory of the innovations from which the process noise is scaled.
        scale_time: f64 = 0.1, "s", [1e-3, 100.0], tunable;
        /// Largest scale of the process noise.
        scale_high: f64 = 50.0, "1", [1.0, 1e6], tunable;
        /// Pitch beyond which the filter restarts.
        pitch_limit: f64 = 1.0, "rad", [0.1, 1.5];
        /// Whether wheels below hold_speed for hold_time count as held, from when on the speed is known to be zero.
        hold_wheels: bool = true, "1";
        /// Smoothed speed below which the wheels may be held.
        hold_speed: f64 = 0.01, "m/s", [0.0, 1.0], tunable;
        /// Time below hold_speed after which the wheels count as held.
        hold_time: f64 = 0.3, "s", [0.0, 100.0], tunable;
    }
}

variables! {
    /// Limits of plausibility. A road vehicle needs larger ones.
    pub struct LimitParameters {
        /// Largest plausible magnitude of one side's torque; beyond it the sample counts as missing.
        torque: f64 = 60.0, "N.m", [0.0, 1e6];
        /// Largest plausible magnitude of the speed; beyond it the sample counts as missing.
        speed: f64 = 3.0, "m/s", [0.0, 200.0];
        /// Largest load mass.
        load_mass: f64 = 250.0, "kg", [1.0, 1e5];
        /// Smallest load mass; negative if the machine may be lighter than robot.mass says.
        load_mass_low: f64 = 0.0, "kg", [-1e5, 0.0];
        /// Prediction error of the drive force beyond which a wheel is taken to slip and the sample is rejected.
        slip_residual: f64 = 250.0, "N", [0.0, 1e6];
        /// Longest step that is bridged, but at least 1.5 sample periods; after a longer one the filters restart and the mass is held.
        step: f64 = 0.1, "s", [1e-4, 100.0];
    }
}

variables! {
    /// All parameters of the nursing robot.
    pub struct Parameters {
        /// Time between two samples.
        sample_period: f64 = 0.01, "s", [1e-4, 10.0], essential;
        /// The robot or vehicle without its load.
        robot: Robot;
        /// Rolling resistance.
        rolling: Rolling;
        /// Air drag.
        aero: Aero;
        /// The seated person.
        human: Human;
        /// What is known at the start.
        initial: InitialParameters;
        /// The mass filter.
        mass: MassParameters;
        /// The sway filter.
        sway: SwayParameters;
        /// Limits of plausibility.
        limit: LimitParameters;
    }
}

impl Parameters {
    /// Longest step that the filters bridge, s; a rounding error longer than 1.5 sample periods is not
    /// taken for a gap.
    pub fn longest_step(&self) -> f64 {
        self.limit.step.max(1.5 * self.sample_period) * (1.0 + 1e-9)
    }

    /// Checks what single ranges cannot.
    pub(super) fn check_together(&self) -> Result<(), ParameterError> {
        let (human, mass) = (&self.human, self.human.nominal_mass);
        let toppling = human.toppling_stiffness(mass);
        let refuse = |name: &str, reason: String| {
            let declared = Self::declare();
            let index = declared.iter().position(|v| v.name == name).unwrap_or(0);
            Err(declared[index].refuse(self.to_vec()[index], reason))
        };
        if human.hip_inertia(mass) > 0.0 && human.stiffness_pitch <= toppling {
            let reason = format!(
                "does not hold the body upright: it must exceed {toppling:.1} N.m/rad, the moment of gravity per angle"
            );
            return refuse("human.stiffness_pitch", reason);
        }
        if self.mass.forgetting_fast > self.mass.forgetting_slow {
            return refuse("mass.forgetting_fast", "must not exceed mass.forgetting_slow".to_owned());
        }
        if self.mass.error_low >= self.mass.error_high {
            return refuse("mass.error_low", "must be below mass.error_high".to_owned());
        }
        if self.mass.covariance_low > self.mass.covariance_high {
            return refuse("mass.covariance_low", "must not exceed mass.covariance_high".to_owned());
        }
        if self.robot.mass + self.limit.load_mass_low <= 0.0 {
            return refuse("limit.load_mass_low", "leaves no mass: it must be above -robot.mass".to_owned());
        }
        Ok(())
    }
}
