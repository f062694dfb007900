//! Square-root cubature Kalman filter: `2N` equally weighted points `x ± sqrt(N) S e_i`.
//!
//! The filter carries a lower triangular factor `S` of the covariance `P = S Sᵀ`, which is
//! symmetric and positive semidefinite by construction. CN117406607B, claim 1, step 3, in its eleven steps, for
//! `x[k] = f(x[k-1], u[k-1]) + q`, `z[k] = h(x[k], u[k]) + r` with independent Gaussian noises:
//!
//! ```text
//!  1  S0                                        7  z_hat = mean Z,  Zc = (Z - z_hat)/sqrt(2N),
//!  2  X_i = x ± sqrt(N) S e_i                      S_zz = tria[Zc  S_R]
//!  3  X*_i = f(X_i)                             8  P_xz = Xc Zcᵀ
//!  4  x = mean X*,  S = tria[(X* - x)/sqrt(2N)  S_Q]
//!  5  X_i = x ± sqrt(N) S e_i  (drawn anew)     9  W = (P_xz / S_zzᵀ) / S_zz
//!  6  Z_i = h(X_i)                             10  x = x + W (z - z_hat)
//!                                              11  S = tria[Xc - W Zc  W S_R]
//! ```
//!
//! Errata: step 7 of the source calls `S_R` process noise; it is measurement noise. Its title speaks of
//! non-Gaussian noise; nothing in the filter treats any.
//!
//! Other programs skip step 5 and keep the propagated points, which loses the process noise in the
//! measurement's spread; drawn anew the filter equals an unscented one with `alpha = 1, beta = 0,
//! kappa = 0`. Step 11 holds for any gain `W`. A measurement that is not finite is left out.
//!
//! # Constants that are not known
//! A model's parameters are known with an error, which no filter of the states alone has in its covariance. The
//! Schmidt-Kalman filter considers it (Schmidt, *Application of state-space methods to navigation problems*, 1966): with
//! independent errors `p` of unit variance the state's error is that of the factor plus `C p`, so that the covariance
//! is `S Sᵀ + C Cᵀ`. `C` moves with the state, `C <- F C + G` (`G = df/dp`), and with `D = dh/dp` and `E = H C + D`
//!
//! ```text
//! S_zz = tria[Zc  S_R  E],   P_xz = Xc Zcᵀ + C Eᵀ,   C <- C - W E
//! ```
//!
//! The parameters themselves are not estimated. Without any this is the filter above.

use super::gaussian::{FactoredGaussian, add_scaled, dot};
use super::innovation::{Gate, Innovation, Verdict};
use super::square_root::{absorb, absorb_rows, forward, product, rows};
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

/// Time update (steps 2 to 4) with the standard deviations of the process noise over this step.
///
/// `f` takes all `P = 2N` points at once, which a processor may evaluate side by side.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn predict<const N: usize, const P: usize>(
    belief: &mut FactoredGaussian<N>,
    std: &SVector<f64, N>,
    f: impl Fn(&[SVector<f64, N>; P]) -> [SVector<f64, N>; P],
) {
    let moved = f(&points(belief));
    belief.mean = mean(&moved);
    belief.factor = SMatrix::from_diagonal(&std.abs());
    absorb(&mut belief.factor, centred(&moved, &belief.mean));
}

/// Measurement update (steps 5 to 11) with `z`, its standard deviations and `h`, which takes all points
/// at once.
///
/// Channels of `z` that are not finite are left out. The gate judges the normalised innovation squared per channel
/// and rejects all channels together; `in_a_row` counts its rejections. The states marked in `considered` keep their
/// values: their uncertainty counts, and no measurement moves them. For states that the measurements do not
/// determine and would only disturb.
pub fn correct<const N: usize, const M: usize, const P: usize>(
    belief: &mut FactoredGaussian<N>,
    z: &SVector<f64, M>,
    std: &SVector<f64, M>,
    gate: (Gate, &mut u32),
    considered: [bool; N],
    h: impl Fn(&[SVector<f64, N>; P]) -> [SVector<f64, M>; P],
) -> Innovation<M> {
    let none = (&mut SMatrix::<f64, N, 0>::zeros(), &SMatrix::zeros());
    correct_considering(belief, z, std, gate, considered, none, h)
}

/// [`correct`] with `K` constants that are known with an error: `cross` is `C`, `N x K`, which the update changes, and
/// `shown` is `E`, `M x K`, how an error of one standard deviation of each shows in the measurements.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn correct_considering<const N: usize, const M: usize, const P: usize, const K: usize>(
    belief: &mut FactoredGaussian<N>,
    z: &SVector<f64, M>,
    std: &SVector<f64, M>,
    (gate, in_a_row): (Gate, &mut u32),
    considered: [bool; N],
    (cross, shown): (&mut SMatrix<f64, N, K>, &SMatrix<f64, M, K>),
    h: impl Fn(&[SVector<f64, N>; P]) -> [SVector<f64, M>; P],
) -> Innovation<M> {
    let available: [bool; M] = std::array::from_fn(|j| z[j].is_finite());
    let mut out = Innovation::none();
    if !available.contains(&true) {
        return out;
    }
    let seen = h(&points(belief));
    let expected = mean(&seen);
    // Everything by rows, which are longer than the columns.
    let mut spread = rows(&centred(&seen, &expected));
    let (mut shown, mut cross_rows) = (rows(shown), rows(cross));
    // A channel without a sample becomes one that measures nothing, with unit noise: independent
    // of all others, without gain and without a share in the likelihood.
    let mut noise = SMatrix::<f64, M, M>::identity();
    for j in 0..M {
        if available[j] {
            noise[(j, j)] = std[j];
            out.residual[j] = z[j] - expected[j];
        } else {
            (spread[j], shown[j]) = ([0.0; P], [0.0; K]);
        }
    }
    let mut factor = noise;
    absorb_rows(&mut factor, &mut { spread });
    absorb_rows(&mut factor, &mut { shown });

    let white = forward(&factor, &out.residual);
    let mut determinant = 1.0;
    for j in (0..M).filter(|&j| available[j]) {
        out.count(j, white[j], factor[(j, j)] * factor[(j, j)], &mut determinant);
    }
    let mut out = out.with_determinant(determinant);
    if gate.judge(out.nis_per_row(), in_a_row) == Verdict::Rejected {
        out.rejected = available;
        return out;
    }
    out.used = available;

    // The centred points are ± S e_i sqrt(N/2N), so P_xz = S (Zc+ - Zc-)ᵀ / sqrt(2)
    let half = rows(&(belief.factor * std::f64::consts::FRAC_1_SQRT_2));
    let mut joint = SMatrix::<f64, N, M>::zeros();
    for j in 0..M {
        let opposite: [f64; N] = std::array::from_fn(|i| spread[j][i] - spread[j][N + i]);
        for row in 0..N {
            joint[(row, j)] = dot(&half[row], &opposite) + dot(&cross_rows[row], &shown[j]);
        }
    }
    let mut gain = divide(&joint, &factor);
    (0..N).filter(|i| considered[*i]).for_each(|i| gain.row_mut(i).fill(0.0));
    belief.mean += gain * out.residual;
    // Xc - W Zc, and C - W E
    let mut rest = [[0.0; P]; N];
    for row in 0..N {
        for i in 0..N {
            (rest[row][i], rest[row][N + i]) = (half[row][i], -half[row][i]);
        }
        for j in 0..M {
            add_scaled(&mut rest[row], &spread[j], -gain[(row, j)]);
            add_scaled(&mut cross_rows[row], &shown[j], -gain[(row, j)]);
        }
    }
    belief.factor.fill(0.0);
    absorb_rows(&mut belief.factor, &mut rest);
    absorb(&mut belief.factor, product(&gain, &noise));
    *cross = SMatrix::from_fn(|row, k| cross_rows[row][k]);
    out
}

/// The points: first all `x + sqrt(N) S e_i`, then all `x - sqrt(N) S e_i`.
fn points<const N: usize, const P: usize>(belief: &FactoredGaussian<N>) -> [SVector<f64, N>; P] {
    const { assert!(P == 2 * N, "there are two points per state") };
    let step = (N as f64).sqrt();
    std::array::from_fn(|k| belief.mean + belief.factor.column(k % N) * if k < N { step } else { -step })
}

fn mean<const M: usize, const P: usize>(points: &[SVector<f64, M>; P]) -> SVector<f64, M> {
    let mut sum = SVector::zeros();
    for point in points {
        sum += point;
    }
    sum / P as f64
}

fn centred<const M: usize, const P: usize>(
    points: &[SVector<f64, M>; P],
    mean: &SVector<f64, M>,
) -> SMatrix<f64, M, P> {
    let scale = 1.0 / (P as f64).sqrt();
    SMatrix::from_fn(|j, k| (points[k][j] - mean[j]) * scale)
}

/// `P (L Lᵀ)⁻¹` by substitution, no inverse.
fn divide<const N: usize, const M: usize>(p: &SMatrix<f64, N, M>, l: &SMatrix<f64, M, M>) -> SMatrix<f64, N, M> {
    let mut w = *p;
    for row in 0..N {
        for j in 0..M {
            for k in 0..j {
                w[(row, j)] -= l[(j, k)] * w[(row, k)];
            }
            w[(row, j)] /= l[(j, j)];
        }
        for j in (0..M).rev() {
            for k in j + 1..M {
                w[(row, j)] -= l[(k, j)] * w[(row, k)];
            }
            w[(row, j)] /= l[(j, j)];
        }
    }
    w
}
