//! Compression of many rows into as many as there are unknowns, by orthogonal transformations.
//!
//! `min |A theta - y|^2` has the same minimiser as `min |R theta - d|^2` with `[R d]` the triangular
//! factor of `[A y]`. The condition number is kept, where the normal equations would square it, and
//! rows can be fed block by block, so memory does not grow with their number. Written by hand because the factorisations
//! of nalgebra take a whole matrix: they can neither fold new rows into a factor nor leave the rows above it alone.

use nalgebra::{DMatrix, DVector};

const BLOCK: usize = 128;

/// Collects rows and keeps only their triangular factor.
pub struct Compressor {
    columns: usize,
    /// `[R d]` on top, waiting rows below.
    work: DMatrix<f64>,
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
        Self { columns, work: DMatrix::zeros(columns + 1 + BLOCK, columns + 1), waiting: 0 }
    }

    /// Adds `weight * (row, rhs)`.
    pub fn push(&mut self, row: &[f64], rhs: f64, weight: f64) {
        let index = self.columns + 1 + self.waiting;
        for (column, value) in row.iter().enumerate() {
            self.work[(index, column)] = weight * value;
        }
        self.work[(index, self.columns)] = weight * rhs;
        self.waiting += 1;
        if self.waiting == BLOCK {
            self.reduce();
        }
    }

    fn reduce(&mut self) {
        let (rows, columns) = self.work.shape();
        let used = self.columns + 1 + self.waiting;
        for j in 0..columns {
            // Householder reflection of column j; rows between j and the old factor's end are zero below
            // their diagonal, but treating them as full keeps this one loop simple.
            let norm = (j..used).map(|i| self.work[(i, j)].powi(2)).sum::<f64>().sqrt();
            if norm == 0.0 {
                continue;
            }
            let alpha = if self.work[(j, j)] > 0.0 { -norm } else { norm };
            let head = self.work[(j, j)] - alpha;
            let square = norm * norm - alpha * self.work[(j, j)];
            self.work[(j, j)] = head;
            for k in j + 1..columns {
                let product: f64 = (j..used).map(|i| self.work[(i, j)] * self.work[(i, k)]).sum();
                let factor = product / square;
                for i in j..used {
                    let v = self.work[(i, j)];
                    self.work[(i, k)] -= factor * v;
                }
            }
            self.work[(j, j)] = alpha;
            for i in j + 1..rows {
                self.work[(i, j)] = 0.0;
            }
        }
        self.work.rows_range_mut(columns..).fill(0.0);
        self.waiting = 0;
    }

    /// The factor of all rows so far.
    pub fn finish(mut self) -> Compressed {
        self.reduce();
        let n = self.columns;
        Compressed {
            r: self.work.view((0, 0), (n, n)).into_owned(),
            d: self.work.view((0, n), (n, 1)).column(0).into_owned(),
        }
    }
}
