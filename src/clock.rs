//! The sampling clock of a periodic estimator: which sample instants fall into a step from one time to the next. It
//! counts, and asks no operating system for the time.

use serde::{Deserialize, Serialize};

/// Sample instants are `start + k * period`, counted by an integer so that they never drift.
///
/// The master's communication point is the truth. A master that adds up `t += h` gathers rounding
/// errors in `t` (1e-7 s over a million steps of 10 ms), enough to push a sample over a step's
/// boundary. So as long as each step begins exactly where the last one ended, `elapsed` is the
/// compensated sum of the step sizes; a communication point computed otherwise replaces it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    start: f64,
    now: f64,
    elapsed: f64,
    rounding: f64,
    begun: f64,
    samples: i64,
}

impl Clock {
    /// A clock at its start time.
    pub fn new(start: f64) -> Self {
        Self { start, now: start, elapsed: 0.0, rounding: 0.0, begun: 0.0, samples: 0 }
    }

    /// The communication point, s.
    pub fn now(&self) -> f64 {
        self.now
    }

    /// Number of samples taken.
    pub fn samples(&self) -> i64 {
        self.samples
    }

    /// How far a communication point may lie from the end of the last step: 1e-9 of the time and a
    /// thousandth of a period, never half a period.
    pub fn tolerance(&self, period: f64) -> f64 {
        (1e-9 * self.now.abs() + 1e-3 * period).min(0.5 * period) + self.resolution()
    }

    /// Begins a step of `size` at the communication point `point`; gives the number of samples that
    /// will have been taken at its end.
    pub fn advance(&mut self, point: f64, size: f64, period: f64) -> i64 {
        if point != self.now {
            (self.elapsed, self.rounding) = (point - self.start, 0.0);
        }
        self.begun = self.elapsed;
        let term = size - self.rounding;
        let sum = self.elapsed + term;
        self.rounding = (sum - self.elapsed) - term;
        self.elapsed = sum;
        self.now = point + size;
        // a sample at the very end belongs to the next step
        let margin = self.margin(period).min(0.5 * size);
        let periods = (self.elapsed - margin) / period;
        // rounded up; `ceil` is a call on processors that the library must also run on
        let whole = periods as i64;
        whole + i64::from((whole as f64) < periods)
    }

    /// Takes the next sample; gives its time after the beginning of the step.
    pub fn tick(&mut self, period: f64) -> f64 {
        let after = self.samples as f64 * period - self.begun;
        self.samples += 1;
        after
    }

    /// Time from the last sample to the communication point, s; 0 before the first sample.
    pub fn horizon(&self, period: f64) -> f64 {
        if self.samples == 0 {
            return 0.0;
        }
        let ahead = (self.elapsed - (self.samples - 1) as f64 * period).max(0.0);
        if (ahead - period).abs() <= self.margin(period) { period } else { ahead }
    }

    /// Whether the numbers are such as a clock can have that takes a sample every `period`.
    pub fn is_sound(&self, period: f64) -> bool {
        let numbers = [self.start, self.now, self.elapsed, self.rounding, self.begun];
        let near = |time: f64, other: f64| (time - other).abs() <= self.tolerance(period) + period;
        numbers.iter().all(|number| number.is_finite())
            && self.elapsed >= -period
            && near(self.now, self.start + self.elapsed)
            && near(self.samples as f64 * period, self.elapsed)
            && self.rounding.abs() <= period
    }

    fn margin(&self, period: f64) -> f64 {
        (1e-6 * period).max(self.resolution())
    }

    fn resolution(&self) -> f64 {
        4.0 * f64::EPSILON * self.now.abs().max(self.start.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs `count` steps and gives the samples taken in each.
    fn run(start: f64, period: f64, points: impl Iterator<Item = (f64, f64)>) -> (Clock, Vec<i64>) {
        let mut clock = Clock::new(start);
        let mut taken = Vec::new();
        for (point, size) in points {
            assert!((point - clock.now()).abs() <= clock.tolerance(period), "{point} after {}", clock.now());
            let until = clock.advance(point, size, period);
            taken.push(until - clock.samples());
            while clock.samples() < until {
                clock.tick(period);
            }
        }
        (clock, taken)
    }

    #[test]
    fn a_million_accumulated_steps_take_one_sample_each() {
        for start in [0.0, 1000.05, -3.0, 1.7e9] {
            let mut t = start;
            let points = (0..1_000_000).map(|_| {
                let point = t;
                t += 0.01;
                (point, 0.01)
            });
            let (clock, taken) = run(start, 0.01, points);
            assert!(taken.iter().all(|n| *n == 1), "start {start}");
            assert_eq!(clock.horizon(0.01), 0.01);
            assert_eq!(clock.samples(), 1_000_000);
        }
    }

    #[test]
    fn multiplied_times_take_one_sample_each() {
        for start in [0.0, 1000.05, 1.7e9] {
            let (_, taken) = run(start, 0.01, (0..1_000_000).map(|i| (start + i as f64 * 0.01, 0.01)));
            assert!(taken.iter().all(|n| *n == 1), "start {start}");
        }
    }

    #[test]
    fn thirds_of_a_period_take_every_third_step_a_sample() {
        let size = 0.01 / 3.0;
        let (_, taken) = run(1000.05, 0.01, (0..300_000).map(|i| (1000.05 + i as f64 * size, size)));
        assert!(taken.iter().enumerate().all(|(i, n)| *n == i64::from(i % 3 == 0)));
    }

    #[test]
    fn long_steps_take_all_samples_that_begin_in_them() {
        let size = 0.073;
        let (clock, taken) = run(5.0, 0.01, (0..1000).map(|i| (5.0 + i as f64 * size, size)));
        assert_eq!(&taken[..4], &[8, 7, 7, 8]); // [0, 7.3) [7.3, 14.6) [14.6, 21.9) [21.9, 29.2)
        assert_eq!(clock.samples(), 7300);
        assert!((clock.horizon(0.01) - 0.01).abs() < 1e-12);
    }

    #[test]
    fn a_minute_step_still_takes_the_sample_it_begins_with() {
        let mut clock = Clock::new(0.0);
        assert_eq!(clock.advance(0.0, 1e-12, 0.01), 1);
    }

    #[test]
    fn a_clock_that_ran_is_sound_and_an_impossible_one_is_not() {
        for start in [0.0, -3.0, 1.7e9] {
            let (clock, _) = run(start, 0.01, (0..1000).map(|i| (start + i as f64 * 0.0173, 0.0173)));
            assert!(clock.is_sound(0.01) && Clock::new(start).is_sound(0.01));
            for wrong in [
                Clock { elapsed: 1e5, ..clock },
                Clock { samples: -1_000_000_000_000, ..clock },
                Clock { samples: i64::MAX, ..clock },
                Clock { now: start + 1e4, ..clock },
                Clock { start: f64::NAN, ..clock },
                Clock { rounding: -1e9, ..clock },
            ] {
                assert!(!wrong.is_sound(0.01), "{wrong:?}");
            }
        }
    }

    #[test]
    fn rounded_step_sizes_are_accepted() {
        // 60 Hz given in single precision, times multiplied in double
        let size = f64::from(1.0_f32 / 60.0);
        let (clock, _) = run(0.0, 1.0 / 60.0, (0..100_000).map(|i| (i as f64 / 60.0, size)));
        assert_eq!(clock.samples(), 100_000);
    }
}
