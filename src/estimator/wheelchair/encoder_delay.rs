//! By how much the encoders come later than the accelerometer, or earlier.
//!
//! The forward accelerometer feels `v' + g sin theta`; without gravity, as far as the gyro has turned it of late, its integral changes
//! as the speed that the wheels show.

use crate::estimator::relative_delay::DelayOfRate;
use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Time in which a pitch is forgotten, s: what stays is an offset of the acceleration.
const FORGETS_PITCH: f64 = 2.0;
/// Largest time between two readings that show a speed, s.
const LONGEST: f64 = 0.1;

/// What is remembered of encoders and accelerometer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct EncoderDelay {
    delay: DelayOfRate,
    /// How far the gyro has turned of late, rad.
    turned: f64,
    /// How far the wheels had rolled at the last sample, on average, m.
    distance: Option<f64>,
}

impl EncoderDelay {
    /// Takes how far the wheels right and left have rolled, forward specific force and pitch rate `dt` seconds after those before, NaN
    /// where there are none.
    pub fn follow(&mut self, rolled: [f64; 2], accel_x: f64, pitch_rate: f64, gravity: f64, dt: f64) {
        self.turned *= 1.0 - (dt / FORGETS_PITCH).min(1.0);
        if bounded(pitch_rate) {
            self.turned += pitch_rate * dt.min(LONGEST);
        }
        let distance = Some(0.5 * (rolled[0] + rolled[1])).filter(|distance| bounded(*distance));
        if let (Some(before), Some(now)) = (std::mem::replace(&mut self.distance, distance), distance)
            && 0.0 < dt
            && dt <= LONGEST
        {
            self.delay.follow((now - before) / dt, accel_x - gravity * self.turned, dt);
        }
    }

    /// How late they may be, s, that are said to be late by `declared` ([`delay_std`](crate::estimator::relative_delay::RelativeDelay::delay_std)).
    pub fn delay_std(&self, declared: f64) -> f64 {
        self.delay.delay_std(declared)
    }

    /// Whether the numbers can have come from [`follow`](Self::follow).
    pub fn is_valid(&self) -> bool {
        self.delay.is_valid() && self.turned.is_finite() && self.distance.is_none_or(bounded)
    }
}
