//! White noise of sampled signals, estimated from the signals themselves.
//!
//! What moves a machine has mass and changes slowly beside a sample period; white noise does not. The third difference
//! `d = (z[k] - 3 z[k-1] + 3 z[k-2] - z[k-3])/sqrt(20)` has the variance of white noise of `z` and leaves of a motion at
//! the angular frequency `w`, sampled every `T`, only the share `(w T)^3/sqrt(20)`. Unlike an innovation it asks no model,
//! so that a noise estimated from it cannot hide that the model is contradicted.

use super::bounded;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Memory, s.
const TIME: f64 = 0.3;
/// Samples in the mean square at least. The first samples count alike until there were enough for the memory.
const LEAST: u32 = 10;
/// Samples are counted up to this.
const MANY: u32 = 1_000_000;
/// A square beyond this many times the present mean counts as so many: one jump is no noise.
const LARGEST: f64 = 9.0;
/// Mean squares below this many times the declared variance are what chance makes of it.
const CHANCE: f64 = 2.0;
/// Samples further apart than this show the motion too, s.
pub const LONGEST: f64 = 0.1;
/// Largest inflation of a variance.
const MOST: f64 = 1e8;

/// Mean squares of the third differences of `M` signals over their declared variances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SignalNoise<const M: usize> {
    square: SVector<f64, M>,
    /// The last three samples of each, the newest first.
    last: SMatrix<f64, 3, M>,
    /// Samples of each so far.
    samples: SVector<u32, M>,
    /// Time since the last sample of each, s.
    age: SVector<f64, M>,
}

impl<const M: usize> Default for SignalNoise<M> {
    /// As declared.
    fn default() -> Self {
        Self { square: SVector::repeat(1.0), last: SMatrix::zeros(), samples: SVector::zeros(), age: SVector::zeros() }
    }
}

impl<const M: usize> SignalNoise<M> {
    /// Takes the samples `dt` seconds after those before, in units of their declared standard deviations; NaN is
    /// none.
    pub fn update(&mut self, z: &SVector<f64, M>, dt: f64) {
        for j in 0..M {
            self.age[j] = (self.age[j] + dt).min(1e9);
            if z[j].is_nan() {
                continue;
            }
            if self.age[j] > LONGEST {
                (self.samples[j], self.square[j]) = (0, 1.0);
            }
            self.age[j] = 0.0;
            let [a, b, c] = self.last.data.0[j];
            self.last.data.0[j] = [z[j], a, b];
            self.samples[j] = (self.samples[j] + 1).min(MANY);
            if self.samples[j] <= 3 {
                continue;
            }
            let difference = z[j] - 3.0 * (a - b) - c;
            let count = f64::from(self.samples[j] - 3);
            let mut square = difference * difference / 20.0;
            if self.samples[j] > 3 + LEAST {
                square = square.min(LARGEST * self.square[j].max(1.0));
            }
            let share = (1.0 / count).max((dt / TIME).min(1.0 / f64::from(LEAST)));
            self.square[j] = (self.square[j] + share * (square - self.square[j])).min(MOST);
        }
    }

    /// Whether the samples have begun to show a signal's noise.
    pub fn is_seen(&self, signal: usize) -> bool {
        self.samples[signal] > 3
    }

    /// Factor of a signal's declared variance, 1 unless it is clearly noisier.
    pub fn inflation(&self, signal: usize) -> f64 {
        let square = self.square[signal];
        // from chance to certainty without a jump
        square.min(CHANCE * (square - CHANCE) + 1.0).max(1.0)
    }

    /// Whether the numbers can have come from [`update`](Self::update).
    pub fn is_valid(&self) -> bool {
        self.square.iter().all(|square| bounded(*square) && *square >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    /// White noise of unit variance, in law: the sum of twelve uniform numbers, less six.
    fn noise(seed: &mut u64) -> f64 {
        let mut uniform = || {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*seed >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    /// Factor of the variance after 5 s of samples every `dt` seconds.
    fn learnt(dt: f64, mut signal: impl FnMut(f64) -> f64) -> f64 {
        let mut seen = SignalNoise::<1>::default();
        for k in 0..(5.0 / dt) as u32 {
            seen.update(&Vector1::new(signal(dt * f64::from(k))), dt);
        }
        seen.inflation(0)
    }

    #[test]
    fn white_noise_is_seen_with_its_variance_and_none_is_seen_where_there_is_no_more_than_declared() {
        for dt in [0.002, 0.005, 0.01, 0.02] {
            let mut seed = 7;
            assert!(learnt(dt, |_| noise(&mut seed)) < 1.5, "{dt}");
            for std in [3.0, 10.0, 60.0] {
                let found = learnt(dt, |_| std * noise(&mut seed)).sqrt();
                assert!((found / std - 1.0).abs() < 0.4, "{dt} s: {found} for {std}");
            }
        }
    }

    #[test]
    fn motion_is_no_noise() {
        // 5 m/s2 at 1.5 Hz beside a noise of 0.1 m/s2, and a jump of 3 m/s2
        let swing = |t: f64| 50.0 * (9.4 * t).sin();
        assert_eq!(learnt(0.01, swing), 1.0);
        assert_eq!(learnt(0.02, swing), 1.0);
        assert_eq!(learnt(0.01, |t| if t < 4.9 { 0.0 } else { 30.0 }), 1.0);
    }

    #[test]
    fn what_was_noisy_is_quiet_again_within_seconds_and_after_a_pause_at_once() {
        let mut seen = SignalNoise::<1>::default();
        let mut seed = 3;
        let mut run = |seen: &mut SignalNoise<1>, seconds: f64, std: f64| {
            (0..(100.0 * seconds) as u32).for_each(|_| seen.update(&Vector1::new(std * noise(&mut seed)), 0.01));
            seen.inflation(0)
        };
        assert!(run(&mut seen, 1.0, 60.0) > 1000.0);
        assert_eq!(run(&mut seen, 4.0, 0.3), 1.0);
        run(&mut seen, 1.0, 60.0);
        seen.update(&Vector1::new(0.0), 1.0);
        assert!(!seen.is_seen(0) && seen.inflation(0) == 1.0);
    }
}
