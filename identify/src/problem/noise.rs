//! What sensor noise alone makes of a regression row.
//!
//! To first order every entry of a row is a weighted sum of noise samples; the covariance of two
//! entries is the sum of products of their weights times the sensor's variance.

use crate::log::median;
use crate::solve::Rows;

/// Standard deviation of the white noise of a signal: from its third differences, in which any smooth
/// motion vanishes. NaN samples are left out; 0 if there are too few samples.
pub fn noise_of(x: &[f64]) -> f64 {
    let windows = x.len().saturating_sub(3);
    let thirds = |first: usize, to: &mut [f64]| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| &x[first + k..]);
        let samples = a.iter().zip(b).zip(c).zip(d);
        to.iter_mut().zip(samples).for_each(|(to, (((a, b), c), d))| *to = (d - 3.0 * c + 3.0 * b - a).abs());
    };
    match median(windows, thirds) {
        Some((_, count)) if count < 10 => 0.0,
        None => 0.0,
        Some((median, _)) if median > 0.0 => 1.4826 * median / 20f64.sqrt(),
        // Coarse quantisation: most differences vanish, the mean square still tells.
        Some((_, count)) => {
            let mut sizes = vec![0.0; windows];
            thirds(0, &mut sizes);
            let squares = sizes.iter().filter(|size| size.is_finite()).map(|size| size * size);
            (squares.sum::<f64>() / count as f64 / 20.0).sqrt()
        }
    }
}

/// One sensor's part in a row: its channel, a list of weights per entry of `[row, right-hand side]`, and the standard
/// deviation of its white noise.
pub type Part = (&'static str, Vec<Vec<f64>>, f64);

/// Sets the noise of a group of rows from the parts of each log's sensors, with the log's period and its share of all.
pub fn tell_noise(rows: &mut Rows, logs: &[(Vec<Part>, f64, f64)]) {
    let size = (rows.columns + 1).pow(2);
    let mut white = vec![0.0; size];
    let mut coloured: Vec<(String, Vec<f64>)> = Vec::new();
    let samples: f64 = logs.iter().map(|(_, _, samples)| samples).sum();
    for (parts, period, weight) in logs {
        let share = weight / samples;
        for (channel, weights, std) in parts {
            add_noise(&mut white, weights, std * share.sqrt());
            let mut unit = vec![0.0; size];
            add_coloured(&mut unit, weights, *period);
            let place = coloured.iter().position(|(name, _)| name == channel).unwrap_or_else(|| {
                coloured.push(((*channel).to_owned(), vec![0.0; size]));
                coloured.len() - 1
            });
            let largest = share * (LARGEST_COLOUR * std).powi(2);
            coloured[place].1.iter_mut().zip(unit).for_each(|(sum, value)| *sum += largest * value);
        }
    }
    if logs.iter().any(|(parts, ..)| !parts.is_empty()) {
        rows.noise = white;
        rows.coloured = coloured;
    }
}

/// Adds to the covariance of `[row, right-hand side]` what one sensor's noise of this standard deviation
/// makes; `weights` has one list of weights per entry.
pub fn add_noise(covariance: &mut [f64], weights: &[Vec<f64>], std: f64) {
    let n = weights.len();
    for i in 0..n {
        for j in 0..n {
            covariance[i * n + j] += std * std * crate::solve::dot(&weights[i], &weights[j]);
        }
    }
}

/// Correlation time of noise that is not white, s: electronics filter faster, vibration and flexing mounts are about
/// as slow, and what is slower counts as a bias.
const CORRELATION_TIME: f64 = 0.2;

/// Standard deviation of noise that is not white, over that of its white part: third differences see a sixth of
/// first-order noise that is correlated by 0.95 from sample to sample.
const LARGEST_COLOUR: f64 = 8.0;

/// Adds to the covariance of `[row, right-hand side]` what noise of one sensor with unit variance and the correlation
/// `exp(-|t|/tau)` makes; `weights` as in [`add_noise`], on samples a `period` apart.
pub fn add_coloured(covariance: &mut [f64], weights: &[Vec<f64>], period: f64) {
    let n = weights.len();
    let rho = (-period / CORRELATION_TIME).exp();
    // sum over m of rho^|k - m| w_m, from the left and from the right
    let spread = |weights: &Vec<f64>| -> Vec<f64> {
        let mut all = vec![0.0; weights.len()];
        let mut sum = 0.0;
        for (out, weight) in all.iter_mut().zip(weights) {
            sum = rho * sum + weight;
            *out = sum;
        }
        sum = 0.0;
        for (out, weight) in all.iter_mut().zip(weights).rev() {
            *out += sum;
            sum = rho * (sum + weight);
        }
        all
    };
    let spread: Vec<Vec<f64>> = weights.iter().map(spread).collect();
    for i in 0..n {
        for j in 0..n {
            covariance[i * n + j] += crate::solve::dot(&weights[i], &spread[j]);
        }
    }
}
