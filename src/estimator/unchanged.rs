//! How long nothing new has been read: in a host whose step is several sample periods the samples within a step repeat the first,
//! which is old by then.
//!
//! What repeats may also be steady: nothing is said of the readings, only what the estimates that follow them have changed of late
//! ([`Lateness`](super::lateness::Lateness)) may have changed again meanwhile. Of one sensor that repeats while another one changes,
//! [`Repetition`](super::repetition::Repetition) says that it is old.

use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Longest time that counts, s: no host that moves takes longer steps, and what stands or drives steadily repeats for as long as it likes.
const LONGEST: f64 = 1.0;

/// Watches the readings of a machine's sensors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unchanged<const N: usize> {
    #[serde(with = "crate::filter::array")]
    readings: [f64; N],
    seconds: f64,
}

impl<const N: usize> Default for Unchanged<N> {
    fn default() -> Self {
        Self { readings: [0.0; N], seconds: 0.0 }
    }
}

impl<const N: usize> Unchanged<N> {
    /// Takes the readings `dt` seconds after those before, NaN where there are none. Where there are none at all nothing is old: the
    /// filter knows that it has read nothing.
    pub fn follow(&mut self, readings: [f64; N], dt: f64) {
        if readings.iter().all(|reading| reading.is_nan()) {
            *self = Self::default();
            return;
        }
        let readings = readings.map(|reading| if reading.is_nan() { 0.0 } else { reading });
        self.seconds = if readings == self.readings { (self.seconds + dt).min(LONGEST) } else { 0.0 };
        self.readings = readings;
    }

    /// For how long all of them have repeated, s, at most one second.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Whether the numbers can have come from [`follow`](Self::follow).
    pub fn is_valid(&self) -> bool {
        self.readings.iter().all(|reading| bounded(*reading)) && self.seconds >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_passes_while_all_readings_repeat() {
        let mut unchanged = Unchanged::default();
        let mut after = |readings: [f64; 2]| {
            unchanged.follow(readings, 0.01);
            unchanged.seconds()
        };
        assert_eq!([after([1.0, 2.0]), after([1.0, 2.0]), after([1.0, 2.0])], [0.0, 0.01, 0.02]);
        assert_eq!([after([1.0, 2.1]), after([1.0, f64::NAN]), after([1.0, f64::NAN])], [0.0, 0.0, 0.01]);
        assert_eq!([after([f64::NAN; 2]), after([f64::NAN; 2]), after([1.0, 2.0])], [0.0; 3]);
    }
}
