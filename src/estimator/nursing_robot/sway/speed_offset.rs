//! A speed that is off for longer than noise makes it.
//!
//! The filter takes what its model leaves unexplained for white. A force that lasts is none (rolling resistance other than said, a
//! slope, a torque's offset, a body that muscles move): the speed then settles where its innovations balance that force, as far beside
//! the truth as they are in the mean. So what the mean of some tenths of a second shows beyond noise counts in the deviation.

use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Time over which the innovations are averaged, s: shorter than a body swings.
const TIME: f64 = 0.15;
/// Time in which it fades, s: where the mean passes through zero the speed is no better known.
const FADES: f64 = 0.75;
/// Variance of the mean by white noise that is not counted, in units of its own.
const NOISE: f64 = 4.0;

/// How far the estimated speed is beside the measured one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpeedOffset {
    mean: f64,
    largest: f64,
}

impl SpeedOffset {
    /// Takes the speed's innovation, m/s, of a sensor that is said to have this variance, `dt` seconds after the one before.
    pub fn follow(&mut self, innovation: f64, variance: f64, dt: f64) {
        let share = dt / (TIME + dt);
        self.mean += share * (innovation - self.mean);
        // of white noise a low-pass passes share/(2 - share)
        let noise = variance * share / (2.0 - share);
        let beyond = self.mean * self.mean - NOISE * noise;
        self.largest *= FADES / (FADES + dt);
        if beyond > self.largest * self.largest {
            self.largest = beyond.sqrt();
        }
    }

    /// Standard deviation of the speed from this, m/s.
    pub fn std(&self) -> f64 {
        self.largest
    }

    /// Whether the numbers can have come from [`follow`](Self::follow).
    pub fn is_valid(&self) -> bool {
        bounded(self.mean) && bounded(self.largest) && self.largest >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn an_offset_is_counted_and_white_noise_is_hardly() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        for (offset, expected) in [(0.0, 0.0..=0.0015), (0.03, 0.02..=0.06)] {
            let (mut state, mut mean) = (SpeedOffset::default(), 0.0);
            for _ in 0..2000 {
                let noise: f64 = StandardNormal.sample(&mut random);
                state.follow(offset + 0.01 * noise, 1e-4, 0.01);
                mean += state.std() / 2000.0;
            }
            assert!(expected.contains(&mean), "{offset}: {mean}");
        }
    }
}
