//! A speed over ground that is sampled more slowly than the wheel speeds and held meanwhile, or frozen.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Standard deviations by which the wheels must have changed their speed since a reading that repeats.
const MOVED: f64 = 3.0;

/// The last new reading, m/s, and the rims' mean speed then, m/s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Repetition {
    speed: f64,
    rims: f64,
    /// Whether the speed of the last sample is an old one.
    old: bool,
}

impl Repetition {
    /// Takes out of the measurements `[v, w_f, w_r]` a speed that repeats exactly while the wheels have changed theirs by more than the
    /// noise of both, `std` in m/s: it is an old one. The speed of a machine that stands repeats, whatever its wheels do.
    pub fn screen(&mut self, y: &mut Vector3<f64>, radius: [f64; 2], std: f64) {
        self.old = false;
        let rims = 0.5 * (radius[0] * y[1] + radius[1] * y[2]);
        if !(y[0].is_finite() && rims.is_finite()) {
            return;
        }
        if y[0] != self.speed {
            *self = Self { speed: y[0], rims, old: false };
        } else if y[0] != 0.0 && (rims - self.rims).abs() > MOVED * std {
            (y[0], self.old) = (f64::NAN, true);
        }
    }

    /// The last measurements as they were given: an old speed is a late one, which shows in many together.
    pub fn given(&self, y: &Vector3<f64>) -> Vector3<f64> {
        if self.old { Vector3::new(self.speed, y[1], y[2]) } else { *y }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_that_repeats_while_the_wheels_change_theirs_is_an_old_one() {
        let mut repetition = Repetition::default();
        let mut seen = |speed: f64, wheels: f64| {
            let mut y = Vector3::new(speed, wheels, wheels);
            repetition.screen(&mut y, [0.5; 2], 0.03);
            !y[0].is_nan()
        };
        assert!(seen(1.0, 2.0) && seen(1.0, 2.1) && !seen(1.0, 2.3) && seen(1.15, 2.3));
        assert!((0..50).all(|_| seen(1.15, 2.3)), "a machine that drives steadily without noise");
        assert!(seen(0.0, 0.0) && seen(0.0, 4.0), "wheels that spin under a machine that stands");
    }
}
