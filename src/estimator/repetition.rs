//! A sensor that is sampled more slowly than the others and held meanwhile, or frozen.
//!
//! A reading that repeats exactly is an old one if another sensor, the witness, has changed by more than its noise since. Without the
//! witness nothing is said: a machine that moves steadily in a simulation without noise repeats all of its readings.

use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Watches one sensor beside its witness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Repetition {
    /// The last new reading.
    reading: f64,
    /// What the witness said then.
    witness: f64,
    old: bool,
}

impl Repetition {
    /// Takes a reading and what the witness says; whether it is an old one: it repeats although the witness has changed by more
    /// than `noise` since. Of readings that are none, NaN, nothing is said.
    pub fn is_old(&mut self, reading: f64, witness: f64, noise: f64) -> bool {
        if reading != self.reading {
            self.old = false;
            if reading.is_finite() && witness.is_finite() {
                (self.reading, self.witness) = (reading, witness);
            }
            return false;
        }
        // What is old does not become new when the witness returns.
        self.old |= (witness - self.witness).abs() > noise;
        self.old
    }

    /// The last new reading if it is an old one by now.
    pub fn old_reading(&self) -> Option<f64> {
        self.old.then_some(self.reading)
    }

    /// Whether the numbers can have come from [`is_old`](Self::is_old).
    pub fn is_valid(&self) -> bool {
        bounded(self.reading) && bounded(self.witness)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_that_repeats_while_its_witness_changes_is_an_old_one() {
        let mut repetition = Repetition::default();
        let mut old = |reading: f64, witness: f64| repetition.is_old(reading, witness, 0.1);
        assert_eq!([old(1.0, 1.0), old(1.0, 1.05), old(1.0, 1.2), old(1.2, 1.2)], [false, false, true, false]);
        assert!((0..50).all(|_| !old(1.2, 1.2)), "what moves steadily without noise");
        assert!(!old(f64::NAN, 2.0) && !old(1.2, f64::NAN) && old(1.2, 2.0));
        assert!(old(1.2, 1.2), "until there is a new one");
        assert_eq!(repetition.old_reading(), Some(1.2));
    }
}
