//! What sensor noise alone makes of a regression row.
//!
//! To first order every entry of a row is a weighted sum of noise samples; the covariance of two
//! entries is the sum of products of their weights times the sensor's variance.

/// Standard deviation of the white noise of a signal: from its third differences, in which any smooth
/// motion vanishes. NaN samples are left out; 0 if there are too few samples.
pub fn noise_of(x: &[f64]) -> f64 {
    let third = |w: &[f64]| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs();
    let mut sizes: Vec<f64> = x.windows(4).map(third).filter(|value| value.is_finite()).collect();
    if sizes.len() < 10 {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    if *median > 0.0 {
        return 1.4826 * *median / 20f64.sqrt();
    }
    // Coarse quantisation: most differences vanish, the mean square still tells.
    (sizes.iter().map(|size| size * size).sum::<f64>() / sizes.len() as f64 / 20.0).sqrt()
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
