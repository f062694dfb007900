//! From continuous to discrete time.

use super::gaussian::add_scaled;
use multiversion::multiversion;
use nalgebra::SMatrix;

/// One classical Runge-Kutta step of `x' = derivative(x)` over `dt`; of several states side by side, one per column.
pub fn runge_kutta<const N: usize, const K: usize>(
    x: &SMatrix<f64, N, K>,
    dt: f64,
    derivative: impl Fn(&SMatrix<f64, N, K>) -> SMatrix<f64, N, K>,
) -> SMatrix<f64, N, K> {
    runge_kutta_from(x, &derivative(x), dt, derivative)
}

/// As [`runge_kutta`], with the derivative `k1` at `x` known already.
pub fn runge_kutta_from<const N: usize, const K: usize>(
    x: &SMatrix<f64, N, K>,
    k1: &SMatrix<f64, N, K>,
    dt: f64,
    derivative: impl Fn(&SMatrix<f64, N, K>) -> SMatrix<f64, N, K>,
) -> SMatrix<f64, N, K> {
    let k2 = derivative(&(x + k1 * (0.5 * dt)));
    let k3 = derivative(&(x + k2 * (0.5 * dt)));
    let k4 = derivative(&(x + k3 * dt));
    x + (k1 + (k2 + k3) * 2.0 + k4) * (dt / 6.0)
}

/// The first `K` rows of the transition matrix to second order, `I + A + A^2/2` with `A = F dt`, from the
/// first `K` rows of the Jacobian `F`; the other states do not move.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn transition<const K: usize, const N: usize>(jacobian: &SMatrix<f64, K, N>, dt: f64) -> SMatrix<f64, K, N> {
    let (f, half) = (&jacobian.data.0, 0.5 * dt * dt);
    let mut phi = SMatrix::<f64, K, N>::zeros();
    for (j, (phi, column)) in phi.data.0.iter_mut().zip(f).enumerate() {
        let mut sum = column.map(|rate| rate * dt);
        for k in 0..K {
            // A Jacobian is mostly zeros.
            if column[k] != 0.0 {
                add_scaled(&mut sum, &f[k], half * column[k]);
            }
        }
        if j < K {
            sum[j] += 1.0;
        }
        *phi = sum;
    }
    phi
}

/// Noise of a pair (position, rate) driven by white noise of power spectral density `density` over
/// `dt`: the variance of the position, their covariance, and the variance of the rate.
pub fn white_rate_noise(density: f64, dt: f64) -> (f64, f64, f64) {
    (density * dt * dt * dt / 3.0, density * dt * dt / 2.0, density * dt)
}

/// Number of equal steps that divide `dt` into pieces of at most `longest`.
pub fn substeps(dt: f64, longest: f64) -> usize {
    (dt / longest - 1e-9).ceil().max(1.0) as usize
}
