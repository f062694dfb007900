//! What a chair at rest looks like to encoders, gyro and accelerometer.

use serde::{Deserialize, Serialize};

/// How far the signs of a chair at rest may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bands {
    /// Change of the distance, m.
    pub distance: f64,
    /// Change of the heading, rad.
    pub heading: f64,
    /// Pitch rate, rad/s.
    pub gyro: f64,
    /// Deviation of the forward and leftward specific force from its mean, m/s^2.
    pub accel: f64,
}

/// Watches how far distance and heading have moved since the chair came to rest.
///
/// A push shows in the accelerometer before the wheels have turned by a step of the encoders; taken for
/// a slope it would do lasting harm. The bands count from the beginning of the rest, not from a sliding window: creeping
/// is no rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rest {
    /// Smallest and largest distance and heading since the watch began; `None` before the first encoder sample.
    travel: Option<[(f64, f64); 2]>,
    /// Mean of the forward and leftward specific force over so many samples.
    accel: [f64; 2],
    samples: f64,
}

/// What is looked at; NaN = missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signs {
    /// Distance of the encoders, m.
    pub distance: f64,
    /// Heading of the encoders, rad.
    pub heading: f64,
    /// Pitch rate, rad/s.
    pub gyro: f64,
    /// Forward and leftward specific force, m/s^2.
    pub accel: [f64; 2],
}

impl Rest {
    /// Whether the chair has not moved since the watch began; `None` if the encoders say nothing. Motion begins a new
    /// watch.
    pub fn watch(&mut self, bands: &Bands, signs: &Signs) -> Option<bool> {
        let turning = signs.gyro.abs() > bands.gyro;
        let pushed = self.samples > 0.0 && (0..2).any(|k| (signs.accel[k] - self.accel[k]).abs() > bands.accel);
        if turning || pushed {
            *self = Self::default();
        }
        if signs.accel.iter().all(|a| a.is_finite()) {
            self.samples += 1.0;
            for k in 0..2 {
                self.accel[k] += (signs.accel[k] - self.accel[k]) / self.samples;
            }
        }
        let now = [signs.distance, signs.heading];
        if !now.iter().all(|value| value.is_finite()) {
            return if turning || pushed { Some(false) } else { None };
        }
        let widened = |k: usize| self.travel.map(|seen| (seen[k].0.min(now[k]), seen[k].1.max(now[k])));
        if !turning
            && let (Some(distance), Some(heading)) = (widened(0), widened(1))
            && distance.1 - distance.0 <= bands.distance
            && heading.1 - heading.0 <= bands.heading
        {
            self.travel = Some([distance, heading]);
            return Some(true);
        }
        self.travel = if turning { None } else { Some(now.map(|value| (value, value))) };
        Some(false)
    }
}
