//! Speed of the filters alone, on dense problems of fixed size. Run: `cargo bench -p wheelstate --bench filters`; beside
//! Eigen: `tests/bench/filters_peers.sh`, whose `filters_peers.cpp` states the same problems.

use divan::{Bencher, black_box};
use nalgebra::{SMatrix, SVector};
use wheelstate::filter::ekf::{self, Rows};
use wheelstate::filter::gaussian::Gaussian;
use wheelstate::filter::innovation::Gate;
use wheelstate::filter::sigma_points::UnscentedTransform;
use wheelstate::filter::ukf::{self, Channel};

fn main() {
    divan::main();
}

/// A number for each pair, about -1 to 1.
fn number(i: usize, j: usize) -> f64 {
    (1.0 + 3.7 * i as f64 + 1.3 * j as f64).sin()
}

/// Positive definite: `number number^T / N + 1/2`.
fn covariance<const N: usize>() -> SMatrix<f64, N, N> {
    let root = SMatrix::<f64, N, N>::from_fn(number);
    root * root.transpose() / N as f64 + SMatrix::identity() * 0.5
}

fn belief<const N: usize>() -> Gaussian<N> {
    Gaussian { mean: SVector::from_fn(|i, _| number(i, 0)), covariance: covariance() }
}

/// Time update with a dense transition, then `M` dense rows of independent noise.
fn ekf<const N: usize, const M: usize>(bencher: Bencher) {
    let transition = SMatrix::<f64, N, N>::from_fn(|i, j| f64::from(u8::from(i == j)) + 0.1 * number(j, i));
    let rows = Rows::<N, M> {
        innovation: SVector::from_fn(|i, _| 0.3 * number(i, 1)),
        jacobian: SMatrix::from_fn(number),
        noise: SMatrix::identity() * 0.2,
        used: [true; M],
    };
    let start = belief::<N>();
    bencher.bench_local(|| {
        let mut belief = black_box(start);
        let mean = transition * belief.mean;
        ekf::predict(&mut belief, mean, black_box(&transition));
        ekf::correct(&mut belief, black_box(&rows), None).unwrap();
        belief
    });
}

#[divan::bench]
fn ekf_6_6(bencher: Bencher) {
    ekf::<6, 6>(bencher);
}

#[divan::bench]
fn ekf_13_6(bencher: Bencher) {
    ekf::<13, 6>(bencher);
}

/// Time update through `x + 0.05 * (next x)^2`, process noise, then the first `M` states measured.
fn ukf<const N: usize, const M: usize, const P: usize>(bencher: Bencher) {
    let transform = UnscentedTransform::new(N, 0.5, 2.0, 0.0);
    let channels: [Channel; M] =
        std::array::from_fn(|index| Channel { index, sample: 0.5 * number(index, 2), variance: 0.2 });
    let start = belief::<N>();
    bencher.bench_local(|| {
        let mut belief = black_box(start);
        ukf::predict::<N, P>(&mut belief, &transform, |points| points.map(|x| moved(&x))).unwrap();
        for i in 0..N {
            belief.covariance[(i, i)] += 0.01;
        }
        ukf::correct(&mut belief, black_box(&channels), Gate { deviations: 0.0, patience: 0 }, &mut 0);
        belief
    });
}

fn moved<const N: usize>(x: &SVector<f64, N>) -> SVector<f64, N> {
    SVector::from_fn(|i, _| x[i] + 0.05 * x[(i + 1) % N] * x[(i + 1) % N])
}

#[divan::bench]
fn ukf_3_1(bencher: Bencher) {
    ukf::<3, 1, 7>(bencher);
}

#[divan::bench]
fn ukf_4_3(bencher: Bencher) {
    ukf::<4, 3, 9>(bencher);
}
