//! A sensor whose reading has frozen.
//!
//! Noise turns a reading back and forth, as white noise does after two of three samples, and where it is finer than the resolution it
//! never gives the same number twice. If a reading turns with the frequency `p`, the chance that it repeats exactly `n` times is less
//! than `(1 - p)^n`. Readings without noise, as of an ideal sensor in a simulation or of a command, and those of a coarse resolution
//! are not watched: what they repeat may be true. Nor is 0, which wheels and torques that rest have exactly. A host whose step is
//! several sample periods gives all readings in all of them: where that is its habit, such repetitions do not count. What else repeats since
//! the very sample since which a sensor is frozen, and seldom repeated before, froze with it, such as another wheel's speed on the same bus.
//!
//! Of sensors that are read more slowly than the others, [`repetition`](super::repetition) tells beside another one.

use serde::{Deserialize, Serialize};

/// Of the last 64 changes of a reading so many are turns, at least, where there is noise, and so many come after repetitions, at most.
const TURNS: u32 = 20;
const REPEATS: u32 = 3;
/// The same of a reading that may have frozen with another one.
const REPEATS_TOGETHER: u32 = 16;
/// Chance that a reading which is not frozen repeats for so long.
const CHANCE: f64 = 1e-9;
/// Fewer repetitions may always be chance, more are not counted.
const LEAST: u32 = 5;
const MANY: u32 = 1_000_000;

/// What is remembered of one input's readings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Frozen {
    last: f64,
    rises: bool,
    /// Of the last 64 readings that differed from the one before, as bits: whether it turned, and whether the one before had repeated.
    turned: u64,
    repeated: u64,
    /// How often the last reading has repeated, and whether it is a frozen one.
    run: u32,
    frozen: bool,
}

impl Default for Frozen {
    /// Without 64 changes nothing is said.
    fn default() -> Self {
        Self { last: 0.0, rises: false, turned: 0, repeated: u64::MAX, run: 0, frozen: false }
    }
}

/// The bits with one more.
fn with(bits: u64, one: bool) -> u64 {
    bits << 1 | u64::from(one)
}

impl Frozen {
    /// Takes a reading; whether it is a frozen one. Others may be frozen and have repeated `others` times at the sample before.
    #[inline]
    fn follow(&mut self, reading: f64, others: u32) -> bool {
        if reading == self.last {
            self.run = (self.run + 1).min(MANY);
            self.frozen |= self.has_frozen(others);
            return self.frozen;
        }
        let rises = reading > self.last;
        self.turned = with(self.turned, rises != self.rises);
        self.repeated = with(self.repeated, self.run > 0);
        (self.last, self.rises, self.run, self.frozen) = (reading, rises, 0, false);
        false
    }

    /// Whether a reading would be the frozen one again.
    fn repeats(&self, reading: f64) -> bool {
        reading == self.last && self.frozen
    }

    fn has_frozen(&self, others: u32) -> bool {
        // what seldom repeats does not ask for the rest
        if self.last == 0.0 || self.run < LEAST {
            return false;
        }
        let (turns, repeats) = (self.turned.count_ones(), self.repeated.count_ones());
        let together = others > 0 && self.run == others + 1 && repeats <= REPEATS_TOGETHER;
        let watched = turns >= TURNS && repeats <= REPEATS;
        together || watched && (1.0 - f64::from(turns) / f64::from(u64::BITS)).powi(self.run as i32) < CHANCE
    }
}

/// Of all inputs of a machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct FrozenInputs {
    inputs: Vec<Frozen>,
    /// Whether any has changed in this sample, and in the one before.
    changed: [bool; 2],
    /// Of the last 64 samples in which one changed, as bits: whether all had repeated before.
    habit: u64,
    /// How often the reading has repeated that is frozen for longest, in this sample and in the one before.
    frozen: [u32; 2],
}

impl FrozenInputs {
    /// Of so many inputs.
    pub fn new(count: usize) -> Self {
        Self { inputs: vec![Frozen::default(); count], changed: [false, true], habit: 0, frozen: [0; 2] }
    }

    /// Takes other readings into memory that is there already.
    pub fn clone_from(&mut self, other: &Self) {
        self.inputs.clone_from(&other.inputs);
        (self.changed, self.habit, self.frozen) = (other.changed, other.habit, other.frozen);
    }

    /// Takes the reading of the input of this number; whether it is a frozen one.
    #[inline]
    pub fn follow(&mut self, number: usize, reading: f64) -> bool {
        let input = &mut self.inputs[number];
        self.changed[0] |= reading != input.last;
        let frozen = input.follow(reading, self.frozen[1]);
        if frozen {
            self.frozen[0] = self.frozen[0].max(input.run);
        }
        frozen
    }

    /// Ends a sample whose readings have all been taken.
    #[inline]
    pub fn finish(&mut self) {
        let [now, before] = self.changed;
        if now {
            self.habit = with(self.habit, !before);
        } else if self.habit.count_ones() > REPEATS {
            // these repetitions are the host's
            self.inputs.iter_mut().for_each(|input| input.run = input.run.saturating_sub(1));
        }
        self.changed = [false, now];
        self.frozen = [0, self.frozen[0]];
    }

    /// Whether a reading would be the frozen one again.
    pub fn repeats(&self, number: usize, reading: f64) -> bool {
        self.inputs[number].repeats(reading)
    }

    /// Whether the numbers can have come from [`follow`](Self::follow) of so many inputs.
    pub fn is_valid(&self, count: usize) -> bool {
        self.inputs.len() == count && self.inputs.iter().all(|input| input.run <= MANY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// How many of 300 repetitions after 500 of these readings are told to be frozen ones.
    fn frozen(reading: impl Fn(f64, f64) -> f64) -> usize {
        let (mut random, mut frozen) = (ChaCha8Rng::seed_from_u64(5), Frozen::default());
        let mut before = 0;
        for k in 0..500 {
            before += usize::from(frozen.follow(reading(0.01 * f64::from(k), random.sample(StandardNormal)), 0));
        }
        assert_eq!(before, 0);
        let last = frozen.last;
        (0..300).filter(|_| frozen.follow(last, 0)).count()
    }

    #[test]
    fn a_noisy_reading_that_repeats_has_frozen() {
        assert!(frozen(|_, noise| 1.0 + 0.01 * noise) > 270);
        // beside a motion of a noise's standard deviation each sample
        assert!(frozen(|t, noise| 100.0 * t + noise) > 200);
    }

    #[test]
    fn what_has_no_noise_or_a_coarse_resolution_may_repeat() {
        assert_eq!(frozen(|t, _| (3.0 * t).sin()), 0);
        assert_eq!(frozen(|_, noise| (noise * 2.0).round() / 2.0), 0);
        assert_eq!(frozen(|_, _| 2.0), 0);
        assert_eq!(frozen(|t, noise| if t < 4.9 { noise } else { 0.0 }), 0, "at rest");
    }

    #[test]
    fn a_host_that_repeats_all_readings_by_habit_freezes_none() {
        let (mut random, mut inputs) = (ChaCha8Rng::seed_from_u64(7), FrozenInputs::new(2));
        // once in a while a step of one sample, so that the readings themselves seldom repeat
        for step in 0..2000 {
            let readings: [f64; 2] = [random.sample(StandardNormal), random.sample(StandardNormal)];
            let times = if step % 10 == 9 { 60 } else { 1 };
            for _ in 0..times {
                let frozen = (0..2).any(|number| inputs.follow(number, readings[number]));
                inputs.finish();
                assert!(!frozen || step < 200, "{step}");
            }
        }
    }

    #[test]
    fn what_repeats_since_another_one_froze_froze_with_it() {
        let (mut random, mut inputs) = (ChaCha8Rng::seed_from_u64(9), FrozenInputs::new(3));
        let mut frozen = [0; 3];
        let mut readings = [1.0, 1.0, 1.0];
        for k in 0..300 {
            let t = 0.01 * f64::from(k);
            // of noise alone, of noise beside a motion that hides it, and of a motion that goes on until later
            let [a, b]: [f64; 2] = [random.sample(StandardNormal), random.sample(StandardNormal)];
            if k < 200 {
                readings = [a, 1000.0 * t + b, t];
            } else if k < 210 {
                readings[2] = t;
            }
            for (number, reading) in readings.into_iter().enumerate() {
                frozen[number] += usize::from(inputs.follow(number, reading));
            }
            inputs.finish();
        }
        assert!(frozen[0] > 70 && frozen[1] == frozen[0] - 1 && frozen[2] == 0, "{frozen:?}");
    }

    #[test]
    fn a_sensor_that_reads_again_is_read() {
        let (mut random, mut frozen) = (ChaCha8Rng::seed_from_u64(6), Frozen::default());
        let mut noise = || -> f64 { random.sample(StandardNormal) };
        (0..300).for_each(|_| assert!(!frozen.follow(noise(), 0)));
        let last = frozen.last;
        assert!((0..100).fold(false, |_, _| frozen.follow(last, 0)) && frozen.repeats(last));
        assert!(!frozen.repeats(last + 1.0) && !frozen.follow(noise(), 0) && !frozen.repeats(last));
    }
}
