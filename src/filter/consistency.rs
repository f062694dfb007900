//! Whether a filter still believes the right thing: its innovations over the last seconds.

use super::bounded;
use serde::{Deserialize, Serialize};

/// Normalised innovation squared per channel, averaged over some seconds: 1 if model and noise fit,
/// more if the measurements contradict what the filter takes as given, so that its covariance no
/// longer tells how wrong it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Strain {
    average: f64,
    contradicts: bool,
}

/// Time over which the innovations are averaged, s.
const TIME: f64 = 2.0;
/// Average beyond which the measurements contradict the filter.
const MOST: f64 = 2.0;
/// Average below which they agree again: what has been bent to fit them is wrong for longer than they show.
const AGREED: f64 = 1.5;

impl Default for Strain {
    fn default() -> Self {
        Self { average: 1.0, contradicts: false }
    }
}

impl Strain {
    /// Takes the normalised innovation squared per channel of a sample that came `dt` seconds after the
    /// last one. More than `largest` counts as `largest`: one outlier proves nothing.
    pub fn take(&mut self, nis: f64, largest: f64, dt: f64) {
        self.average += (1.0 - (-dt / TIME).exp()) * (nis.min(largest) - self.average);
        self.contradicts = self.average > if self.contradicts { AGREED } else { MOST };
    }

    /// Whether the measurements of the last seconds contradict the filter.
    pub fn contradicts(&self) -> bool {
        self.contradicts
    }

    /// Whether the number can have come from [`take`](Self::take).
    pub fn is_sound(&self) -> bool {
        bounded(self.average) && self.average >= 0.0
    }
}
