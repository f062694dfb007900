//! Covariance of robust regressions, conditioning and the bias of noisy regressors.

use super::compress::Factors;
use super::robust::Minimiser;
use super::{HUBER_DELTA, Loss, Options, Regression, Solution, add_outer, add_scaled, dot};
use nalgebra::{DMatrix, DVector};

/// Judges the minimiser of a regression.
///
/// The covariance is the sandwich `B^-1 S B^-1` with `B = A'WA` and `S` the [`long_run`] covariance of `g`, the summed
/// score of a cluster (`psi(r) a`), rows in units of their noise. `W` is the second derivative of the loss: 1 for
/// least squares; 1 within the Huber threshold, 0 beyond; for L1, whose second derivative is twice a delta function,
/// `1/h` where `|r| <= h` (Powell's kernel, `h = 1.06 rows^(-1/5)`). It is honest about correlation inside and between
/// clusters and about unequal noise, and does not know of noise in the regressors or of what the rows neglect: that
/// is `bias`. With noise of energy `N = [N_a N_y]`
/// in `[A y]` and neglected terms `d` the normal equations hold at `theta + bias`,
/// `B bias = A'W d - (N_a theta - N_y)` at the true `theta`. With [`Options::correct`] it is subtracted, except for guesses.
pub fn of_regression(
    regression: &Regression,
    factors: &Factors,
    scales: &[f64],
    options: &Options,
    minimiser: Minimiser,
) -> Solution {
    let n = regression.unknowns.len();
    let Sums { information, gram, scores, squares, shift, guess, noise_energy, coloured, residuals, rows } =
        Sums::over(regression, factors, scales, options, &minimiser.theta);
    let bread = inverse(&information);
    let LongRun { covariance: mut filling, degrees_of_freedom } = long_run(&scores, n, &gram, rows);
    let mut plain = DMatrix::zeros(n, n);
    let plain_scores = if options.loss == Loss::L1 { &squares } else { &scores };
    plain_scores.iter().for_each(|(_, score)| add_outer(&mut plain, 1.0, score, score));
    for (index, unknown) in regression.unknowns.iter().enumerate() {
        if let Some((_, std)) = unknown.prior {
            plain[(index, index)] += 1.0 / (std * std);
            filling[(index, index)] += 1.0 / (std * std);
        }
    }
    // The shift was taken at the biased point: B bias = shift + N_a bias. Where noise is all there is
    // in a direction, only the first step is known.
    let consistent = match (&information - &noise_energy).cholesky() {
        Some(factor) => factor.inverse(),
        None => bread.clone(),
    };
    let coloured =
        coloured.into_iter().map(|(channel, shift)| (channel, (&bread * shift).as_slice().to_vec())).collect();
    let known = &consistent * shift;
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
    let sandwich = if options.loss == Loss::L1 {
        let bread = inverse(&gram);
        &bread * plain * &bread
    } else {
        gain * plain * gain
    };
    Solution {
        name: regression.name.clone(),
        covariance: gain * filling * gain,
        inverse_information: bread,
        condition_number: condition_of_gram(&gram),
        scales: scales.to_vec(),
        residuals,
        noise_share,
        bias: bias.as_slice().to_vec(),
        coloured,
        sandwich,
        degrees_of_freedom,
        rows,
        at_bound: minimiser.at_bound,
        accuracy: minimiser.accuracy,
        theta,
        cost: Vec::new(),
        profiles: Vec::new(),
    }
}

/// Sums over the rows of a regression at its minimiser, rows in units of their noise.
struct Sums {
    /// `B`, with the priors.
    information: DMatrix<f64>,
    /// `A'A`, with the priors.
    gram: DMatrix<f64>,
    /// `psi(r) a` and `r a`, summed over each cluster; the second for L1 only.
    scores: Scores,
    squares: Scores,
    /// By how much noise in the regressors and neglected terms shift the normal equations, and those that are guesses.
    shift: DVector<f64>,
    guess: DVector<f64>,
    /// `N_a`
    noise_energy: DMatrix<f64>,
    /// The same of coloured noise, by channel.
    coloured: Vec<(String, DVector<f64>)>,
    /// Residuals of each group, in its unit.
    residuals: Vec<Vec<f64>>,
    rows: usize,
}

impl Sums {
    fn over(regression: &Regression, factors: &Factors, scales: &[f64], options: &Options, theta: &[f64]) -> Self {
        let n = regression.unknowns.len();
        let clusters = || regression.groups.iter().flat_map(|group| group.cluster.iter().copied());
        let mut sums = Self {
            information: DMatrix::zeros(n, n),
            gram: DMatrix::zeros(n, n),
            scores: Scores::new(n, clusters()),
            squares: if options.loss == Loss::L1 { Scores::new(n, clusters()) } else { Scores::default() },
            shift: DVector::zeros(n),
            guess: DVector::zeros(n),
            noise_energy: DMatrix::zeros(n, n),
            coloured: Vec::new(),
            residuals: Vec::new(),
            rows: regression.groups.iter().map(super::Rows::len).sum(),
        };
        for ((group, gram), &scale) in regression.groups.iter().zip(factors.grams()).zip(scales) {
            let gram = gram / (scale * scale);
            let curvature = sums.add_rows(group, scale, options.loss, theta);
            if options.loss == Loss::Ls {
                sums.information += &gram;
            }
            sums.gram += gram;
            sums.add_noise(group, scale, curvature, theta);
        }
        for (index, unknown) in regression.unknowns.iter().enumerate() {
            if let Some((_, std)) = unknown.prior {
                sums.information[(index, index)] += 1.0 / (std * std);
                sums.gram[(index, index)] += 1.0 / (std * std);
            }
        }
        sums
    }

    /// Adds the rows of a group; the sum of their weights.
    fn add_rows(&mut self, group: &super::Rows, scale: f64, loss: Loss, theta: &[f64]) -> f64 {
        let kernel = 1.06 * (self.rows.max(1) as f64).powf(-0.2);
        let of_group = group.residuals(theta);
        let mut curvature = 0.0;
        for (i, residual) in of_group.iter().enumerate() {
            let row = group.row(i);
            let r = residual / scale;
            let (weight, psi) = match loss {
                Loss::Ls => (1.0, r),
                Loss::L1 => (f64::from(u8::from(r.abs() <= kernel)) / kernel, r.signum()),
                Loss::Huber => (f64::from(u8::from(r.abs() <= HUBER_DELTA)), r.clamp(-HUBER_DELTA, HUBER_DELTA)),
            };
            // That of least squares is the same for all rows, and known from their factor.
            if weight > 0.0 && loss != Loss::Ls {
                add_outer(&mut self.information, weight / (scale * scale), row, row);
            }
            let cluster = group.cluster[i];
            self.scores.add(cluster, psi / scale, row);
            if loss == Loss::L1 {
                self.squares.add(cluster, r / scale, row);
            }
            if let Some(neglected) = group.neglected.get(i) {
                let into = if group.guessed { &mut self.guess } else { &mut self.shift };
                add_scaled(into, weight * neglected / (scale * scale), row);
            }
            curvature += weight;
        }
        self.residuals.push(of_group);
        curvature
    }

    /// Noise `E` in `[A y]`: the normal equations gain `N (E_aa theta - E_ay)`, which shifts the minimiser.
    fn add_noise(&mut self, group: &super::Rows, scale: f64, curvature: f64, theta: &[f64]) {
        let n = theta.len();
        if group.noise.len() == (n + 1) * (n + 1) {
            for j in 0..n {
                let noise = &group.noise[j * (n + 1)..(j + 1) * (n + 1)];
                self.shift[j] -= curvature * (dot(&noise[..n], theta) - noise[n]) / (scale * scale);
                for (k, noise) in noise[..n].iter().enumerate() {
                    self.noise_energy[(j, k)] += curvature * noise / (scale * scale);
                }
            }
        }
        for (channel, kernel) in &group.coloured {
            if let Some(variance) = excess(group, scale, kernel, theta) {
                let mut into = DVector::zeros(n);
                for j in 0..n {
                    let noise = &kernel[j * (n + 1)..(j + 1) * (n + 1)];
                    into[j] = -curvature * variance * (dot(&noise[..n], theta) - noise[n]) / (scale * scale);
                }
                self.coloured.push((channel.clone(), into));
            }
        }
    }
}

/// Share of the largest plausible coloured noise of a channel that the residuals have room for beyond what white noise
/// explains; `kernel` is the covariance of `[row, right-hand side]` for all of it. None where white noise explains the
/// residuals, or is not known.
fn excess(group: &super::Rows, scale: f64, kernel: &[f64], theta: &[f64]) -> Option<f64> {
    let n = theta.len();
    let of = |noise: &[f64]| -> f64 {
        let value = |i: usize| if i < n { theta[i] } else { -1.0 };
        (0..=n)
            .flat_map(|i| (0..=n).map(move |j| (i, j)))
            .map(|(i, j)| value(i) * noise[i * (n + 1) + j] * value(j))
            .sum()
    };
    if group.noise.len() != (n + 1) * (n + 1) || kernel.len() != group.noise.len() || group.len() < 2 {
        return None;
    }
    let clusters = group.cluster.iter().zip(&group.cluster[1..]).filter(|(a, b)| a != b).count() + 1;
    // Three standard deviations of a variance from so many independent values.
    let chance = 1.0 + 3.0 * (2.0 / clusters as f64).sqrt();
    let beyond = scale * scale - chance * of(&group.noise);
    let unit = of(kernel);
    (beyond > 0.0 && unit > 0.0).then(|| (beyond / unit).min(1.0))
}

/// Vectors summed over the rows of each cluster, in the order of the clusters' numbers.
#[derive(Default)]
pub struct Scores {
    n: usize,
    clusters: Vec<u32>,
    /// `n` values for each cluster.
    sums: Vec<f64>,
    /// Where the last row was added.
    last: usize,
}

impl Scores {
    /// Zeros of length `n` for the clusters of all rows.
    pub fn new(n: usize, clusters: impl Iterator<Item = u32>) -> Self {
        let mut all: Vec<u32> = Vec::new();
        // Neighbouring rows share a cluster: of each run one.
        for cluster in clusters {
            if all.last() != Some(&cluster) {
                all.push(cluster);
            }
        }
        if !all.is_sorted() {
            all.sort_unstable();
        }
        all.dedup();
        Self { n, sums: vec![0.0; n * all.len()], clusters: all, last: 0 }
    }

    /// Adds `weight row` to a cluster's sum.
    #[inline]
    pub fn add(&mut self, cluster: u32, weight: f64, row: &[f64]) {
        if self.clusters[self.last] != cluster {
            let next = self.last + 1;
            self.last = match self.clusters.get(next) {
                Some(after) if *after == cluster => next,
                _ => self.clusters.partition_point(|other| *other < cluster),
            };
        }
        let sum = &mut self.sums[self.last * self.n..][..self.n];
        sum.iter_mut().zip(row).for_each(|(cell, value)| *cell += weight * value);
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.clusters.len()
    }

    /// Whether there is no cluster.
    pub fn is_empty(&self) -> bool {
        self.clusters.is_empty()
    }

    /// Each cluster's number and sum.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &[f64])> {
        self.clusters.iter().copied().zip(self.sums.chunks_exact(self.n.max(1)))
    }
}

/// Covariance of the sum of correlated scores.
pub struct LongRun {
    /// The covariance.
    pub covariance: DMatrix<f64>,
    /// Clusters less the unknowns, times what correlation leaves of them; at least 1.
    pub degrees_of_freedom: f64,
}

/// Covariance of the sum of the scores of consecutive clusters that may hang together.
///
/// Each component is whitened as a first-order autoregression, the covariance of what is left is taken, and coloured
/// again by `1/(1 - rho)` on both sides (Andrews and Monahan 1992, diagonal); `rho` is corrected for its bias in short
/// series (Kendall 1954) and never taken as negative. Times `G/(G - n)` for the unknowns that the residuals were
/// fitted with. With no more clusters than unknowns nothing can be said about correlation: then each cluster
/// counts as one of the `rows` of the `gram`, which is pessimistic.
pub fn long_run(scores: &Scores, n: usize, gram: &DMatrix<f64>, rows: usize) -> LongRun {
    let count = scores.len() as f64;
    // The score of the cluster before, where there is one.
    let pairs = || {
        let before = std::iter::once(None).chain(scores.iter().map(Some));
        scores
            .iter()
            .zip(before)
            .map(|((id, score), before)| (score, before.filter(|(other, _)| other + 1 == id).map(|(_, score)| score)))
    };
    let (mut products, mut squares) = (vec![0.0_f64; n], vec![0.0_f64; n]);
    for (score, before) in pairs() {
        squares.iter_mut().zip(score).for_each(|(sum, s)| *sum += s * s);
        let before = before.into_iter().flatten();
        products.iter_mut().zip(score).zip(before).for_each(|((sum, s), b)| *sum += s * b);
    }
    let most = (1.0 - 4.0 / count).clamp(0.0, 0.95);
    let of_component = |(product, square): (&f64, &f64)| {
        let raw = if *square > 0.0 { product / square } else { 0.0 };
        if raw > 0.0 { (raw + (1.0 + 3.0 * raw) / count).min(most) } else { 0.0 }
    };
    let rho: Vec<f64> = products.iter().zip(&squares).map(of_component).collect();
    let usual = rho.iter().sum::<f64>() / n.max(1) as f64;
    let mut covariance = DMatrix::zeros(n, n);
    if scores.len() <= n + 1 {
        let energy: f64 = scores.iter().map(|(_, score)| dot(score, score)).sum();
        let mean = energy / gram.trace().max(f64::MIN_POSITIVE);
        return LongRun { covariance: gram * mean.max(rows as f64 / count.max(1.0)), degrees_of_freedom: 1.0 };
    }
    let mut left = vec![0.0; n];
    for (score, before) in pairs() {
        for (j, left) in left.iter_mut().enumerate() {
            *left = match before {
                Some(before) => (score[j] - rho[j] * before[j]) / (1.0 - rho[j]),
                // Without a cluster before it a score has its full variance already.
                None => score[j] * ((1.0 + rho[j]) / (1.0 - rho[j])).sqrt(),
            };
        }
        add_outer(&mut covariance, 1.0, &left, &left);
    }
    covariance *= count / (count - n as f64);
    LongRun { covariance, degrees_of_freedom: ((count - n as f64) * (1.0 - usual)).max(1.0) }
}

/// Pseudo-inverse of a symmetric matrix, scaled to a unit diagonal first so that the units of
/// the unknowns do not matter. NaN, of which nothing follows, if the matrix is not finite.
pub fn inverse(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    // Of a log by itself that tells no parameter; singular values of nothing are refused.
    if matrix.is_empty() {
        return matrix.clone();
    }
    let scale = matrix.diagonal().map(|value| if value > 0.0 { value.sqrt() } else { 1.0 });
    let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / (scale[i] * scale[j]));
    // Singular values of what is not finite are looked for without end.
    let finite = scaled.iter().all(|value| value.is_finite());
    let pseudo = finite.then(|| scaled.pseudo_inverse(1e-14).ok()).flatten();
    let pseudo = pseudo.unwrap_or_else(|| DMatrix::from_element(matrix.nrows(), matrix.ncols(), f64::NAN));
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| pseudo[(i, j)] / (scale[i] * scale[j]))
}

/// Whether the rows of a regression, compressed to `factors`, and its priors leave a direction of the unknowns open.
pub fn is_singular(regression: &Regression, factors: &Factors) -> bool {
    let n = regression.unknowns.len();
    let mut gram = DMatrix::<f64>::zeros(n, n);
    for of_group in factors.grams() {
        // Groups of different units weigh alike.
        let size = of_group.trace();
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

#[cfg(test)]
mod tests {
    use super::inverse;
    use nalgebra::DMatrix;

    /// A log that tells no parameter stopped the fit of several logs.
    #[test]
    fn the_inverse_of_nothing_is_nothing_and_of_a_singular_matrix_its_pseudo_inverse() {
        assert!(inverse(&DMatrix::zeros(0, 0)).is_empty());
        let corner = |value: f64| DMatrix::from_row_slice(2, 2, &[value, 0.0, 0.0, 0.0]);
        assert!((inverse(&corner(4.0)) - corner(0.25)).amax() < 1e-15);
    }
}
