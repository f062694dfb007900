//! Recognises a chair that stands still, so that brakes and static friction cannot mislead the filter.

use serde::{Deserialize, Serialize};

/// When a chair stands still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bands {
    /// Time without motion, s.
    pub time: f64,
    /// Change of the distance, m.
    pub distance: f64,
    /// Change of the heading, rad.
    pub heading: f64,
    /// Pitch rate, rad/s.
    pub gyro: f64,
    /// Deviation of the specific force ahead and to the left from its mean, m/s^2.
    pub accel: f64,
}

/// Watches how far distance and heading have moved since the chair came to rest.
///
/// A push shows in the accelerometer before the wheels have turned by a step of the encoders; taken for
/// a slope it would do lasting harm. The bands count from the beginning of the rest, not from a sliding window: creeping is no rest.
/// The first violation ends the rest at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Standstill {
    /// Smallest and largest distance and heading since the watch began.
    distance: (f64, f64),
    heading: (f64, f64),
    /// Duration of the watch, s; `None` before the first complete sample.
    watched: Option<f64>,
    /// Mean of the specific force ahead and to the left over so many samples.
    accel: [f64; 2],
    samples: f64,
    /// Time since the last encoder sample, s.
    blind: f64,
    still: bool,
}

/// What the detector looks at; NaN = missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signs {
    /// Distance of the encoders, m.
    pub distance: f64,
    /// Heading of the encoders, rad.
    pub heading: f64,
    /// Pitch rate, rad/s.
    pub gyro: f64,
    /// Specific force ahead and to the left, m/s^2.
    pub accel: [f64; 2],
}

impl Standstill {
    /// Whether the chair stands still.
    pub fn is_still(&self) -> bool {
        self.still
    }

    /// Takes the sample after `dt` seconds. Returns whether the chair stands still.
    ///
    /// Without encoders nothing is known: after the time that makes a standstill it is taken back.
    pub fn update(&mut self, bands: &Bands, signs: &Signs, dt: f64) -> bool {
        let seen = signs.distance.is_finite() && signs.heading.is_finite();
        self.blind = if seen { 0.0 } else { self.blind + dt };
        let turning = signs.gyro.abs() > bands.gyro;
        let pushed = self.samples > 0.0 && (0..2).any(|k| (signs.accel[k] - self.accel[k]).abs() > bands.accel);
        if turning || pushed || self.blind > bands.time {
            *self = Self { blind: self.blind, ..Self::default() };
        }
        if signs.accel.iter().all(|a| a.is_finite()) {
            self.samples += 1.0;
            for k in 0..2 {
                self.accel[k] += (signs.accel[k] - self.accel[k]) / self.samples;
            }
        }
        if turning || !seen {
            self.watched = self.watched.map(|time| time + dt);
            return self.still;
        }
        let widen = |(low, high): (f64, f64), value: f64| (low.min(value), high.max(value));
        let (distance, heading) = (widen(self.distance, signs.distance), widen(self.heading, signs.heading));
        match self.watched {
            Some(time) if distance.1 - distance.0 <= bands.distance && heading.1 - heading.0 <= bands.heading => {
                (self.distance, self.heading) = (distance, heading);
                self.watched = Some(time + dt);
                self.still = time + dt >= bands.time - 0.5 * dt;
            }
            _ => {
                self.distance = (signs.distance, signs.distance);
                self.heading = (signs.heading, signs.heading);
                self.watched = Some(0.0);
                self.still = false;
            }
        }
        self.still
    }
}
