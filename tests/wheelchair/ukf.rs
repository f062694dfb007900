//! A plain unscented Kalman filter (scaled points, redrawn before the update), for comparison only.

use nalgebra::{SMatrix, SVector};

pub struct Ukf<const N: usize> {
    pub mean: SVector<f64, N>,
    pub covariance: SMatrix<f64, N, N>,
}

const ALPHA: f64 = 0.3;
const BETA: f64 = 2.0;
const KAPPA: f64 = 0.0;

impl<const N: usize> Ukf<N> {
    fn points(&self) -> Vec<(SVector<f64, N>, f64, f64)> {
        let n = N as f64;
        let lambda = ALPHA * ALPHA * (n + KAPPA) - n;
        let root = (self.covariance * (n + lambda)).cholesky().expect("positive definite").l();
        let weight = 0.5 / (n + lambda);
        let centre = lambda / (n + lambda);
        let mut points = vec![(self.mean, centre, centre + 1.0 - ALPHA * ALPHA + BETA)];
        for k in 0..N {
            points.push((self.mean + root.column(k), weight, weight));
            points.push((self.mean - root.column(k), weight, weight));
        }
        points
    }

    pub fn predict(&mut self, f: impl Fn(&SVector<f64, N>) -> SVector<f64, N>, noise: &SMatrix<f64, N, N>) {
        let moved: Vec<_> = self.points().into_iter().map(|(x, wm, wc)| (f(&x), wm, wc)).collect();
        self.mean = moved.iter().map(|(x, wm, _)| x * *wm).sum();
        self.covariance = *noise
            + moved
                .iter()
                .map(|(x, _, wc)| (x - self.mean) * (x - self.mean).transpose() * *wc)
                .sum::<SMatrix<f64, N, N>>();
    }

    pub fn update<const M: usize>(
        &mut self,
        h: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
        y: &SVector<f64, M>,
        noise: &SMatrix<f64, M, M>,
    ) {
        let seen: Vec<_> = self.points().into_iter().map(|(x, wm, wc)| (x, h(&x), wm, wc)).collect();
        let expected: SVector<f64, M> = seen.iter().map(|(_, z, wm, _)| z * *wm).sum();
        let s: SMatrix<f64, M, M> = *noise
            + seen
                .iter()
                .map(|(_, z, _, wc)| (z - expected) * (z - expected).transpose() * *wc)
                .sum::<SMatrix<f64, M, M>>();
        let cross: SMatrix<f64, N, M> =
            seen.iter().map(|(x, z, _, wc)| (x - self.mean) * (z - expected).transpose() * *wc).sum();
        let gain = cross * s.try_inverse().expect("invertible");
        self.mean += gain * (y - expected);
        let reduced = self.covariance - gain * s * gain.transpose();
        self.covariance = 0.5 * (reduced + reduced.transpose());
    }
}
