//! Sampling of a log: its period, its gaps, parts of it.

use super::{Channel, Log, Series, median};
use std::borrow::Cow;
use std::ops::Range;

/// Steps may differ by this share of the period before a log is resampled.
const UNIFORM: f64 = 0.01;

impl Log {
    /// The usual time between two samples: the median, s.
    pub fn period(&self) -> f64 {
        let own = self.time.clone();
        let time = own.as_slice();
        let steps = |first: usize, to: &mut [f64]| {
            let pairs = time[first..].iter().zip(&time[first + 1..]);
            to.iter_mut().zip(pairs).for_each(|(step, (before, after))| *step = after - before);
        };
        median(time.len().saturating_sub(1), steps).map_or(f64::NAN, |(period, _)| period)
    }

    /// From the first to the last sample, s.
    pub fn duration(&self) -> f64 {
        self.len().checked_sub(1).map_or(0.0, |last| self.time.at(last) - self.time.at(0))
    }

    /// The log on even steps, and its period.
    ///
    /// A log whose steps vary by more than 1 % is interpolated linearly onto its median period; across gaps
    /// of more than one and a half periods and 0.05 s, too long to interpolate what machines and people do,
    /// everything counts as missing.
    pub fn on_even_steps(&self) -> (Cow<'_, Self>, f64) {
        let period = self.period();
        let even = self.time.windows(2).all(|pair| ((pair[1] - pair[0]) - period).abs() <= UNIFORM * period);
        let log = if even || self.len() < 3 {
            Cow::Borrowed(self)
        } else {
            Cow::Owned(self.resample(period, (1.5 * period).max(0.05)))
        };
        // Times written with few digits: the mean step is closer to the truth than the median one.
        let period = if log.len() > 1 { log.duration() / (log.len() - 1) as f64 } else { period };
        (log, period)
    }

    /// A part of the log, whose samples it shares, with those channels whose names `keep` accepts.
    pub fn slice(&self, samples: Range<usize>, keep: impl Fn(&str) -> bool) -> Self {
        let channels = self
            .channels
            .iter()
            .filter(|channel| keep(&channel.name))
            .map(|channel| Channel { name: channel.name.clone(), values: channel.values.part(samples.clone()) });
        Self {
            source: self.source.clone(),
            sha256: self.sha256.clone(),
            time: self.time.part(samples.clone()),
            channels: channels.collect(),
            notes: self.notes.clone(),
            unread: self.unread.clone(),
        }
    }

    /// The first `share` of the samples (0 to 1) and the rest.
    pub fn split(&self, share: f64) -> (Self, Self) {
        let at = ((self.len() as f64 * share).round() as usize).min(self.len());
        (self.slice(0..at, |_| true), self.slice(at..self.len(), |_| true))
    }

    /// The log on the uniform grid `first time + k period`, linearly interpolated. A grid point
    /// between two samples further apart than `gap` s, or beside a missing one, is missing.
    pub fn resample(&self, period: f64, gap: f64) -> Self {
        let Some(first) = self.time.first() else { return self.clone() };
        let count = (self.duration() / period * (1.0 + 1e-12)).floor() as usize + 1;
        let time: Series = (0..count).map(|k| first + k as f64 * period).collect();
        // For every grid point: the sample at or before it and the share of the next one.
        let mut left = 0;
        let place = time.iter().map(|t| {
            while left + 2 < self.len() && self.time[left + 1] <= *t {
                left += 1;
            }
            let (t0, t1) = (self.time[left], self.time.get(left + 1).copied().unwrap_or(*t));
            let share = if t1 > t0 { ((t - t0) / (t1 - t0)).clamp(0.0, 1.0) } else { 0.0 };
            (left, share, t1 - t0 > gap)
        });
        let places: Vec<_> = place.collect();
        let pick = |values: &[f64]| {
            let at = |(left, share, apart): &(usize, f64, bool)| match *share {
                0.0 => values[*left],
                1.0 => values[left + 1],
                _ if *apart => f64::NAN,
                share => values[*left] + share * (values[left + 1] - values[*left]),
            };
            places.iter().map(at).collect()
        };
        let channels =
            self.channels.iter().map(|c| Channel { name: c.name.clone(), values: pick(&c.values) }).collect();
        Self {
            source: self.source.clone(),
            sha256: self.sha256.clone(),
            time,
            channels,
            notes: self.notes.clone(),
            unread: self.unread.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(times: &[f64]) -> Log {
        let mut log = Log { time: times.to_vec().into(), ..Log::default() };
        log.push("twice", times.iter().map(|t| 2.0 * t).collect::<Series>());
        log
    }

    #[test]
    fn the_period_is_that_of_most_steps() {
        let log = ramp(&[0.0, 0.1, 0.2, 0.5, 0.6, 0.7001, 2.0]);
        assert!((log.period() - 0.1).abs() < 1e-3);
    }

    #[test]
    fn parts_keep_their_samples() {
        let log = ramp(&[0.0, 1.0, 2.0, 3.0, 4.0]);
        let (head, tail) = log.split(0.6);
        assert_eq!(head.time, [0.0, 1.0, 2.0]);
        assert_eq!(tail.channel("twice"), Some(&[6.0, 8.0][..]));
    }

    #[test]
    fn a_straight_line_survives_resampling_and_gaps_do_not_fill() {
        let log = ramp(&[1.0, 1.3, 1.7, 2.0, 4.0]);
        let even = log.resample(0.25, 0.5);
        assert_eq!(even.len(), 13);
        for (t, value) in even.time.iter().zip(even.channel("twice").unwrap()) {
            let inside = *t > 2.0 && *t < 4.0;
            assert!(if inside { value.is_nan() } else { (value - 2.0 * t).abs() < 1e-12 }, "{value} at {t}");
        }
    }
}
