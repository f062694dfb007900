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
}

/// Watches how far distance and heading have moved since the chair came to rest.
///
/// The bands count from the beginning of the rest, not from a sliding window: creeping is no rest.
/// The first violation ends the rest at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Standstill {
    /// Smallest and largest distance and heading since the watch began.
    distance: (f64, f64),
    heading: (f64, f64),
    /// Duration of the watch, s; `None` before the first complete sample.
    watched: Option<f64>,
    /// Time since the last encoder sample, s.
    blind: f64,
    still: bool,
}

impl Standstill {
    /// Whether the chair stands still.
    pub fn is_still(&self) -> bool {
        self.still
    }

    /// Takes the sample after `dt` seconds; NaN = missing. Returns whether the chair stands still.
    ///
    /// Without encoders nothing is known: after the time that makes a standstill it is taken back.
    pub fn update(&mut self, bands: &Bands, distance: f64, heading: f64, gyro: f64, dt: f64) -> bool {
        let turning = gyro.abs() > bands.gyro;
        let seen = distance.is_finite() && heading.is_finite();
        self.blind = if seen { 0.0 } else { self.blind + dt };
        if turning || self.blind > bands.time {
            *self = Self { blind: self.blind, ..Self::default() };
            return false;
        }
        if !seen {
            self.watched = self.watched.map(|time| time + dt);
            return self.still;
        }
        let widen = |(low, high): (f64, f64), value: f64| (low.min(value), high.max(value));
        if let Some(time) = self.watched {
            let (d, h) = (widen(self.distance, distance), widen(self.heading, heading));
            if d.1 - d.0 <= bands.distance && h.1 - h.0 <= bands.heading {
                (self.distance, self.heading) = (d, h);
                self.watched = Some(time + dt);
                self.still = time + dt >= bands.time - 0.5 * dt;
                return self.still;
            }
        }
        *self = Self { distance: (distance, distance), heading: (heading, heading), watched: Some(0.0), ..*self };
        self.still = false;
        false
    }
}
