//! The loader's estimator on the built-in plant, many seeds: accuracy, divergence, calibration.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use wheelstate::estimator::wheel_loader::*;
use wheelstate::{Estimator, Status};
use wheelstate_identify::simulate::Request;
use wheelstate_identify::tune::replay::Track;
use wheelstate_identify::vehicles::wheel_loader;

use crate::support::{median, quantile};

const SEEDS: u64 = 50;
const TRUTH: [f64; 3] = [19.0, 0.95, 0.45];

/// A log's inputs and its true load ratio.
struct Drive {
    time: Vec<f64>,
    inputs: Vec<Inputs>,
    load_ratio: Vec<f64>,
}

fn log(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Drive {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    let log = wheel_loader::VEHICLE.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap();
    let inputs = Track::<WheelLoader>::new(&log).inputs;
    Drive { inputs, load_ratio: log.channel("true_load_ratio").unwrap().to_vec(), time: log.time.to_vec() }
}

/// One run: largest relative errors of `[K, h, lambda]` in the window, errors over std at its end.
struct Run {
    error: [f64; 3],
    score: [f64; 3],
    std: [f64; 3],
    diverged: bool,
    failed: bool,
    load_ratio: f64,
    contradicted: bool,
}

/// The study's prior draws: K in 12..28, h in 0.75..1.15, lambda in 0.35..0.60.
fn drawn(parameters: &Parameters, seed: u64) -> Parameters {
    let mut random = ChaCha8Rng::seed_from_u64(1_000_000 + seed);
    let mut between = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let mut p = parameters.clone();
    let initial = [between(12.0, 28.0), between(0.75, 1.15), between(0.35, 0.60)];
    (p.initial.slip_stiffness, p.initial.cg_height, p.initial.cg_ratio) = initial.into();
    let slope = |p: f64, lo: f64, hi: f64| (p - lo) * (hi - p) / (hi - lo);
    p.initial.slip_stiffness_std = 0.8 * slope(initial[0], 2.0, 80.0);
    p.initial.cg_height_std = 0.35 * slope(initial[1], 0.3, 2.5);
    p.initial.cg_ratio_std = 0.5 * slope(initial[2], 0.1, 0.9);
    p
}

fn run(parameters: &Parameters, log: &Drive, window: (f64, f64)) -> Run {
    let mut estimator = WheelLoader::new(parameters).unwrap();
    let mut out = Outputs::default();
    let mut run = Run {
        error: [0.0; 3],
        score: [0.0; 3],
        std: [0.0; 3],
        diverged: false,
        failed: false,
        load_ratio: 0.0,
        contradicted: false,
    };
    let mut mean = Vec::new();
    for (k, inputs) in log.inputs.iter().enumerate() {
        let status = estimator.step(inputs, 0.01);
        run.failed |= status.contains(Status::RECOVERED);
        estimator.outputs(inputs, 0.0, &mut out);
        run.contradicted |= status.contains(Status::CONTRADICTED);
        let t = log.time[k];
        if t < window.0 || t > window.1 {
            continue;
        }
        let values = [out.slip_stiffness.value, out.cg_height.value, out.cg_ratio.value];
        let stds = [out.slip_stiffness.std, out.cg_height.std, out.cg_ratio.std];
        for i in 0..3 {
            run.error[i] = run.error[i].max((values[i] / TRUTH[i] - 1.0).abs());
            run.score[i] = (values[i] - TRUTH[i]) / stds[i];
            run.std[i] = stds[i];
        }
        mean.push(out.load_ratio.value - log.load_ratio[k]);
        if mean.len() >= 50 {
            let average = mean[mean.len() - 50..].iter().sum::<f64>() / 50.0;
            run.load_ratio = run.load_ratio.max(average.abs());
        }
    }
    run.diverged = run.error[2] > 0.3 || run.error[0] > 1.0;
    run
}

fn window(scenario: &str) -> (f64, f64) {
    match scenario {
        "constant-torque" => (10.0, 14.0),
        "accelerate-brake" => (18.0, 30.0),
        _ => (6.0, 10.0),
    }
}

/// Many seeds of one scenario, each for every set of parameters; the priors are drawn, the rest is as
/// given.
fn studies<const N: usize>(parameters: [&Parameters; N], scenario: &str, settings: &[(&str, f64)]) -> [Vec<Run>; N] {
    let mut all: Vec<[Run; N]> = (0..SEEDS)
        .into_par_iter()
        .map(|seed| {
            let log = log(scenario, seed, settings);
            parameters.map(|p| run(&drawn(p, seed), &log, window(scenario)))
        })
        .collect();
    let mut columns: [Vec<Run>; N] = std::array::from_fn(|_| Vec::new());
    for row in all.drain(..) {
        for (column, run) in columns.iter_mut().zip(row) {
            column.push(run);
        }
    }
    columns
}

fn study(parameters: &Parameters, scenario: &str, settings: &[(&str, f64)]) -> Vec<Run> {
    let [runs] = studies([parameters], scenario, settings);
    runs
}

fn column(runs: &[Run], of: impl Fn(&Run) -> f64) -> (f64, f64) {
    let values: Vec<f64> = runs.iter().map(of).collect();
    (median(&values), quantile(&values, 0.95))
}

fn describe(what: &str, runs: &[Run]) {
    let mut line = format!("{what:34}");
    for (i, name) in ["K", "h", "lam"].iter().enumerate() {
        let (half, most) = column(runs, |run| run.error[i]);
        let within = runs.iter().filter(|run| run.score[i].abs() < 2.0).count() as f64 / runs.len() as f64;
        let std = column(runs, |run| run.std[i]).0 / TRUTH[i];
        line += &format!(
            " | {name} {:5.1}/{:5.1} % (std {:4.1} %, {:3.0} % in 2 std)",
            100.0 * half,
            100.0 * most,
            100.0 * std,
            100.0 * within
        );
    }
    let ratio = column(runs, |run| run.load_ratio);
    let diverged = runs.iter().filter(|run| run.diverged).count();
    println!("{line} | load {:.3}/{:.3} | diverged {diverged}", ratio.0, ratio.1);
}

/// Share of the runs whose final estimate lies within two of its standard deviations.
fn covered(runs: &[Run], i: usize) -> f64 {
    runs.iter().filter(|run| run.score[i].abs() < 2.0).count() as f64 / runs.len() as f64
}

/// What must hold wherever the estimator runs: no repair, no false alarm, consistent standard deviations.
fn sound(runs: &[Run]) {
    assert!(runs.iter().all(|run| !run.failed), "the factor had to be repaired");
    assert!(runs.iter().all(|run| !run.contradicted), "a sound machine was called contradicted");
    for (i, name) in ["K", "h", "lambda"].iter().enumerate() {
        assert!(covered(runs, i) >= 0.93, "{name} is overconfident: {} within 2 std", covered(runs, i));
    }
}

fn bounded(runs: &[Run], i: usize, half: f64, most: f64) {
    let (median, p95) = column(runs, |run| run.error[i]);
    assert!(median <= half && p95 <= most, "median {median} > {half} or p95 {p95} > {most}");
}

fn diverged(runs: &[Run]) -> usize {
    runs.iter().filter(|run| run.diverged).count()
}

const K: usize = 0;
const H: usize = 1;
const LAMBDA: usize = 2;

#[test]
fn the_load_ratio_is_found_on_an_average_road() {
    for scenario in ["bumpy-c", "spade", "spade-heavy"] {
        let runs = study(&Parameters::default(), scenario, &[]);
        describe(scenario, &runs);
        sound(&runs);
        bounded(&runs, LAMBDA, 0.06, 0.13);
        assert!(diverged(&runs) <= 1);
    }
}

#[test]
fn the_load_ratio_is_found_on_a_poor_road() {
    let [runs, before] = studies([&Parameters::default(), &as_in_the_study()], "bumpy-d", &[]);
    describe("bumpy-d", &runs);
    sound(&runs);
    bounded(&runs, LAMBDA, 0.08, 0.16);
    bounded(&runs, K, 0.15, 0.25);
    assert_eq!(diverged(&runs), 0);
    describe("bumpy-d as in the study", &before);
    for i in [K, LAMBDA] {
        assert!(column(&runs, |run| run.error[i]).0 < 0.75 * column(&before, |run| run.error[i]).0);
    }
}

#[test]
fn accelerating_and_braking_reveals_the_height() {
    let runs = study(&Parameters::default(), "accelerate-brake", &[]);
    describe("accelerate-brake", &runs);
    sound(&runs);
    bounded(&runs, LAMBDA, 0.025, 0.05);
    bounded(&runs, K, 0.06, 0.10);
    bounded(&runs, H, 0.15, 0.30);
    assert_eq!(diverged(&runs), 0);
}

/// Traction up to two thirds of the friction, and rolling radii that follow the load, which the model
/// does not know: the standard deviations say it.
#[test]
fn strong_traction_and_soft_tyres_stay_within_the_standard_deviations() {
    for settings in [
        &[("plant.torque", 2.2)][..],
        &[("plant.radius_softness", 0.05)],
        &[("plant.torque", 2.2), ("plant.radius_softness", 0.05), ("plant.wheel_moments", 1.0)],
        &[("plant.torque", 2.2), ("plant.radius_softness", 0.05), ("plant.load_sensitivity", 0.0)],
    ] {
        let runs = study(&Parameters::default(), "accelerate-brake", settings);
        describe(&format!("{settings:?}"), &runs);
        sound(&runs);
        bounded(&runs, H, 0.15, 0.30);
    }
}

#[test]
fn constant_torque_gives_a_rough_load_ratio() {
    let runs = study(&Parameters::default(), "constant-torque", &[]);
    describe("constant-torque", &runs);
    sound(&runs);
    bounded(&runs, LAMBDA, 0.139, 0.32);
}

/// A front radius that is wrong by 0.3 % ruins the study's filter; with the radii among the unknowns
/// and a prior as wide as the error, accelerating and braking reveals it, and where torque is
/// constant the standard deviations say that nothing can be known.
#[test]
fn wrong_radii_are_found_or_widen_the_standard_deviations() {
    let mut wide = Parameters::default();
    wide.initial.wheel_radius_std = 0.003;
    for error in [0.003, -0.003] {
        let settings = [("plant.wheel_radius_front_error", error)];
        let [runs, narrow, before] =
            studies([&wide, &Parameters::default(), &as_in_the_study()], "accelerate-brake", &settings);
        describe(&format!("accelerate-brake, radius {error:+}"), &runs);
        sound(&runs);
        bounded(&runs, LAMBDA, 0.025, 0.05);
        bounded(&runs, H, 0.15, 0.30);
        describe(&format!("accelerate-brake, radius {error:+}, default prior"), &narrow);
        bounded(&narrow, LAMBDA, 0.03, 0.06);
        describe(&format!("accelerate-brake, radius {error:+}, as in the study"), &before);
        assert!(column(&before, |run| run.error[H]).0 > 0.3);
    }
    let runs = study(&wide, "bumpy-c", &[("plant.wheel_radius_front_error", 0.003)]);
    describe("bumpy-c, radius +0.003", &runs);
    sound(&runs);
}

#[test]
fn the_unscented_filter_diverges_no_more_often_than_the_extended_one() {
    let mut extended = Parameters::default();
    extended.filter.kind = Kind::Extended;
    for scenario in ["bumpy-c", "bumpy-d", "constant-torque", "accelerate-brake"] {
        let [ukf, ekf] = studies([&Parameters::default(), &extended], scenario, &[]);
        describe(&format!("{scenario}, extended"), &ekf);
        assert!(diverged(&ukf) <= diverged(&ekf));
        assert!(ekf.iter().all(|run| !run.failed));
    }
}

/// The study's filter: given radii, one fixed noise level, no settling.
fn as_in_the_study() -> Parameters {
    let mut p = Parameters::default();
    p.filter.radii = Radii::Fixed;
    (p.filter.measurement_std.speed, p.filter.measurement_std.wheel_speed) = (0.03, 0.05);
    p.filter.adaptation.enabled = false;
    p.hold.settle_time = 0.0;
    p.filter.alpha = 1.0;
    p
}
