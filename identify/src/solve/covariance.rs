//! Covariance of robust regressions, conditioning and the bias of noisy regressors.

use super::robust::Minimiser;
use super::{HUBER_DELTA, Loss, Options, Regression, Solution, dot};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Judges the minimiser of a regression.
///
/// The covariance is the sandwich `B^-1 (sum over clusters of g g') B^-1` with `B = A'WA` and
/// `g` the summed score of a cluster (`psi(r) a`), rows in units of their noise. `W` is the second
/// derivative of the loss (1 within the Huber threshold, 0 beyond; 1 for least squares and L1). It is
/// honest about correlation inside a cluster and about unequal noise, and does not know of noise
/// in the regressors or of what the rows neglect: that is `bias`. With noise of energy `N = [N_a N_y]`
/// in `[A y]` and neglected terms `d` the normal equations hold at `theta + bias`,
/// `B bias = A'W d - (N_a theta - N_y)` at the true `theta`. With [`Options::correct`] it is subtracted, except for guesses.
pub fn of_regression(regression: &Regression, scales: &[f64], options: &Options, minimiser: Minimiser) -> Solution {
    let n = regression.unknowns.len();
    let mut information = DMatrix::<f64>::zeros(n, n);
    let mut gram = DMatrix::<f64>::zeros(n, n);
    let mut scores: BTreeMap<u32, DVector<f64>> = BTreeMap::new();
    let mut pull = DVector::<f64>::zeros(n);
    let mut guess = DVector::<f64>::zeros(n);
    let mut noise_energy = DMatrix::<f64>::zeros(n, n);
    let mut rows = 0;
    let mut residuals = Vec::new();
    for (group, &scale) in regression.groups.iter().zip(scales) {
        let of_group = group.residuals(&minimiser.theta);
        let mut quadratic = 0.0;
        for (i, residual) in of_group.iter().enumerate() {
            let row = DVector::from_iterator(n, group.row(i).iter().map(|value| value / scale));
            let r = residual / scale;
            let (weight, psi) = match options.loss {
                Loss::Ls | Loss::L1 => (1.0, r),
                Loss::Huber => (f64::from(u8::from(r.abs() <= HUBER_DELTA)), r.clamp(-HUBER_DELTA, HUBER_DELTA)),
            };
            gram.ger(1.0, &row, &row, 1.0);
            information.ger(weight, &row, &row, 1.0);
            scores.entry(group.cluster[i]).or_insert_with(|| DVector::zeros(n)).axpy(psi, &row, 1.0);
            if let Some(neglected) = group.neglected.get(i) {
                let into = if group.guessed { &mut guess } else { &mut pull };
                into.axpy(weight * neglected / scale, &row, 1.0);
            }
            quadratic += weight;
        }
        // Noise E in [A y]: the normal equations gain N (E_aa theta - E_ay), which pulls the minimiser.
        if group.noise.len() == (n + 1) * (n + 1) {
            for j in 0..n {
                let noise = &group.noise[j * (n + 1)..(j + 1) * (n + 1)];
                pull[j] -= quadratic * (dot(&noise[..n], &minimiser.theta) - noise[n]) / (scale * scale);
                for k in 0..n {
                    noise_energy[(j, k)] += quadratic * noise[k] / (scale * scale);
                }
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
    // The pull was taken at the biased point: B bias = pull + N_a bias. Where noise is all there is
    // in a direction, only the first step is known.
    let consistent = match (&information - &noise_energy).cholesky() {
        Some(factor) => factor.inverse(),
        None => bread.clone(),
    };
    let known = &consistent * pull;
    let mut bias = &consistent * guess;
    // What regressor j adds to the others is A d_j with d_j = B^-1 e_j / (B^-1)_jj; its energy is
    // 1 / (B^-1)_jj, of which d_j' N d_j is noise.
    let noise_share: Vec<f64> = (0..n)
        .map(|j| match bread[(j, j)] {
            variance if variance > 0.0 => {
                (bread.column(j).dot(&(&noise_energy * bread.column(j))) / variance).clamp(0.0, 1.0)
            }
            _ => 1.0,
        })
        .collect();
    let mut theta = minimiser.theta;
    let mut gain = &bread;
    if options.correct {
        for (index, unknown) in regression.unknowns.iter().enumerate() {
            theta[index] = (theta[index] - known[index]).clamp(unknown.lower, unknown.upper);
        }
        gain = &consistent;
    } else {
        bias += known;
    }
    Solution {
        name: regression.name.clone(),
        covariance: gain * filling * gain,
        inverse_information: bread,
        condition_number: condition_of_gram(&gram),
        scales: scales.to_vec(),
        residuals,
        noise_share,
        bias: bias.as_slice().to_vec(),
        rows,
        at_bound: minimiser.at_bound,
        accuracy: minimiser.accuracy,
        theta,
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

/// Whether the rows and priors of a regression leave a direction of the unknowns open.
pub fn is_singular(regression: &Regression) -> bool {
    let n = regression.unknowns.len();
    let mut gram = DMatrix::<f64>::zeros(n, n);
    for group in &regression.groups {
        // Groups of different units weigh alike.
        let size = group.a.iter().map(|value| value * value).sum::<f64>();
        let mut of_group = DMatrix::<f64>::zeros(n, n);
        for i in 0..group.len() {
            let row = nalgebra::DVectorView::from_slice(group.row(i), n);
            of_group.ger(1.0, &row, &row, 1.0);
        }
        if size > 0.0 {
            gram += of_group / size;
        }
    }
    let largest = gram.diagonal().max().max(f64::MIN_POSITIVE);
    for (index, unknown) in regression.unknowns.iter().enumerate() {
        if unknown.prior.is_some() {
            gram[(index, index)] += largest;
        }
    }
    condition_of_gram(&gram) > 1e7
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
