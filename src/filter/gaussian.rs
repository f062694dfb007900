//! What a filter knows of a state: the mean with the covariance, or with a factor of it.

use super::bounded;
use super::square_root::std_of;
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// A Gaussian of `N` numbers by mean and covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gaussian<const N: usize> {
    /// Mean.
    pub mean: SVector<f64, N>,
    /// Covariance, symmetric.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Gaussian<N> {
    /// Independent states with these standard deviations.
    pub fn independent(mean: SVector<f64, N>, std: &SVector<f64, N>) -> Self {
        Self { mean, covariance: SMatrix::from_diagonal(&std.map(|std| std * std)) }
    }

    /// Standard deviation of one state.
    pub fn std(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }

    /// Variance of a quantity whose derivative over the state is `gradient`.
    pub fn variance_along(&self, gradient: &SVector<f64, N>) -> f64 {
        let cross = combination(&self.covariance, &gradient.data.0[0]);
        dot(&gradient.data.0[0], &cross).max(0.0)
    }

    /// Makes one state known as `value` with `variance`, independent of the others.
    pub fn reset_state(&mut self, index: usize, value: f64, variance: f64) {
        self.mean[index] = value;
        self.covariance.row_mut(index).fill(0.0);
        self.covariance.column_mut(index).fill(0.0);
        self.covariance[(index, index)] = variance;
    }

    /// Adds `variance` to the variance of one state.
    pub fn inflate(&mut self, index: usize, variance: f64) {
        self.covariance[(index, index)] += variance;
    }

    /// Whether all numbers are finite, their sums far from overflow, and no variance is negative.
    pub fn is_valid(&self) -> bool {
        bounded(sum_of_sizes(self)) && (0..N).all(|i| self.covariance[(i, i)] >= 0.0)
    }
}

/// Row by row in plain arrays, so that the processor adds several numbers at once.
#[multiversion(targets("x86_64+avx+avx2"))]
fn sum_of_sizes<const N: usize>(belief: &Gaussian<N>) -> f64 {
    let mut sums = belief.mean.data.0[0].map(f64::abs);
    for column in &belief.covariance.data.0 {
        for i in 0..N {
            sums[i] += column[i].abs();
        }
    }
    sums.iter().sum()
}

/// A Gaussian of `N` numbers by mean and the lower triangular factor `S` of its covariance `P = S S^T`, which is
/// symmetric and positive semidefinite by construction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FactoredGaussian<const N: usize> {
    /// Mean.
    pub mean: SVector<f64, N>,
    /// Lower triangular `S` with `P = S S^T`.
    pub factor: SMatrix<f64, N, N>,
}

impl<const N: usize> FactoredGaussian<N> {
    /// Independent states with these standard deviations.
    pub fn independent(mean: SVector<f64, N>, std: &SVector<f64, N>) -> Self {
        Self { mean, factor: SMatrix::from_diagonal(std) }
    }

    /// Standard deviation of one state.
    pub fn std(&self, index: usize) -> f64 {
        std_of(&self.factor, index)
    }

    /// Variance of a quantity whose derivative over the state is `gradient`.
    pub fn variance_along(&self, gradient: &SVector<f64, N>) -> f64 {
        (self.factor.transpose() * gradient).norm_squared()
    }

    /// Whether mean and factor are finite: 0 times anything else is not 0.
    pub fn is_valid(&self) -> bool {
        let mut sum = self.mean * 0.0;
        for column in self.factor.column_iter() {
            sum += column * 0.0;
        }
        sum.sum() == 0.0
    }
}

/// `matrix += factor * v v^T`, exactly symmetric.
pub fn add_square<const N: usize>(matrix: &mut SMatrix<f64, N, N>, factor: f64, v: &SVector<f64, N>) {
    for j in 0..N {
        for i in 0..=j {
            let sum = matrix[(i, j)] + factor * v[i] * v[j];
            matrix[(i, j)] = sum;
            matrix[(j, i)] = sum;
        }
    }
}

/// `A h`, without the terms in which `h` is zero.
#[inline(always)]
pub(super) fn combination<const N: usize, const K: usize>(a: &SMatrix<f64, N, K>, h: &[f64; K]) -> [f64; N] {
    let mut sum = [0.0; N];
    for (column, h) in a.data.0.iter().zip(h) {
        if *h != 0.0 {
            add_scaled(&mut sum, column, *h);
        }
    }
    sum
}

/// `a b`, four terms side by side.
#[inline(always)]
pub(super) fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    let mut sums = [0.0; 4];
    let whole = N - N % 4;
    for k in (0..whole).step_by(4) {
        for lane in 0..4 {
            sums[lane] += a[k + lane] * b[k + lane];
        }
    }
    let mut sum = (sums[0] + sums[2]) + (sums[1] + sums[3]);
    for k in whole..N {
        sum += a[k] * b[k];
    }
    sum
}

#[inline(always)]
pub(super) fn add_scaled<const N: usize>(sum: &mut [f64; N], terms: &[f64; N], factor: f64) {
    for i in 0..N {
        sum[i] += terms[i] * factor;
    }
}
