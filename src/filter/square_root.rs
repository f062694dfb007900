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

use nalgebra::{SMatrix, SVector};

/// The lower triangular `L` with non-negative diagonal and `L L^T = A A^T`.
///
/// `A` has any number of columns; with fewer than `N` independent ones some diagonal elements are 0.
pub fn tria<const N: usize, const M: usize>(a: SMatrix<f64, N, M>) -> SMatrix<f64, N, N> {
    let mut factor = SMatrix::zeros();
    absorb(&mut factor, a);
    factor
}

/// Adds the columns of `block` to a factor: `L L^T` becomes `L L^T + B B^T`.
///
/// `tria([A | B])` is `absorb` of `B` into `tria(A)`: blocks of any width can follow one another.
pub fn absorb<const N: usize, const M: usize>(factor: &mut SMatrix<f64, N, N>, block: SMatrix<f64, N, M>) {
    let (mut left, mut right) = (SMatrix::<f64, 0, N>::zeros(), SMatrix::<f64, 0, M>::zeros());
    let mut block = block;
    absorb_carrying(factor, &mut block, &mut left, &mut right);
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

/// Triangularises `[L | B]` row by row with Householder reflections and applies them to the rows
/// `[left | right]` that stand below. On return `B` is zero.
///
/// The reflection of row `i` touches only column `i` of `L` and all columns of `B`, because the rest
/// of that row of `L` is zero already. A row of `B` that is 1e-20 of its diagonal element carries
/// nothing in double precision and is dropped: correlations that fade away step by step would
/// otherwise underflow in the reflection's scale.
fn absorb_carrying<const N: usize, const M: usize, const K: usize>(
    factor: &mut SMatrix<f64, N, N>,
    block: &mut SMatrix<f64, N, M>,
    left: &mut SMatrix<f64, K, N>,
    right: &mut SMatrix<f64, K, M>,
) {
    for i in 0..N {
        let mut row = [0.0; M];
        let (mut square, mut size) = (0.0, 0.0_f64);
        for (j, element) in row.iter_mut().enumerate() {
            *element = block[(i, j)];
            block[(i, j)] = 0.0;
            square += *element * *element;
            size = size.max(element.abs());
        }
        let diagonal = factor[(i, i)];
        if size <= 1e-20 * diagonal.abs() || size < SMALLEST {
            if diagonal < 0.0 {
                for k in i..N {
                    factor[(k, i)] = -factor[(k, i)];
                }
                for k in 0..K {
                    left[(k, i)] = -left[(k, i)];
                }
            }
            continue;
        }
        // The reflection takes (diagonal, row) to (+length, 0). For a positive diagonal the
        // difference diagonal - length cancels; its other form does not.
        let length = (diagonal * diagonal + square).sqrt();
        let sum = length + diagonal.abs();
        let (head, scale) =
            if diagonal >= 0.0 { (-square / sum, sum / (length * square)) } else { (-sum, 1.0 / (length * sum)) };
        factor[(i, i)] = length;

        // Rows up to i of the block are zero by now; running over them keeps the loops' bounds fixed.
        let mut dot = [0.0; N];
        for (k, sum) in dot.iter_mut().enumerate().skip(i + 1) {
            *sum = head * factor[(k, i)];
        }
        for (j, element) in row.iter().enumerate() {
            for (k, sum) in dot.iter_mut().enumerate() {
                *sum += element * block[(k, j)];
            }
        }
        for (k, sum) in dot.iter_mut().enumerate() {
            *sum *= scale;
            factor[(k, i)] -= head * *sum;
        }
        for (j, element) in row.iter().enumerate() {
            for (k, sum) in dot.iter().enumerate() {
                block[(k, j)] -= element * sum;
            }
        }

        let mut dot = [0.0; K];
        for (k, sum) in dot.iter_mut().enumerate() {
            *sum = head * left[(k, i)];
        }
        for (j, element) in row.iter().enumerate() {
            for (k, sum) in dot.iter_mut().enumerate() {
                *sum += element * right[(k, j)];
            }
        }
        for (k, sum) in dot.iter_mut().enumerate() {
            *sum *= scale;
            left[(k, i)] -= head * *sum;
        }
        for (j, element) in row.iter().enumerate() {
            for (k, sum) in dot.iter().enumerate() {
                right[(k, j)] -= element * sum;
            }
        }
    }
}

/// What a linear measurement update of a factor yields.
#[derive(Clone, Copy, Debug)]
pub struct FactorUpdate<const N: usize, const NY: usize> {
    /// Factor of the posterior covariance, `N x N`.
    pub factor: SMatrix<f64, N, N>,
    /// Factor `U` of the innovation covariance `H P H^T + V V^T`, `NY x NY`.
    pub innovation: SMatrix<f64, NY, NY>,
    /// `G = P H^T U^-T`, so that the Kalman gain is `G U^-1`; `N x NY`.
    pub whitened_gain: SMatrix<f64, N, NY>,
}

impl<const N: usize, const NY: usize> FactorUpdate<N, NY> {
    /// The innovation in units of its standard deviation, `U^-1 nu`, all elements independent.
    pub fn whiten(&self, nu: &SVector<f64, NY>) -> SVector<f64, NY> {
        forward(&self.innovation, nu)
    }

    /// The change of the state mean that the innovation `nu` causes, `K nu`.
    pub fn step(&self, nu: &SVector<f64, NY>) -> SVector<f64, N> {
        self.whitened_gain * self.whiten(nu)
    }

    /// The Kalman gain `K = P H^T (H P H^T + V V^T)^-1`.
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
/// `hs` is `H S` and `v` a lower factor of the measurement covariance.
pub fn array<const N: usize, const NY: usize>(
    s: &SMatrix<f64, N, N>,
    hs: &SMatrix<f64, NY, N>,
    v: &SMatrix<f64, NY, NY>,
) -> FactorUpdate<N, NY> {
    let (mut innovation, mut block) = (*v, *hs);
    let (mut whitened_gain, mut factor) = (SMatrix::zeros(), *s);
    absorb_carrying(&mut innovation, &mut block, &mut whitened_gain, &mut factor);
    FactorUpdate { factor: tria(factor), innovation, whitened_gain }
}

/// Andrews' form: `S+ = S [I - F U^-T (U + V)^-1 F^T]`, `F = S^T H^T`, `U U^T = F^T F + V V^T`.
///
/// Valid for any square roots with `U + V` invertible, which lower factors with positive diagonals
/// guarantee; a raw QR may give `U` near `-V`, hence [`tria`]. `S+` is made triangular again.
///
/// Erratum: the loader study's eq. 28 prints `P` for `S` and leaves `U` undefined.
pub fn andrews<const N: usize, const NY: usize>(
    s: &SMatrix<f64, N, N>,
    hs: &SMatrix<f64, NY, N>,
    v: &SMatrix<f64, NY, NY>,
) -> FactorUpdate<N, NY> {
    let mut innovation = *v;
    absorb(&mut innovation, *hs);
    // G^T = U^-1 (H S) S^T
    let whitened = forward_columns(&innovation, hs);
    let whitened_gain = product(s, &whitened.transpose());
    let correction = forward_columns(&(innovation + v), hs);
    FactorUpdate { factor: tria(s - product(&whitened_gain, &correction)), innovation, whitened_gain }
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

/// Standard deviation of state `i`: the length of row `i` of its factor.
pub fn std_of<const N: usize>(factor: &SMatrix<f64, N, N>, i: usize) -> f64 {
    let mut square = 0.0;
    for j in 0..=i {
        square += factor[(i, j)] * factor[(i, j)];
    }
    square.sqrt()
}
