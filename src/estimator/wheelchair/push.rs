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
const KEPT: usize = 8;
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
