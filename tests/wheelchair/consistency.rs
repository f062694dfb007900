//! Whether the wheelchair's filter believes as much as it knows.

use super::chairs::{reference_chair, reference_limits, reference_noise};
use super::ukf;
use crate::support::{quantile, vector_table, vector_text};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::wheelchair::ekf::{ChairEkf, Drive, Form, Noise, Sample};
use wheelstate::estimator::wheelchair::{Basic, Biased, GravityVector, Mover};
use wheelstate::filter::discretise::runge_kutta;
use wheelstate::filter::ekf::{self, Rows};
use wheelstate::filter::gaussian::Gaussian;
use wheelstate::filter::innovation::Gate;
use wheelstate::model::wheelchair::{self as model, Command, Output, State};
use wheelstate::plant::wheelchair::Course;

const NO_GATE: Gate = Gate { deviations: 0.0, patience: 10 };

fn observer<F>(form: F) -> ChairEkf<F> {
    let noise = reference_noise(&serde_json::Value::Null);
    ChairEkf { chair: reference_chair("full"), noise, limits: reference_limits(), gate: NO_GATE, form }
}

fn prior() -> SVector<f64, 6> {
    SVector::from([0.005, 0.02, 0.02, 0.02, 0.01, 0.02]).map(|s: f64| s * s)
}

/// Covariance of the six rows, as the filter assumes it.
fn sensor_noise(noise: &Noise, chair: &model::Chair, alpha: f64) -> SMatrix<f64, 6, 6> {
    let mut r = SMatrix::<f64, 6, 6>::zeros();
    r.fixed_view_mut::<2, 2>(0, 0).copy_from(&model::encoder_covariance(chair, noise.encoder));
    r[(2, 2)] = noise.gyro * noise.gyro;
    let lever = model::tilt_lever(chair, alpha);
    let accel = SMatrix::<f64, 3, 3>::identity() * (noise.accel * noise.accel)
        + lever * lever.transpose() * (noise.slope_acceleration * noise.slope_acceleration);
    r.fixed_view_mut::<3, 3>(3, 3).copy_from(&accel);
    r
}

/// Covariance of a step of 10 ms.
fn process_noise(observer: &ChairEkf<Basic>) -> SMatrix<f64, 6, 6> {
    let mut step = Gaussian { mean: State::zeros(), covariance: SMatrix::zeros() };
    let drive = Drive::reported(Command::zeros(), false);
    Basic.add_process_noise(&mut step, &observer.chair, &drive, &observer.noise, observer.noise.speed, 0.01);
    step.covariance
}

/// 100 runs of 500 steps on a plant whose noise is what the filter assumes.
#[test]
fn nees_and_nis_are_those_of_a_consistent_filter() {
    let mut observer = observer(Basic);
    observer.chair.heading_reference = Course::Oblique.heading();
    let chair = observer.chair;
    let (mut all_nees, mut all_nis, mut rows, mut per_run) = (0.0, 0.0, 0.0, vec![]);
    for seed in 0..100 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let start = State::from([0.0, Course::Oblique.heading(), 0.0, 0.0, 0.0, 0.0]);
        let mut x = start;
        let spread = prior().map(f64::sqrt);
        let mut filter =
            Gaussian::independent(start + State::from_fn(|i, _| spread[i] * draw()), &prior().map(f64::sqrt));
        let q_root = process_noise(&observer).cholesky().unwrap().l();
        let mut nees = 0.0;
        for k in 0..500 {
            let command = |k: usize| Command::from(Course::Oblique.command(0.01 * k as f64, 0.0));
            if k > 0 {
                let held = Drive::reported(command(k - 1), false);
                x = runge_kutta(&x, 0.01, |x| model::derivative(&chair, x, &held.command, false));
                x += q_root * State::from_fn(|_, _| draw());
                observer.predict(&mut filter, 0.01, &held);
            }
            let now = Drive::reported(command(k), false);
            let r_root = sensor_noise(&observer.noise, &chair, x[model::ALPHA]).cholesky().unwrap().l();
            let y = model::output(&chair, &x, &now.command, false) + r_root * Output::from_fn(|_, _| draw());
            let update = observer.correct(&mut filter, &mut [0; 6], &Sample::from(y), &now).unwrap();
            let error = x - filter.mean;
            nees += error.dot(&filter.covariance.cholesky().unwrap().solve(&error));
            all_nis += update.nis;
            rows += update.dof as f64;
        }
        per_run.push(nees / 500.0);
        all_nees += nees;
    }
    let (nees, nis) = (all_nees / 50_000.0, all_nis / rows);
    println!(
        "NEES {nees:.3} of 6, per run 5-95 % {:.2}..{:.2}; NIS per row {nis:.4}",
        quantile(&per_run, 0.05),
        quantile(&per_run, 0.95)
    );
    assert!((5.6..=6.5).contains(&nees), "NEES {nees}");
    assert!((0.97..=1.03).contains(&nis), "NIS {nis}");
}

/// Both filters see the same samples; the unscented one shows what linearising costs.
#[test]
fn extended_and_unscented_filters_agree() {
    let runs: serde_json::Value = serde_json::from_str(&vector_text("wheelchair/runs.json")).unwrap();
    let mut worst = [0.0_f64; 3];
    for (case, variant) in [1, 2, 3].into_iter().flat_map(|case| [(case, "full"), (case, "paper")]) {
        let file = format!("ekf_case{case}_{variant}.csv");
        let mut observer = observer(Basic);
        observer.chair = reference_chair(variant);
        observer.chair.heading_reference = runs[&file]["alpha_ref"].as_f64().unwrap();
        let chair = observer.chair;
        let x0 = runs[&file]["x0"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap());
        let mut extended = Gaussian::independent(State::from_iterator(x0), &prior().map(f64::sqrt));
        let mut unscented = ukf::Ukf { mean: extended.mean, covariance: extended.covariance };
        let table = vector_table(&format!("wheelchair/{file}"));
        let q = process_noise(&observer);
        for row in 0..table.rows.len() {
            let drive = |row: usize| Drive::reported(Command::new(table.at(row, "u_f"), table.at(row, "u_r")), false);
            if row > 0 {
                let held = drive(row - 1);
                observer.predict(&mut extended, 0.01, &held);
                let f = |x: &State| runge_kutta(x, 0.01, |x| model::derivative(&chair, x, &held.command, false));
                unscented.predict(f, &q);
            }
            let now = drive(row);
            let y = Output::from_fn(|i, _| table.at(row, &format!("y{}", i + 1)));
            let r = sensor_noise(&observer.noise, &chair, unscented.mean[model::ALPHA]);
            unscented.update(|x| model::output(&chair, x, &now.command, false), &y, &r);
            observer.correct(&mut extended, &mut [0; 6], &y.into(), &now).unwrap();
            for (k, state) in [model::V, model::ALPHA, model::XI].into_iter().enumerate() {
                worst[k] = worst[k].max((extended.mean[state] - unscented.mean[state]).abs());
            }
        }
    }
    println!("largest |EKF - UKF| over six runs: v {:.1e}, alpha {:.1e}, xi {:.1e}", worst[0], worst[1], worst[2]);
    assert!(worst[0] < 5e-4 && worst[1] < 1e-4 && worst[2] < 1e-3);
}

/// Rows with dependent noises, some of them missing, against the textbook's `P - P H^T S^-1 H P`.
#[test]
fn rows_taken_one_by_one_equal_the_joint_update() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
    for lost in 0..64_usize {
        let (root, spread) =
            (SMatrix::<f64, 8, 8>::from_fn(|_, _| draw()), SMatrix::<f64, 6, 6>::from_fn(|_, _| draw()));
        let prior = Gaussian { mean: SVector::<f64, 8>::from_fn(|_, _| draw()), covariance: root * root.transpose() };
        let rows = Rows {
            innovation: SVector::<f64, 6>::from_fn(|_, _| draw()),
            jacobian: SMatrix::<f64, 6, 8>::from_fn(|_, _| draw()),
            noise: spread * spread.transpose() + SMatrix::identity() * 0.1,
            used: std::array::from_fn(|row| lost >> row & 1 == 0),
        };
        let mut posterior = prior;
        let correction = ekf::correct(&mut posterior, &rows, None).unwrap();

        let chosen: Vec<usize> = (0..6).filter(|row| rows.used[*row]).collect();
        let h = nalgebra::DMatrix::from_fn(chosen.len(), 8, |i, j| rows.jacobian[(chosen[i], j)]);
        let r = nalgebra::DMatrix::from_fn(chosen.len(), chosen.len(), |i, j| rows.noise[(chosen[i], chosen[j])]);
        let nu = nalgebra::DVector::from_fn(chosen.len(), |i, _| rows.innovation[chosen[i]]);
        let s = &h * prior.covariance * h.transpose() + r;
        let determinant = s.determinant();
        let inverse = s.try_inverse().unwrap();
        let gain = prior.covariance * h.transpose() * &inverse;
        let (mean, covariance) = (prior.mean + &gain * &nu, prior.covariance - &gain * &h * prior.covariance);
        assert!((posterior.mean - mean).amax() < 1e-9 && (posterior.covariance - covariance).amax() < 1e-9);
        assert_eq!(correction.dof, chosen.len());
        if !chosen.is_empty() {
            let nis = nu.dot(&(inverse * &nu));
            let likelihood = -0.5 * (nis + determinant.ln() + chosen.len() as f64 * std::f64::consts::TAU.ln());
            assert!((correction.nis - nis).abs() < 1e-9 * nis && (correction.log_likelihood - likelihood).abs() < 1e-8);
        }
    }
}

/// Where `P - K S K^T` has lost all digits, Joseph's form has not.
#[test]
fn a_precise_measurement_of_an_unknown_state_leaves_its_own_variance() {
    let mut belief = Gaussian::independent(SVector::from([0.0, 0.0]), &SVector::from([1e5, 1e5]));
    let rows = Rows {
        innovation: SVector::from([1.0, 2.0]),
        jacobian: SMatrix::<f64, 2, 2>::from_row_slice(&[1.0, 0.0, 1.0, 1.0]),
        noise: SMatrix::identity() * 1e-8,
        used: [true; 2],
    };
    ekf::correct(&mut belief, &rows, None).unwrap();
    let expected = SMatrix::<f64, 2, 2>::from_row_slice(&[1e-8, -1e-8, -1e-8, 2e-8]);
    assert!((belief.covariance - expected).amax() < 1e-12, "{}", belief.covariance);
    assert!((belief.mean - SVector::from([1.0, 1.0])).amax() < 1e-6);
}

/// Symmetric and positive definite after every step, whatever arrives.
fn stays_sound<const N: usize, const K: usize, const P: usize, F: Form<N, K, P>>(
    form: F,
    mean: SVector<f64, N>,
    steps: &[Step],
) -> Result<(), TestCaseError> {
    let observer = observer(form);
    let mut filter = Gaussian::independent(mean, &SVector::repeat(0.1));
    let mut counters = [0; 6];
    for (y, force, moment, dt, still, lost) in steps {
        let drive = Drive { accel_x: Some(y[3]), ..Drive::reported(Command::new(*force, *moment), *still) };
        observer.predict(&mut filter, *dt, &drive);
        let y = Output::from_fn(|i, _| if lost >> i & 1 == 1 { f64::NAN } else { y[i] });
        let update = observer.correct(&mut filter, &mut counters, &y.into(), &drive);
        prop_assert!(update.is_ok(), "{} {}", filter.mean, filter.covariance);
        prop_assert!(filter.is_valid() && filter.covariance.cholesky().is_some(), "{}", filter.covariance);
        // What no chair can do any more makes the estimator restart; it is not for the filter to bear.
        if filter.mean[2].abs() > 20.0 || filter.mean[3].abs() > 30.0 || filter.mean.rows(4, 2).amax() > 1.5 {
            return Ok(());
        }
        prop_assert_eq!(filter.covariance, filter.covariance.transpose());
    }
    Ok(())
}

/// Measurement, force, moment, step, standstill, lost rows.
type Step = ([f64; 6], f64, f64, f64, bool, u8);

fn steps() -> impl Strategy<Value = Vec<Step>> {
    // Within what wheels and sensors can do: 0.2 m and 0.2 rad between any two samples.
    let y = [-0.1..0.1, -0.1..0.1, -2.0..2.0, -8.0..8.0, -8.0..8.0, 2.0..15.0];
    prop::collection::vec((y, -300.0..300.0, -40.0..40.0, 5e-3..1.0, any::<bool>(), any::<u8>()), 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn covariance_of_six_states_stays_positive_definite(steps in steps()) {
        stays_sound(Basic, SVector::zeros(), &steps)?;
    }

    #[test]
    fn covariance_of_thirteen_states_stays_positive_definite(steps in steps(), force in any::<bool>()) {
        let mover = if force { Mover::Force } else { Mover::TippingAcceleration };
        stays_sound(Biased { mover }, SVector::zeros(), &steps)?;
    }

    #[test]
    fn covariance_of_the_gravity_form_stays_positive_definite(steps in steps(), force in any::<bool>()) {
        let mover = if force { Mover::Force } else { Mover::TippingAcceleration };
        stays_sound(GravityVector { mover }, SVector::zeros(), &steps)?;
    }
}
