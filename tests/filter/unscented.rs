//! The square-root unscented filter against the covariance and against Schmidt's consider filter.

use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use wheelstate::filter::gaussian::FactoredGaussian;
use wheelstate::filter::innovation::Gate;
use wheelstate::filter::sigma_points::UnscentedTransform;
use wheelstate::filter::srukf::{Noise, UpdateForm, correct, predict};

type V3 = SVector<f64, 3>;
type V5 = SVector<f64, 5>;
type M5 = SMatrix<f64, 5, 5>;

struct Draws(ChaCha8Rng);

impl Draws {
    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
    fn belief(&mut self) -> FactoredGaussian<5> {
        let factor = M5::from_fn(|i, j| if j < i { self.normal() } else { 0.0 });
        let diagonal = V5::from_fn(|_, _| 0.1 + self.normal().abs());
        FactoredGaussian { mean: V5::from_fn(|_, _| self.normal()), factor: factor + M5::from_diagonal(&diagonal) }
    }
}

fn covariance(belief: &FactoredGaussian<5>) -> M5 {
    belief.factor * belief.factor.transpose()
}

/// `K = P H^T S^-1` with the rows of considered states zero, and `P = (I - K H) P (I - K H)^T + K R K^T`.
struct Expected {
    mean: V5,
    covariance: M5,
    nis: f64,
    log_likelihood: f64,
}

fn expected(belief: &FactoredGaussian<5>, z: &V3, std: &V3, used: [bool; 3], considered: [bool; 5]) -> Expected {
    let p = covariance(belief);
    let rows: Vec<usize> = (0..3).filter(|&i| used[i]).collect();
    let m = rows.len();
    let h = nalgebra::DMatrix::from_fn(m, 5, |k, j| f64::from(u8::from(rows[k] == j)));
    let noise = nalgebra::DMatrix::from_fn(m, m, |k, j| if k == j { std[rows[k]].powi(2) } else { 0.0 });
    let residual = nalgebra::DVector::from_fn(m, |k, _| z[rows[k]] - belief.mean[rows[k]]);
    let s = &h * p * h.transpose() + &noise;
    let inverse = s.clone().try_inverse().unwrap();
    let mut gain = p * h.transpose() * &inverse;
    (0..5).filter(|&i| considered[i]).for_each(|i| gain.row_mut(i).fill(0.0));
    let rest = M5::identity() - &gain * &h;
    let nis = residual.dot(&(&inverse * &residual));
    Expected {
        mean: belief.mean + &gain * residual,
        covariance: M5::from_fn(|i, j| (rest * p * rest.transpose() + &gain * &noise * gain.transpose())[(i, j)]),
        nis,
        log_likelihood: -0.5 * (nis + s.determinant().ln() + m as f64 * TAU.ln()),
    }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0)
}

proptest! {
    #[test]
    fn a_correction_is_that_of_the_covariance(
        seed in any::<u64>(), missing in prop::array::uniform3(any::<bool>()),
        considered in prop::array::uniform5(any::<bool>()), andrews in any::<bool>()
    ) {
        let mut random = Draws(ChaCha8Rng::seed_from_u64(seed));
        let prior = random.belief();
        let z = V3::from_fn(|i, _| if missing[i] { f64::NAN } else { prior.mean[i] + random.normal() });
        let std = V3::from_fn(|_, _| 0.05 + random.normal().abs());
        let form = if andrews { UpdateForm::Andrews } else { UpdateForm::Array };
        let noise = Noise { level: std, weighted: std };
        let mut posterior = prior;
        let out = correct(&mut posterior, &z, &noise, (Gate::OPEN, &mut [0; 3]), considered, form);
        let used = missing.map(|missing| !missing);
        prop_assert_eq!((out.used, out.rejected, out.dof), (used, [false; 3], out.used_count()));
        if out.dof == 0 {
            prop_assert_eq!((posterior, out.nis, out.log_likelihood), (prior, 0.0, 0.0));
            return Ok(());
        }
        let expected = expected(&prior, &z, &std, used, considered);
        prop_assert!((posterior.mean - expected.mean).amax() < 1e-9);
        prop_assert!((covariance(&posterior) - expected.covariance).amax() < 1e-9);
        prop_assert!(close(out.nis, expected.nis) && close(out.log_likelihood, expected.log_likelihood));
        for i in (0..5).filter(|&i| considered[i]) {
            prop_assert!(close(posterior.mean[i], prior.mean[i]) && close(posterior.std(i), prior.std(i)));
        }
    }

    /// A linear map has no curvature: whatever the spread, the time update is `F P F^T + Q`.
    #[test]
    fn a_linear_map_is_carried_exactly(seed in any::<u64>(), alpha in 0.01..1.2f64, kappa in -2.0..3.0f64) {
        let mut random = Draws(ChaCha8Rng::seed_from_u64(seed));
        let prior = random.belief();
        let f = SMatrix::<f64, 3, 5>::from_fn(|_, _| random.normal());
        let std = V5::from_fn(|_, _| random.normal().abs());
        let transform = UnscentedTransform::new(5, alpha, 2.0, kappa);
        let mut belief = prior;
        predict::<5, 3, 2>(&mut belief, &transform, &std, &(f * prior.mean), |offsets| {
            offsets.map(|offset| [f * (prior.mean + offset), f * (prior.mean - offset)])
        });
        let mut whole = M5::identity();
        whole.fixed_rows_mut::<3>(0).copy_from(&f);
        let expected = whole * covariance(&prior) * whole.transpose() + M5::from_diagonal(&std.map(|std| std * std));
        prop_assert!((belief.mean - whole * prior.mean).amax() < 1e-9 / (alpha * alpha));
        prop_assert!((covariance(&belief) - expected).amax() < 1e-8 / (alpha * alpha) * expected.amax().max(1.0));
    }
}

/// Two channels agree, the third is far off: it is left out and yet counted, until the gate has run out of patience;
/// then it moves what is measured and nothing else.
#[test]
fn a_far_channel_is_left_out_and_at_last_moves_what_is_measured_alone() {
    let mut random = Draws(ChaCha8Rng::seed_from_u64(5));
    let prior = random.belief();
    let z = V3::new(prior.mean[0] + 0.1, prior.mean[1] + 100.0, prior.mean[2] - 0.1);
    let (std, gate) = (V3::new(0.3, 0.2, 0.4), Gate { deviations: 6.0, patience: 2 });
    let noise = Noise { level: std, weighted: std };
    let mut rejections = [0; 3];
    for form in [UpdateForm::Array, UpdateForm::Array, UpdateForm::Andrews] {
        let mut posterior = prior;
        let out = correct(&mut posterior, &z, &noise, (gate, &mut rejections), [false; 5], form);
        if rejections[1] <= 2 {
            let agree = expected(&prior, &z, &std, [true, false, true], [false; 5]);
            let far = expected(&prior, &z, &std, [false, true, false], [false; 5]);
            assert_eq!((out.used, out.rejected, out.dof), ([true, false, true], [false, true, false], 3));
            assert!((posterior.mean - agree.mean).amax() < 1e-12);
            assert!(close(out.nis, agree.nis + far.nis), "the rejected channel counts singly");
            assert!(close(out.log_likelihood, agree.log_likelihood + far.log_likelihood));
        } else {
            let all = expected(&prior, &z, &std, [true; 3], [false, false, false, true, true]);
            assert_eq!((out.used, out.rejected, rejections), ([true; 3], [false; 3], [0, 3, 0]));
            assert!(
                (posterior.mean - all.mean).amax() < 1e-9 && (covariance(&posterior) - all.covariance).amax() < 1e-9
            );
            assert_eq!((posterior.mean[3], posterior.mean[4]), (prior.mean[3], prior.mean[4]));
        }
    }
    assert_eq!(rejections[1], 3);
}

/// A down-weighted sample enters with its own noise, and the gate still judges by the level.
#[test]
fn the_gate_judges_by_the_level_and_the_update_by_the_weight() {
    let prior = FactoredGaussian::independent(V5::zeros(), &V5::repeat(1.0));
    let (level, weighted) = (V3::repeat(0.1), V3::repeat(3.0));
    let gate = Gate { deviations: 6.0, patience: 10 };
    let mut posterior = prior;
    let z = V3::new(5.9, 6.2, f64::NAN);
    let noise = Noise { level, weighted };
    let out = correct(&mut posterior, &z, &noise, (gate, &mut [0; 3]), [false; 5], UpdateForm::Array);
    assert_eq!((out.used, out.rejected), ([true, false, false], [false, true, false]));
    assert!(close(posterior.mean[0], 5.9 / 10.0) && posterior.mean[1] == 0.0);
}
