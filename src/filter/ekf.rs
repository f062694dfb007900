//! Extended Kalman filter with missing rows, gate and Joseph update; the sizes are fixed by types.
//!
//! The filter holds mean and covariance and knows no equations: the caller linearises its model and
//! hands in the propagated mean with its transition matrix, or the innovation with its Jacobian.
//! Joseph's form keeps the covariance symmetric and positive definite under rounding.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Mean and covariance of a state of `N` numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ekf<const N: usize> {
    /// Mean.
    pub mean: SVector<f64, N>,
    /// Covariance, symmetric and positive definite.
    pub covariance: SMatrix<f64, N, N>,
}

/// `M` linearised measurement rows for a state of `N` numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows<const N: usize, const M: usize> {
    /// Measured minus predicted, angles wrapped by the caller. Ignored where `used` is false.
    pub innovation: SVector<f64, M>,
    /// Derivative of the prediction over the state.
    pub jacobian: SMatrix<f64, M, N>,
    /// Covariance of the measurement noise.
    pub noise: SMatrix<f64, M, M>,
    /// Rows that have a sample.
    pub used: [bool; M],
}

/// Rejects single rows whose innovation is implausible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Rejected is what exceeds this many standard deviations; 0 or less rejects nothing.
    pub deviations: f64,
    /// After so many rejections in a row one sample is let through, so that a filter that has gone
    /// astray can find back.
    pub patience: u32,
}

/// What an update tells about its rows; nothing of it is thrown away.
#[derive(Clone, Debug, PartialEq)]
pub struct Innovation<const M: usize> {
    /// Measured minus predicted, 0 in rows without a sample.
    pub residual: SVector<f64, M>,
    /// Predicted standard deviation of the residual.
    pub std: SVector<f64, M>,
    /// Rows that were used.
    pub used: [bool; M],
    /// Rows that the gate rejected.
    pub rejected: [bool; M],
    /// Normalised innovation squared over the used rows, chi-squared with [`dof`](Self::dof) degrees
    /// of freedom if filter and plant agree; NaN if no row was used.
    pub nis: f64,
    /// Number of used rows.
    pub dof: usize,
    /// Logarithm of the likelihood of the used rows; 0 if there is none.
    pub log_likelihood: f64,
}

/// A covariance that is not positive definite; the filter was left as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the innovation covariance is not positive definite")]
pub struct NotPositiveDefinite;

impl<const N: usize> Ekf<N> {
    /// A filter with independent states: variances on the diagonal.
    pub fn new(mean: SVector<f64, N>, variances: SVector<f64, N>) -> Self {
        Self { mean, covariance: SMatrix::from_diagonal(&variances) }
    }

    /// Time update: the propagated mean, `P = Phi P Phi^T + Q`.
    pub fn predict(&mut self, mean: SVector<f64, N>, transition: &SMatrix<f64, N, N>, noise: &SMatrix<f64, N, N>) {
        self.mean = mean;
        let half = times_transposed(&self.covariance, transition);
        self.covariance = symmetric(&(times_transposed(&half.transpose(), transition) + noise));
    }

    /// Measurement update of the used rows, in Joseph's form.
    ///
    /// `gate` comes with one counter of rejections in a row per measurement row. Rows without a sample
    /// are decoupled (zero Jacobian, unit variance), which equals leaving them out.
    pub fn update<const M: usize>(
        &mut self,
        rows: &Rows<N, M>,
        gate: Option<(Gate, &mut [u32; M])>,
    ) -> Result<Innovation<M>, NotPositiveDefinite> {
        let mut used = rows.used;
        let mut rejected = [false; M];
        let cross = times_transposed(&self.covariance, &rows.jacobian);
        let all = times_transposed(&cross.transpose(), &rows.jacobian) + rows.noise;
        if let Some((gate, counters)) = gate {
            for row in (0..M).filter(|&row| rows.used[row]) {
                rejected[row] = gate.rejects(rows.innovation[row], all[(row, row)], &mut counters[row]);
                used[row] &= !rejected[row];
            }
        }
        let dof = used.iter().filter(|used| **used).count();
        let (mut jacobian, mut noise, mut cross) = (rows.jacobian, rows.noise, cross);
        let (mut innovation, mut s) = (rows.innovation, all);
        for row in (0..M).filter(|&row| !used[row]) {
            jacobian.row_mut(row).fill(0.0);
            cross.column_mut(row).fill(0.0);
            innovation[row] = 0.0;
            for matrix in [&mut noise, &mut s] {
                matrix.row_mut(row).fill(0.0);
                matrix.column_mut(row).fill(0.0);
                matrix[(row, row)] = 1.0;
            }
        }
        let std = all.diagonal().map(|variance| variance.max(0.0).sqrt());
        if dof == 0 {
            return Ok(Innovation {
                residual: innovation,
                std,
                used,
                rejected,
                nis: f64::NAN,
                dof,
                log_likelihood: 0.0,
            });
        }
        let factor = symmetric(&s).cholesky().ok_or(NotPositiveDefinite)?;
        let root = factor.l_dirty();
        let gain = divide(&cross, root);
        let whitened = whiten(&innovation, root);
        let nis = whitened.norm_squared();
        let log_determinant = 2.0 * root.diagonal().product().ln();
        let mean = self.mean + gain * innovation;
        // (I - K H) P (I - K H)^T + K R K^T, factor by factor: A P with A = I - K H is P - K (H P), and
        // (A P) A^T + K R K^T = A P + (K R - A P H^T) K^T.
        let kept = self.covariance - times_transposed(&gain, &cross);
        let rest = times_transposed(&gain, &noise) - times_transposed(&kept, &jacobian);
        let covariance = symmetric(&(kept + times_transposed(&rest, &gain)));
        if !(mean.iter().all(|value| value.is_finite()) && covariance.iter().all(|value| value.is_finite())) {
            return Err(NotPositiveDefinite);
        }
        self.mean = mean;
        self.covariance = covariance;
        let log_likelihood = -0.5 * (nis + log_determinant + dof as f64 * std::f64::consts::TAU.ln());
        Ok(Innovation { residual: innovation, std, used, rejected, nis, dof, log_likelihood })
    }

    /// Standard deviation of one state.
    pub fn std(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }

    /// Whether mean and covariance are finite and the covariance is positive definite.
    pub fn is_sound(&self) -> bool {
        let finite = self.mean.iter().chain(self.covariance.iter()).all(|value| value.is_finite());
        finite && self.covariance.cholesky().is_some()
    }
}

impl Gate {
    fn rejects(&self, innovation: f64, variance: f64, in_a_row: &mut u32) -> bool {
        let beyond = self.deviations > 0.0 && innovation.abs() > self.deviations * variance.max(0.0).sqrt();
        let reject = beyond && *in_a_row < self.patience;
        *in_a_row = if reject { *in_a_row + 1 } else { 0 };
        reject
    }
}

/// `A B^T`, column by column, without the terms in which `B` is zero: Jacobians and transition matrices
/// mostly are.
fn times_transposed<const N: usize, const K: usize, const M: usize>(
    a: &SMatrix<f64, N, K>,
    b: &SMatrix<f64, M, K>,
) -> SMatrix<f64, N, M> {
    let mut product = SMatrix::<f64, N, M>::zeros();
    for row in 0..M {
        let mut column = SVector::<f64, N>::zeros();
        for k in 0..K {
            let factor = b[(row, k)];
            if factor != 0.0 {
                for i in 0..N {
                    column[i] += a[(i, k)] * factor;
                }
            }
        }
        product.set_column(row, &column);
    }
    product
}

/// `C S^-1` with `S = L L^T`.
fn divide<const N: usize, const M: usize>(c: &SMatrix<f64, N, M>, l: &SMatrix<f64, M, M>) -> SMatrix<f64, N, M> {
    let mut x = *c;
    // x L^T = c, then x L = that: each a substitution over columns.
    for j in 0..M {
        for k in 0..j {
            subtract_column(&mut x, j, k, l[(j, k)]);
        }
        x.column_mut(j).scale_mut(1.0 / l[(j, j)]);
    }
    for j in (0..M).rev() {
        for k in j + 1..M {
            subtract_column(&mut x, j, k, l[(k, j)]);
        }
        x.column_mut(j).scale_mut(1.0 / l[(j, j)]);
    }
    x
}

fn subtract_column<const N: usize, const M: usize>(x: &mut SMatrix<f64, N, M>, from: usize, what: usize, times: f64) {
    if times != 0.0 {
        for i in 0..N {
            x[(i, from)] -= times * x[(i, what)];
        }
    }
}

/// `L^-1 v`.
fn whiten<const M: usize>(v: &SVector<f64, M>, l: &SMatrix<f64, M, M>) -> SVector<f64, M> {
    let mut x = *v;
    for i in 0..M {
        let known: f64 = (0..i).map(|k| l[(i, k)] * x[k]).sum();
        x[i] = (x[i] - known) / l[(i, i)];
    }
    x
}

/// The symmetric part.
pub fn symmetric<const N: usize>(matrix: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (matrix + matrix.transpose()) * 0.5
}
