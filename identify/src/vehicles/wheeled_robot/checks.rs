//! What a four-wheeled robot's log must be like: channels, and those that say the same in two ways.

use crate::check::{Checks, Gain, Relation, Signals};

/// The checks.
pub const CHECKS: Checks = Checks {
    required: &[&["steering_angle"], &["accel_y"], &["gyro_z"], &["speed_y"], &["speed_x", "speed"]],
    optional: &[
        (
            "drive_torque_*",
            "longitudinal wheel forces come from the accelerations, and rolling.coefficient stays unknown",
        ),
        ("wheel_speed_*", "longitudinal wheel forces come from the torques alone"),
        ("accel_x", "the derivative of the speed takes its place"),
    ],
    // Turns of a few seconds, through a window of five samples.
    slowest: 0.1,
    quick: 100_000,
    gravity: &[],
    relations,
    delays: |_| Vec::new(),
};

const WHEELS: [&str; 4] = ["wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rl", "wheel_speed_rr"];

/// ```text
/// v_x = R mean(w_i),                a_x = dv_x/dt - r v_y,     a_y = dv_y/dt + r v_x
/// r = R (w_right - w_left)/track,   r = v_x tan(delta)/L / (1 + understeer)
/// ```
fn relations(signals: &Signals) -> Vec<Relation> {
    let get = |name: &str| signals.known.get(name);
    let radius = get("wheel.radius");
    let base = get("vehicle.cg_to_front") + get("vehicle.cg_to_rear");
    let forward = ["speed_x", "speed"].into_iter().find(|name| signals.channel(name).is_some());
    let mut all = Vec::new();
    let wheels = signals.mean(&WHEELS, 0).map(|term| term.times(radius));
    // Driven tyres slip: wheels then turn faster than the speed in proportion to the force, as if they were early.
    let torque = ["drive_torque_", "brake_torque_"].map(|stem| {
        let names = ["fl", "fr", "rl", "rr"].map(|wheel| format!("{stem}{wheel}"));
        signals.mean(&names.each_ref().map(String::as_str), 0)
    });
    let slip = match torque {
        [Some(drive), brake] => signals.product(&drive.plus(brake.map(|term| term.times(-1.0))), wheels.as_ref()),
        _ => None,
    };
    for (what, name) in [
        ("speed_x compared with wheel speed times radius", "speed_x"),
        ("speed compared with wheel speed times radius", "speed"),
    ] {
        if let (Some(y), Some(x)) = (signals.term(name, 0), wheels.clone()) {
            let (delay, x) = (slip.is_some(), [Some(x), slip.clone()].into_iter().flatten().collect());
            let rolling = Relation::new(what, y.late(), x, Gain::Same(2.0)).given("wheel.radius");
            all.push(rolling.without_constant().with_delay(delay));
        }
    }
    if let Some(forward) = forward {
        let turning = signals.of(["gyro_z", "speed_y"], 0, |[r, v]| -r * v);
        if let (Some(y), Some(x)) = (signals.term("accel_x", 0), signals.term(forward, 1)) {
            let what = "accel_x compared with the derivative of the speed";
            let x = vec![x.plus(turning)];
            all.push(Relation::new(what, y.late(), x, Gain::Same(2.5)));
        }
        let turning = signals.of(["gyro_z", forward], 0, |[r, v]| r * v);
        if let (Some(y), Some(x)) = (signals.term("accel_y", 0), turning) {
            let what = "accel_y compared with yaw rate times speed";
            // Without the lateral speed its change is missing, which comes before the turn.
            let (delay, x) = (signals.channel("speed_y").is_some(), vec![x.plus(signals.term("speed_y", 1))]);
            all.push(Relation::new(what, y.late(), x, Gain::Same(2.5)).with_delay(delay));
        }
        let rest = signals.of(["accel_y", "gyro_z", forward], 0, |[a, r, v]| a - r * v);
        if let (Some(y), Some(x)) = (rest, signals.term("speed_y", 1)) {
            let what = "the change of speed_y compared with accel_y less yaw rate times speed";
            all.push(Relation::new(what, y, vec![x], Gain::Same(2.5)).with_delay(false));
        }
        let steered = signals.of(["steering_angle", forward], 0, |[delta, v]| v * delta.tan() / base);
        if let (Some(y), Some(x)) = (signals.term("gyro_z", 0), steered) {
            let what = "yaw rate compared with speed times steering angle over wheelbase";
            // Understeer, and the lag of the turn: the sign and the size tell, a delay does not.
            let factor = if signals.known.is_set("vehicle.cg_to_front") { 6.0 } else { 20.0 };
            let turn = Relation::new(what, y, vec![x], Gain::About(1.0, factor)).with_delay(false);
            all.push(turn.given("vehicle.cg_to_front and vehicle.cg_to_rear"));
        }
    }
    let track = get("vehicle.track_rear");
    let turned = signals.of(["wheel_speed_rl", "wheel_speed_rr"], 0, |[left, right]| radius * (right - left) / track);
    if let (Some(y), Some(x)) = (signals.term("gyro_z", 0), turned) {
        let what = "yaw rate compared with the rear wheels' difference over track";
        let turn = Relation::new(what, y.late(), vec![x], Gain::Same(3.0));
        all.push(turn.given("wheel.radius and vehicle.track_rear"));
    }
    all
}
