//! Square-root unscented Kalman filter whose time update needs no downdate.
//!
//! The factor of the predicted covariance is usually made by an orthogonal transformation of all
//! sigma points but the central one, followed by a rank-one update with the central one's weight,
//! which is negative for the usual spreads: a downdate, and it can fail. With the deviations
//! `d_i = Y_i - Y_0` from the *central* point and their weighted sum `d = w sum d_i` there is the
//! identity
//!
//! ```text
//! sum w_c (Y - z)(Y - z)^T = sum w d_i d_i^T + (beta - alpha^2) d d^T,   z = Y_0 + d
//! ```
//!
//! so that for `beta >= alpha^2` the factor is `tria[sqrt(w) d_1 .. d_2n | sqrt(beta - alpha^2) d |
//! diag(q)]` and nothing is subtracted. The mean is formed as `Y_0 + d`, never with the central
//! weight, which is -9999 for the source's `alpha = 0.01`.
//!
//! Errata of the source (Yang, Wang and Han, 2021): eq. 22 prints the weights without their divisors
//! and `1..n` for `1..2n`; eq. 23 drops the central point; eqs. 24 to 26 leave the process noise out
//! of the innovation's covariance, which [`crate::filter::square_root`] takes from the whole factor;
//! eq. 27 stands for two triangular solves.

use super::gaussian::FactoredGaussian;
use super::square_root::{absorb, absorb_leading, block, set_block};
use nalgebra::{SMatrix, SVector};

/// How far the sigma points lie from the mean and how they are weighted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Distance in units of the factor's columns, `gamma = alpha sqrt(n + kappa)`.
    gamma: f64,
    /// Weight of each outer point, `1 / (2 gamma^2)`.
    weight: f64,
    /// `beta - alpha^2`, not negative.
    surplus: f64,
}

/// A spread for which the filter does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SpreadError {
    /// With `beta < alpha^2` the time update would need a downdate.
    #[error("beta must be at least alpha^2")]
    BetaBelowAlphaSquared,
    /// `alpha^2 (n + kappa)` must be positive.
    #[error("alpha and the number of states plus kappa must be positive")]
    NotPositive,
}

impl Spread {
    /// The scaled unscented transform for `n` states.
    pub fn new(n: usize, alpha: f64, beta: f64, kappa: f64) -> Result<Self, SpreadError> {
        let square = alpha * alpha * (n as f64 + kappa);
        if !(alpha > 0.0 && square > 0.0 && square.is_finite()) {
            return Err(SpreadError::NotPositive);
        }
        let surplus = beta - alpha * alpha;
        if surplus.is_nan() || surplus < 0.0 {
            return Err(SpreadError::BetaBelowAlphaSquared);
        }
        Ok(Self { gamma: square.sqrt(), weight: 0.5 / square, surplus })
    }

    /// Time update of `M` states that move and `K` that only walk at random, `N = M + K`, with process
    /// noise of standard deviation `q`.
    ///
    /// `centre` is where the mean moves to; `pair(offset)` gives where `mean + offset` and
    /// `mean - offset` move to. Offset `j` is column `j` of the factor times the spread: its first `j`
    /// elements are zero.
    ///
    /// Opposite points enter as half their difference and half their sum. States that do not move
    /// have no sum, so that half of the points only widen the moving states' own block.
    pub fn predict<const N: usize, const M: usize, const K: usize>(
        &self,
        prior: &FactoredGaussian<N>,
        q: &SVector<f64, N>,
        centre: &SVector<f64, M>,
        mut pair: impl FnMut(&SVector<f64, N>) -> [SVector<f64, M>; 2],
    ) -> FactoredGaussian<N> {
        let (mut moved, mut bent) = (SMatrix::<f64, M, N>::zeros(), SMatrix::<f64, M, N>::zeros());
        let mut sum = SVector::<f64, M>::zeros();
        let half = 0.5 / self.gamma;
        for j in 0..N {
            let [up, down] = pair(&(prior.factor.column(j) * self.gamma));
            let (up, down) = (up - centre, down - centre);
            sum += up + down;
            moved.set_column(j, &((up - down) * half));
            bent.set_column(j, &((up + down) * half));
        }
        let drift = sum * self.weight;
        let mut noise = SMatrix::<f64, M, M>::from_diagonal(&block(q, 0, 0));
        absorb(&mut noise, bent);
        absorb(&mut noise, drift * self.surplus.sqrt());
        let mut mean = prior.mean;
        set_block(&mut mean, 0, 0, &(centre + drift));
        FactoredGaussian { mean, factor: predicted_factor::<N, M, K>(noise, &moved, &prior.factor, q) }
    }
}

/// Time update of the extended Kalman filter in square-root form for `M` states that move and `K` that
/// only walk at random, `N = M + K`: the mean is already carried forward, `F` holds the moving states'
/// rows of the map's Jacobian and `q` the standard deviations of the process noise.
pub fn predict_linearised<const N: usize, const M: usize, const K: usize>(
    mean: SVector<f64, N>,
    f: &SMatrix<f64, M, N>,
    prior: &SMatrix<f64, N, N>,
    q: &SVector<f64, N>,
) -> FactoredGaussian<N> {
    let mut moved = SMatrix::<f64, M, N>::zeros();
    for j in 0..N {
        for k in j..N {
            for i in 0..M {
                moved[(i, j)] += f[(i, k)] * prior[(k, j)];
            }
        }
    }
    let noise = SMatrix::from_diagonal(&block(q, 0, 0));
    FactoredGaussian { mean, factor: predicted_factor::<N, M, K>(noise, &moved, prior, q) }
}

/// The factor whose first `M` rows have become `moved` and `noise`, and whose others have walked.
fn predicted_factor<const N: usize, const M: usize, const K: usize>(
    noise: SMatrix<f64, M, M>,
    moved: &SMatrix<f64, M, N>,
    prior: &SMatrix<f64, N, N>,
    q: &SVector<f64, N>,
) -> SMatrix<f64, N, N> {
    const { assert!(N == M + K) }
    let mut rows = *prior;
    set_block(&mut rows, 0, 0, moved);
    let mut leading = SMatrix::<f64, N, M>::zeros();
    set_block(&mut leading, 0, 0, &noise);
    absorb_leading(&mut leading, &mut rows);
    let mut rest = SMatrix::from_diagonal(&block(q, M, 0));
    absorb::<K, N>(&mut rest, block(&rows, M, 0));
    let mut factor = SMatrix::zeros();
    set_block(&mut factor, 0, 0, &leading);
    set_block(&mut factor, M, M, &rest);
    factor
}
