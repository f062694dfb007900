//! What a nursing robot's log must be like: channels, and those that say the same in two ways.

use super::problem::lateness;
use super::problem::rows::GRAVITY;
use super::problem::signals::body;
use crate::check::{Checks, Gain, Relation, Signals, Term};

/// The checks.
pub const CHECKS: Checks = Checks {
    required: &[&["speed"], &["torque_left"], &["torque_right"]],
    optional: &[
        ("tilt", "human.*_pitch come from the wheels alone, and human.rest_pitch stays unknown"),
        ("tilt_rate", "the derivative of tilt takes its place"),
        ("roll", "human.*_roll stay unknown: roll does not act on the wheels"),
        ("roll_rate", "the derivative of roll takes its place"),
        ("yaw_rate", "the robot is taken to drive straight"),
        ("accel_x", "slopes of the floor go into mass and rolling resistance"),
    ],
    // Six samples in a window of 1.2 s.
    slowest: 0.2,
    quick: 100_000,
    gravity: &[],
    relations,
    delays: lateness::delays,
};

/// ```text
/// tilt_rate = d tilt/dt,   roll_rate = d roll/dt,   accel_x = dv/dt + g sin(slope)
/// (T_l + T_r)/r = (M + m) dv/dt + b d tilt_rate/dt + rolling
/// b dv/dt = -(j d tilt_rate/dt + c tilt_rate + (k - b g) tilt),   b w v = j d roll_rate/dt + c roll_rate + (k - b g) roll
/// ```
fn relations(signals: &Signals) -> Vec<Relation> {
    let (radius, mass) = (signals.known.get("robot.wheel_radius"), signals.known.get("robot.mass"));
    let total = mass + signals.known.get("human.nominal_mass") + signals.known.get("robot.rotating_mass");
    let mut all = Vec::new();
    for (what, angle, rate) in [
        ("tilt_rate compared with the derivative of tilt", "tilt", "tilt_rate"),
        ("roll_rate compared with the derivative of roll", "roll", "roll_rate"),
    ] {
        if let (Some(y), Some(x)) = (signals.term(rate, 0), signals.term(angle, 1)) {
            all.push(Relation::new(what, y.late(), vec![x], Gain::Same(2.5)));
        }
    }
    if let (Some(y), Some(x)) = (signals.term("accel_x", 0), signals.term("speed", 1)) {
        let what = "accel_x compared with the derivative of the speed";
        all.push(Relation::new(what, y.late(), vec![x], Gain::Same(2.5)));
    }
    let smoothing = signals.known.get("rolling.smoothing_speed");
    let force = signals.of(["torque_left", "torque_right"], 0, |[left, right]| (left + right) / radius);
    let rolling = signals.of(["speed"], 0, |[speed]| (speed / smoothing).tanh());
    let sway = match (signals.term("tilt_rate", 1), signals.term("tilt", 2)) {
        (None, None) => None,
        (Some(rate), _) => Some(rate),
        (None, angle) => angle,
    };
    if let (Some(y), Some(x), Some(rolling)) = (force, signals.term("speed", 1), rolling) {
        let what = "drive force compared with the derivative of the speed";
        let x: Vec<_> = [Some(x), sway.clone(), Some(rolling)].into_iter().flatten().collect();
        // Without the sway the person moves between force and speed.
        let delay = sway.is_some();
        let gain = Gain::About(total, 30.0);
        let of_force = Relation::new(what, y.late(), x, gain).given("robot.mass").with_delay(delay);
        all.push(of_force);
    }
    all.extend(swaying(signals, ["tilt", "tilt_rate"], signals.term("speed", 1).map(|term| term.times(-1.0))));
    let side = signals.of(["speed", "yaw_rate"], 0, |[speed, yaw_rate]| speed * yaw_rate);
    all.extend(swaying(signals, ["roll", "roll_rate"], side));
    all
}

/// An acceleration and the motion of the body that it causes, `a = ((k - b g) angle + c rate + j d rate/dt) / b`.
fn swaying(signals: &Signals, [angle, rate]: [&'static str; 2], acceleration: Option<Term>) -> Option<Relation> {
    let body = body(signals.known);
    let stiffness = signals.known.get(if angle == "tilt" { "human.stiffness_pitch" } else { "human.stiffness_roll" });
    let expected = (stiffness - body.b * GRAVITY) / body.b;
    let slope = signals.term(rate, 0).or_else(|| signals.term(angle, 1))?;
    let curve = signals.term(rate, 1).or_else(|| signals.term(angle, 2))?;
    let what =
        if angle == "tilt" { "tilt compared with the acceleration" } else { "roll compared with speed times yaw rate" };
    let x = [signals.term(angle, 0)?, slope, curve].to_vec();
    let gain = if expected > 0.0 { Gain::About(expected, 10.0) } else { Gain::Any };
    // Noise of the angle poses as a delay; against a simulation it does not (`lateness`).
    Some(Relation::new(what, acceleration?, x, gain).with_delay(false))
}
