//! The moment with which hands hold the chair on a slope across its heading, where it is not reported.
//!
//! Gravity turns a chair whose centre of mass lies ahead of the axle downhill by the moment `-M g l gy`
//! ([`model`](crate::model::wheelchair), `r'`). If the chair keeps its heading and no moment is reported, a caregiver, the
//! user's hands or a caster hold it. A filter that takes the report for exact expects a yaw acceleration `r'` that there is
//! none of, and reads the part `dx r'` of the leftward accelerometer as slope: `M l dx/I'` of it, a seventh with the
//! defaults. So the share of gravity's moment that is held unseen is estimated beside the state, by a filter of one state
//! that takes what a correction adds to the yaw rate as a measurement of the unmodelled yaw acceleration: without one the
//! additions are white, and each has the variance by which the correction lowered that of the yaw rate. What is not known
//! of it counts in the standard deviations from the start. The source has nothing of the kind.

use serde::{Deserialize, Serialize};

/// Standard deviation of the share, of which nothing is known: all of the moment may be held.
const UNKNOWN: f64 = 1.0;
/// Time over which the share changes, s.
const KEPT: f64 = 60.0;
/// The report is believed until the share is so many standard deviations from zero, and so large: at the edge of a ramp an
/// error of the slope looks like a small share.
const SIGNIFICANT: f64 = 3.0;
const LEAST: f64 = 0.5;
/// One sample counts at most as this many standard deviations off.
const LARGEST: f64 = 4.0;

/// Share of gravity's moment that is held and not reported.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Held {
    share: f64,
    variance: f64,
}

impl Default for Held {
    fn default() -> Self {
        Self { share: 0.0, variance: UNKNOWN * UNKNOWN }
    }
}

impl Held {
    /// What is taken to be held: nobody holds against more than gravity's moment.
    pub fn taken(&self) -> f64 {
        let least = LEAST.max(SIGNIFICANT * self.variance.sqrt());
        if self.share.abs() > least { self.share.clamp(-1.0, 1.0) } else { 0.0 }
    }

    /// Root mean square of what is held beyond that.
    pub fn unknown(&self) -> f64 {
        ((self.share - self.taken()).powi(2) + self.variance).sqrt()
    }

    /// Lets `dt` seconds pass.
    pub(super) fn wait(&mut self, dt: f64) {
        let kept = (-dt / KEPT).exp();
        self.share *= kept;
        self.variance = kept * kept * self.variance + (1.0 - kept * kept) * UNKNOWN * UNKNOWN;
    }

    /// Takes what a correction added to the yaw rate within the last `dt` seconds, rad/s. All of gravity's moment makes the
    /// yaw acceleration `gravity`, rad/s^2; `spread` is the variance that an addition has without a moment held.
    pub(super) fn update(&mut self, added: f64, gravity: f64, spread: f64, dt: f64) {
        let off = added / dt - (self.share - self.taken()) * gravity;
        let noise = spread / (dt * dt);
        if !(off.is_finite() && noise > 0.0) {
            return;
        }
        let total = self.variance * gravity * gravity + noise;
        let gain = self.variance * gravity / total;
        let most = LARGEST * total.sqrt();
        self.share += gain * off.clamp(-most, most);
        self.variance -= gain * gravity * self.variance;
    }
}
