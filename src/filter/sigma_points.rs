//! Sigma points of a Gaussian: their places and weights.
//!
//! Yang et al., eq. (44)-(45); Merwe's scaled form. Errata: the paper never gives
//! `lambda = alpha^2 (n + kappa) - n`, and for the first set it prints the predicted mean and
//! covariance where the text, rightly, means the posterior of the step before.

use nalgebra::{SMatrix, SVector};

/// The scaled unscented transform of an `n`-dimensional Gaussian: `2 n + 1` points, the mean and two on each column of
/// a root of the covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnscentedTransform {
    /// Distance of the outer points from the centre in lengths of the root's columns, `alpha sqrt(n + kappa)`.
    pub distance: f64,
    /// Weight of each outer point.
    pub outer: f64,
    /// Weight of the centre in the mean.
    pub mean: f64,
    /// Weight of the centre in the covariance.
    pub covariance: f64,
    /// `beta - alpha^2`: weight of the mean's own deviation where deviations are taken from the centre.
    pub surplus: f64,
}

impl UnscentedTransform {
    /// From the spread `alpha` > 0, the prior knowledge `beta` and the secondary scaling `kappa` > -n.
    pub fn new(n: usize, alpha: f64, beta: f64, kappa: f64) -> Self {
        let n = n as f64;
        let square = alpha * alpha * (n + kappa);
        let mean = (square - n) / square;
        Self {
            distance: square.sqrt(),
            outer: 0.5 / square,
            mean,
            covariance: mean + 1.0 - alpha * alpha + beta,
            surplus: beta - alpha * alpha,
        }
    }
}

/// Lower triangular root of a symmetric positive definite matrix; `None` if it is not.
pub fn cholesky<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let mut root = SMatrix::<f64, N, N>::zeros();
    for j in 0..N {
        let mut pivot = matrix[(j, j)];
        for k in 0..j {
            pivot -= root[(j, k)] * root[(j, k)];
        }
        // Written so that NaN fails too.
        if !(pivot > 0.0 && pivot < f64::INFINITY) {
            return None;
        }
        let diagonal = pivot.sqrt();
        let inverse = 1.0 / diagonal;
        root[(j, j)] = diagonal;
        for i in j + 1..N {
            let mut sum = matrix[(i, j)];
            for k in 0..j {
                sum -= root[(i, k)] * root[(j, k)];
            }
            root[(i, j)] = sum * inverse;
        }
    }
    Some(root)
}

/// Like [`cholesky`] for a covariance that rounding may have spoilt: tries again with 1e-12, 1e-9 and
/// 1e-6 of the trace on the diagonal, and at last drops the correlations and keeps the variances.
/// The flag says whether a repair was needed. `None` if a diagonal element is not finite.
pub fn robust_cholesky<const N: usize>(covariance: &SMatrix<f64, N, N>) -> Option<(SMatrix<f64, N, N>, bool)> {
    if let Some(root) = cholesky(covariance) {
        return Some((root, false));
    }
    let trace = covariance.trace();
    if !trace.is_finite() {
        return None;
    }
    for share in [1e-12, 1e-9, 1e-6] {
        let lifted = covariance + SMatrix::<f64, N, N>::identity() * (share * trace.abs());
        if let Some(root) = cholesky(&lifted) {
            return Some((root, true));
        }
    }
    let floor = f64::MIN_POSITIVE.max(1e-12 * trace.abs());
    let variances: SVector<f64, N> = covariance.diagonal().map(|variance| variance.max(floor));
    Some((SMatrix::from_diagonal(&variances.map(f64::sqrt)), true))
}
