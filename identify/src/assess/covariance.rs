//! Covariance of robust regressions, conditioning and the bias of noisy regressors.

use crate::solve::robust::Minimiser;
use crate::solve::{HUBER_DELTA, Loss, Regression, Solution, dot};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Judges the minimiser of a regression.
///
/// The covariance is the sandwich `B^-1 (sum over clusters of g g') B^-1` with `B = A'WA` and
/// `g` the summed score of a cluster (`psi(r) a`), rows in units of their noise. `W` is the second
/// derivative of the loss (1 within the Huber threshold, 0 beyond; 1 for least squares and L1). It is
/// honest about correlation inside a cluster and about unequal noise, and does not know of noise
/// in the regressors: that is `bias`.
pub fn of_regression(regression: &Regression, scales: &[f64], loss: Loss, minimiser: Minimiser) -> Solution {
    let n = regression.unknowns.len();
    let mut information = DMatrix::<f64>::zeros(n, n);
    let mut gram = DMatrix::<f64>::zeros(n, n);
    let mut scores: BTreeMap<u32, DVector<f64>> = BTreeMap::new();
    let mut pull = DVector::<f64>::zeros(n);
    let mut rows = 0;
    let mut residuals = Vec::new();
    for (group, &scale) in regression.groups.iter().zip(scales) {
        let of_group = group.residuals(&minimiser.theta);
        let mut quadratic = 0.0;
        for (i, residual) in of_group.iter().enumerate() {
            let row = DVector::from_iterator(n, group.row(i).iter().map(|value| value / scale));
            let r = residual / scale;
            let (weight, psi) = match loss {
                Loss::Ls | Loss::L1 => (1.0, r),
                Loss::Huber => (f64::from(u8::from(r.abs() <= HUBER_DELTA)), r.clamp(-HUBER_DELTA, HUBER_DELTA)),
            };
            gram.ger(1.0, &row, &row, 1.0);
            information.ger(weight, &row, &row, 1.0);
            scores.entry(group.cluster[i]).or_insert_with(|| DVector::zeros(n)).axpy(psi, &row, 1.0);
            quadratic += weight;
        }
        // Noise E in [A y]: the normal equations gain N (E_aa theta - E_ay), which pulls the minimiser.
        if group.noise.len() == (n + 1) * (n + 1) {
            for j in 0..n {
                let noise = &group.noise[j * (n + 1)..(j + 1) * (n + 1)];
                pull[j] -= quadratic * (dot(&noise[..n], &minimiser.theta) - noise[n]) / (scale * scale);
            }
        }
        rows += group.len();
        residuals.push(of_group);
    }
    for (index, unknown) in regression.unknowns.iter().enumerate() {
        if let Some((_, std)) = unknown.prior {
            information[(index, index)] += 1.0 / (std * std);
            gram[(index, index)] += 1.0 / (std * std);
        }
    }
    let bread = inverse(&information);
    let mut filling = DMatrix::zeros(n, n);
    scores.values().for_each(|score| filling.ger(1.0, score, score, 1.0));
    for (index, unknown) in regression.unknowns.iter().enumerate() {
        if let Some((_, std)) = unknown.prior {
            filling[(index, index)] += 1.0 / (std * std);
        }
    }
    let bias = (&bread * pull).as_slice().to_vec();
    Solution {
        name: regression.name.clone(),
        covariance: &bread * filling * &bread,
        correlation: correlation(&bread),
        condition_number: condition_of_gram(&gram),
        scales: scales.to_vec(),
        residuals,
        bias,
        rows,
        at_bound: minimiser.at_bound,
        accuracy: minimiser.accuracy,
        theta: minimiser.theta,
        cost: Vec::new(),
    }
}

/// Pseudo-inverse of a symmetric matrix, scaled to a unit diagonal first so that the units of
/// the unknowns do not matter.
pub fn inverse(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = matrix.diagonal().map(|value| if value > 0.0 { value.sqrt() } else { 1.0 });
    let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / (scale[i] * scale[j]));
    let pseudo = scaled.pseudo_inverse(1e-14).unwrap_or_else(|_| DMatrix::zeros(matrix.nrows(), matrix.ncols()));
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| pseudo[(i, j)] / (scale[i] * scale[j]))
}

/// Correlation matrix of a covariance.
pub fn correlation(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let std = covariance.diagonal().map(|value| value.max(0.0).sqrt());
    DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
        let product = std[i] * std[j];
        if i == j {
            1.0
        } else if product > 0.0 {
            (covariance[(i, j)] / product).clamp(-1.0, 1.0)
        } else {
            0.0
        }
    })
}

/// Condition number of a matrix with its columns scaled to unit norm; infinite if singular.
pub fn condition_number(matrix: &DMatrix<f64>) -> f64 {
    condition_of_gram(&(matrix.transpose() * matrix))
}

fn condition_of_gram(gram: &DMatrix<f64>) -> f64 {
    let size = gram.diagonal().map(|value| value.max(0.0).sqrt());
    if gram.nrows() == 0 || size.iter().any(|value| *value == 0.0) {
        return f64::INFINITY;
    }
    let unit = DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| gram[(i, j)] / (size[i] * size[j]));
    let values = unit.symmetric_eigenvalues();
    let smallest = values.min();
    if smallest <= 0.0 { f64::INFINITY } else { (values.max() / smallest).sqrt() }
}
