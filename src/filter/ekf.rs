//! Extended Kalman filter with missing rows, gate and Joseph update; the sizes are fixed by types.
//!
//! The filter knows no equations: the caller linearises its model and hands in the propagated mean with
//! its transition matrix, or the innovation with its Jacobian. Joseph's form keeps the covariance
//! symmetric and positive definite under rounding; where a row leaves enough of the variance, the short form
//! `P - K S K^T`, which equals it, does so too.

use super::gaussian::{Gaussian, add_scaled, combination, dot};
use super::innovation::{Gate, Innovation, Verdict};
use super::two_stage::Beside;
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

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

impl<const N: usize, const M: usize> Rows<N, M> {
    /// Variance of what a row is expected to measure, without its noise.
    pub fn expected_variance(&self, row: usize, belief: &Gaussian<N>) -> f64 {
        belief.variance_along(&self.jacobian.row(row).transpose())
    }
}

/// Smallest share of the noise in an innovation's variance with which the short form of the update is used.
///
/// What a row leaves of the variance along it is just this share. The short form subtracts it from the whole with a
/// relative error of 2^-53, of which 1e-10 remains.
const SHORT_FORM: f64 = 1e-6;

/// A covariance that is not positive definite; the belief was left as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the innovation covariance is not positive definite")]
pub struct NotPositiveDefinite;

/// Time update: the propagated mean and `P = Phi P Phi^T`. Process noise is added by the caller.
///
/// Only the first `K` states move: `transition` is the first `K` rows of `Phi`, the rest is the identity's.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn predict<const N: usize, const K: usize>(
    belief: &mut Gaussian<N>,
    mean: SVector<f64, N>,
    transition: &SMatrix<f64, K, N>,
) {
    belief.mean = mean;
    let p = &mut belief.covariance;
    let mut half = SMatrix::<f64, N, K>::zeros();
    add_times_transposed(&mut half, p, transition);
    let mut moved = SMatrix::<f64, K, K>::zeros();
    add_times_transposed(&mut moved, &transposed(&half), transition);
    for j in 0..K {
        for i in j..N {
            let value = if i < K { moved[(i, j)] } else { half[(i, j)] };
            p[(i, j)] = value;
            p[(j, i)] = value;
        }
    }
}

/// Measurement update of the used rows, in Joseph's form or where it is as exact in the short one.
///
/// The rows are made independent of each other and then taken one by one, which equals taking them
/// together and needs no solution of equations. `gate` comes with one counter of rejections in a row per
/// measurement row; it judges every row by the belief before the update.
pub fn correct<const N: usize, const M: usize>(
    belief: &mut Gaussian<N>,
    rows: &Rows<N, M>,
    gate: Option<(Gate, &mut [u32; M])>,
) -> Result<Innovation<M>, NotPositiveDefinite> {
    correct_beside(belief, rows, gate, None)
}

/// [`correct`] with a constant beside the state, which comes with what it adds to each row, per unit.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn correct_beside<const N: usize, const M: usize>(
    belief: &mut Gaussian<N>,
    rows: &Rows<N, M>,
    gate: Option<(Gate, &mut [u32; M])>,
    beside: Option<(&mut Beside<N>, [f64; M])>,
) -> Result<Innovation<M>, NotPositiveDefinite> {
    let mut outcome = Innovation::none();
    let mut determinant = 1.0;
    let mut used = rows.used;
    if let Some((gate, counters)) = gate.filter(|(gate, _)| gate.deviations > 0.0) {
        for row in (0..M).filter(|&row| rows.used[row]) {
            let variance = rows.expected_variance(row, belief) + rows.noise[(row, row)];
            let square = rows.innovation[row] * rows.innovation[row] / variance;
            if gate.judge(square, &mut counters[row]) == Verdict::Rejected {
                (used[row], outcome.rejected[row]) = (false, true);
                outcome.residual[row] = rows.innovation[row];
                outcome.count(row, rows.innovation[row] / variance.sqrt(), variance, &mut determinant);
            }
        }
    }
    outcome.used = used;
    if !used.contains(&true) {
        return Ok(outcome.with_determinant(determinant));
    }
    for row in (0..M).filter(|&row| used[row]) {
        outcome.residual[row] = rows.innovation[row];
    }
    let adds = beside.as_ref().map_or([0.0; M], |(_, adds)| *adds);
    let mut aside = beside.as_ref().map(|(beside, _)| **beside);
    let rows = Independent::of(rows, adds, &used);
    let before = *belief;
    let p = &mut belief.covariance;
    let mut change = [0.0; N];
    for row in 0..M {
        if !outcome.used[row] {
            continue;
        }
        let (h, noise) = (&rows.jacobian[row], rows.noise[row]);
        // Held in memory as it is: taken apart number by number it would cost the chair a twentieth more instructions.
        let cross = std::hint::black_box(combination(p, h));
        let variance = dot(h, &cross) + noise;
        if !(variance > 0.0 && variance < f64::INFINITY) {
            *belief = before;
            return Err(NotPositiveDefinite);
        }
        let innovation = rows.innovation[row] - dot(h, &change);
        let inverse = 1.0 / variance;
        if let Some(aside) = &mut aside {
            aside.take_row(h, rows.adds[row], innovation, variance, &cross);
        }
        if noise < SHORT_FORM * variance {
            let gain = cross.map(|c| c / variance);
            add_scaled(&mut change, &gain, innovation);
            joseph(p, h, noise, &cross, &gain);
        } else {
            // Symmetric up to rounding, and in the end from its lower half.
            add_scaled(&mut change, &cross, innovation * inverse);
            let scaled = cross.map(|c| c * -inverse);
            for (column, factor) in p.data.0.iter_mut().zip(&scaled) {
                add_scaled(column, &cross, *factor);
            }
        }
        outcome.count(row, innovation / variance.sqrt(), variance, &mut determinant);
    }
    for j in 0..N {
        for i in 0..j {
            p[(i, j)] = p[(j, i)];
        }
    }
    belief.mean += SVector::from(change);
    // A sum is finite only if all that it adds is.
    let sum = (0..N).fold(belief.mean, |sum, j| sum + p.column(j));
    if !sum.sum().is_finite() {
        *belief = before;
        return Err(NotPositiveDefinite);
    }
    if let (Some((beside, _)), Some(aside)) = (beside, aside) {
        *beside = aside;
    }
    Ok(outcome.with_determinant(determinant))
}

/// Joseph's form with one row `h` and its gain `k`: `(I - k h) P (I - k h)^T + r k k^T`, `cross` is `P h^T`.
///
/// Factor by factor: `A P` with `A = I - k h` is `P - k (P h^T)^T`, and `(A P) A^T + r k k^T` is
/// `A P + (r k - A P h^T) k^T`.
#[cold]
fn joseph<const N: usize>(p: &mut SMatrix<f64, N, N>, h: &[f64; N], noise: f64, cross: &[f64; N], gain: &[f64; N]) {
    for (column, cross) in p.data.0.iter_mut().zip(cross) {
        add_scaled(column, gain, -cross);
    }
    let mut rest = combination(p, h).map(|value| -value);
    add_scaled(&mut rest, gain, noise);
    for (column, gain) in p.data.0.iter_mut().zip(gain) {
        add_scaled(column, &rest, *gain);
    }
    for j in 0..N {
        for i in 0..j {
            p[(i, j)] = p[(j, i)];
        }
    }
}

/// Measurement rows whose noises are independent of each other.
struct Independent<const N: usize, const M: usize> {
    innovation: [f64; M],
    jacobian: [[f64; N]; M],
    /// What a constant beside the state adds.
    adds: [f64; M],
    noise: [f64; M],
}

impl<const N: usize, const M: usize> Independent<N, M> {
    /// The used rows times `L^-1`, where their noise is `L D L^T`.
    #[inline(always)]
    fn of(rows: &Rows<N, M>, mut adds: [f64; M], used: &[bool; M]) -> Self {
        let mut noise = rows.noise;
        let mut innovation: [f64; M] = rows.innovation.into();
        let mut jacobian: [[f64; N]; M] = std::array::from_fn(|i| std::array::from_fn(|k| rows.jacobian[(i, k)]));
        for i in 0..M {
            for j in 0..i {
                let covariance = noise[(i, j)];
                if covariance != 0.0 && used[i] && used[j] {
                    let share = covariance / noise[(j, j)];
                    let known = jacobian[j];
                    add_scaled(&mut jacobian[i], &known, -share);
                    innovation[i] -= share * innovation[j];
                    adds[i] -= share * adds[j];
                    for k in i..M {
                        noise[(k, i)] -= share * noise[(k, j)];
                    }
                }
            }
        }
        Self { innovation, jacobian, adds, noise: std::array::from_fn(|row| noise[(row, row)]) }
    }
}

/// `sum += A B^T`, column by column, without the terms in which `B` is zero: Jacobians and transition
/// matrices mostly are.
#[inline(always)]
fn add_times_transposed<const N: usize, const K: usize, const M: usize>(
    sum: &mut SMatrix<f64, N, M>,
    a: &SMatrix<f64, N, K>,
    b: &SMatrix<f64, M, K>,
) {
    // Plain arrays, one per column: their bounds are known, so that the processor adds several rows at once.
    let (sum, a, b) = (&mut sum.data.0, &a.data.0, &b.data.0);
    for row in 0..M {
        let mut column = sum[row];
        for k in 0..K {
            let factor = b[k][row];
            if factor != 0.0 {
                add_scaled(&mut column, &a[k], factor);
            }
        }
        sum[row] = column;
    }
}

#[inline(always)]
fn transposed<const N: usize, const M: usize>(matrix: &SMatrix<f64, N, M>) -> SMatrix<f64, M, N> {
    SMatrix::from_fn(|i, j| matrix[(j, i)])
}
