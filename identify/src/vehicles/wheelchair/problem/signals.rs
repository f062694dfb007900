//! From a log to the signals of the chair on a uniform time base.

use crate::log::Log;
use crate::problem::noise::noise_of;
use crate::problem::{FitError, Known};
use wheelstate::estimator::wheelchair::Parameters;
use wheelstate::model::wheelchair::{Chair, wheel_travel};

/// Largest reach to both sides of the running mean whose slope gives speed and yaw rate where products and signs of them
/// are needed, s, and the noise that is left in them as a share of the width of the smooth sign.
const MEAN_REACH: f64 = 0.1;
const LEFT_NOISE: f64 = 0.01;

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
    /// Smooth signs of speed and yaw rate.
    pub sense: [Vec<f64>; 2],
    /// Forward specific force, m/s2.
    pub forward: Vec<f64>,
    /// Specific force to the left, m/s2.
    pub left: Vec<f64>,
    /// Drive force, N.
    pub force: Vec<f64>,
    /// Drive moment, N m.
    pub moment: Vec<f64>,
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
    let widths = [chair.rolling.smoothing_speed, chair.rolling.smoothing_yaw_rate];
    let [speed, yaw_rate] = [(&travel, widths[0]), (&heading, widths[1])]
        .map(|(x, width)| slope_of_mean(x, period, reach(x, period, width)));
    let sense = |values: &[f64], width: f64| values.iter().map(|value| (value / width).tanh()).collect();
    Ok(Signals {
        period,
        start: log.time.first().copied().unwrap_or(0.0),
        sense: [sense(&speed, widths[0]), sense(&yaw_rate, widths[1])],
        speed,
        yaw_rate,
        travel,
        heading,
        forward: channel("accel_x"),
        left: channel("accel_y"),
        force: channel("drive_force"),
        moment: channel("drive_moment"),
    })
}

/// Samples in a time, at least one.
fn samples(seconds: f64, period: f64) -> usize {
    ((seconds / period).round() as usize).max(1)
}

/// Samples to both sides that a running mean needs: as few as leave a noise that hardly matters in a sign of this width,
/// since every mean rounds off the sign's changes too.
fn reach(x: &[f64], period: f64, width: f64) -> usize {
    let (most, noise) = (samples(MEAN_REACH, period), noise_of(x));
    let left = |reach: usize| 1.5 * noise / ((2 * reach + 1) as f64 * period);
    (1..most).find(|reach| left(*reach) < LEFT_NOISE * width).unwrap_or(most)
}

/// Smoothed slope: that of the running mean by central differences, one-sided at the ends, and once more of what the mean
/// took away (Tukey's twicing), `2 S x - S S x`: a motion of frequency `f` is left as `1 - (1 - sinc(f T))^2` of itself,
/// an error of fourth order, at one and a half times the noise. No Savitzky-Golay fit, which is several times as noisy at
/// the ends as within.
fn slope_of_mean(x: &[f64], period: f64, reach: usize) -> Vec<f64> {
    let n = x.len();
    let mean = |x: &[f64]| -> Vec<f64> {
        let around = |i: usize| &x[i.saturating_sub(reach)..(i + reach + 1).min(n)];
        (0..n).map(|i| around(i).iter().sum::<f64>() / around(i).len() as f64).collect()
    };
    let once = mean(x);
    let slope: Vec<f64> = (0..n)
        .map(|i| {
            let (from, to) = (i.saturating_sub(1), (i + 1).min(n - 1));
            if to > from { (once[to] - once[from]) / ((to - from) as f64 * period) } else { f64::NAN }
        })
        .collect();
    let twice = mean(&slope);
    // At the ends the windows are one-sided and their means late or early, and so is what is taken from them.
    let inside = 2 * reach + 1..n.saturating_sub(2 * reach + 1);
    slope.iter().zip(&twice).enumerate().map(|(i, (s, m))| if inside.contains(&i) { 2.0 * s - m } else { *s }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::outliers::hampel;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn the_slope_of_a_ramp_is_its_slope() {
        let x: Vec<f64> = (0..100).map(|i| 0.3 * 0.01 * f64::from(i)).collect();
        let slope = slope_of_mean(&x, 0.01, 10);
        assert!(slope[15..85].iter().all(|v| (v - 0.3).abs() < 1e-9));
    }

    /// A mean over 0.2 s leaves `s = sin(pi f T)/(pi f T)` of a motion, twice `1 - (1 - s)^2`, and a knock of 30 ms is an outlier, at every rate.
    #[test]
    fn windows_last_as_long_at_every_rate() {
        let frequency = 2.0;
        for rate in [50.0, 100.0, 500.0] {
            let (period, samples) = (1.0 / rate, (4.0 * rate) as usize);
            let motion = |i: usize| (TAU * frequency * i as f64 * period).sin();
            let position: Vec<f64> = (0..samples).map(motion).collect();
            let slope = slope_of_mean(&position, period, (MEAN_REACH * rate) as usize);
            let size = slope[samples / 4..3 * samples / 4].iter().fold(0.0_f64, |a, b| a.max(*b));
            let over = PI * frequency * (2.0 * MEAN_REACH + period);
            let expected = TAU * frequency * (1.0 - (1.0 - over.sin() / over).powi(2));
            assert!((size / expected - 1.0).abs() < 0.02, "{rate} Hz: {size} instead of {expected}");

            let mut acceleration: Vec<f64> = (0..samples).map(|i| motion(i) + 0.01 * (i % 3) as f64).collect();
            let knock = samples / 2..samples / 2 + (0.03 * rate) as usize;
            knock.clone().for_each(|i| acceleration[i] += 10.0);
            hampel(&mut acceleration, period);
            assert!(knock.clone().all(|i| acceleration[i].abs() < 2.0), "{rate} Hz: {:?}", &acceleration[knock]);
        }
    }
}
