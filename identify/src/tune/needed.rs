//! What a log must carry at least before a filter is tuned on it. Everything else may be missing.

use crate::log::{Log, LogError};
use crate::vehicle::Vehicle;
use wheelstate::Variable;

/// Groups of inputs, `*` standing for any ending: a log needs samples of at least one input of each. Accelerations
/// alone are not enough for any machine, and a speed alone fits every machine.
fn needed(vehicle: Vehicle) -> &'static [&'static [&'static str]] {
    match vehicle {
        Vehicle::NursingRobot => &[&["torque_left", "torque_right"], &["speed", "tilt", "tilt_rate"]],
        Vehicle::WheeledRobot => &[&["steering_angle", "drive_torque_*", "brake_torque_*", "wheel_speed_*", "gyro_z"]],
        Vehicle::WheelLoader => &[
            &["torque_front", "torque_rear", "brake_front", "brake_rear"],
            &["speed", "wheel_speed_front", "wheel_speed_rear"],
        ],
        Vehicle::HumanDynamics => &[&["q_*"]],
        Vehicle::Wheelchair => &[&["encoder_left", "encoder_right", "gyro_pitch"]],
    }
}

/// Refuses a log that cannot be of this machine.
pub(super) fn check(vehicle: Vehicle, log: &Log) -> Result<(), LogError> {
    let inputs = vehicle.inputs();
    let matches = |pattern: &str, name: &str| match pattern.strip_suffix('*') {
        Some(beginning) => name.starts_with(beginning),
        None => name == pattern,
    };
    let sampled = |pattern: &&str| inputs.iter().any(|input| matches(pattern, &input.name) && has_samples(log, input));
    match needed(vehicle).iter().find(|group| !group.iter().any(sampled)) {
        None => Ok(()),
        Some(group) => {
            let what = format!("no channel with samples among {}; {vehicle} needs one of them", group.join(", "));
            Err(LogError::file(&log.source, what))
        }
    }
}

/// The measured inputs of which no log has a sample.
pub(super) fn lacking(inputs: &[Variable], logs: &[Log]) -> Vec<String> {
    let lacks = |input: &&Variable| input.measured && !logs.iter().any(|log| has_samples(log, input));
    inputs.iter().filter(lacks).map(|input| input.name.clone()).collect()
}

fn has_samples(log: &Log, input: &Variable) -> bool {
    log.channel(&input.name).is_some_and(|values| values.iter().any(|value| value.is_finite()))
}
