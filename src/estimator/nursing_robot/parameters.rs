//! Everything that can be set, measured and read, declared once.

use crate::Status;
use crate::model::nursing_robot::{Aero, Human, Robot, Rolling};

choice! {
    /// Law by which the mass filter forgets.
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
        /// Large errors make the filter forget; every stop re-opens the covariance.
        AnyTime = "any_time",
        /// Errors are noise; only a long stop lets the mass change.
        AtStops = "at_stops",
    }
}

choice! {
    /// Model of the sway filter.
    pub enum SwayModel {
        /// `sound_torque` if tilt or tilt rate is used, else `sound`.
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
        /// Whether accel_x (specific force, with gravity) replaces the derivative of the speed for the masses that move along, so that slopes cancel.
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
        /// Acceleration above which a sample tells something about the mass.
        minimum_acceleration: f64 = 0.1, "m/s2", [1e-3, 10.0], tunable;
        /// Corner frequency of the filter that force, speed and acceleration pass alike.
        cutoff: f64 = 2.0, "Hz", [0.01, 100.0], tunable;
        /// Largest scaled covariance, also the one after the covariance has been re-opened.
        covariance_high: f64 = 10.0, "s4/m2", [1e-9, 1e6], tunable;
        /// Smallest scaled covariance.
        covariance_low: f64 = 1e-6, "s4/m2", [1e-15, 1e6], tunable;
        /// Number of samples pooled into the first estimate after a start.
        pooled_samples: i32 = 10, "1", [1, 10000], tunable;
        /// Standing at least this long allows the load to have changed: the next start re-opens the covariance.
        stop_time: f64 = 0.5, "s", [0.0, 1e4], tunable;
        /// Time after a missing or rejected sample during which the mass is held.
        block_time: f64 = 0.4, "s", [0.0, 100.0], tunable;
        /// Relative standard deviation of rolling.coefficient, for load_mass_std.
        rolling_uncertainty: f64 = 0.1, "1", [0.0, 10.0], tunable;
        /// Relative standard deviation of the drive force (torque scale, efficiency), for load_mass_std.
        force_uncertainty: f64 = 0.01, "1", [0.0, 10.0], tunable;
        /// Relative standard deviation of the computed sway force, for load_mass_std.
        sway_uncertainty: f64 = 0.3, "1", [0.0, 10.0], tunable;
    }
}

variables! {
    /// Densities of the process noise of the sway filter and standard deviations of its sensors.
    pub struct SwayParameters {
        /// Model of the sway filter.
        model: SwayModel = SwayModel::Auto, "1";
        /// Whether measurement and process noise are adapted.
        adaptive: bool = true, "1", tunable;
        /// Whether the measured tilt is used. Without it a kept lean cannot be seen.
        use_tilt: bool = false, "1";
        /// Whether the measured tilt rate is used.
        use_tilt_rate: bool = false, "1";
        /// Standard deviation of the measured speed.
        speed_std: f64 = 0.005, "m/s", [1e-6, 10.0], tunable;
        /// Standard deviation of the measured tilt.
        tilt_std: f64 = 0.01, "rad", [1e-6, 1.0], tunable;
        /// Standard deviation of the measured tilt rate.
        tilt_rate_std: f64 = 0.01, "rad/s", [1e-6, 10.0], tunable;
        /// Process noise of the speed, variance per second.
        speed_noise: f64 = 1e-5, "m2/s3", [0.0, 1e3], tunable;
        /// Process noise of the pitch, variance per second.
        pitch_noise: f64 = 1e-8, "rad2/s", [0.0, 1e3], tunable;
        /// Process noise of the pitch rate, variance per second.
        pitch_rate_noise: f64 = 1e-6, "rad2/s3", [0.0, 1e3], tunable;
        /// White hip torque of the model sound, variance times time.
        hip_torque_noise: f64 = 1.0, "N2.m2.s", [0.0, 1e6], tunable;
        /// White hip torque of the model sound_torque, variance times time, beside its slow active torque.
        hip_torque_noise_fast: f64 = 0.1, "N2.m2.s", [0.0, 1e6], tunable;
        /// Process noise of the active torque of the model sound_torque, variance per second.
        active_torque_noise: f64 = 500.0, "N2.m2/s", [0.0, 1e6], tunable;
        /// Time constant of the active torque of the model sound_torque.
        active_torque_time: f64 = 5.0, "s", [0.01, 1e4], tunable;
        /// Process noise of the speed in the models paper and paper_raw, variance per second.
        paper_speed_noise: f64 = 1e-4, "m2/s3", [0.0, 1e3], tunable;
        /// Process noise of the pitch in the models paper and paper_raw, variance per second.
        paper_pitch_noise: f64 = 0.02, "rad2/s", [0.0, 1e3], tunable;
        /// Standard deviation of the speed at the start.
        start_speed_std: f64 = 0.01, "m/s", [1e-6, 10.0];
        /// Standard deviation of the pitch at the start.
        start_pitch_std: f64 = 0.2, "rad", [1e-6, 1.0];
        /// Standard deviation of the pitch rate at the start.
        start_pitch_rate_std: f64 = 0.5, "rad/s", [1e-6, 10.0];
        /// Standard deviation of the active torque at the start.
        start_torque_std: f64 = 5.0, "N.m", [1e-6, 1e3];
        /// Spread of the sigma points.
        alpha: f64 = 1.0, "1", [1e-3, 10.0];
        /// Prior knowledge of the distribution; 2 for a Gaussian.
        beta: f64 = 2.0, "1", [0.0, 10.0];
        /// Secondary scaling of the sigma points.
        kappa: f64 = 0.0, "1", [-1.0, 10.0];
        /// Normalised innovation squared per channel above which a sample is rejected; the fourth in a row re-aligns the speed.
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
        /// Largest plausible torque of one side, in size; beyond it the sample counts as missing.
        torque: f64 = 60.0, "N.m", [0.0, 1e6];
        /// Largest plausible speed, in size; beyond it the sample counts as missing.
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
        sample_period: f64 = 0.01, "s", [1e-4, 10.0];
        /// The robot or vehicle without its load.
        robot: Robot;
        /// Rolling resistance.
        rolling: Rolling;
        /// Air drag.
        aero: Aero;
        /// The seated person.
        human: Human;
        /// The mass filter.
        mass: MassParameters;
        /// The sway filter.
        sway: SwayParameters;
        /// Limits of plausibility.
        limit: LimitParameters;
    }
}

variables! {
    /// What is measured.
    pub struct Inputs {
        /// Torque at the left drive wheel after the gearbox, positive driving forward. NaN: no sample.
        torque_left: f64 = 0.0, "N.m", measured;
        /// Torque at the right drive wheel after the gearbox, positive driving forward. NaN: no sample.
        torque_right: f64 = 0.0, "N.m", measured;
        /// Forward speed of the driven axle's midpoint. NaN: no sample.
        speed: f64 = 0.0, "m/s", measured;
        /// Yaw rate of the robot, positive counter-clockwise seen from above. NaN: driving straight.
        yaw_rate: f64 = 0.0, "rad/s", measured;
        /// Measured pitch of the upper body, positive leaning forward; used if sway.use_tilt. NaN: no sample.
        tilt: f64 = f64::NAN, "rad", measured;
        /// Measured pitch rate of the upper body; used if sway.use_tilt_rate. NaN: no sample.
        tilt_rate: f64 = f64::NAN, "rad/s", measured;
        /// Measured roll of the upper body, positive leaning right. Not used by the filters, whose motion is planar; for identification. NaN: no sample.
        roll: f64 = f64::NAN, "rad", measured;
        /// Measured roll rate of the upper body. Not used by the filters; for identification. NaN: no sample.
        roll_rate: f64 = f64::NAN, "rad/s", measured;
        /// Longitudinal specific force (acceleration plus the share of gravity along a slope), positive forward; used if mass.use_accelerometer. NaN: no sample.
        accel_x: f64 = f64::NAN, "m/s2", measured;
    }
}

variables! {
    /// What is estimated.
    pub struct Outputs {
        /// Mass of the person or load. human.nominal_mass until mass_valid.
        load_mass: f64 = 70.0, "kg";
        /// Standard deviation of load_mass, with the effect of uncertain rolling resistance, drive force and sway.
        load_mass_std: f64 = 20.0, "kg";
        /// Whether a mass has been estimated since the start.
        mass_valid: bool = false, "1";
        /// Whether load_mass has sat at its bound for longer than 0.5 s of updates whose forces ask for a mass far beyond it (5 % of robot.mass): inputs and parameters do not fit each other.
        mass_implausible: bool = false, "1";
        /// Forgetting factor of the mass filter at its last update.
        forgetting_factor: f64 = 0.998, "1";
        /// Mass filter: 0 updated, 1 pooling the first samples, 2 not moving, 3 not excited, 4 rejected as slip, 5 missing sample or bad step, 6 held after 4 or 5.
        mass_status: i32 = 2, "1";
        /// Pitch of the upper body, positive leaning forward. Without a tilt sensor a kept lean is not observable and only the motion about human.rest_pitch is estimated.
        body_pitch: f64 = 0.0, "rad";
        /// Standard deviation of body_pitch.
        body_pitch_std: f64 = 0.2, "rad";
        /// Pitch rate of the upper body.
        body_pitch_rate: f64 = 0.0, "rad/s";
        /// Standard deviation of body_pitch_rate.
        body_pitch_rate_std: f64 = 0.5, "rad/s";
        /// Longitudinal force of the swaying body on the robot, positive slowing it.
        sway_force: f64 = 0.0, "N";
        /// Standard deviation of sway_force.
        sway_force_std: f64 = 0.0, "N";
        /// Passive torque of spring and damper at the hip, positive when leaning forward of the rest posture.
        hip_torque: f64 = 0.0, "N.m";
        /// Standard deviation of hip_torque.
        hip_torque_std: f64 = 0.0, "N.m";
        /// Active torque of the person at the hip, positive pushing the body forward; 0 unless the model is sound_torque.
        active_torque: f64 = 0.0, "N.m";
        /// Standard deviation of active_torque; 0 unless the model is sound_torque.
        active_torque_std: f64 = 0.0, "N.m";
        /// Centre of gravity of the person, forward of the driven axle.
        load_cog_x: f64 = 0.0, "m";
        /// Standard deviation of load_cog_x.
        load_cog_x_std: f64 = 0.0, "m";
        /// Centre of gravity of the person above the floor.
        load_cog_z: f64 = 0.0, "m";
        /// Standard deviation of load_cog_z.
        load_cog_z_std: f64 = 0.0, "m";
        /// Centre of gravity of robot and person, forward of the driven axle.
        cog_x: f64 = 0.0, "m";
        /// Standard deviation of cog_x.
        cog_x_std: f64 = 0.0, "m";
        /// Centre of gravity of robot and person above the floor.
        cog_z: f64 = 0.0, "m";
        /// Standard deviation of cog_z.
        cog_z_std: f64 = 0.0, "m";
        /// Forward speed of the driven axle's midpoint; the last measured one if the load cannot sway.
        speed_estimate: f64 = 0.0, "m/s";
        /// Standard deviation of speed_estimate.
        speed_estimate_std: f64 = 0.01, "m/s";
        /// Sway filter: 0 updated, 2 some channel missing, 3 wheels held, 4 rejected by the gate, 5 bad step or gap, 6 rolled back, 7 restarted beyond the pitch limit, 8 speed re-aligned, 9 switched off.
        sway_status: i32 = 0, "1";
        /// Normalised innovation squared of the sway filter per measured channel; about 1 when the filter is consistent, 0 without a sample.
        nis: f64 = 0.0, "1";
        /// Logarithm of the likelihood of what the sway filter measured last, 0 without a sample.
        log_likelihood: f64 = 0.0, "1";
        /// Conditions of the last sample, a bit field with the same meaning in all machines.
        status: Status = Status::OK, "1";
        /// Whether the main estimates are usable now: a mass is known and plausible and the sway filter is neither starting anew nor contradicted by the speeds (which the bit contradicted of the status says).
        healthy: bool = false, "1";
    }
}
