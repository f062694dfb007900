//! From a log to the signals of the chair on a uniform time base.

use crate::log::Log;
use crate::problem::{FitError, Known};
use wheelstate::estimator::wheelchair::Parameters;
use wheelstate::model::wheelchair::{Chair, wheel_travel};

/// Samples of the running mean whose slope gives speed and yaw rate where products of them are needed.
const MEAN: usize = 21;
/// Window of the outlier filter, samples, and its threshold in robust standard deviations.
const HAMPEL: (usize, f64) = (21, 4.0);

/// Signals of one log; NaN is missing.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// Time between two samples, s.
    pub period: f64,
    /// Time of the first sample, s.
    pub start: f64,
    /// Travel of the axle's midpoint, m.
    pub travel: Vec<f64>,
    /// Heading from the encoders, rad.
    pub heading: Vec<f64>,
    /// Smoothed speed, m/s, and yaw rate, rad/s.
    pub speed: Vec<f64>,
    /// Smoothed yaw rate, rad/s.
    pub yaw_rate: Vec<f64>,
    /// Specific force ahead, m/s2, without outliers.
    pub ahead: Vec<f64>,
    /// Specific force to the left, m/s2, without outliers.
    pub left: Vec<f64>,
    /// Drive force, N.
    pub force: Vec<f64>,
    /// Drive moment, N m.
    pub moment: Vec<f64>,
    /// Share of the accelerometer's samples that were outliers.
    pub outliers: f64,
}

impl Signals {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.travel.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.travel.is_empty()
    }
}

/// The chair that the known parameters describe.
pub fn chair(known: &Known) -> Chair {
    known.parameters::<Parameters>().chair()
}

/// The signals of a log.
pub fn signals(log: &Log, chair: &Chair) -> Result<Signals, FitError> {
    for name in ["encoder_left", "encoder_right", "accel_x", "accel_y", "drive_force", "drive_moment"] {
        log.require(name)?;
    }
    let (log, period) = log.on_even_steps();
    let channel = |name: &str| -> Vec<f64> {
        let finite = |value: &f64| if value.is_finite() { *value } else { f64::NAN };
        log.channel(name).map(|values| values.iter().map(finite).collect()).unwrap_or_default()
    };
    let (left, right) = (channel("encoder_left"), channel("encoder_right"));
    let (mut travel, mut heading) = (Vec::with_capacity(log.len()), Vec::with_capacity(log.len()));
    for (right, left) in right.iter().zip(&left) {
        let (reference, turned) = wheel_travel(chair, *right, *left);
        travel.push(reference + chair.reference_offset() * (turned - chair.heading_reference));
        heading.push(turned);
    }
    let (mut ahead, mut sideways) = (channel("accel_x"), channel("accel_y"));
    let replaced = hampel(&mut ahead) + hampel(&mut sideways);
    Ok(Signals {
        period,
        start: log.time.first().copied().unwrap_or(0.0),
        speed: slope_of_mean(&travel, period),
        yaw_rate: slope_of_mean(&heading, period),
        travel,
        heading,
        outliers: replaced as f64 / (2 * log.len()).max(1) as f64,
        ahead,
        left: sideways,
        force: channel("drive_force"),
        moment: channel("drive_moment"),
    })
}

/// Replaces outliers by the median around them; on raw samples, because every window of a hundred
/// samples holds some and no robust loss on windows could tell them. Returns how many.
pub fn hampel(x: &mut [f64]) -> usize {
    let (window, threshold) = HAMPEL;
    let raw = x.to_vec();
    let mut around = Vec::with_capacity(window);
    let mut replaced = 0;
    for (i, value) in x.iter_mut().enumerate() {
        let (from, to) = (i.saturating_sub(window / 2), (i + window / 2 + 1).min(raw.len()));
        let Some(centre) = median(&mut around, raw[from..to].iter().copied()) else { continue };
        let spread = median(&mut around, raw[from..to].iter().map(|v| (v - centre).abs())).unwrap_or(0.0);
        // A signal that hardly ever moves has no spread to judge by.
        if spread > 0.0 && (*value - centre).abs() > threshold * 1.4826 * spread {
            *value = centre;
            replaced += 1;
        }
    }
    replaced
}

fn median(buffer: &mut Vec<f64>, values: impl Iterator<Item = f64>) -> Option<f64> {
    buffer.clear();
    buffer.extend(values.filter(|value| value.is_finite()));
    buffer.sort_unstable_by(f64::total_cmp);
    let n = buffer.len();
    match n {
        0 => None,
        n if n % 2 == 1 => Some(buffer[n / 2]),
        n => Some(0.5 * (buffer[n / 2 - 1] + buffer[n / 2])),
    }
}

/// Slope of the running mean by central differences, one-sided at the ends.
fn slope_of_mean(x: &[f64], period: f64) -> Vec<f64> {
    let n = x.len();
    let mean: Vec<f64> = (0..n)
        .map(|i| {
            let part = &x[i.saturating_sub(MEAN / 2)..(i + MEAN / 2 + 1).min(n)];
            part.iter().sum::<f64>() / part.len() as f64
        })
        .collect();
    (0..n)
        .map(|i| {
            let (from, to) = (i.saturating_sub(1), (i + 1).min(n - 1));
            if to > from { (mean[to] - mean[from]) / ((to - from) as f64 * period) } else { f64::NAN }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_are_replaced_and_the_rest_is_kept() {
        let clean: Vec<f64> = (0..200).map(|i| (0.05 * f64::from(i)).sin() + 0.01 * f64::from(i % 3)).collect();
        let mut x = clean.clone();
        for i in [0, 20, 21, 77, 199] {
            x[i] += if i % 2 == 0 { 5.0 } else { -3.0 };
        }
        x[100] = f64::NAN;
        assert_eq!(hampel(&mut x), 5);
        for (i, (x, clean)) in x.iter().zip(&clean).enumerate() {
            assert!(i == 100 || (x - clean).abs() < 0.5, "{i}: {x} instead of {clean}");
        }
        assert!(x[100].is_nan());
        let mut still = vec![1.0; 50];
        still[3] = 1.1;
        assert_eq!(hampel(&mut still), 0);
    }

    #[test]
    fn the_slope_of_a_ramp_is_its_slope() {
        let x: Vec<f64> = (0..100).map(|i| 0.3 * 0.01 * f64::from(i)).collect();
        let slope = slope_of_mean(&x, 0.01);
        assert!(slope[15..85].iter().all(|v| (v - 0.3).abs() < 1e-9));
    }
}
