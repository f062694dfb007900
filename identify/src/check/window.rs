//! The window that all signals of a relation pass, and their derivatives through it.

use crate::log::Series;
use multiversion::multiversion;

/// Half width of the window, s; in samples at least 2.
const HALF_WINDOW: f64 = 0.15;

/// Half width of the window, samples.
fn half(period: f64) -> usize {
    ((HALF_WINDOW / period).round() as usize).max(2)
}

/// Samples that a window with its derivatives takes.
pub fn taps(period: f64) -> usize {
    2 * half(period) + 3
}

/// A window and its derivatives: taps on samples around the middle, for values, slopes and curvatures that belong
/// together.
fn weights(half: usize, period: f64, order: usize) -> Vec<f64> {
    let n = half as f64 + 1.0;
    let weight = |i: usize| {
        let away = (i as f64 - half as f64) / n;
        (1.0 + (std::f64::consts::PI * away).cos()) / (2.0 * n)
    };
    let smooth: Vec<f64> = (0..=2 * half).map(weight).collect();
    // A mean over two steps is what a central difference averages over.
    let stencil = match order {
        0 => [0.25, 0.5, 0.25],
        1 => [-0.5 / period, 0.0, 0.5 / period],
        _ => [1.0 / (period * period), -2.0 / (period * period), 1.0 / (period * period)],
    };
    let mut taps = vec![0.0; smooth.len() + 2];
    for (i, weight) in smooth.iter().enumerate() {
        (0..3).for_each(|k| taps[i + k] += weight * stencil[k]);
    }
    taps
}

/// Values of a term that are worked out together: the processor keeps them in its registers.
const CHUNK: usize = 16;

/// Signals through their windows, added up, one value every `stride` samples; NaN where a sample is missing.
pub struct Filter<'a> {
    /// Samples and the taps on them.
    parts: Vec<(&'a [f64], Vec<f64>)>,
    stride: usize,
}

impl<'a> Filter<'a> {
    /// For signals with the orders of their derivatives.
    pub fn new(parts: &'a [(Series, usize)], period: f64, stride: usize) -> Self {
        let half = half(period);
        let parts = parts.iter().map(|(values, order)| (values.as_slice(), weights(half, period, *order)));
        Self { parts: parts.collect(), stride }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        let (values, taps) = &self.parts[0];
        (values.len() + 1).saturating_sub(taps.len()).div_ceil(self.stride)
    }

    /// The values from number `from` on. Those of a chunk grow tap by tap side by side, each in the order of its window.
    pub fn fill(&self, from: usize, to: &mut [f64]) {
        let mut first = from * self.stride;
        for chunk in to.chunks_mut(CHUNK) {
            for (number, (values, taps)) in self.parts.iter().enumerate() {
                let sums = if chunk.len() == CHUNK && self.stride == 1 {
                    side_by_side(&values[first..], taps)
                } else {
                    self.one_by_one(&values[first..], taps, chunk.len())
                };
                if number == 0 {
                    chunk.copy_from_slice(&sums[..chunk.len()]);
                } else {
                    chunk.iter_mut().zip(sums).for_each(|(value, sum)| *value += sum);
                }
            }
            first += chunk.len() * self.stride;
        }
    }

    fn one_by_one(&self, values: &[f64], taps: &[f64], count: usize) -> [f64; CHUNK] {
        let mut sums = [0.0; CHUNK];
        let windows = values.windows(taps.len()).step_by(self.stride);
        for (sum, window) in sums[..count].iter_mut().zip(windows) {
            *sum = window.iter().zip(taps).map(|(value, weight)| value * weight).sum();
        }
        sums
    }
}

/// The sums of neighbouring windows.
#[multiversion(targets("x86_64+avx+avx2"))]
fn side_by_side(values: &[f64], taps: &[f64]) -> [f64; CHUNK] {
    // An empty sum is -0.
    let mut sums = [-0.0; CHUNK];
    for (samples, weight) in values.windows(CHUNK).zip(taps) {
        sums.iter_mut().zip(samples).for_each(|(sum, value)| *sum += value * weight);
    }
    sums
}

/// The first derivative of signals, added up, through the window at every sample; missing at both ends.
pub fn slope(parts: &[(Series, usize)], period: f64) -> Vec<f64> {
    let half = half(period);
    let length = parts.first().map_or(0, |(values, _)| values.len());
    let mut slope = vec![f64::NAN; length];
    let once: Vec<_> = parts.iter().map(|(values, order)| (values.clone(), order + 1)).collect();
    if length > 0 {
        let filter = Filter::new(&once, period, 1);
        let count = filter.len();
        if count > 0 {
            filter.fill(0, &mut slope[half + 1..][..count]);
        }
    }
    slope
}
