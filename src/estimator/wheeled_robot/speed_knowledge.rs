//! Whether the longitudinal speed can be known.
//!
//! Without a measured speed only steering and turning carry information about it, and the filter's own covariance
//! does not always notice.

use super::parameters::{Channels, Filter};
use crate::estimator::sampled::LONG_AGO;
use serde::{Deserialize, Serialize};

/// Time over which steering and turning are remembered, and after which a measured speed is an old one, s.
const MEMORY: f64 = 0.5;
/// Root mean square of the sine of the steering angle and of the yaw rate (rad/s) beyond which they show the speed.
const SHOWS_SPEED: [f64; 2] = [0.02, 0.05];
/// Largest standard deviation that is reported, m/s.
const LARGEST_STD: f64 = 200.0;

/// What is remembered of how the speed could be known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct SpeedKnowledge {
    /// Mean squares of the sine of the steering angle and of the yaw rate.
    activity: [f64; 2],
    /// Standard deviation that the speed has at least, m/s.
    std: f64,
    /// Time since a speed was measured, s.
    age: f64,
    unobservable: bool,
}

/// What one sample says about the speed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence {
    /// Whether a speed was measured and used.
    pub measured: bool,
    /// Sine of the steering angle and yaw rate, rad/s.
    pub turning: [f64; 2],
    /// Estimated speed and the standard deviation that the filter gives it, m/s.
    pub speed: f64,
    pub std: f64,
}

/// Whether the parameters let a speed be measured at all.
pub(super) fn is_measured(filter: &Filter) -> bool {
    filter.channels == Channels::WheelSpeed || filter.use_speed
}

impl SpeedKnowledge {
    /// Before the first sample.
    pub fn start(filter: &Filter, std: f64) -> Self {
        Self { activity: [0.0; 2], std, age: LONG_AGO, unobservable: !is_measured(filter) }
    }

    /// Whether no speed was ever measured.
    pub fn is_from_the_start(&self) -> bool {
        self.age >= LONG_AGO
    }

    /// After a gap of so many seconds at whose end the speed has this standard deviation.
    pub fn reset(&mut self, std: f64, gap: f64) {
        *self = Self { activity: [0.0; 2], std, age: (self.age + gap).min(LONG_AGO), ..*self };
    }

    /// Standard deviation that the speed has at least, m/s.
    pub fn std(&self) -> f64 {
        self.std
    }

    /// Whether nothing has shown the speed lately.
    pub fn is_unobservable(&self) -> bool {
        self.unobservable
    }

    /// Takes the sample `dt` seconds after the one before.
    pub fn update(&mut self, filter: &Filter, evidence: &Evidence, dt: f64) {
        let share = (dt / MEMORY).min(1.0);
        for (mean, turning) in self.activity.iter_mut().zip(evidence.turning) {
            *mean += share * (turning * turning - *mean);
        }
        self.age = if evidence.measured { 0.0 } else { (self.age + dt).min(LONG_AGO) };
        let shown = self.activity.iter().zip(SHOWS_SPEED).all(|(mean, least)| *mean > least * least);
        let seen = evidence.measured || (shown && evidence.speed.abs() > filter.minimum_speed);
        if seen {
            self.std = evidence.std;
        } else {
            // the open loop's: unmodelled acceleration, and the noise of the measured one
            let noise = filter.measurement_std.accel_x * dt;
            let grown = self.std * self.std + filter.process_psd.speed_x * dt + noise * noise;
            self.std = grown.sqrt().max(evidence.std).min(LARGEST_STD);
        }
        self.unobservable = !seen && (self.age > MEMORY || !is_measured(filter));
    }
}
