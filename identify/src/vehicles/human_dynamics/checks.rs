//! What a body's log must be like: channels, and those that say the same in two ways.

use crate::check::{Accelerometer, Checks, Gain, Relation, Signals};

macro_rules! imu {
    ($stem:literal) => {
        Accelerometer { axes: [concat!($stem, "_x"), concat!($stem, "_y"), concat!($stem, "_z")], upright: false }
    };
}

/// The checks.
pub const CHECKS: Checks = Checks {
    required: &[&["q_*"], &["qd_*"]],
    optional: &[
        ("seat_*", "the seat's forces are unknown, and with them the torques of the lumbar spine"),
        ("imu_*", "accelerations come from the angles alone"),
        ("qdd_*", "accelerations of the joints are their priors'"),
        ("right_hand_*", "the right hand is taken to be free"),
        ("left_hand_*", "the left hand is taken to be free"),
    ],
    // Passive joints move at up to 3 Hz.
    slowest: 0.1,
    quick: 2_000,
    gravity: &[
        imu!("base_accel"),
        imu!("imu_thorax_accel"),
        imu!("imu_head_accel"),
        imu!("imu_right_forearm_accel"),
        imu!("imu_left_forearm_accel"),
    ],
    relations,
    delays: |_| Vec::new(),
};

/// `qd = dq/dt` and `qdd = dqd/dt` of every joint.
fn relations(signals: &Signals) -> Vec<Relation> {
    let joints: Vec<String> = signals
        .log()
        .channels
        .iter()
        .filter_map(|channel| channel.name.strip_prefix("q_"))
        .map(str::to_owned)
        .collect();
    let mut all = Vec::new();
    for joint in joints {
        for (what, rate, of) in [
            ("joint velocity compared with the derivative of the angle", "qd_", "q_"),
            ("joint acceleration compared with the derivative of the velocity", "qdd_", "qd_"),
        ] {
            let (rate, of) = (format!("{rate}{joint}"), format!("{of}{joint}"));
            if let (Some(y), Some(x)) = (signals.term(&rate, 0), signals.term(&of, 1)) {
                all.push(Relation::new(what, y.late(), vec![x], Gain::Same(2.5)));
            }
        }
    }
    all
}
