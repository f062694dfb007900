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
/// Largest share of one sample in the average, also after a pause: one outlier does not lift it from 1 beyond [`MOST`].
const SHARE: f64 = (MOST - 1.0) / (LARGEST - 1.0);

impl Default for NisMonitor {
    fn default() -> Self {
        Self { average: 1.0, contradicted: false }
    }
}

impl NisMonitor {
    /// Takes the normalised innovation squared per channel of a sample that came `dt` seconds after the last one.
    pub fn update(&mut self, nis: f64, dt: f64) {
        self.average += (1.0 - (-dt / TIME).exp()).min(SHARE) * (nis.min(LARGEST) - self.average);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds of samples with this NIS until `until` holds; 20 s if it never does.
    fn seconds(monitor: &mut NisMonitor, nis: f64, until: impl Fn(&NisMonitor) -> bool) -> f64 {
        (0..2000)
            .find(|_| {
                monitor.update(nis, 0.01);
                until(monitor)
            })
            .map_or(20.0, |k| 0.01 * f64::from(k))
    }

    #[test]
    fn a_contradiction_is_seen_within_seconds_and_one_outlier_is_none() {
        let mut monitor = NisMonitor::default();
        monitor.update(1e12, 0.01);
        assert!(!monitor.contradicted(), "one outlier proves nothing");
        let gross = seconds(&mut NisMonitor::default(), 100.0, NisMonitor::contradicted);
        assert!((0.05..0.3).contains(&gross), "a gross one in {gross} s");
        let slight = seconds(&mut NisMonitor::default(), 2.5, NisMonitor::contradicted);
        assert!((1.5..4.0).contains(&slight), "a slight one in {slight} s");
        assert_eq!(seconds(&mut NisMonitor::default(), 1.9, NisMonitor::contradicted), 20.0);
    }

    /// What has been bent to fit the measurements stays wrong for longer than they show: between the two levels a
    /// contradiction that was seen stays, and one that was not seen is none.
    #[test]
    fn a_contradiction_stays_until_the_innovations_clearly_agree_again() {
        let mut monitor = NisMonitor::default();
        seconds(&mut monitor, 8.0, NisMonitor::contradicted);
        assert_eq!(seconds(&mut monitor, 1.7, |monitor| !monitor.contradicted()), 20.0);
        assert!(seconds(&mut monitor, 1.0, |monitor| !monitor.contradicted()) < 4.0);
        assert_eq!(seconds(&mut monitor, 1.7, NisMonitor::contradicted), 20.0);
    }

    #[test]
    fn the_memory_counts_seconds_and_not_samples() {
        let after = |dt: f64| {
            let mut monitor = NisMonitor::default();
            (0..(1.0 / dt).round() as usize).for_each(|_| monitor.update(4.0, dt));
            monitor.average
        };
        assert!((after(0.001) - after(0.05)).abs() < 1e-9);
    }

    #[test]
    fn one_outlier_is_no_contradiction_however_long_the_pause_before_it_and_some_in_a_row_are() {
        for dt in [0.001, 0.01, 0.1, 0.5, 1.0] {
            let mut monitor = NisMonitor::default();
            monitor.update(1e12, dt);
            assert!(!monitor.contradicted(), "{dt}");
            (0..(1.0 / dt) as usize).for_each(|_| monitor.update(1e12, dt));
            assert!(monitor.contradicted(), "{dt}");
        }
    }
}
