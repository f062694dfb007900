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
use super::innovation::{Gate, Innovation, Verdict};
use super::sigma_points::UnscentedTransform;
use super::square_root::{absorb, absorb_rows, andrews, array, block, joseph, rows, set_block};
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

/// Time update of `M` states that move and `K` that only walk at random, `N = M + K`, with process
/// noise of standard deviation `std` over this step.
///
/// `centre` is where the mean moves to; `pairs(offsets)` gives for each of two offsets where `mean + offset` and
/// `mean - offset` move to, so that a model may take four points at a time. Offset `j` is column `j` of the factor times the
/// transform's distance: its first `j` elements are zero; of an odd number of states the last one comes twice. The
/// transform's `beta` is at least `alpha^2`.
///
/// Opposite points enter as half their difference and half their sum. States that do not move
/// have no sum, so that half of the points only widen the moving states' own block.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn predict<const N: usize, const M: usize, const K: usize>(
    belief: &mut FactoredGaussian<N>,
    transform: &UnscentedTransform,
    std: &SVector<f64, N>,
    centre: &SVector<f64, M>,
    mut pairs: impl FnMut([&SVector<f64, N>; 2]) -> [[SVector<f64, M>; 2]; 2],
) {
    let (mut moved, mut bent) = (SMatrix::<f64, M, N>::zeros(), SMatrix::<f64, M, N>::zeros());
    let mut sum = SVector::<f64, M>::zeros();
    let half = 0.5 / transform.distance;
    for first in (0..N).step_by(2) {
        let columns = [first, (first + 1).min(N - 1)];
        let [a, b] = columns.map(|j| belief.factor.column(j) * transform.distance);
        for (j, [up, down]) in columns.into_iter().zip(pairs([&a, &b])).take(N - first) {
            let (up, down) = (up - centre, down - centre);
            sum += up + down;
            moved.set_column(j, &((up - down) * half));
            bent.set_column(j, &((up + down) * half));
        }
    }
    let drift = sum * transform.outer;
    let mut noise = SMatrix::<f64, M, M>::from_diagonal(&block(std, 0, 0));
    absorb(&mut noise, bent);
    absorb(&mut noise, drift * transform.surplus.sqrt());
    set_block(&mut belief.mean, 0, 0, &(centre + drift));
    belief.factor = predicted_factor::<N, M, K>(noise, &moved, &belief.factor, std);
}

/// Time update of the extended Kalman filter in square-root form for `M` states that move to `moved` and `K` that
/// only walk at random, `N = M + K`: `f` holds the moving states' rows of the map's Jacobian and `std` the standard
/// deviations of the process noise over this step.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn predict_linearised<const N: usize, const M: usize, const K: usize>(
    belief: &mut FactoredGaussian<N>,
    moved: &SVector<f64, M>,
    f: &SMatrix<f64, M, N>,
    std: &SVector<f64, N>,
) {
    set_block(&mut belief.mean, 0, 0, moved);
    let mut product = SMatrix::<f64, M, N>::zeros();
    for j in 0..N {
        for k in j..N {
            for i in 0..M {
                product[(i, j)] += f[(i, k)] * belief.factor[(k, j)];
            }
        }
    }
    let noise = SMatrix::from_diagonal(&block(std, 0, 0));
    belief.factor = predicted_factor::<N, M, K>(noise, &product, &belief.factor, std);
}

/// How [`correct`] updates the factor. Both forms agree in exact arithmetic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateForm {
    /// One orthogonal transformation: [`array()`].
    Array,
    /// [`andrews`]
    Andrews,
}

/// Standard deviations of the measurement noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise<const M: usize> {
    /// By which the gate judges.
    pub level: SVector<f64, M>,
    /// With which a sample corrects the state: larger than the level where the sample is down-weighted.
    pub weighted: SVector<f64, M>,
}

/// Measurement update by samples `z` of the first `M` states, for which the unscented transform is exact.
///
/// Channels that are not finite are left out. The gate judges every channel alone, by the belief before the update;
/// `in_a_row` counts its rejections. The states marked in `considered` keep mean and variance: their uncertainty counts,
/// and no measurement moves them. So do all that are not measured while a channel is let through that disagrees, which
/// is one that is used although `in_a_row` is not 0: what it says is about the measured states.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn correct<const N: usize, const M: usize>(
    belief: &mut FactoredGaussian<N>,
    z: &SVector<f64, M>,
    noise: &Noise<M>,
    (gate, in_a_row): (Gate, &mut [u32; M]),
    mut considered: [bool; N],
    form: UpdateForm,
) -> Innovation<M> {
    let mut out = Innovation::none();
    let mut determinant = 1.0;
    // A channel without a sample, or with a rejected one, becomes one that measures nothing, with unit noise:
    // independent of all others, without gain and without a share in the likelihood. H S has columns of zeros
    // beyond the first M.
    let (mut residual, mut hs) = (SVector::<f64, M>::zeros(), SMatrix::<f64, M, M>::zeros());
    let mut v = SMatrix::<f64, M, M>::identity();
    for i in (0..M).filter(|&i| z[i].is_finite()) {
        out.residual[i] = z[i] - belief.mean[i];
        let mut variance = 0.0;
        for j in 0..=i {
            variance += belief.factor[(i, j)] * belief.factor[(i, j)];
        }
        variance += noise.level[i] * noise.level[i];
        match gate.judge(out.residual[i] * out.residual[i] / variance, &mut in_a_row[i]) {
            Verdict::Rejected => {
                out.rejected[i] = true;
                out.count(i, out.residual[i] / variance.sqrt(), variance, &mut determinant);
                continue;
            }
            Verdict::LetThrough => considered[M..].fill(true),
            Verdict::Accepted => {}
        }
        out.used[i] = true;
        residual[i] = out.residual[i];
        v[(i, i)] = noise.weighted[i];
        for j in 0..M {
            hs[(i, j)] = belief.factor[(i, j)];
        }
    }
    if !out.used.contains(&true) {
        return out.with_determinant(determinant);
    }
    let (used, considers) = (out.used, considered.contains(&true));
    let leading: SMatrix<f64, N, M> = block(&belief.factor, 0, 0);
    let update = match form {
        UpdateForm::Andrews if !considers => andrews(&leading, &hs, &v),
        // also where only the gain is needed
        _ => array(&leading, &hs, &v),
    };
    let white = update.whiten(&residual);
    for i in (0..M).filter(|&i| used[i]) {
        let deviation = update.innovation[(i, i)];
        out.count(i, white[i], deviation * deviation, &mut determinant);
    }
    if considers {
        let mut gain = update.gain();
        (0..N).filter(|&i| considered[i]).for_each(|i| gain.row_mut(i).fill(0.0));
        let mut all = SMatrix::<f64, M, N>::zeros();
        set_block(&mut all, 0, 0, &hs);
        belief.mean += gain * residual;
        belief.factor = joseph(&belief.factor, &all, &v, &gain);
    } else {
        belief.mean += update.whitened_gain * white;
        set_block(&mut belief.factor, 0, 0, &update.factor);
    }
    out.with_determinant(determinant)
}

/// The factor whose first `M` rows have become `moved` and `noise`, and whose others have walked.
#[inline(always)]
fn predicted_factor<const N: usize, const M: usize, const K: usize>(
    noise: SMatrix<f64, M, M>,
    moved: &SMatrix<f64, M, N>,
    prior: &SMatrix<f64, N, N>,
    q: &SVector<f64, N>,
) -> SMatrix<f64, N, N> {
    const { assert!(N == M + K) }
    let (mut block_rows, moved) = (rows(prior), rows(moved));
    block_rows[..M].copy_from_slice(&moved);
    let mut leading = SMatrix::<f64, N, M>::zeros();
    set_block(&mut leading, 0, 0, &noise);
    absorb_rows(&mut leading, &mut block_rows);
    let mut rest = SMatrix::<f64, K, K>::from_diagonal(&block(q, M, 0));
    let mut left = [[0.0; N]; K];
    left.copy_from_slice(&block_rows[M..]);
    absorb_rows(&mut rest, &mut left);
    let mut factor = SMatrix::zeros();
    set_block(&mut factor, 0, 0, &leading);
    set_block(&mut factor, M, M, &rest);
    factor
}
