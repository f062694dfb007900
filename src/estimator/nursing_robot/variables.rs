//! Inputs and outputs of the nursing robot's estimator.

use super::status::{MassStatus, SwayStatus};
use crate::estimator::Diagnostics;
use crate::variable::Estimate;

crate::variables! {
    /// What is measured.
    pub struct Inputs {
        /// Torque at the left drive wheel after the gearbox, positive driving forward. NaN = no sample.
        torque_left: f64 = f64::NAN, "N.m", [-1e6, 1e6], measured;
        /// Torque at the right drive wheel after the gearbox, positive driving forward. NaN = no sample.
        torque_right: f64 = f64::NAN, "N.m", [-1e6, 1e6], measured;
        /// Forward speed of the driven axle's midpoint. NaN = no sample.
        speed: f64 = f64::NAN, "m/s", [-200.0, 200.0], measured;
        /// Yaw rate of the robot, positive counter-clockwise seen from above; never set = driving straight. NaN = the last value holds.
        yaw_rate: f64 = f64::NAN, "rad/s", [-50.0, 50.0], held;
        /// Measured pitch of the upper body, positive leaning forward; used if sway.use_tilt. NaN = no sample.
        tilt: f64 = f64::NAN, "rad", [-1.6, 1.6], measured;
        /// Measured pitch rate of the upper body; used if sway.use_tilt_rate. NaN = no sample.
        tilt_rate: f64 = f64::NAN, "rad/s", [-50.0, 50.0], measured;
        /// Measured roll of the upper body, positive leaning right. Not used by the filters, whose motion is planar; for identification. NaN = no sample.
        roll: f64 = f64::NAN, "rad", [-1.6, 1.6], measured;
        /// Measured roll rate of the upper body. Not used by the filters; for identification. NaN = no sample.
        roll_rate: f64 = f64::NAN, "rad/s", [-50.0, 50.0], measured;
        /// Longitudinal specific force (acceleration plus the share of gravity along a slope), positive forward; used if mass.use_accelerometer. NaN = no sample.
        accel_x: f64 = f64::NAN, "m/s2", [-100.0, 100.0], measured;
    }
}

crate::variables! {
    /// What is estimated.
    pub struct Outputs {
        /// Mass of the person or load, human.nominal_mass until mass_valid. The standard deviation contains the effect of uncertain rolling resistance, drive force and sway.
        load_mass: Estimate = Estimate::new(70.0, 20.0), "kg";
        /// Whether a mass has been estimated since the start.
        mass_valid: bool = false, "1";
        /// Whether load_mass has sat at its bound for longer than 0.5 s of updates whose forces ask for a mass far beyond it (5 % of robot.mass): inputs and parameters do not fit each other.
        mass_implausible: bool = false, "1";
        /// Forgetting factor of the mass filter at its last update.
        forgetting_factor: f64 = 0.998, "1";
        /// What the mass filter did with the last sample.
        mass_status: MassStatus = MassStatus::NotMoving, "1";
        /// Pitch of the upper body, positive leaning forward. Without a tilt sensor a kept lean is not observable and only the motion about human.rest_pitch is estimated.
        body_pitch: Estimate = Estimate::new(0.0, 0.2), "rad";
        /// Pitch of the upper body about the posture that it keeps, positive leaning forward: what the wheels show. Its standard deviation leaves out human.rest_pitch_std.
        sway_pitch: Estimate = Estimate::new(0.0, 0.2), "rad";
        /// Pitch rate of the upper body.
        body_pitch_rate: Estimate = Estimate::new(0.0, 0.5), "rad/s";
        /// Longitudinal force of the swaying body on the robot, positive slowing it.
        sway_force: Estimate = Estimate::NONE, "N";
        /// Passive torque of spring and damper at the hip, positive when leaning forward of the rest posture.
        hip_torque: Estimate = Estimate::NONE, "N.m";
        /// Active torque of the person at the hip, positive pushing the body forward; 0 unless the model is sound_torque, with the standard deviation of what a person may do unnoticed.
        active_torque: Estimate = Estimate::NONE, "N.m";
        /// Centre of gravity of the person, forward of the driven axle.
        load_cog_x: Estimate = Estimate::NONE, "m";
        /// Centre of gravity of the person above the floor.
        load_cog_z: Estimate = Estimate::NONE, "m";
        /// Centre of gravity of robot and person, forward of the driven axle.
        cog_x: Estimate = Estimate::NONE, "m";
        /// Centre of gravity of robot and person above the floor.
        cog_z: Estimate = Estimate::NONE, "m";
        /// Forward speed of the driven axle's midpoint; the last measured one if the sway filter is off.
        speed_estimate: Estimate = Estimate::new(0.0, 0.01), "m/s";
        /// What the sway filter did with the last sample.
        sway_status: SwayStatus = SwayStatus::Updated, "1";
        /// What holds of the last sample. Unobservable: no mass has been estimated yet, or none since a stop in which the load may have changed. The innovations are those of the sway filter: speed, and tilt and tilt rate where they are used. Healthy needs a mass that is known and plausible.
        @flat diagnostics: Diagnostics;
    }
}

impl AsMut<Diagnostics> for Outputs {
    fn as_mut(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}
