//! Yaw accelerations that nobody reports: hands on the rims, a caregiver, motors whose moment is no input.
//!
//! No sensor shows them. The filter takes them for white noise and follows late: at 1 rad/s^2 the yaw rate lags by
//! 0.1 rad/s, four of its standard deviations, and what the accelerometer feels of them goes into the tilt. What the measurement
//! update adds to the yaw rate in one sample after another is that acceleration,
//!
//! ```text
//! a = mean (r(k|k) - r(k|k-1)) / dt
//! ```
//!
//! which is zero but for noise, of the variance `(P(k|k-1) - P(k|k)) / dt^2` per sample, where the model is right. What it is beyond that
//! makes the yaw rate's process noise larger, by [`PER_SQUARE`] of its square, and the accelerometer's where it sits off
//! the axle. The source has nothing of the kind.

use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Memory of the mean, s: a fraction of a turn of a slalom.
const TIME: f64 = 0.2;
/// Memory of what lasts, s.
const LASTING: f64 = 0.5;
/// Memory of the square, s: some turns.
const MEMORY: f64 = 1.0;
/// Of the square the noise explains so many times its variance.
const NOISE: f64 = 2.0;
/// Density of white noise in the yaw rate per square of the acceleration, s: with the encoders' noise the yaw rate that it
/// gives lags by less than it is noisy.
const PER_SQUARE: f64 = 0.1;
/// Larger accelerations are those of a wheel that hits something, rad/s^2.
const LARGEST: f64 = 5.0;

/// The yaw acceleration that the model lacks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Turn {
    /// Mean, rad/s^2, and its variance by the noise.
    mean: f64,
    variance: f64,
    /// Its mean over a longer time, which ground that tilts otherwise than was said explains as well as a moment; 0 where no
    /// moment is reported at all.
    lasting: f64,
    /// Mean square of what it is beside that, less the noise, rad^2/s^4.
    square: f64,
}

impl Turn {
    /// Density of the white noise that lets the yaw rate follow, beyond the usual one, rad^2/s^3.
    pub fn density(&self) -> f64 {
        PER_SQUARE * self.square.max(self.seen()).max(0.0)
    }

    /// Variance of the acceleration, white noise of this density, over `dt` seconds, rad^2/s^4.
    pub(super) fn variance(&self, dt: f64) -> f64 {
        if dt > 0.0 { self.density() / dt } else { 0.0 }
    }

    /// Takes what a sample `dt` seconds after the last one has added to the yaw rate, rad/s, and taken from its variance;
    /// whether moments are reported.
    pub(super) fn follow(&mut self, added: f64, learnt: f64, reported: bool, dt: f64) {
        let share = 1.0 - (-dt / TIME).exp();
        self.mean += share * (added / dt - self.mean);
        self.variance += share * (share * learnt.max(0.0) / (dt * dt) - (2.0 - share) * self.variance);
        self.lasting += (1.0 - (-dt / LASTING).exp()) * (self.mean - self.lasting);
        if !reported {
            self.lasting = 0.0;
        }
        self.square += (1.0 - (-dt / MEMORY).exp()) * (self.seen() - self.square);
    }

    /// What the square is beyond the noise, rad^2/s^4.
    fn seen(&self) -> f64 {
        ((self.mean - self.lasting).powi(2) - NOISE * self.variance).min(LARGEST * LARGEST)
    }

    /// What comes next has nothing to do with what was before.
    pub(super) fn interrupt(&mut self) {
        *self = Self { square: self.square, ..Self::default() };
    }

    /// Whether its numbers are those of a turn.
    pub(super) fn is_valid(&self) -> bool {
        [self.mean, self.variance, self.lasting, self.square].into_iter().all(bounded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const DT: f64 = 0.01;
    /// Of what a sample adds to the yaw rate, rad/s.
    const STD: f64 = 3e-3;

    /// Density after some seconds of a yaw acceleration, in which a sample adds what the noise of the encoders does, too.
    fn density(seconds: f64, reported: bool, acceleration: impl Fn(f64) -> f64) -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut turn = Turn::default();
        for k in 0..(seconds / DT) as u32 {
            let noise: f64 = StandardNormal.sample(&mut random);
            turn.follow(acceleration(f64::from(k) * DT) * DT + STD * noise, STD * STD, reported, DT);
        }
        turn.density()
    }

    #[test]
    fn a_yaw_acceleration_widens_by_its_square_and_noise_does_not() {
        let constant = density(5.0, false, |_| 1.0);
        assert!((constant / PER_SQUARE - 1.0).abs() < 0.3, "{constant}");
        let held = density(5.0, true, |_| 1.0);
        assert!(held < 0.1 * PER_SQUARE, "ground that tilts: {held}");
        let swinging = density(5.0, true, |t| 1.5 * (2.0 * t).sin());
        assert!((0.5..2.0).contains(&(swinging / (PER_SQUARE * 1.5 * 1.5 / 2.0))), "{swinging}");
        let largest = (1..100).map(|k| density(0.1 * f64::from(k), false, |_| 0.0)).fold(0.0, f64::max);
        assert!(largest < 4e-3, "less than the usual density: {largest}");
    }
}
