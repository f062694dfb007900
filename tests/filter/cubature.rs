//! The square-root cubature filter against a covariance filter and against filterpy.

use crate::support::assert_close;
use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};
use wheelstate::filter::gaussian::FactoredGaussian;
use wheelstate::filter::innovation::Gate;
use wheelstate::filter::srckf;

const DT: f64 = 0.05;
const Q: [f64; 3] = [0.02, 0.01, 0.03];
const R: [f64; 2] = [0.1, 0.05];
const P0: [f64; 3] = [0.5, 0.3, 0.2];

fn f(x: &Vector3<f64>) -> Vector3<f64> {
    let [a, b, c] = (*x).into();
    Vector3::new(a + DT * (b * f64::cos(c) + 0.3), b + DT * (f64::sin(a) - 0.2 * b), c + DT * (0.5 * b - 0.1 * c))
}

fn h(x: &Vector3<f64>) -> Vector2<f64> {
    let [a, b, c]: [f64; 3] = (*x).into();
    Vector2::new(a.hypot(b + 1.0), a * c + b)
}

fn measurement(k: usize) -> Vector2<f64> {
    let k = k as f64;
    let one = 1.5 + 0.5 * (0.11 * k).sin() + 0.1 * (1.7 * k).cos();
    Vector2::new(one, 0.2 * (0.07 * k).cos() + 0.05 * (2.3 * k).sin())
}

fn run(mut see: impl FnMut(usize, &FactoredGaussian<3>)) {
    let mut filter = FactoredGaussian::independent(Vector3::new(0.5, -0.2, 0.1), &Vector3::from(P0));
    for k in 0..400 {
        if k > 0 {
            srckf::predict(&mut filter, &Q.into(), |x: &[Vector3<f64>; 6]| x.map(|x| f(&x)));
        }
        srckf::correct(
            &mut filter,
            &measurement(k),
            &R.into(),
            (Gate::OPEN, &mut 0),
            [false; 3],
            |x: &[Vector3<f64>; 6]| x.map(|x| h(&x)),
        );
        see(k, &filter);
    }
}

/// The same filter with covariances and Cholesky factors instead of carried square roots.
#[test]
fn the_filter_equals_the_covariance_form() {
    let points = |x: &Vector3<f64>, p: &Matrix3<f64>| -> Vec<Vector3<f64>> {
        let l = p.cholesky().unwrap().l() * 3f64.sqrt();
        (0..3).map(|i| x + l.column(i)).chain((0..3).map(|i| x - l.column(i))).collect()
    };
    let mut x = Vector3::new(0.5, -0.2, 0.1);
    let mut p = Matrix3::from_diagonal(&Vector3::from(P0).map(|s| s * s));
    run(|k, filter| {
        if k > 0 {
            let moved: Vec<_> = points(&x, &p).iter().map(f).collect();
            x = moved.iter().sum::<Vector3<f64>>() / 6.0;
            p = moved.iter().map(|m| (m - x) * (m - x).transpose()).sum::<Matrix3<f64>>() / 6.0;
            p += Matrix3::from_diagonal(&Vector3::from(Q).map(|s| s * s));
        }
        let drawn = points(&x, &p);
        let seen: Vec<_> = drawn.iter().map(h).collect();
        let mean = seen.iter().sum::<Vector2<f64>>() / 6.0;
        let mut spread = Matrix2::from_diagonal(&Vector2::from(R).map(|s| s * s));
        let mut cross = Matrix3x2::zeros();
        for (drawn, seen) in drawn.iter().zip(&seen) {
            spread += (seen - mean) * (seen - mean).transpose() / 6.0;
            cross += (drawn - x) * (seen - mean).transpose() / 6.0;
        }
        let gain = cross * spread.try_inverse().unwrap();
        x += gain * (measurement(k) - mean);
        p -= gain * spread * gain.transpose();
        p = (p + p.transpose()) * 0.5;
        let own = filter.factor * filter.factor.transpose();
        for i in 0..3 {
            assert_close(&format!("sample {k} x{i}"), filter.mean[i], x[i], 1e-9, 1e-12);
            for j in 0..3 {
                assert_close(&format!("sample {k} p{i}{j}"), own[(i, j)], p[(i, j)], 1e-9, 1e-12);
            }
        }
    });
}

#[test]
fn the_filter_equals_filterpy() {
    let text = include_str!("../oracles/srckf_filterpy.csv");
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    run(|k, filter| {
        let p = filter.factor * filter.factor.transpose();
        let own = [
            filter.mean[0],
            filter.mean[1],
            filter.mean[2],
            p[(0, 0)],
            p[(1, 0)],
            p[(1, 1)],
            p[(2, 0)],
            p[(2, 1)],
            p[(2, 2)],
        ];
        for (i, (own, theirs)) in own.iter().zip(&rows[k]).enumerate() {
            assert_close(&format!("sample {k} column {i}"), *own, *theirs, 1e-9, 1e-12);
        }
    });
    assert_eq!(rows.len(), 400);
}

/// Nearly equal rows of the measurement in a filter that knows almost everything: factors stay.
#[test]
fn the_filter_keeps_its_factor_where_covariances_lose_definiteness() {
    let mut filter = FactoredGaussian::independent(Vector3::zeros(), &Vector3::repeat(1.0));
    for k in 0..2000 {
        srckf::predict(&mut filter, &Vector3::repeat(1e-9), |x: &[Vector3<f64>; 6]| *x);
        let z = Vector2::new(1e-6 * f64::from(k % 3), 0.0);
        srckf::correct(
            &mut filter,
            &z,
            &Vector2::repeat(1e-8),
            (Gate::OPEN, &mut 0),
            [false; 3],
            |x: &[Vector3<f64>; 6]| x.map(|x| Vector2::new(x[0] + x[1] + x[2], x[0] + x[1] + (1.0 + 1e-9) * x[2])),
        );
        assert!(filter.factor.iter().all(|s| s.is_finite()));
        assert!((0..3).all(|i| filter.factor[(i, i)] >= 0.0));
    }
}
