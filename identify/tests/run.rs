//! Runs of logs: what they refuse, and smoothing against what is known otherwise.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wheelstate::estimator::one_step::{Belief, Transition};
use wheelstate_identify::log::Log;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::run::{Assessment, Run, RunError, Sampling, Settings, assess, smooth_step};
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicle::Vehicle;
use wheelstate_identify::vehicles;

fn vehicle(name: &str) -> &'static Vehicle {
    vehicles::ALL.into_iter().find(|vehicle| vehicle.name == name).expect("a machine of the list")
}

fn log(machine: &str, scenario: &str, seed: u64) -> Log {
    let request = Request { scenario: scenario.to_owned(), seed, ..Request::default() };
    vehicle(machine).simulate(&request).expect("a scenario of the machine")
}

/// A smoothed run with parameters, and what it is worth.
fn smoothed(machine: &str, log: &Log, parameters: &[(&str, f64)]) -> (Run, Assessment) {
    let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    let settings = Settings { parameters, smooth: true, ..Settings::default() };
    let run = vehicle(machine).run(log, &settings, &Progress::none()).expect("a run");
    let assessment = assess(&run, log);
    (run, assessment)
}

fn vector(values: &[f64]) -> DVector<f64> {
    DVector::from_column_slice(values)
}

/// Row by row.
fn matrix(rows: usize, values: &[f64]) -> DMatrix<f64> {
    DMatrix::from_row_slice(rows, values.len() / rows, values)
}

/// A chain `x[k+1] = F x[k] + q`, `z[k] = H x[k] + r`, with every third sample missing.
struct Chain {
    f: DMatrix<f64>,
    q: DMatrix<f64>,
    h: DMatrix<f64>,
    r: f64,
    start: Belief,
    z: Vec<Option<f64>>,
}

impl Chain {
    fn random(length: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let start =
            Belief { mean: vector(&[0.3, -0.2, 0.1]), covariance: DMatrix::from_diagonal(&vector(&[2.0, 0.5, 0.1])) };
        Self {
            f: matrix(3, &[1.0, 0.1, 0.005, 0.0, 1.0, 0.1, 0.0, -0.05, 0.97]),
            q: DMatrix::from_diagonal(&vector(&[1e-4, 2e-3, 5e-2])),
            h: matrix(1, &[1.0, 0.0, 0.3]),
            r: 0.04,
            start,
            z: (0..length).map(|k| (k % 3 != 2).then(|| random.random_range(-2.0..2.0))).collect(),
        }
    }

    /// Everything at once: the joint Gaussian of all states, conditioned on all samples.
    fn batch(&self) -> Vec<Belief> {
        let (n, length) = (3, self.z.len());
        let mut mean = DVector::zeros(n * length);
        let mut covariance = DMatrix::zeros(n * length, n * length);
        let (mut m, mut p) = (self.start.mean.clone(), self.start.covariance.clone());
        for k in 0..length {
            mean.rows_mut(n * k, n).copy_from(&m);
            let mut block = p.clone();
            for later in k..length {
                covariance.view_mut((n * later, n * k), (n, n)).copy_from(&block);
                covariance.view_mut((n * k, n * later), (n, n)).copy_from(&block.transpose());
                block = &self.f * block;
            }
            m = &self.f * m;
            p = &self.f * p * self.f.transpose() + &self.q;
        }
        let there: Vec<usize> = (0..length).filter(|&k| self.z[k].is_some()).collect();
        let mut rows = DMatrix::zeros(there.len(), n * length);
        let z = DVector::from_iterator(there.len(), there.iter().filter_map(|&k| self.z[k]));
        for (row, k) in there.iter().enumerate() {
            rows.view_mut((row, n * k), (1, n)).copy_from(&self.h);
        }
        let s = &rows * &covariance * rows.transpose() + DMatrix::identity(there.len(), there.len()) * self.r;
        let gain = &covariance * rows.transpose() * s.try_inverse().expect("a covariance of samples");
        let posterior = &mean + &gain * (z - &rows * &mean);
        let left = &covariance - &gain * &rows * &covariance;
        let part = |k: usize| Belief {
            mean: posterior.rows(n * k, n).into_owned(),
            covariance: left.view((n * k, n * k), (n, n)).into_owned(),
        };
        (0..length).map(part).collect()
    }

    /// The filter forward, then the smoother back.
    fn filter_and_smooth(&self) -> Vec<Belief> {
        let mut belief = self.start.clone();
        let (mut filtered, mut transitions) = (Vec::new(), Vec::new());
        for (k, z) in self.z.iter().enumerate() {
            if k > 0 {
                let predicted = Belief {
                    mean: &self.f * &belief.mean,
                    covariance: &self.f * &belief.covariance * self.f.transpose() + &self.q,
                };
                transitions
                    .push(Transition { predicted: predicted.clone(), cross: &belief.covariance * self.f.transpose() });
                belief = predicted;
            }
            if let Some(z) = z {
                let variance = (&self.h * &belief.covariance * self.h.transpose())[(0, 0)] + self.r;
                let gain = &belief.covariance * self.h.transpose() / variance;
                let innovation = z - (&self.h * &belief.mean)[(0, 0)];
                belief.mean += gain.column(0) * innovation;
                belief.covariance -= &gain * &self.h * &belief.covariance;
            }
            filtered.push(belief.clone());
        }
        let mut smoothed = vec![belief];
        for (filtered, transition) in filtered.iter().zip(&transitions).rev() {
            let later = smoothed.last().expect("the last sample");
            smoothed.push(smooth_step(filtered, transition, later).expect("covariances that have an inverse"));
        }
        smoothed.reverse();
        smoothed
    }
}

#[test]
fn a_smoothed_linear_chain_is_the_joint_gaussian_conditioned_on_all_samples() {
    let chain = Chain::random(40);
    for (k, (smoothed, batch)) in chain.filter_and_smooth().iter().zip(chain.batch()).enumerate() {
        let mean = (&smoothed.mean - &batch.mean).amax();
        let covariance = (&smoothed.covariance - &batch.covariance).amax();
        assert!(mean < 1e-9 && covariance < 1e-9, "sample {k}: {mean:e}, {covariance:e}");
    }
}

#[test]
fn states_that_are_known_exactly_are_left_alone_by_the_smoother() {
    let covariance = matrix(2, &[2.0, 0.0, 0.0, 0.0]);
    let filtered = Belief { mean: vector(&[1.0, 5.0]), covariance: covariance.clone() };
    let transition = Transition { predicted: filtered.clone(), cross: covariance };
    let later = Belief { mean: vector(&[2.0, 5.0]), covariance: matrix(2, &[1.0, 0.0, 0.0, 0.0]) };
    let smoothed = smooth_step(&filtered, &transition, &later).expect("the first state has an inverse");
    assert!((smoothed.mean - later.mean).amax() < 1e-12 && (smoothed.covariance - later.covariance).amax() < 1e-12);
}

/// Estimates that a smoother must improve.
struct Improved {
    machine: &'static str,
    scenario: &'static str,
    parameters: &'static [(&'static str, f64)],
    names: &'static [&'static str],
}

const IMPROVED: [Improved; 3] = [
    Improved {
        machine: "wheelchair",
        scenario: "climb",
        parameters: &[("initial.heading", std::f64::consts::FRAC_PI_2)],
        names: &["speed", "yaw_rate", "slope", "pitch"],
    },
    Improved {
        machine: "nursing-robot",
        scenario: "coughs",
        // what these errors make of a deviation depends on the mean
        parameters: &[("human.stiffness_pitch_std", 0.0), ("human.damping_pitch_std", 0.0)],
        names: &["body_pitch", "body_pitch_rate", "hip_torque"],
    },
    Improved { machine: "wheel-loader", scenario: "bumpy-c", parameters: &[], names: &["cg_ratio", "slip_stiffness"] },
];

#[test]
fn smoothed_estimates_err_less_and_say_truly_how_much() {
    for Improved { machine, scenario, parameters, names } in IMPROVED {
        let all: Vec<Assessment> =
            (1..=6).map(|seed| smoothed(machine, &log(machine, scenario, seed), parameters).1).collect();
        for name in names {
            let of = |f: fn(&wheelstate_identify::run::Truth) -> f64| {
                let values = all.iter().flat_map(|a| &a.truth).filter(|truth| truth.name == *name).map(f);
                let values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
                values.iter().sum::<f64>() / values.len() as f64
            };
            let (filtered, smoothed) = (of(|t| t.rmse), of(|t| t.rmse_smoothed));
            let (within, within_smoothed) = (of(|t| t.within), of(|t| t.within_smoothed));
            println!(
                "{machine} {name}: {filtered:.3e} -> {smoothed:.3e}, within 2 std {within:.3} -> {within_smoothed:.3}"
            );
            assert!(smoothed < filtered, "{machine} {name}: {filtered} -> {smoothed}");
            assert!(within_smoothed > 0.9, "{machine} {name}: {within} -> {within_smoothed}");
        }
    }
}

#[test]
fn smoothing_widens_no_standard_deviation_and_leaves_the_last_sample_alone() {
    for Improved { machine, scenario, parameters, names } in IMPROVED {
        let (run, _) = smoothed(machine, &log(machine, scenario, 3), parameters);
        // Those that are no states, or another function of one, have a deviation that depends on the mean as well.
        for name in names.iter().filter(|name| !["hip_torque", "slip_stiffness"].contains(name)) {
            let column = |ending: &str| run.column(&format!("{name}{ending}")).expect("a column of the run");
            let (filtered, smoothed) = (column("_std"), column("_smoothed_std"));
            let widened = (0..filtered.len()).filter(|&k| smoothed[k] > 1.02 * filtered[k]).count();
            assert!(widened * 100 <= filtered.len(), "{machine} {name}: {widened} of {}", filtered.len());
            let last = filtered.len() - 1;
            assert_eq!((column("")[last], filtered[last]), (column("_smoothed")[last], smoothed[last]));
        }
    }
}

#[test]
fn nothing_is_carried_back_across_a_gap() {
    let whole = log("wheelchair", "climb", 2);
    // two seconds are missing: more than the filter bridges
    let mut gap = whole.slice(0..400, |_| true);
    let rest = whole.slice(600..whole.len(), |_| true);
    gap.time = gap.time.iter().chain(&rest.time).copied().collect();
    for (channel, rest) in gap.channels.iter_mut().zip(&rest.channels) {
        channel.values = channel.values.iter().chain(&rest.values).copied().collect();
    }
    let alone = whole.slice(0..400, |_| true);
    let parameters = [("initial.heading", std::f64::consts::FRAC_PI_2)];
    let (both, first) = (smoothed("wheelchair", &gap, &parameters).0, smoothed("wheelchair", &alone, &parameters).0);
    for name in ["speed_smoothed", "slope_smoothed", "slope_smoothed_std"] {
        let (both, first) = (both.column(name).expect("smoothed"), first.column(name).expect("smoothed"));
        assert_eq!(both[..400], first[..], "{name}");
    }
}

#[test]
fn what_cannot_be_smoothed_is_refused_with_the_reason() {
    for (machine, scenario, word) in [
        ("wheeled-robot", "sine", "considers errors of constants"),
        ("human-dynamics", "seated-braking", "of one instant"),
    ] {
        let settings = Settings { smooth: true, ..Settings::default() };
        let refused = vehicle(machine).run(&log(machine, scenario, 1), &settings, &Progress::none());
        assert!(matches!(&refused, Err(RunError::NotSmooth { reason, .. }) if reason.contains(word)), "{refused:?}");
    }
}

#[test]
fn a_sensor_that_contradicts_the_model_is_named_with_its_time() {
    let mut log = log("wheelchair", "climb", 1);
    let place = log.channels.iter().position(|channel| channel.name == "accel_x").expect("an input");
    for (value, time) in log.channels[place].values.iter_mut().zip(&log.time) {
        *value += if (4.0..6.0).contains(time) { 4.0 } else { 0.0 };
    }
    let settings = Settings {
        parameters: vec![
            ("initial.heading".to_owned(), std::f64::consts::FRAC_PI_2),
            ("filter.outlier_threshold".to_owned(), 0.0),
        ],
        sampling: Sampling::EveryRow,
        smooth: false,
    };
    let run = vehicle("wheelchair").run(&log, &settings, &Progress::none()).expect("a run");
    let assessment = assess(&run, &log);
    let span = assessment.contradicted.first().expect("a contradiction");
    assert!((4.0..6.5).contains(&span.from), "{span:?}");
    assert!(span.channels.contains(&"accel_x"), "{span:?}");
    let told = format!("contradicted from {:.1} s", span.from);
    assert!(assessment.warnings.iter().any(|warning| warning.starts_with(&told)), "{:?}", assessment.warnings);
}

#[test]
fn logs_that_no_file_can_hold_are_refused() {
    let good = log("wheelchair", "climb", 1);
    let run = |log: &Log| vehicle("wheelchair").run(log, &Settings::default(), &Progress::none());
    let mut back = good.clone();
    back.time[5] = back.time[4];
    assert!(run(&back).is_err_and(|e| e.to_string().contains("sample 6") && e.to_string().contains("is not after")));
    let mut short = good.clone();
    short.channels[0].values = short.channels[0].values.part(1..short.len());
    assert!(run(&short).is_err_and(|e| e.to_string().contains("values for")));
    assert!(run(&Log::default()).is_err_and(|e| e.to_string().contains("no sample")));
    let mut far = good.slice(0..10, |_| true);
    far.time[9] += 2000.0;
    assert!(run(&far).is_err_and(|e| e.to_string().contains("--clock log")));
}
