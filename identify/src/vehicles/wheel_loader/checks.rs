//! What a wheel loader's log must be like: channels, and those that say the same in two ways.

use crate::check::{Checks, Gain, Relation, Signals};
use wheelstate::model::wheel_loader::GRAVITY;

/// The checks.
pub const CHECKS: Checks = Checks {
    required: &[&["torque_front"], &["torque_rear"], &["wheel_speed_front"], &["wheel_speed_rear"], &["speed"]],
    optional: &[
        ("brake_front", "the brakes are taken not to act"),
        ("brake_rear", "the brakes are taken not to act"),
        ("slope", "the ground is taken as level: a grade goes into rolling resistance and centre of gravity"),
        ("spading_force_x", "the bucket is taken to be free"),
        ("spading_force_z", "the bucket is taken to be free"),
    ],
    // Tyres bounce within a quarter of a second.
    slowest: 0.1,
    quick: 100_000,
    gravity: &[],
    relations,
    delays: |_| Vec::new(),
};

/// ```text
/// v = r_i w_i (1 - slip),  slip in proportion to the torque
/// sum T_i/r_i = m (dv/dt + g sin(slope)) + rolling
/// ```
fn relations(signals: &Signals) -> Vec<Relation> {
    let get = |name: &str| signals.known.get(name);
    let radius = [get("loader.wheel_radius_front"), get("loader.wheel_radius_rear")];
    let mut all = Vec::new();
    let axles = [
        ("speed compared with front wheel speed times radius", "wheel_speed_front", "torque_front"),
        ("speed compared with rear wheel speed times radius", "wheel_speed_rear", "torque_rear"),
    ];
    for (axle, (what, wheel, torque)) in axles.into_iter().enumerate() {
        let rolled = signals.term(wheel, 0).map(|term| term.times(radius[axle]));
        let slipping = signals.of([wheel, torque], 0, |[wheel, torque]| wheel * torque);
        if let (Some(y), Some(x)) = (signals.term("speed", 0), rolled) {
            let x = [Some(x), slipping].into_iter().flatten().collect();
            let rolling = Relation::new(what, y.late(), x, Gain::Same(2.0)).given("the rolling radius");
            all.push(rolling.without_constant());
        }
    }
    let force = signals.of(["torque_front", "torque_rear"], 0, |[front, rear]| front / radius[0] + rear / radius[1]);
    if let (Some(y), Some(x)) = (force, signals.term("speed", 1)) {
        let slope = signals.of(["slope"], 0, |[slope]| GRAVITY * slope.sin());
        let brakes = signals.of(["brake_front", "speed"], 0, |[brake, speed]| brake.abs() * speed.signum());
        let x = [Some(x), slope, brakes, signals.term("spading_force_x", 0)].into_iter().flatten().collect();
        let what = "drive force compared with the derivative of the speed";
        let gain = Gain::About(get("loader.mass"), 30.0);
        all.push(Relation::new(what, y.late(), x, gain).given("loader.mass"));
    }
    all
}
