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

use super::square_root::{absorb, product};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// A Gaussian with the lower factor of its covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gaussian<const N: usize> {
    /// Mean.
    pub mean: SVector<f64, N>,
    /// Lower triangular `S` with `P = S S^T`.
    pub factor: SMatrix<f64, N, N>,
}

impl<const N: usize> Gaussian<N> {
    /// Independent states.
    pub fn independent(mean: SVector<f64, N>, std: &SVector<f64, N>) -> Self {
        Self { mean, factor: SMatrix::from_diagonal(std) }
    }

    /// Whether mean and factor are finite.
    pub fn is_finite(&self) -> bool {
        self.mean.iter().chain(self.factor.iter()).all(|value| value.is_finite())
    }
}

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

    /// Time update through `phi`, then independent process noise of standard deviation `q`.
    pub fn predict<const N: usize>(
        &self,
        prior: &Gaussian<N>,
        q: &SVector<f64, N>,
        mut phi: impl FnMut(&SVector<f64, N>) -> SVector<f64, N>,
    ) -> Gaussian<N> {
        let centre = phi(&prior.mean);
        let (mut plus, mut minus) = (SMatrix::<f64, N, N>::zeros(), SMatrix::<f64, N, N>::zeros());
        let mut sum = SVector::<f64, N>::zeros();
        for i in 0..N {
            let offset = prior.factor.column(i) * self.gamma;
            let up = phi(&(prior.mean + offset)) - centre;
            let down = phi(&(prior.mean - offset)) - centre;
            sum += up + down;
            plus.set_column(i, &up);
            minus.set_column(i, &down);
        }
        let drift = sum * self.weight;
        let root = self.weight.sqrt();
        let mut factor = SMatrix::from_diagonal(q);
        absorb(&mut factor, plus * root);
        absorb(&mut factor, minus * root);
        absorb(&mut factor, drift * self.surplus.sqrt());
        Gaussian { mean: centre + drift, factor }
    }
}

/// Time update of the extended Kalman filter in square-root form: the mean is already carried
/// forward, `F` is the map's Jacobian and `q` the standard deviations of the process noise.
pub fn predict_linearised<const N: usize>(
    mean: SVector<f64, N>,
    f: &SMatrix<f64, N, N>,
    prior: &SMatrix<f64, N, N>,
    q: &SVector<f64, N>,
) -> Gaussian<N> {
    let mut factor = SMatrix::from_diagonal(q);
    absorb(&mut factor, product(f, prior));
    Gaussian { mean, factor }
}
