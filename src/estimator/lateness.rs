//! What a sensor whose samples come late, or are held between slower ones, leaves out of an estimate that follows it; the same
//! as what an estimate that is not carried forward leaves out after a while.
//!
//! A signal `x` that comes `tau` late is off by `tau x'`. Its first-order low-pass `s` with the time constant `T` lags by as
//! much as a signal that comes `T` late, without a derivative that would show noise: `x - s = T x'` for what changes more
//! slowly than that. The largest of late counts, so that nothing is sure of itself where the signal turns back and `x' = 0`.

use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Time constant `T` of the low-pass, s.
const TIME: f64 = 0.05;
/// Time in which a change fades, s: bodies and vehicles swing with a period of one to two.
const FADES: f64 = 0.75;

/// How much each of `N` signals has changed of late.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lateness<const N: usize> {
    #[serde(with = "crate::filter::array")]
    smoothed: [f64; N],
    #[serde(with = "crate::filter::array")]
    change: [f64; N],
}

impl<const N: usize> Default for Lateness<N> {
    fn default() -> Self {
        Self::at([0.0; N])
    }
}

impl<const N: usize> Lateness<N> {
    /// Of signals that begin at these values.
    pub fn at(values: [f64; N]) -> Self {
        Self { smoothed: values, change: [0.0; N] }
    }

    /// Takes the signals `dt` seconds after the values before.
    pub fn follow(&mut self, values: [f64; N], dt: f64) {
        let (kept, behind) = ((-dt / FADES).exp(), (-dt / TIME).exp());
        for ((smoothed, change), value) in self.smoothed.iter_mut().zip(&mut self.change).zip(values) {
            let ahead = value - *smoothed;
            *change = change.max(ahead.abs()) * kept;
            *smoothed = value - ahead * behind;
        }
    }

    /// Standard deviation of a signal's error where its samples come late by `late` seconds (one standard deviation).
    pub fn std(&self, signal: usize, late: f64) -> f64 {
        self.change[signal] * (late / TIME)
    }

    /// Whether the numbers can have come from [`follow`](Self::follow).
    pub fn is_valid(&self) -> bool {
        self.smoothed.iter().chain(&self.change).all(|value| bounded(*value))
            && self.change.iter().all(|change| *change >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of the samples of a signal that comes so late, s, which three deviations do not hold, after the first second.
    fn beyond(signal: impl Fn(f64) -> f64, dt: f64, late: f64, std: f64) -> f64 {
        let (mut lateness, mut beyond, count) = (Lateness::default(), 0.0, (10.0 / dt) as u32);
        for k in 0..count {
            let t = dt * f64::from(k);
            lateness.follow([signal(t - late)], dt);
            let error = (signal(t) - signal(t - late)).abs();
            beyond += f64::from(u8::from(t > 1.0 && error > 3.0 * lateness.std(0, std) + 1e-12));
        }
        beyond / f64::from(count)
    }

    #[test]
    fn three_deviations_hold_a_signal_that_is_late_by_two_of_them() {
        for dt in [0.002, 0.01, 0.02] {
            for frequency in [0.2, 0.5, 1.0] {
                let swing = |t: f64| (std::f64::consts::TAU * frequency * t).sin();
                assert!(beyond(swing, dt, 0.02, 0.01) < 0.01, "{dt} s, {frequency} Hz");
            }
            assert_eq!(beyond(|t| 0.7 * t, dt, 0.025, 0.01), 0.0, "{dt} s, steady");
        }
    }

    #[test]
    fn what_does_not_change_is_not_late() {
        let mut lateness = Lateness::default();
        (0..500).for_each(|_| lateness.follow([0.4], 0.01));
        assert!(lateness.std(0, 0.01) < 1e-3);
        assert_eq!(beyond(|_| 0.4, 0.01, 0.05, 0.0), 0.0);
    }
}
