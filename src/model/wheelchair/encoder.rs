//! Wheel angles to travel and heading, and counters that wrap around.

use super::Chair;

/// Travel of the encoder reference point, m, and heading, rad, from the wheel angles, rad
/// (eq. 9, 10 with the sides named and the constant of integration):
/// `s_enc = R (r2 theta_r + r1 theta_l)/T`, `alpha_enc = alpha_ref + R (theta_r - theta_l)/T`.
pub fn wheel_travel(chair: &Chair, right: f64, left: f64) -> (f64, f64) {
    let scale = chair.body.wheel_radius / chair.body.track();
    (
        scale * (chair.body.reference_to_left * right + chair.body.reference_to_right * left),
        chair.heading_reference + scale * (right - left),
    )
}

/// The inverse of [`wheel_travel`]: wheel angles right and left, rad.
pub fn wheel_angles(chair: &Chair, travel: f64, heading: f64) -> (f64, f64) {
    let turned = heading - chair.heading_reference;
    let (right, left) =
        (travel + chair.body.reference_to_right * turned, travel - chair.body.reference_to_left * turned);
    (right / chair.body.wheel_radius, left / chair.body.wheel_radius)
}

/// Unwraps a hardware counter of `bits` bits into a count that never overflows.
///
/// Between two samples the wheel may turn less than half the counter's range.
///
/// ```
/// let mut counter = wheelstate::model::wheelchair::Unwrapper::new(16);
/// assert_eq!(counter.update(65_530), 65_530);
/// assert_eq!(counter.update(4), 65_540);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unwrapper {
    bits: u32,
    last: Option<u64>,
    count: i64,
}

impl Unwrapper {
    /// A counter of `bits` bits; below 1 counts as 1, above 63 as 63.
    pub fn new(bits: u32) -> Self {
        Self { bits: bits.clamp(1, 63), last: None, count: 0 }
    }

    /// Takes the raw counter and returns the unwrapped count; the first one counts from 0.
    pub fn update(&mut self, raw: u64) -> i64 {
        let range = 1_i64 << self.bits;
        let raw = raw & (range as u64 - 1);
        let step = match self.last {
            None => raw as i64,
            Some(last) => {
                let forward = (raw as i64 - last as i64).rem_euclid(range);
                if forward >= range / 2 { forward - range } else { forward }
            }
        };
        self.last = Some(raw);
        self.count = self.count.saturating_add(step);
        self.count
    }
}
