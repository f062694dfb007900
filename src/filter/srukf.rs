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
use super::sigma_points::UnscentedTransform;
use super::square_root::{absorb, absorb_leading, block, set_block};
use nalgebra::{SMatrix, SVector};

/// Time update of `M` states that move and `K` that only walk at random, `N = M + K`, with process
/// noise of standard deviation `std` over this step.
///
/// `centre` is where the mean moves to; `pair(offset)` gives where `mean + offset` and
/// `mean - offset` move to. Offset `j` is column `j` of the factor times the transform's distance: its
/// first `j` elements are zero. The transform's `beta` is at least `alpha^2`.
///
/// Opposite points enter as half their difference and half their sum. States that do not move
/// have no sum, so that half of the points only widen the moving states' own block.
pub fn predict<const N: usize, const M: usize, const K: usize>(
    belief: &mut FactoredGaussian<N>,
    transform: &UnscentedTransform,
    std: &SVector<f64, N>,
    centre: &SVector<f64, M>,
    mut pair: impl FnMut(&SVector<f64, N>) -> [SVector<f64, M>; 2],
) {
    let (mut moved, mut bent) = (SMatrix::<f64, M, N>::zeros(), SMatrix::<f64, M, N>::zeros());
    let mut sum = SVector::<f64, M>::zeros();
    let half = 0.5 / transform.distance;
    for j in 0..N {
        let [up, down] = pair(&(belief.factor.column(j) * transform.distance));
        let (up, down) = (up - centre, down - centre);
        sum += up + down;
        moved.set_column(j, &((up - down) * half));
        bent.set_column(j, &((up + down) * half));
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

/// The factor whose first `M` rows have become `moved` and `noise`, and whose others have walked.
fn predicted_factor<const N: usize, const M: usize, const K: usize>(
    noise: SMatrix<f64, M, M>,
    moved: &SMatrix<f64, M, N>,
    prior: &SMatrix<f64, N, N>,
    q: &SVector<f64, N>,
) -> SMatrix<f64, N, N> {
    const { assert!(N == M + K) }
    let mut rows = *prior;
    set_block(&mut rows, 0, 0, moved);
    let mut leading = SMatrix::<f64, N, M>::zeros();
    set_block(&mut leading, 0, 0, &noise);
    absorb_leading(&mut leading, &mut rows);
    let mut rest = SMatrix::from_diagonal(&block(q, M, 0));
    absorb::<K, N>(&mut rest, block(&rows, M, 0));
    let mut factor = SMatrix::zeros();
    set_block(&mut factor, 0, 0, &leading);
    set_block(&mut factor, M, M, &rest);
    factor
}
