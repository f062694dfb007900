//! Whether the innovations of the last seconds agree with what a filter was given.

use super::bounded;
use serde::{Deserialize, Serialize};

/// Normalised innovation squared per channel, averaged over some seconds: 1 if model and noise fit,
/// more if the measurements contradict what the filter takes as given, so that its covariance no
/// longer tells how wrong it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NisMonitor {
    average: f64,
    contradicted: bool,
}

/// Time over which the innovations are averaged, s.
const TIME: f64 = 2.0;
/// Average beyond which the measurements contradict the filter.
const MOST: f64 = 2.0;
/// Average below which they agree again: what has been bent to fit them is wrong for longer than they show.
const AGREED: f64 = 1.5;
/// More than this counts as this: one outlier proves nothing.
const LARGEST: f64 = 16.0;

impl Default for NisMonitor {
    fn default() -> Self {
        Self { average: 1.0, contradicted: false }
    }
}

impl NisMonitor {
    /// Takes the normalised innovation squared per channel of a sample that came `dt` seconds after the last one.
    pub fn update(&mut self, nis: f64, dt: f64) {
        self.average += (1.0 - (-dt / TIME).exp()) * (nis.min(LARGEST) - self.average);
        self.contradicted = self.average > if self.contradicted { AGREED } else { MOST };
    }

    /// Whether the measurements of the last seconds contradict the filter.
    pub fn contradicted(&self) -> bool {
        self.contradicted
    }

    /// Whether the number can have come from [`update`](Self::update).
    pub fn is_valid(&self) -> bool {
        bounded(self.average) && self.average >= 0.0
    }
}
