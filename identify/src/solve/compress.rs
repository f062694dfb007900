//! Compression of many rows into as many as there are unknowns, by orthogonal transformations.
//!
//! `min |A theta - y|^2` has the same minimiser as `min |R theta - d|^2` with `[R d]` the triangular
//! factor of `[A y]`. The condition number is kept, where the normal equations would square it, and
//! rows can be fed block by block, so memory does not grow with their number. Written by hand because the factorisations
//! of nalgebra take a whole matrix: they can neither fold new rows into a factor nor leave the rows above it alone.

use super::{Regression, Rows};
use nalgebra::{DMatrix, DVector};

/// Rows that wait before they are folded into the factor; with them a column still fits the first-level cache.
const BLOCK: usize = 128;

/// Collects rows and keeps only their triangular factor.
pub struct Compressor {
    columns: usize,
    /// `[R d; 0 rho]`, upper triangular.
    factor: DMatrix<f64>,
    /// Waiting rows of `[A y]`, column after column, [`BLOCK`] values each.
    block: Vec<f64>,
    waiting: usize,
}

/// The triangular factor of many rows: `R theta ~ d`.
#[derive(Clone, Debug)]
pub struct Compressed {
    /// Upper triangular, square.
    pub r: DMatrix<f64>,
    /// Right-hand side.
    pub d: DVector<f64>,
}

impl Compressor {
    /// For rows of `columns` regressors.
    pub fn new(columns: usize) -> Self {
        let width = columns + 1;
        Self { columns, factor: DMatrix::zeros(width, width), block: vec![0.0; width * BLOCK], waiting: 0 }
    }

    /// Adds `weight * (row, rhs)`.
    pub fn push(&mut self, row: &[f64], rhs: f64, weight: f64) {
        let waiting = self.waiting;
        for (column, value) in self.block.chunks_exact_mut(BLOCK).zip(row) {
            column[waiting] = weight * value;
        }
        self.block[self.columns * BLOCK + waiting] = weight * rhs;
        self.waiting += 1;
        if self.waiting == BLOCK {
            self.reduce();
        }
    }

    /// Folds the waiting rows into the factor: for each column the Householder reflection of its diagonal entry and the
    /// block below (Golub and Van Loan, Matrix Computations, 4th ed., 5.1). The factor's other rows are not touched by it.
    fn reduce(&mut self) {
        let used = self.waiting;
        for j in 0..=self.columns {
            let (head, tail) = self.block.split_at_mut((j + 1) * BLOCK);
            let below = &head[j * BLOCK..][..used];
            let square = inner(below, below);
            if square == 0.0 {
                continue;
            }
            let diagonal = self.factor[(j, j)];
            let norm = (diagonal * diagonal + square).sqrt();
            let alpha = if diagonal > 0.0 { -norm } else { norm };
            // The reflection is I - v v' / scale with v = [diagonal - alpha, below].
            let first = diagonal - alpha;
            let scale = -alpha * first;
            for (k, column) in tail.chunks_exact_mut(BLOCK).enumerate() {
                let top = &mut self.factor[(j, j + 1 + k)];
                let factor = (first * *top + inner(below, &column[..used])) / scale;
                *top -= factor * first;
                column[..used].iter_mut().zip(below).for_each(|(cell, v)| *cell -= factor * v);
            }
            self.factor[(j, j)] = alpha;
        }
        self.waiting = 0;
    }

    /// The factor of all rows so far.
    pub fn finish(mut self) -> Compressed {
        self.reduce();
        let n = self.columns;
        Compressed {
            r: self.factor.view((0, 0), (n, n)).into_owned(),
            d: self.factor.view((0, n), (n, 1)).column(0).into_owned(),
        }
    }
}

/// Inner product by eight partial sums, which the processor can add at the same time.
fn inner(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<8>();
    let (b, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// Each group's rows compressed in the group's own unit: all that least squares needs of them, whatever their noise levels.
pub struct Factors(Vec<Compressed>);

impl Factors {
    /// One pass over all rows of a regression.
    pub fn of(regression: &Regression) -> Self {
        let compressed = |group: &Rows| {
            let mut compressor = Compressor::new(group.columns);
            (0..group.len()).for_each(|i| compressor.push(group.row(i), group.y[i], 1.0));
            compressor.finish()
        };
        Self(regression.groups.iter().map(compressed).collect())
    }

    /// The factor of each group.
    pub fn iter(&self) -> impl Iterator<Item = &Compressed> {
        self.0.iter()
    }

    /// `A'A` of each group.
    pub fn grams(&self) -> impl Iterator<Item = DMatrix<f64>> {
        self.0.iter().map(|factor| factor.r.tr_mul(&factor.r))
    }
}
