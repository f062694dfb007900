//! Square roots of covariances: triangularisation by orthogonal transformations and the measurement
//! updates that never form a covariance.
//!
//! A factor is a lower triangular `S` with non-negative diagonal and `P = S S^T`. All that happens
//! to factors here is a product with an orthogonal matrix from the right, which changes `S` but not
//! `S S^T`; nothing is ever subtracted, so no factor can lose its positive definiteness.
//!
//! The three forms of the linear measurement update agree in exact arithmetic:
//!
//! - [`array()`]: one orthogonal transformation of `[[V, H S], [0, S]]`,
//! - [`andrews`]: `S [I - F U^-T (U + V)^-1 F^T]` with `F = S^T H^T`,
//! - [`joseph`]: `[(I - K H) S | K V]`, which is right for every gain `K`.

use super::gaussian::dot;
use nalgebra::{SMatrix, SVector};

/// The lower triangular `L` with non-negative diagonal and `L L^T = A A^T`.
///
/// `A` has any number of columns; with fewer than `N` independent ones some diagonal elements are 0.
#[inline(always)]
pub fn tria<const N: usize, const M: usize>(a: SMatrix<f64, N, M>) -> SMatrix<f64, N, N> {
    let mut factor = SMatrix::zeros();
    absorb(&mut factor, a);
    factor
}

/// Makes `A` lower trapezoidal with a non-negative diagonal; `A A^T` stays. What lies right of the
/// first `N` columns becomes 0.
#[inline(always)]
pub fn lower<const N: usize, const M: usize>(a: &mut SMatrix<f64, N, M>) {
    for i in 0..N.min(M) {
        let (left, right) = a.data.0.split_at_mut(i + 1);
        let reflection = Reflection::<M>::of_columns(i, &left[i], right);
        reflection.apply(i, &mut left[i], right);
    }
}

/// Adds the columns of `block` to a factor: `L L^T` becomes `L L^T + B B^T`.
///
/// `tria([A | B])` is `absorb` of `B` into `tria(A)`: blocks of any width can follow one another.
#[inline(always)]
pub fn absorb<const N: usize, const M: usize>(factor: &mut SMatrix<f64, N, N>, block: SMatrix<f64, N, M>) {
    absorb_rows(factor, &mut rows(&block));
}

/// The rows of a matrix.
#[inline(always)]
pub fn rows<const N: usize, const M: usize>(a: &SMatrix<f64, N, M>) -> [[f64; M]; N] {
    let mut rows = [[0.0; M]; N];
    for (j, column) in a.data.0.iter().enumerate() {
        for i in 0..N {
            rows[i][j] = column[i];
        }
    }
    rows
}

/// Triangularises the first `C` rows of `[L | B]`, where `L` holds the first `C` columns of a factor and `B` is given by
/// its rows. On return these rows of `B` have been used up and its other rows are what is left for the other columns.
#[inline(always)]
pub fn absorb_rows<const N: usize, const C: usize, const M: usize>(
    leading: &mut SMatrix<f64, N, C>,
    block: &mut [[f64; M]; N],
) {
    for i in 0..C {
        let reflection = Reflection::new(leading[(i, i)], block[i]);
        let column = &mut leading.data.0[i];
        if reflection.scale == 0.0 {
            if reflection.length < 0.0 {
                column[i..].iter_mut().for_each(|element| *element = -*element);
            }
            continue;
        }
        column[i] = reflection.length;
        for k in i + 1..N {
            let dot = reflection.scale * (reflection.head * column[k] + dot(&reflection.tail, &block[k]));
            column[k] -= reflection.head * dot;
            for (element, tail) in block[k].iter_mut().zip(&reflection.tail) {
                *element -= tail * dot;
            }
        }
    }
}

/// Adds independent noise to single states: `L L^T + diag(std^2)`.
pub fn absorb_diagonal<const N: usize>(factor: &mut SMatrix<f64, N, N>, std: &SVector<f64, N>) {
    for i in 0..N {
        if std[i] != 0.0 {
            let mut column = SVector::<f64, N>::zeros();
            column[i] = std[i];
            rotate_in_from(factor, &mut column, i);
        }
    }
}

/// [`absorb`] of one column whose first `from` elements are zero, by Givens rotations.
fn rotate_in_from<const N: usize>(factor: &mut SMatrix<f64, N, N>, column: &mut SVector<f64, N>, from: usize) {
    for i in from..N {
        let (diagonal, off) = (factor[(i, i)], column[i]);
        if off.abs() <= 1e-20 * diagonal.abs() || off.abs() < SMALLEST {
            continue;
        }
        let length = (diagonal * diagonal + off * off).sqrt();
        let (c, s) = (diagonal / length, off / length);
        for row in i..N {
            let (a, b) = (factor[(row, i)], column[row]);
            factor[(row, i)] = c * a + s * b;
            column[row] = c * b - s * a;
        }
    }
}

/// Elements below this are no variance at all: their squares would underflow.
const SMALLEST: f64 = 1e-100;

/// The Householder reflection that takes a row `(diagonal, tail)` to `(length, 0)`.
///
/// A tail that is 1e-20 of its diagonal element carries nothing in double precision and is
/// dropped: correlations that fade away step by step would otherwise underflow in the scale.
struct Reflection<const M: usize> {
    tail: [f64; M],
    /// First element of the reflection's vector, whose others are `tail`.
    head: f64,
    /// 2 over the square of the vector's length; 0 if nothing is reflected.
    scale: f64,
    /// What the row's first element becomes; the diagonal if nothing is reflected.
    length: f64,
}

impl<const M: usize> Reflection<M> {
    #[inline(always)]
    fn new(diagonal: f64, tail: [f64; M]) -> Self {
        let square = dot(&tail, &tail);
        if square <= 1e-40 * diagonal * diagonal || square < SMALLEST * SMALLEST {
            return Self { tail, head: 0.0, scale: 0.0, length: diagonal };
        }
        // For a positive diagonal the difference diagonal - length cancels; its other form does not.
        let length = (diagonal * diagonal + square).sqrt();
        let sum = length + diagonal.abs();
        let (head, scale) =
            if diagonal >= 0.0 { (-square / sum, sum / (length * square)) } else { (-sum, 1.0 / (length * sum)) };
        Self { tail, head, scale, length }
    }

    /// The one that makes row `i` of the block of columns `[p | B]` zero, but for `p`.
    #[inline(always)]
    fn of_columns<const N: usize>(i: usize, pivot: &[f64; N], block: &[[f64; N]]) -> Self {
        let mut tail = [0.0; M];
        for (element, column) in tail.iter_mut().zip(block) {
            *element = column[i];
        }
        Self::new(pivot[i], tail)
    }

    /// Reflects the columns of whose row `i` it was made; the rows above are zero and stay so.
    #[inline(always)]
    fn apply<const N: usize>(&self, i: usize, pivot: &mut [f64; N], block: &mut [[f64; N]]) {
        self.carry(pivot, block);
        pivot[i] = self.length.abs();
        for column in block {
            column[i] = 0.0;
        }
    }

    /// Reflects other rows of the same columns. All of them at once keeps the loops' bounds fixed.
    #[inline(always)]
    fn carry<const N: usize>(&self, pivot: &mut [f64; N], block: &mut [[f64; N]]) {
        if self.scale == 0.0 {
            if self.length < 0.0 {
                pivot.iter_mut().for_each(|element| *element = -*element);
            }
            return;
        }
        let mut dot = pivot.map(|element| self.head * element);
        for (element, column) in self.tail.iter().zip(&*block) {
            for k in 0..N {
                dot[k] += element * column[k];
            }
        }
        for k in 0..N {
            dot[k] *= self.scale;
            pivot[k] -= self.head * dot[k];
        }
        for (element, column) in self.tail.iter().zip(block) {
            for k in 0..N {
                column[k] -= element * dot[k];
            }
        }
    }
}

/// What a linear measurement update of a factor yields.
#[derive(Clone, Copy, Debug)]
pub struct FactorUpdate<const N: usize, const NY: usize, const C: usize> {
    /// Factor of the posterior covariance, or its first `C` columns, `N x C`.
    pub factor: SMatrix<f64, N, C>,
    /// Factor `U` of the innovation covariance `H P H^T + V V^T`, `NY x NY`.
    pub innovation: SMatrix<f64, NY, NY>,
    /// `G = P H^T U^-T`, so that the Kalman gain is `G U^-1`; `N x NY`.
    pub whitened_gain: SMatrix<f64, N, NY>,
}

impl<const N: usize, const NY: usize, const C: usize> FactorUpdate<N, NY, C> {
    /// The innovation in units of its standard deviation, `U^-1 nu`, all elements independent.
    #[inline(always)]
    pub fn whiten(&self, nu: &SVector<f64, NY>) -> SVector<f64, NY> {
        forward(&self.innovation, nu)
    }

    /// The change of the state mean that the innovation `nu` causes, `K nu`.
    #[inline(always)]
    pub fn step(&self, nu: &SVector<f64, NY>) -> SVector<f64, N> {
        self.whitened_gain * self.whiten(nu)
    }

    /// The Kalman gain `K = P H^T (H P H^T + V V^T)^-1`.
    #[inline(always)]
    pub fn gain(&self) -> SMatrix<f64, N, NY> {
        // K U = G, solved from the last column backwards.
        let mut gain = self.whitened_gain;
        for j in (0..NY).rev() {
            let mut column = gain.column(j).into_owned();
            for k in j + 1..NY {
                column -= gain.column(k) * self.innovation[(k, j)];
            }
            gain.set_column(j, &(column / self.innovation[(j, j)]));
        }
        gain
    }
}

/// The array form: an orthogonal matrix takes `[[V, H S], [0, S]]` to `[[U, 0], [G, S+]]`.
///
/// `hs` is `H S` and `v` a lower factor of the measurement covariance. Where only the first `C` columns
/// of `H S` are not zero, which is so if the first `C` states are what is measured, the first `C` columns
/// of `S` are enough: the update leaves the others as they are.
pub fn array<const N: usize, const NY: usize, const C: usize>(
    s: &SMatrix<f64, N, C>,
    hs: &SMatrix<f64, NY, C>,
    v: &SMatrix<f64, NY, NY>,
) -> FactorUpdate<N, NY, C> {
    let (mut innovation, mut block) = (*v, *hs);
    let (mut whitened_gain, mut factor) = (SMatrix::<f64, N, NY>::zeros(), *s);
    for i in 0..NY {
        let reflection = Reflection::<C>::of_columns(i, &innovation.data.0[i], &block.data.0);
        reflection.apply(i, &mut innovation.data.0[i], &mut block.data.0);
        reflection.carry(&mut whitened_gain.data.0[i], &mut factor.data.0);
    }
    lower(&mut factor);
    FactorUpdate { factor, innovation, whitened_gain }
}

/// Andrews' form: `S+ = S [I - F U^-T (U + V)^-1 F^T]`, `F = S^T H^T`, `U U^T = F^T F + V V^T`.
///
/// Valid for any square roots with `U + V` invertible, which lower factors with positive diagonals
/// guarantee; a raw QR may give `U` near `-V`, hence [`tria`]. `S+` is made triangular again.
///
/// Erratum: the loader study's eq. 28 prints `P` for `S` and leaves `U` undefined.
///
/// As in [`array()`], the first `C` columns of `S` are enough where the others of `H S` are zero.
pub fn andrews<const N: usize, const NY: usize, const C: usize>(
    s: &SMatrix<f64, N, C>,
    hs: &SMatrix<f64, NY, C>,
    v: &SMatrix<f64, NY, NY>,
) -> FactorUpdate<N, NY, C> {
    let mut innovation = *v;
    absorb(&mut innovation, *hs);
    // G^T = U^-1 (H S) S^T
    let whitened = forward_columns(&innovation, hs);
    let whitened_gain = product(s, &whitened.transpose());
    let correction = forward_columns(&(innovation + v), hs);
    let mut factor = s - product(&whitened_gain, &correction);
    lower(&mut factor);
    FactorUpdate { factor, innovation, whitened_gain }
}

/// The update with a gain that need not be optimal: the factor of `(I - K H) P (I - K H)^T + K R K^T`.
///
/// With rows of `K` set to zero it is the consider update: those states keep mean and variance, and
/// only their correlations change.
pub fn joseph<const N: usize, const NY: usize>(
    s: &SMatrix<f64, N, N>,
    hs: &SMatrix<f64, NY, N>,
    v: &SMatrix<f64, NY, NY>,
    gain: &SMatrix<f64, N, NY>,
) -> SMatrix<f64, N, N> {
    let mut factor = tria(s - product(gain, hs));
    absorb(&mut factor, product(gain, v));
    factor
}

/// `A B` with loops that unroll: for matrices of this size a general product costs more in set-up
/// than in arithmetic.
pub fn product<const R: usize, const K: usize, const C: usize>(
    a: &SMatrix<f64, R, K>,
    b: &SMatrix<f64, K, C>,
) -> SMatrix<f64, R, C> {
    let mut product = SMatrix::<f64, R, C>::zeros();
    for j in 0..C {
        for k in 0..K {
            let factor = b[(k, j)];
            for i in 0..R {
                product[(i, j)] += a[(i, k)] * factor;
            }
        }
    }
    product
}

/// The block of `A` that begins at `(row, column)`, copied with loops that unroll.
pub fn block<const N: usize, const M: usize, const R: usize, const C: usize>(
    a: &SMatrix<f64, N, M>,
    row: usize,
    column: usize,
) -> SMatrix<f64, R, C> {
    let mut block = SMatrix::<f64, R, C>::zeros();
    for (to, from) in block.data.0.iter_mut().zip(&a.data.0[column..]) {
        to.copy_from_slice(&from[row..row + R]);
    }
    block
}

/// Puts a block into `A` at `(row, column)`.
pub fn set_block<const N: usize, const M: usize, const R: usize, const C: usize>(
    a: &mut SMatrix<f64, N, M>,
    row: usize,
    column: usize,
    block: &SMatrix<f64, R, C>,
) {
    for (to, from) in a.data.0[column..].iter_mut().zip(&block.data.0) {
        to[row..row + R].copy_from_slice(from);
    }
}

/// `L^-1 b` for a lower triangular `L`. A zero pivot gives 0: that direction has no variance.
pub fn forward<const N: usize>(l: &SMatrix<f64, N, N>, b: &SVector<f64, N>) -> SVector<f64, N> {
    forward_columns(l, b)
}

fn forward_columns<const N: usize, const M: usize>(
    l: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
) -> SMatrix<f64, N, M> {
    let mut x = *b;
    for j in 0..M {
        for i in 0..N {
            let mut sum = x[(i, j)];
            for k in 0..i {
                sum -= l[(i, k)] * x[(k, j)];
            }
            x[(i, j)] = if l[(i, i)] == 0.0 { 0.0 } else { sum / l[(i, i)] };
        }
    }
    x
}

/// Variances of all states.
pub fn variances<const N: usize>(factor: &SMatrix<f64, N, N>) -> SVector<f64, N> {
    let mut sum = SVector::<f64, N>::zeros();
    for column in &factor.data.0 {
        for i in 0..N {
            sum[i] += column[i] * column[i];
        }
    }
    sum
}

/// Standard deviation of state `i`: the length of row `i` of its factor.
pub fn std_of<const N: usize>(factor: &SMatrix<f64, N, N>, i: usize) -> f64 {
    let mut square = 0.0;
    for j in 0..=i {
        square += factor[(i, j)] * factor[(i, j)];
    }
    square.sqrt()
}
