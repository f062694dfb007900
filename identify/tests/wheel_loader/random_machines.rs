//! The loader's estimator on machines, drives and settings drawn at random, with damaged logs: it never
//! fails, nothing leaves the numbers, and the standard deviations stay consistent although every machine
//! differs from the model in its tyres.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use wheelstate::estimator::wheel_loader::*;
use wheelstate::{Estimator, Status, Variables};
use wheelstate_identify::simulate::Request;
use wheelstate_identify::tune::replay::Track;
use wheelstate_identify::vehicles::wheel_loader;

const RUNS: u64 = 200;
const SCENARIOS: [&str; 6] = ["bumpy-c", "bumpy-d", "spade", "spade-heavy", "constant-torque", "accelerate-brake"];

struct Draws(ChaCha8Rng);

impl Draws {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }
    fn normal(&mut self, std: f64) -> f64 {
        let draw: f64 = StandardNormal.sample(&mut self.0);
        std * draw
    }
    fn coin(&mut self) -> bool {
        self.0.random()
    }
}

struct Run {
    what: String,
    extended: bool,
    scenario: &'static str,
    /// Errors of `[K, h, lambda]` over their standard deviations at the end.
    score: [f64; 3],
    /// Relative standard deviations.
    std: [f64; 3],
    failed: bool,
    finite: bool,
    contradicted: bool,
}

/// A machine of this seed, its scenario and the truth `[K, h, lambda]`.
fn settings(random: &mut Draws, fixed: bool) -> (Vec<(String, f64)>, [f64; 3]) {
    let truth = [random.between(14.0, 28.0), random.between(0.7, 1.3), random.between(0.35, 0.6)];
    // Radii that are taken as given are as given.
    let radius_error = if fixed { 0.0 } else { 3e-4 };
    let settings = [
        ("plant.slip_stiffness", truth[0]),
        ("plant.cg_height", truth[1]),
        ("plant.cg_ratio", truth[2]),
        ("plant.torque", random.between(0.6, 2.2)),
        ("plant.length", random.between(1.0, 2.0)),
        ("plant.radius_softness", random.between(0.0, 0.06)),
        ("plant.wheel_moments", random.between(0.0, 1.0)),
        ("plant.load_sensitivity", random.between(0.0, 0.1)),
        ("plant.shape", random.between(1.3, 1.8)),
        ("plant.curvature", random.between(-0.5, 0.5)),
        ("plant.relaxation_length", random.between(0.1, 0.5)),
        ("plant.tire_stiffness", random.between(5e5, 1.2e6)),
        ("plant.roughness", random.between(0.3, 1.2)),
        ("plant.grade", random.between(-0.03, 0.03)),
        ("plant.rolling_error", random.normal(0.002)),
        ("plant.mass_error", random.normal(0.01)),
        ("plant.wheel_radius_front_error", random.normal(radius_error)),
        ("plant.wheel_radius_rear_error", random.normal(radius_error)),
    ];
    (settings.map(|(name, value)| (name.to_owned(), value)).to_vec(), truth)
}

/// Parameters with a prior that is as wrong as it says.
fn parameters(random: &mut Draws, truth: [f64; 3], fixed: bool) -> Parameters {
    let mut p = Parameters::default();
    let initial = &mut p.initial;
    (initial.slip_stiffness_std, initial.cg_height_std, initial.cg_ratio_std) = (5.0, 0.16, 0.07);
    initial.slip_stiffness = (truth[0] + random.normal(5.0)).clamp(6.0, 60.0);
    initial.cg_height = (truth[1] + random.normal(0.16)).clamp(0.45, 2.0);
    initial.cg_ratio = (truth[2] + random.normal(0.07)).clamp(0.2, 0.8);
    let filter = &mut p.filter;
    filter.kind = if random.between(0.0, 1.0) < 0.25 { Kind::Extended } else { Kind::SquareRootUnscented };
    filter.form = if random.coin() { Form::Array } else { Form::Andrews };
    filter.parameters = if random.coin() { Coordinates::Logit } else { Coordinates::Direct };
    filter.radii = if fixed { Radii::Fixed } else { Radii::Estimated };
    p
}

/// Damages a log and drops samples; returns what is left with the time since the sample before.
fn damaged(random: &mut Draws, mut inputs: Vec<Inputs>) -> Vec<(Inputs, f64)> {
    for _ in 0..6 {
        let (start, channel) = (random.between(0.0, inputs.len() as f64) as usize, random.between(0.0, 10.0) as usize);
        let length = random.between(1.0, 40.0) as usize;
        let value = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300][random.between(0.0, 4.0) as usize];
        for inputs in inputs.iter_mut().skip(start).take(length) {
            let mut flat = inputs.to_vec();
            flat[channel] = value;
            inputs.read(&flat);
        }
    }
    let mut left = Vec::new();
    let mut gap = 0.0;
    for inputs in inputs {
        gap += 0.01;
        if random.between(0.0, 1.0) > 0.03 {
            left.push((inputs, gap));
            gap = 0.0;
        }
    }
    left
}

fn run(seed: u64) -> Run {
    let mut random = Draws(ChaCha8Rng::seed_from_u64(77_000 + seed));
    let scenario = SCENARIOS[seed as usize % SCENARIOS.len()];
    let fixed = random.coin();
    let (settings, truth) = settings(&mut random, fixed);
    let what = format!("{seed} {scenario} {settings:.3?}");
    let log = wheel_loader::VEHICLE.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap();
    let inputs = Track::<WheelLoader>::new(&log).inputs;
    let p = parameters(&mut random, truth, fixed);
    let mut estimator = WheelLoader::new(&p).unwrap();
    let mut out = Outputs::default();
    let (mut failed, mut finite, mut contradicted) = (false, true, false);
    for (inputs, dt) in damaged(&mut random, inputs) {
        let status = estimator.step(&inputs, dt);
        failed |= status.contains(Status::RECOVERED);
        contradicted |= status.contains(Status::CONTRADICTED);
        estimator.outputs(&inputs, 0.005, &mut out);
        finite &= out.to_vec().iter().all(|value| value.is_finite());
    }
    let values = [out.slip_stiffness.value, out.cg_height.value, out.cg_ratio.value];
    let stds = [out.slip_stiffness.std, out.cg_height.std, out.cg_ratio.std];
    Run {
        what: format!("{what} {:?} {:?} {:?} {:?}", p.filter.kind, p.filter.form, p.filter.parameters, p.filter.radii),
        extended: p.filter.kind == Kind::Extended,
        scenario,
        score: std::array::from_fn(|i| (values[i] - truth[i]) / stds[i]),
        std: std::array::from_fn(|i| stds[i] / truth[i]),
        failed,
        finite,
        contradicted,
    }
}

fn describe(what: &str, runs: &[&Run]) {
    let mut line = format!("{what:18}");
    for (i, name) in ["K", "h", "lambda"].iter().enumerate() {
        let mean = |of: &dyn Fn(&Run) -> f64| runs.iter().map(|run| of(run)).sum::<f64>() / runs.len() as f64;
        line += &format!(
            " | {name} {:3.0} % in 2 std, rms score {:.2}, std {:4.1} %",
            100.0 * covered(runs, i),
            mean(&|run| run.score[i].powi(2)).sqrt(),
            100.0 * mean(&|run| run.std[i])
        );
    }
    println!("{line}");
}

fn covered(runs: &[&Run], i: usize) -> f64 {
    runs.iter().filter(|run| run.score[i].abs() < 2.0).count() as f64 / runs.len() as f64
}

#[test]
fn estimates_of_random_machines_keep_to_their_standard_deviations() {
    let runs: Vec<Run> = (0..RUNS).into_par_iter().map(run).collect();
    for run in &runs {
        assert!(!run.failed && run.finite, "{}", run.what);
    }
    // Some hop over a rough road at 50 km/h without a speed sensor, and some initial values are wrong by more than they say.
    let contradicted = runs.iter().filter(|run| run.contradicted).count();
    println!("contradicted: {contradicted} of {RUNS}");
    assert!(contradicted as u64 <= RUNS / 20);
    let (extended, unscented): (Vec<&Run>, Vec<&Run>) = runs.iter().partition(|run| run.extended);
    for scenario in SCENARIOS {
        describe(scenario, &unscented.iter().copied().filter(|run| run.scenario == scenario).collect::<Vec<_>>());
    }
    describe("unscented", &unscented);
    describe("extended", &extended);
    for (i, name) in ["K", "h", "lambda"].iter().enumerate() {
        let share = covered(&unscented, i);
        assert!(share >= 0.93, "{name} is overconfident: {share} within 2 std");
        // The linearised filter is the baseline: it is lost now and then where the motion starts roughly.
        assert!(covered(&extended, i) >= 0.75, "{name} by the extended filter");
    }
}
