//! What a Kalman filter knows of a state: mean and covariance.

use super::bounded;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Mean and covariance of a state of `N` numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Belief<const N: usize> {
    /// Mean.
    pub mean: SVector<f64, N>,
    /// Covariance, symmetric.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Belief<N> {
    /// Independent states with these variances.
    pub fn new(mean: SVector<f64, N>, variances: &SVector<f64, N>) -> Self {
        Self { mean, covariance: SMatrix::from_diagonal(variances) }
    }

    /// Standard deviation of one state.
    pub fn std(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }

    /// Makes one state known as `value` with `variance`, independent of the others.
    pub fn realign(&mut self, index: usize, value: f64, variance: f64) {
        self.mean[index] = value;
        self.covariance.row_mut(index).fill(0.0);
        self.covariance.column_mut(index).fill(0.0);
        self.covariance[(index, index)] = variance;
    }

    /// Whether all numbers are finite, their sum far from overflow, and no variance is negative.
    pub fn is_sound(&self) -> bool {
        // Row by row, so that the processor adds several numbers at once.
        let mut sums = self.mean.abs();
        for column in &self.covariance.data.0 {
            for (sum, value) in sums.iter_mut().zip(column) {
                *sum += value.abs();
            }
        }
        bounded(sums.sum()) && (0..N).all(|i| self.covariance[(i, i)] >= 0.0)
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
