//! Forces that nobody reports and that change fast: a person who rocks, hands on the rims, a brake that takes hold.
//!
//! An unmodelled force that drifts is a state of the kinds with a drive force ([`FORCE_OFFSET`](crate::model::wheelchair::FORCE_OFFSET)).
//! One that swings within a second is none of these: the filter would take the reported force for noise that the accelerometer does
//! not follow, unlearn the force's gain, and put gravity's part of a ramp into slope and biases. How fast the force moves
//! is seen in `u = m nu + c_f`, the innovation of the forward accelerometer as a force beside what is known of it, which contains
//! neither slope nor acceleration. Between means of `u` over blocks of `D` seconds that lie `k` blocks apart a random walk of the
//! density `q` has moved by
//!
//! ```text
//! E d^2 = q D (k - 1/3) + 2 s^2
//! ```
//!
//! with `s^2` the variance of a mean by the accelerometer's noise. The largest `q` that some `k` shows beyond its noise is what the
//! state's random walk is given. The source has nothing of the kind.

use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Length of a block, s.
const BLOCK: f64 = 0.05;
/// Blocks that are compared with the present one: so many before it.
const APART: [usize; 4] = [1, 2, 4, 8];
const KEPT: usize = APART[APART.len() - 1];
/// Memory of the squares, s: some swings of a body.
const TIME: f64 = 2.0;
/// Of the squares the noise explains so many times its own: its mean square scatters.
const NOISE: f64 = 2.0;
/// Larger steps are none of a person or a brake but of a sensor or an impact, m/s^2.
const LARGEST: f64 = 2.5;
/// A gap of so many blocks between two samples begins anew.
const GAP: f64 = 2.0;

/// How fast an unreported force moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Push {
    /// Of the present block: sum of the force, N, and of the variance of a sample, N^2; samples; time, s.
    sum: f64,
    variance: f64,
    samples: f64,
    time: f64,
    /// Means of the blocks before, the last one first, and how many of them there are.
    means: [f64; KEPT],
    blocks: usize,
    /// Mean squares of what lies between blocks so far apart, less the noise, N^2.
    moved: [f64; APART.len()],
    /// What the largest of them makes of the random walk, N^2/s.
    density: f64,
}

impl Push {
    /// Density of the random walk that moves as the force does beyond what is expected, N^2/s.
    pub fn density(&self) -> f64 {
        self.density
    }

    /// Takes the force that a sample shows beside the reported one, of this variance, `dt` seconds after the last sample of a chair of
    /// this mass.
    pub(super) fn follow(&mut self, force: f64, variance: f64, mass: f64, dt: f64) {
        if dt > GAP * BLOCK {
            self.interrupt();
        }
        self.sum += force;
        self.variance += variance;
        self.samples += 1.0;
        self.time += dt;
        // half a sample: sums of time steps are not exact
        if self.time < BLOCK - 0.5 * dt {
            return;
        }
        let (mean, noise) = (self.sum / self.samples, 2.0 * self.variance / (self.samples * self.samples));
        let share = 1.0 - (-self.time / TIME).exp();
        for (moved, apart) in self.moved.iter_mut().zip(APART) {
            let by = mean - self.means[apart - 1];
            let counts = apart <= self.blocks && by.abs() < LARGEST * mass;
            let seen = if counts { by * by - NOISE * noise } else { 0.0 };
            *moved += share * (seen - *moved);
        }
        let of = |(apart, moved): (&usize, &f64)| moved / (BLOCK * (*apart as f64 - 1.0 / 3.0));
        self.density = APART.iter().zip(&self.moved).map(of).fold(0.0, f64::max);
        self.means.rotate_right(1);
        self.means[0] = mean;
        self.blocks = (self.blocks + 1).min(KEPT);
        (self.sum, self.variance, self.samples, self.time) = (0.0, 0.0, 0.0, 0.0);
    }

    /// What comes next has nothing to do with what was before: no force acts on a chair that stands.
    pub(super) fn interrupt(&mut self) {
        *self = Self { moved: self.moved, density: self.density, ..Self::default() };
    }

    /// Whether its numbers are those of a force.
    pub(super) fn is_valid(&self) -> bool {
        let all = [self.sum, self.variance, self.samples, self.time, self.density];
        all.iter().chain(&self.means).chain(&self.moved).all(|value| bounded(*value)) && self.blocks <= KEPT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const MASS: f64 = 100.0;
    /// Of a sample by the accelerometer, N.
    const NOISE_STD: f64 = 5.0;

    /// Mean density over some minutes of a force that moves at random with the density `walk`, N^2/s, seen through noise.
    fn found(walk: f64, dt: f64) -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let (mut push, mut force, mut sum, samples) = (Push::default(), 0.0, 0.0, 20_000);
        for _ in 0..samples {
            force += (walk * dt).sqrt() * normal();
            push.follow(force + NOISE_STD * normal(), NOISE_STD * NOISE_STD, MASS, dt);
            sum += push.density() / f64::from(samples);
        }
        sum
    }

    /// The largest of four estimates is above their mean; a block is as many whole samples as fit best, at 20 ms four fifths of its length.
    #[test]
    fn a_random_walk_is_found_with_its_density_and_white_noise_is_none() {
        for dt in [0.005, 0.01, 0.02] {
            for walk in [1e3, 1e4] {
                let found = found(walk, dt);
                assert!((0.8 * walk..2.0 * walk).contains(&found), "{dt} s, {walk}: {found}");
            }
            assert!(found(0.0, dt) < 4.0, "{dt} s: {}", found(0.0, dt));
        }
    }

    #[test]
    fn a_brake_that_takes_hold_is_followed_and_a_sensor_that_jumps_is_not() {
        for (step, followed) in [(60.0, true), (400.0, false)] {
            let mut push = Push::default();
            for k in 0..120 {
                push.follow(if k < 100 { 0.0 } else { step }, NOISE_STD * NOISE_STD, MASS, 0.01);
            }
            assert_eq!(push.density() > 100.0, followed, "{step} N: {}", push.density());
        }
    }
}
