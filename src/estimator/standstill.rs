//! Whether a machine stands still: one detector; each machine says what it sees as quiet and for how long.

use serde::{Deserialize, Serialize};

/// Counts how long nothing has moved. The first sign of motion ends a standstill at once; without anything seen
/// for longer than it takes to recognise one, it is taken back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Standstill {
    /// Time without motion, s.
    quiet: f64,
    /// Time since anything was seen, s.
    unseen: f64,
    still: bool,
}

impl Standstill {
    /// Whether the machine stands still.
    pub fn is_still(&self) -> bool {
        self.still
    }

    /// Takes the sample `dt` seconds after the one before and returns whether the machine stands still: quiet for at
    /// least `time` seconds. `quiet` is whether nothing moves as far as can be seen, `None` if nothing can be seen.
    pub fn update(&mut self, quiet: Option<bool>, time: f64, dt: f64) -> bool {
        match quiet {
            Some(false) => *self = Self::default(),
            Some(true) => {
                self.unseen = 0.0;
                self.quiet = (self.quiet + dt).min(1e9);
                // half a sample: sums of time steps are not exact
                self.still = self.quiet >= time - 0.5 * dt;
            }
            None => {
                self.unseen += dt;
                self.quiet = (self.quiet + dt).min(1e9);
                if self.unseen > time {
                    *self = Self { unseen: self.unseen.min(1e9), ..Self::default() };
                }
            }
        }
        self.still
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standstill_takes_its_time_and_ends_at_once() {
        let mut standstill = Standstill::default();
        let still: Vec<bool> = (0..40).map(|_| standstill.update(Some(true), 0.3, 0.01)).collect();
        assert_eq!(still.iter().position(|still| *still), Some(29), "the 30th sample completes 0.3 s");
        assert!(!standstill.update(Some(false), 0.3, 0.01));
        assert!(!standstill.update(Some(true), 0.3, 0.01));
    }

    #[test]
    fn what_is_not_seen_for_long_is_no_standstill() {
        let mut standstill = Standstill::default();
        (0..40).for_each(|_| _ = standstill.update(Some(true), 0.3, 0.01));
        let still: Vec<bool> = (0..40).map(|_| standstill.update(None, 0.3, 0.01)).collect();
        assert!(still[..29].iter().all(|still| *still) && still[31..].iter().all(|still| !still));
    }

    #[test]
    fn without_a_waiting_time_the_first_quiet_sample_is_a_standstill() {
        assert!(Standstill::default().update(Some(true), 0.0, 0.01));
    }
}
