//! Inputs and outputs of the wheelchair's estimator.

use crate::estimator::Diagnostics;
use crate::variable::Estimate;

crate::variables! {
    /// What is measured.
    pub struct Inputs {
        /// Unwrapped angle of the left driven wheel, positive forward. NaN = no sample.
        encoder_left: f64 = f64::NAN, "rad", [-1e9, 1e9], measured;
        /// Unwrapped angle of the right driven wheel, positive forward. NaN = no sample.
        encoder_right: f64 = f64::NAN, "rad", [-1e9, 1e9], measured;
        /// Pitch rate of a gyro strapped down along the axle, positive nose up. NaN = no sample.
        gyro_pitch: f64 = f64::NAN, "rad/s", [-1e4, 1e4], measured;
        /// Forward specific force; 0 at rest on flat ground. NaN = no sample.
        accel_x: f64 = f64::NAN, "m/s2", [-1e4, 1e4], measured;
        /// Leftward specific force; 0 at rest on flat ground. NaN = no sample.
        accel_y: f64 = f64::NAN, "m/s2", [-1e4, 1e4], measured;
        /// Upward specific force; +g at rest on flat ground. NaN = no sample.
        accel_z: f64 = f64::NAN, "m/s2", [-1e4, 1e4], measured;
        /// Force of motors and hands along the heading. NaN = the last value holds.
        drive_force: f64 = f64::NAN, "N", [-1e6, 1e6], held;
        /// Moment of motors and hands about the normal of the ground, counter-clockwise. NaN = the last value holds.
        drive_moment: f64 = f64::NAN, "N.m", [-1e6, 1e6], held;
    }
}

crate::variables! {
    /// What is estimated; quantities that the kind of filter does not estimate are 0 with standard deviation 0.
    pub struct Outputs {
        /// Distance rolled by the driven axle's midpoint, as the encoders count it.
        distance: Estimate = Estimate::NONE, "m";
        /// Heading relative to the contour line of the slope, counter-clockwise, not wrapped; pi/2 climbs straight. With the kind gravity_vector it is within half a turn and means nothing on flat ground.
        heading: Estimate = Estimate::NONE, "rad";
        /// Forward speed of the driven axle's midpoint.
        speed: Estimate = Estimate::NONE, "m/s";
        /// Yaw rate about the normal of the ground, counter-clockwise.
        yaw_rate: Estimate = Estimate::NONE, "rad/s";
        /// Slope of the ground, positive uphill across the contour line.
        slope: Estimate = Estimate::NONE, "rad";
        /// Rate of change of the slope.
        slope_rate: Estimate = Estimate::NONE, "rad/s";
        /// Pitch of the chair, positive nose up.
        pitch: Estimate = Estimate::NONE, "rad";
        /// Bias of the gyro.
        gyro_bias: Estimate = Estimate::NONE, "rad/s";
        /// Bias of the forward accelerometer.
        accel_x_bias: Estimate = Estimate::NONE, "m/s2";
        /// Bias of the leftward accelerometer.
        accel_y_bias: Estimate = Estimate::NONE, "m/s2";
        /// Bias of the upward accelerometer.
        accel_z_bias: Estimate = Estimate::NONE, "m/s2";
        /// Heading minus the heading from the encoders.
        heading_offset: Estimate = Estimate::NONE, "rad";
        /// Relative error of the drive force, that of the mass included: (1 + this) times drive_force acts on the chair.
        force_gain_error: Estimate = Estimate::NONE, "1";
        /// Unmodelled force along the heading, such as unknown rolling resistance or a push.
        force_offset: Estimate = Estimate::NONE, "N";
        /// Unmodelled moment, such as hands that steer. Where the heading comes from gravity.
        moment_offset: Estimate = Estimate::NONE, "N.m";
        /// Whether heading and slope come from the direction of gravity alone: always with the kind gravity_vector, with the others once the ground has contradicted the initial heading.
        heading_from_gravity: bool = false, "1";
        /// Whether the chair stands still; brakes and static friction are then allowed for.
        standstill: bool = false, "1";
        /// What holds of the last sample. Unobservable: on ground as flat as this nothing measured says how the heading lies to the contour line; it rests on the initial heading and the encoders.
        @flat diagnostics: Diagnostics;
    }
}

impl AsMut<Diagnostics> for Outputs {
    fn as_mut(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}
