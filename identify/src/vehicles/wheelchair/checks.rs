//! What a wheelchair's log must be like: channels, and those that say the same in two ways.

use super::problem::signals::chair;
use crate::check::{Accelerometer, Checks, Gain, Relation, Signals, Term};
use wheelstate::model::wheelchair::wheel_travel;

/// The checks.
pub const CHECKS: Checks = Checks {
    required: &[&["encoder_left"], &["encoder_right"], &["accel_x"], &["accel_y"], &["drive_force"], &["drive_moment"]],
    optional: &[],
    // Ten samples in a window of 1 s.
    slowest: 0.1,
    quick: 100_000,
    gravity: &[Accelerometer { axes: ["accel_x", "accel_y", "accel_z"], upright: true }],
    relations,
    delays: |_| Vec::new(),
};

/// ```text
/// a_x = dv/dt + g sin(slope) - dx r^2 - dy dr/dt,   a_y = v r + dx dr/dt - dy r^2
/// u_f = M a_x + D v + Fc sgn v,                     u_r = IP dr/dt + B r + tauc sgn r + ML a_y
/// ```
fn relations(signals: &Signals) -> Vec<Relation> {
    let chair = chair(signals.known);
    let encoders = ["encoder_right", "encoder_left"];
    let of = |order: usize, turned: bool| {
        signals.of(encoders, order, |[right, left]| {
            let (travel, heading) = wheel_travel(&chair, right, left);
            if turned { heading } else { travel + chair.reference_offset() * (heading - chair.heading_reference) }
        })
    };
    let (Some(acceleration), Some(turning)) = (of(2, false), of(2, true)) else { return Vec::new() };
    let (Some(speed), Some(rate)) = (of(1, false), of(1, true)) else { return Vec::new() };
    let [_, dy, _] = chair.lever();
    let mut all = Vec::new();
    if let Some(y) = signals.term("accel_x", 0) {
        let what = "accel_x compared with the encoders' acceleration";
        let x = vec![acceleration.plus(Some(turning.clone().times(-dy)))];
        all.push(Relation::new(what, y.late(), x, Gain::Same(2.5)).given("chair.wheel_radius"));
    }
    for (what, one, other) in [
        ("accel_x compared with the left encoder's acceleration", "encoder_left", "encoder_right"),
        ("accel_x compared with the right encoder's acceleration", "encoder_right", "encoder_left"),
    ] {
        let half = |name: &str| signals.term(name, 2).map(|term| term.times(0.5 * chair.body.wheel_radius));
        if let (Some(y), Some(x), Some(other)) = (signals.term("accel_x", 0), half(one), half(other)) {
            all.push(
                Relation::new(what, y, vec![x, other], Gain::Same(3.0)).given("chair.wheel_radius").with_delay(false),
            );
        }
    }
    let [forward, turn] = [of(0, false), of(0, true)].map(|term| term.map(|term| signals.slope(&term)));
    if let (Some(y), Some(x)) =
        (signals.term("accel_y", 0), forward.as_ref().and_then(|v| signals.product(v, turn.as_ref())))
    {
        let what = "accel_y compared with the encoders' speed times yaw rate";
        all.push(
            Relation::new(what, y, vec![x, turning.clone()], Gain::Same(2.5))
                .given("chair.wheel_radius")
                .with_delay(false),
        );
    }
    let gravity = signals.known.get("gravity");
    let tilting = signals.term("accel_x", 1).map(|term| term.times(1.0 / gravity));
    if let (Some(y), Some(x), Some(change)) =
        (signals.term("gyro_pitch", 0), tilting, forward.map(|v| signals.slope(&v)))
    {
        let what = "gyro_pitch compared with the change of the slope that accel_x shows";
        let change = Term { parts: change.parts.into_iter().map(|(values, _)| (values, 1)).collect(), ..change };
        // The speed is smoothed twice, which takes from the edges of a ramp.
        let x = vec![x.plus(Some(change.times(-1.0 / gravity)))];
        all.push(Relation::new(what, y, x, Gain::Same(6.0)).given("chair.wheel_radius").with_delay(false));
    }
    // The noisy side stands on the left: noise among the regressors would bias the coefficients of the others.
    if let (Some(x), Some(y)) = (signals.term("drive_force", 0), signals.term("accel_x", 0)) {
        let what = "accel_x compared with the drive force";
        let gain = Gain::About(1.0 / signals.known.get("chair.mass"), 30.0);
        all.push(Relation::new(what, y, vec![x.late(), speed], gain).given("chair.mass"));
    }
    if let Some(x) = signals.term("drive_moment", 0) {
        let what = "the encoders' yaw acceleration compared with the drive moment";
        let side = signals.term("accel_y", 0);
        let gain = Gain::About(1.0 / signals.known.get("chair.yaw_inertia"), 30.0);
        let x = [Some(x.late()), Some(rate), side].into_iter().flatten().collect();
        all.push(Relation::new(what, turning, x, gain).given("chair.wheel_radius"));
    }
    all
}
