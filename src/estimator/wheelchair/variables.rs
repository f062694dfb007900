//! Inputs and outputs of the wheelchair's estimator.

use crate::Status;

crate::variables! {
    /// What is measured.
    pub struct Inputs {
        /// Unwrapped angle of the left driven wheel, positive forward. NaN = no sample.
        encoder_left: f64 = 0.0, "rad", [-1e9, 1e9], measured;
        /// Unwrapped angle of the right driven wheel, positive forward. NaN = no sample.
        encoder_right: f64 = 0.0, "rad", [-1e9, 1e9], measured;
        /// Pitch rate of a gyro strapped down along the axle, positive nose up. NaN = no sample.
        gyro_pitch: f64 = 0.0, "rad/s", [-1e4, 1e4], measured;
        /// Specific force ahead; 0 at rest on flat ground. NaN = no sample.
        accel_x: f64 = 0.0, "m/s2", [-1e4, 1e4], measured;
        /// Specific force to the left; 0 at rest on flat ground. NaN = no sample.
        accel_y: f64 = 0.0, "m/s2", [-1e4, 1e4], measured;
        /// Specific force up; +g at rest on flat ground. NaN = no sample.
        accel_z: f64 = 9.80665, "m/s2", [-1e4, 1e4], measured;
        /// Force of motors and hands along the heading. NaN = the last value holds.
        drive_force: f64 = 0.0, "N", [-1e6, 1e6], measured;
        /// Moment of motors and hands about the normal of the ground, counter-clockwise. NaN = the last value holds.
        drive_moment: f64 = 0.0, "N.m", [-1e6, 1e6], measured;
    }
}

crate::variables! {
    /// What is estimated.
    pub struct Outputs {
        /// Distance rolled by the driven axle's midpoint, as the encoders count it.
        distance: f64 = 0.0, "m";
        /// Standard deviation of the distance.
        distance_std: f64 = 0.0, "m", [0.0, f64::INFINITY];
        /// Heading against the contour line of the slope, counter-clockwise, not wrapped; pi/2 climbs straight. With the kind gravity_vector it is within half a turn and means nothing on flat ground.
        heading: f64 = 0.0, "rad";
        /// Standard deviation of the heading; pi/sqrt(3) = 1.81 says that nothing is known.
        heading_std: f64 = 0.0, "rad", [0.0, f64::INFINITY];
        /// Forward speed of the driven axle's midpoint.
        speed: f64 = 0.0, "m/s";
        /// Standard deviation of the speed.
        speed_std: f64 = 0.0, "m/s", [0.0, f64::INFINITY];
        /// Yaw rate about the normal of the ground, counter-clockwise.
        yaw_rate: f64 = 0.0, "rad/s";
        /// Standard deviation of the yaw rate.
        yaw_rate_std: f64 = 0.0, "rad/s", [0.0, f64::INFINITY];
        /// Slope of the ground, positive uphill across the contour line.
        slope: f64 = 0.0, "rad";
        /// Standard deviation of the slope.
        slope_std: f64 = 0.0, "rad", [0.0, f64::INFINITY];
        /// Rate of change of the slope.
        slope_rate: f64 = 0.0, "rad/s";
        /// Standard deviation of the slope's rate.
        slope_rate_std: f64 = 0.0, "rad/s", [0.0, f64::INFINITY];
        /// Pitch of the chair, positive nose up.
        pitch: f64 = 0.0, "rad";
        /// Standard deviation of the pitch.
        pitch_std: f64 = 0.0, "rad", [0.0, f64::INFINITY];
        /// Bias of the gyro; 0 with standard deviation 0 where the kind does not estimate it.
        gyro_bias: f64 = 0.0, "rad/s";
        /// Standard deviation of the gyro's bias.
        gyro_bias_std: f64 = 0.0, "rad/s", [0.0, f64::INFINITY];
        /// Bias of the accelerometer ahead; 0 with standard deviation 0 where the kind does not estimate it.
        accel_x_bias: f64 = 0.0, "m/s2";
        /// Standard deviation of the accelerometer's bias ahead.
        accel_x_bias_std: f64 = 0.0, "m/s2", [0.0, f64::INFINITY];
        /// Bias of the accelerometer to the left; 0 with standard deviation 0 where the kind does not estimate it.
        accel_y_bias: f64 = 0.0, "m/s2";
        /// Standard deviation of the accelerometer's bias to the left.
        accel_y_bias_std: f64 = 0.0, "m/s2", [0.0, f64::INFINITY];
        /// Bias of the accelerometer upward; 0 with standard deviation 0 where the kind does not estimate it.
        accel_z_bias: f64 = 0.0, "m/s2";
        /// Standard deviation of the accelerometer's bias upward.
        accel_z_bias_std: f64 = 0.0, "m/s2", [0.0, f64::INFINITY];
        /// Heading minus the heading from the encoders; 0 with standard deviation 0 where the kind does not estimate it.
        heading_offset: f64 = 0.0, "rad";
        /// Standard deviation of the heading's offset.
        heading_offset_std: f64 = 0.0, "rad", [0.0, f64::INFINITY];
        /// Relative error of the drive force, that of the mass included: (1 + this) times drive_force acts on the chair; 0 with standard deviation 0 where the kind does not estimate it.
        force_gain_error: f64 = 0.0, "1";
        /// Standard deviation of the drive force's relative error.
        force_gain_error_std: f64 = 0.0, "1", [0.0, f64::INFINITY];
        /// Force along the heading that nobody reports, such as unknown rolling resistance or a push; 0 with standard deviation 0 where the kind does not estimate it.
        force_offset: f64 = 0.0, "N";
        /// Standard deviation of the force that nobody reports.
        force_offset_std: f64 = 0.0, "N", [0.0, f64::INFINITY];
        /// Whether the chair stands still; brakes and static friction are then allowed for.
        standstill: bool = false, "1";
        /// Normalised innovation squared per channel of the last sample; near 1 if noise and model fit, 0 if nothing was measured.
        nis: f64 = 0.0, "1", [0.0, f64::INFINITY];
        /// Number of channels used in the last sample, with those that say that the chair stands still.
        nis_channels: i32 = 0, "1", [0, 16];
        /// Logarithm of the likelihood of what the sensors measured last, 0 without a measurement.
        log_likelihood: f64 = 0.0, "1";
        /// Conditions of the last sample as bits. Unobservable: on ground as flat as this nothing measured says how the heading lies to the contour line; it rests on the initial heading and the encoders.
        status: Status = Status::OK, "1";
        /// Whether speed and slope are usable now: measured, certain enough, and not contradicted by the last seconds' measurements, as they are by a wrong initial heading.
        healthy: bool = false, "1";
    }
}
