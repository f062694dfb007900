//! Sparse `L D L'` of a symmetric positive definite matrix whose pattern never changes.
//!
//! Construction orders the unknowns by approximate minimum degree (Amestoy, Davis and Duff 1996),
//! finds the pattern of `L` and writes down where every product of the numeric phase goes.
//! [`factor`](SparseLdl::factor), [`solve`](SparseLdl::solve) and
//! [`invert`](SparseLdl::invert) (the selected inverse of Takahashi, Fagan and Chen 1973) then run
//! over fixed lists and allocate nothing.

use multiversion::multiversion;

/// A pivot that is not positive: the matrix is not positive definite, or not to working precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadPivot {
    /// The unknown at which it happened.
    pub unknown: usize,
}

/// Pattern, factor and selected inverse of one matrix.
#[derive(Clone, Debug)]
pub struct SparseLdl {
    /// Unknown eliminated at each place, and the place of each unknown.
    order: Vec<u32>,
    place: Vec<u32>,
    /// Strictly lower columns of `L`: where they start, and their rows in ascending order.
    start: Vec<usize>,
    row: Vec<u32>,
    /// For each column and each pair of its rows `i > k`, where `(i, k)` is in `row`.
    target: Vec<u32>,
    /// The matrix, then its factor: first the diagonal, then the strictly lower part.
    values: Vec<f64>,
    /// Largest ratio of a diagonal entry to its pivot in the last factorisation.
    cancellation: f64,
    original: Vec<f64>,
    inverse_diagonal: Vec<f64>,
    inverse_lower: Vec<f64>,
    column: Vec<f64>,
    sum: Vec<f64>,
}

impl SparseLdl {
    /// For a symmetric matrix of size `n` with nonzeros at the diagonal and at `pairs` (in any order, doubled
    /// or mirrored as they come).
    pub fn new(n: usize, pairs: &[(u32, u32)]) -> Self {
        let order = minimum_degree(n, pairs);
        let mut place = vec![0; n];
        for (k, &unknown) in order.iter().enumerate() {
            place[unknown as usize] = k as u32;
        }
        // pattern of the permuted lower triangle, column by column
        let mut below: Vec<Vec<u32>> = vec![vec![]; n];
        for &(i, j) in pairs {
            let (a, b) = (place[i as usize], place[j as usize]);
            if a != b {
                below[a.min(b) as usize].push(a.max(b));
            }
        }
        // a column of L has its own rows and those of the columns that it is the parent of
        let mut start = vec![0];
        let mut row: Vec<u32> = vec![];
        for j in 0..n {
            let mut own = std::mem::take(&mut below[j]);
            own.sort_unstable();
            own.dedup();
            if let Some(&parent) = own.first() {
                below[parent as usize].extend(&own[1..]);
            }
            row.extend(&own);
            start.push(row.len());
        }
        let mut target = vec![];
        for j in 0..n {
            let rows = &row[start[j]..start[j + 1]];
            for (k, &r) in rows.iter().enumerate() {
                let (from, to) = (start[r as usize], start[r as usize + 1]);
                let mut at = from;
                for &i in &rows[k + 1..] {
                    at += row[at..to].partition_point(|&other| other < i);
                    target.push(at as u32);
                }
            }
        }
        let widest = (0..n).map(|j| start[j + 1] - start[j]).max().unwrap_or(0);
        let nonzeros = row.len();
        Self {
            order,
            place,
            start,
            row,
            target,
            values: vec![0.0; n + nonzeros],
            cancellation: 1.0,
            original: vec![0.0; n],
            inverse_diagonal: vec![0.0; n],
            inverse_lower: vec![0.0; nonzeros],
            column: vec![0.0; widest],
            sum: vec![0.0; widest],
        }
    }

    /// Number of unknowns.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there are no unknowns.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Nonzeros of the lower triangle of `L` with the diagonal.
    pub fn nonzeros(&self) -> usize {
        self.len() + self.row.len()
    }

    /// Floating-point operations of one factorisation, `c^2 + 2 c` per column with `c` entries below
    /// the diagonal.
    pub fn factor_flops(&self) -> usize {
        self.start.windows(2).map(|w| (w[1] - w[0]) * (w[1] - w[0] + 2)).sum()
    }

    /// Slot of the entry `(i, j)` in [`values_mut`](Self::values_mut), if it is in the pattern:
    /// diagonals first.
    pub fn slot(&self, i: usize, j: usize) -> Option<usize> {
        let (a, b) = (self.place[i] as usize, self.place[j] as usize);
        if a == b {
            return Some(a);
        }
        let (low, high) = (a.min(b), a.max(b));
        let rows = &self.row[self.start[low]..self.start[low + 1]];
        let found = rows.binary_search(&(high as u32)).ok()?;
        Some(self.len() + self.start[low] + found)
    }

    /// The matrix to be factored, slot by slot.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Factors the matrix in place.
    pub fn factor(&mut self) -> Result<(), BadPivot> {
        let (diagonal, lower) = self.values.split_at_mut(self.order.len());
        let mut targets = self.target.as_slice();
        self.original.copy_from_slice(diagonal);
        self.cancellation = 1.0;
        for j in 0..self.order.len() {
            let pivot = diagonal[j];
            if !(pivot > 0.0 && pivot < f64::INFINITY) {
                return Err(BadPivot { unknown: self.order[j] as usize });
            }
            let inverse = 1.0 / pivot;
            self.cancellation = self.cancellation.max(self.original[j] * inverse);
            let (from, to) = (self.start[j], self.start[j + 1]);
            let column = &mut self.column[..to - from];
            column.copy_from_slice(&lower[from..to]);
            for (k, &r) in self.row[from..to].iter().enumerate() {
                let l = column[k] * inverse;
                diagonal[r as usize] -= l * column[k];
                let rest = &column[k + 1..];
                let (now, later) = targets.split_at(rest.len());
                targets = later;
                for (&x, &t) in rest.iter().zip(now) {
                    lower[t as usize] -= l * x;
                }
                lower[from + k] = l;
            }
        }
        Ok(())
    }

    /// The diagonal of `D` after a factorisation; their product is the determinant.
    pub fn pivots(&self) -> &[f64] {
        &self.values[..self.order.len()]
    }

    /// How many times larger a diagonal entry was than the pivot that was left of it, at worst. The
    /// inverse is known to about this times the rounding unit.
    pub fn cancellation(&self) -> f64 {
        self.cancellation
    }

    /// Solves with the factor: `x` holds the right side and becomes the solution, both in the order
    /// of elimination; see [`order`](Self::order).
    pub fn solve(&self, x: &mut [f64]) {
        self.solve_columns(x.as_chunks_mut::<1>().0, 0);
    }

    /// The same for several right sides at once, which are zero before the place `first`.
    pub fn solve_columns<const K: usize>(&self, x: &mut [[f64; K]], first: usize) {
        let (diagonal, lower) = self.values.split_at(self.order.len());
        substitute(&Factor { start: &self.start, row: &self.row, lower, diagonal }, x, first);
    }

    /// The place of an unknown in the order of elimination.
    pub fn place(&self, unknown: usize) -> usize {
        self.place[unknown] as usize
    }

    /// The unknown at each place of the order of elimination.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Computes the inverse at the pattern of `L`, from the last column to the first.
    pub fn invert(&mut self) {
        let (diagonal, lower) = self.values.split_at(self.order.len());
        let mut remaining = self.target.len();
        for j in (0..self.order.len()).rev() {
            let (from, to) = (self.start[j], self.start[j + 1]);
            let width = to - from;
            let l = &lower[from..to];
            let sum = &mut self.sum[..width];
            sum.fill(0.0);
            let first = remaining - width * width.saturating_sub(1) / 2;
            let mut targets = &self.target[first..remaining];
            remaining = first;
            let (mut later, mut sums) = (l, &mut *sum);
            for &r in &self.row[from..to] {
                let (Some((&lk, rest)), Some((own_sum, rest_sums))) = (later.split_first(), sums.split_first_mut())
                else {
                    break;
                };
                (later, sums) = (rest, rest_sums);
                let mut own = lk * self.inverse_diagonal[r as usize];
                let (now, others) = targets.split_at(rest.len());
                targets = others;
                for ((&t, &li), s) in now.iter().zip(rest).zip(&mut *sums) {
                    let z = self.inverse_lower[t as usize];
                    own += li * z;
                    *s += lk * z;
                }
                *own_sum += own;
            }
            let mut diagonal = 1.0 / diagonal[j];
            for ((&s, &l), z) in sum.iter().zip(l).zip(&mut self.inverse_lower[from..to]) {
                *z = -s;
                diagonal += l * s;
            }
            self.inverse_diagonal[j] = diagonal;
        }
    }

    /// Diagonal of the inverse, in the order of elimination.
    pub fn inverse_diagonal(&self) -> &[f64] {
        &self.inverse_diagonal
    }

    /// The entry of the inverse at a slot; see [`slot`](Self::slot).
    pub fn inverse_at(&self, slot: usize) -> f64 {
        let n = self.len();
        if slot < n { self.inverse_diagonal[slot] } else { self.inverse_lower[slot - n] }
    }
}

/// `L` and `D`; see [`SparseLdl`].
struct Factor<'a> {
    start: &'a [usize],
    row: &'a [u32],
    lower: &'a [f64],
    diagonal: &'a [f64],
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn substitute<const K: usize>(factor: &Factor, x: &mut [[f64; K]], first: usize) {
    let Factor { start, row, lower, diagonal } = *factor;
    for j in first..diagonal.len() {
        let xj = x[j];
        for (&r, &l) in row[start[j]..start[j + 1]].iter().zip(&lower[start[j]..start[j + 1]]) {
            for (x, xj) in x[r as usize].iter_mut().zip(&xj) {
                *x -= l * xj;
            }
        }
    }
    for j in (0..diagonal.len()).rev() {
        let mut xj = x[j].map(|x| x / diagonal[j]);
        for (&r, &l) in row[start[j]..start[j + 1]].iter().zip(&lower[start[j]..start[j + 1]]) {
            for (xj, x) in xj.iter_mut().zip(&x[r as usize]) {
                *xj -= l * x;
            }
        }
        x[j] = xj;
    }
}

fn minimum_degree(n: usize, pairs: &[(u32, u32)]) -> Vec<u32> {
    let natural = || (0..n as u32).collect();
    let mut columns: Vec<Vec<usize>> = vec![vec![]; n];
    for &(i, j) in pairs.iter().filter(|(i, j)| i != j) {
        columns[j as usize].push(i as usize);
        columns[i as usize].push(j as usize);
    }
    let mut start = vec![0];
    let mut rows = vec![];
    for column in &mut columns {
        column.sort_unstable();
        column.dedup();
        rows.append(column);
        start.push(rows.len());
    }
    match amd::order(n, &start, &rows, &amd::Control::default()) {
        Ok((order, _, _)) => order.into_iter().map(|unknown| unknown as u32).collect(),
        Err(_) => natural(),
    }
}
