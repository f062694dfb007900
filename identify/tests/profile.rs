//! Profiles against closed forms and other programs.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::{Declared, FitError, FitRequest, Problem, Session, Target, Task, fit};
use wheelstate_identify::progress::Progress;
use wheelstate_identify::result::{ProfileEnd, Verdict};
use wheelstate_identify::simulate::Request;
use wheelstate_identify::solve::compress::Factors;
use wheelstate_identify::solve::profile::{self, Curve, End, LEVELS, Subject};
use wheelstate_identify::solve::{
    Loss, Options, Regression, Rows, Scale, Smooth, SmoothGroup, Trust, TrustNorm, Unknown, refine, robust, solve,
};
use wheelstate_identify::vehicles;

/// Rows `y = [1, x] . theta + noise` with noise of standard deviation 1.
fn line(theta: [f64; 2], count: usize, seed: u64) -> Regression {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut rows = Rows { scale: Scale::Known(1.0), ..Rows::new("line", "1", 2) };
    for i in 0..count {
        let x = i as f64 / count as f64 - 0.3;
        let noise: f64 = StandardNormal.sample(&mut rng);
        rows.push(&[1.0, x], theta[0] + theta[1] * x + noise, i as u32);
    }
    let unknowns = vec![Unknown::free("at zero"), Unknown::free("slope")];
    Regression { name: "line".into(), unknowns, groups: vec![rows], constraints: Vec::new() }
}

/// A parameter of no declared machine.
fn target(name: &str) -> Target {
    let range = (-1e9, 1e9);
    Target { name: name.into(), unit: "1".into(), range, usual: true, optional: false, contested: false }
}

/// The profile of `theta_1/theta_0` without inflation.
fn ratio(regression: &Regression, range: (f64, f64)) -> (Curve, Vec<f64>, DMatrix<f64>) {
    let options = Options { loss: Loss::Ls, ..Options::default() };
    let solution = solve(regression, &options).unwrap();
    let (theta, covariance) = (solution.theta.clone(), solution.inverse_information.clone());
    let gradient = DVector::from_vec(vec![-theta[1] / (theta[0] * theta[0]), 1.0 / theta[0]]);
    let std = gradient.dot(&(&covariance * &gradient)).sqrt();
    let factors = Factors::of(regression);
    let refit = |pull: Option<&profile::Pull>, _: &[f64]| {
        let minimum = robust::minimise(regression, &factors, &[1.0], Loss::Ls, &options, pull)?;
        let cost = profile::cost(regression, &[1.0], Loss::Ls, &minimum.theta);
        Ok((minimum.theta, cost))
    };
    let of = |theta: &[f64]| theta[1] / theta[0];
    let subject = Subject { theta: &theta, of: &of, std, std_of_cost: std, range, refit: &refit };
    (profile::curve(&subject).unwrap().unwrap(), theta, covariance)
}

/// Fieller (1954): `(b_1 - c b_0)^2 = q (V_11 - 2 c V_01 + c^2 V_00)` at the ends of the interval of `c = b_1/b_0`.
fn fieller(b: &[f64], v: &DMatrix<f64>, c: f64) -> f64 {
    (b[1] - c * b[0]).powi(2) / (v[(1, 1)] - 2.0 * c * v[(0, 1)] + c * c * v[(0, 0)])
}

#[test]
fn the_profile_of_a_ratio_of_regression_coefficients_is_fiellers() {
    for seed in 0..6 {
        let (curve, b, v) = ratio(&line([2.0, 3.0], 40, seed), (-1e9, 1e9));
        for (value, statistic) in curve.value.iter().zip(&curve.statistic) {
            let exact = fieller(&b, &v, *value);
            assert!((statistic - exact).abs() < 1e-3 * exact.max(0.1), "{value}: {statistic}, Fieller {exact}");
        }
        for (level, ends) in LEVELS.iter().zip(curve.crossings) {
            for end in ends.into_iter().filter(|end| end.is_finite()) {
                let exact = fieller(&b, &v, end);
                assert!((exact.sqrt() - level.sqrt()).abs() < 5e-3, "{end} is at {exact}, not {level}");
            }
        }
        assert_eq!(curve.ends, [End::Passed; 2]);
    }
}

#[test]
fn a_ratio_whose_denominator_may_be_zero_has_no_end() {
    // Some draw of the noise leaves a denominator that is not zero for certain.
    let draws = (0..100).map(|seed| ratio(&line([0.25, 4.0], 40, seed), (-1e9, 1e9)));
    let uncertain = |b: &[f64], v: &DMatrix<f64>| (0.5..0.8 * LEVELS[0]).contains(&(b[0].powi(2) / v[(0, 0)]));
    let (curve, b, _) = draws.into_iter().find(|(_, b, v)| uncertain(b, v)).unwrap();
    let side = usize::from(b[1] / b[0] > 0.0);
    assert_eq!(curve.ends[side], End::Open, "{curve:?}");
    assert!(curve.crossings[0][side].is_infinite() && curve.crossings[0][1 - side].is_finite());
}

#[test]
fn a_profile_ends_at_the_range_of_its_parameter() {
    let regression = line([2.0, 3.0], 40, 1);
    let (free, b, _) = ratio(&regression, (-1e9, 1e9));
    let bound = 0.5 * (free.crossings[0][0] + b[1] / b[0]);
    let (curve, ..) = ratio(&regression, (bound, 1e9));
    assert_eq!(curve.ends, [End::Bound, End::Passed]);
    assert!((curve.value[0] - bound).abs() < 1e-3 && curve.crossings[0][0].is_infinite());
}

/// `tests/oracles/profile.py`
#[test]
fn profiles_of_a_refinement_are_those_of_minos_and_scipy() {
    let oracle: serde_json::Value = serde_json::from_str(include_str!("../../tests/oracles/profile.json")).unwrap();
    let list = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (time, values, std) = (list(&oracle["time"]), list(&oracle["values"]), oracle["std"].as_f64().unwrap());
    let residuals = |x: &[f64]| vec![time.iter().zip(&values).map(|(t, y)| y - x[0] * (-x[1] * t).exp()).collect()];
    let smooth = Smooth {
        name: "decay".into(),
        unknowns: vec![Unknown::free("a"), Unknown::free("b")],
        start: vec![2.5, 0.4],
        typical: vec![1.0, 0.1],
        groups: vec![SmoothGroup { name: "y".into(), unit: "1", scale: Scale::Known(std), cluster_rows: 1 }],
        residuals: &residuals,
        constraints: Vec::new(),
        trust: Trust { radius: 0.5, largest: 2.0, norm: TrustNorm::Box, accept: 0.1 },
        passes: 3,
        fuller: None,
        correct: false,
        profiled: Vec::new(),
        progress: Progress::none(),
    };
    let mut solution = refine(&smooth, Loss::Ls).unwrap();
    // The noise is known and white: nothing is to be inflated.
    solution.covariance = solution.inverse_information.clone();
    solution.degrees_of_freedom = 1e9;
    for index in 0..2 {
        let curve = refine::profile(&smooth, &solution, index, Loss::Ls).unwrap().unwrap();
        assert!((solution.theta[index] - oracle["estimate"][index].as_f64().unwrap()).abs() < 1e-4);
        for (level, ends) in ["0.95", "0.997"].into_iter().zip(curve.crossings) {
            let exact = list(&oracle["intervals"][level][index]);
            for (end, exact) in ends.into_iter().zip(exact) {
                let half = (exact - solution.theta[index]).abs();
                assert!((end - exact).abs() < 4e-3 * half, "unknown {index}, {level}: {end}, MINOS {exact}");
            }
        }
        if index == 1 {
            for (held, exact) in list(&oracle["held"]).into_iter().zip(list(&oracle["statistic"])) {
                let after = curve.value.iter().position(|value| *value > held).unwrap();
                let root = |k: usize| curve.statistic[k].sqrt().copysign(curve.value[k] - solution.theta[1]);
                let share = (held - curve.value[after - 1]) / (curve.value[after] - curve.value[after - 1]);
                let between = root(after - 1) + share * (root(after) - root(after - 1));
                assert!((between.abs() - exact.sqrt()).abs() < 0.02, "b = {held}: {} for {exact}", between * between);
            }
        }
    }
}

/// Every machine's own good log: near its estimate a profile is the parabola of the interval, whatever the loss, and it
/// holds the 95 % interval by noise where the cost is quadratic.
#[test]
fn near_the_estimate_every_profile_is_the_parabola_of_its_interval() {
    let cases = [
        ("nursing-robot", "identification", ["human.stiffness_pitch", "rolling.coefficient"]),
        ("wheelchair", "identification", ["chair.yaw_inertia", "rolling.coefficient"]),
        ("wheel-loader", "accelerate-brake", ["initial.slip_stiffness", "initial.cg_height"]),
        ("wheeled-robot", "sine", ["tire.front.stiffness", "tire.rear.stiffness"]),
        ("human-dynamics", "seated-braking", ["stiffness.lumbar_y", "rest.lumbar_y"]),
    ];
    for (machine, scenario, names) in cases {
        let vehicle = vehicles::ALL.iter().find(|vehicle| vehicle.name == machine).unwrap();
        let log = vehicle.simulate(&Request { scenario: scenario.into(), seed: 3, settings: Vec::new() }).unwrap();
        for loss in [Loss::Ls, Loss::Huber] {
            let request = FitRequest { loss, profile: names.map(str::to_owned).into(), ..FitRequest::default() };
            let report = vehicle.fit(std::slice::from_ref(&log), &request, &Progress::none()).unwrap();
            assert_eq!(report.profiles.len(), 2, "{machine}: {:?}", report.warnings);
            for profile in &report.profiles {
                let what = format!("{machine} {} {}", profile.parameter, loss.word());
                // The loader's slip is solved by instruments, which minimise no cost.
                assert_eq!(profile.refitted, machine != "wheel-loader", "{what}");
                assert!(profile.ends.iter().all(|end| *end == ProfileEnd::Passed), "{what}");
                for (value, statistic) in profile.values.iter().zip(&profile.statistic) {
                    let root = (value - profile.estimate).abs() / profile.std;
                    let tolerance = if loss == Loss::Ls { 0.04 * root } else { 0.15 * root + 0.1 };
                    assert!((statistic.sqrt() - root).abs() < tolerance + 0.02, "{what}: {statistic} at {root}");
                }
                for (side, end) in profile.noise95.into_iter().enumerate() {
                    let half = [-1.96, 1.96][side] * profile.std;
                    assert!((end - profile.estimate - half).abs() < 0.15 * half.abs(), "{what}: {end}");
                }
                assert!(profile.ci95[0] <= profile.noise95[0] && profile.ci95[1] >= profile.noise95[1]);
            }
        }
    }
}

/// A ratio whose denominator may be zero is not known, however small the standard error of the delta method is.
#[test]
fn a_parameter_whose_profile_has_no_end_is_not_identified() {
    fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
        let mut regression = line([0.0, 0.0], 0, 0);
        regression.groups[0].scale = Scale::Robust;
        for log in task.logs {
            let (x, y) = (log.require("x")?, log.require("y")?);
            for k in 0..log.len() {
                regression.groups[0].push(&[1.0, x[k]], y[k], k as u32);
            }
        }
        if let Some(fit) = session.solve(&regression, &["ratio"])? {
            session.estimate("ratio", fit, |theta| theta[1] / theta[0]);
        }
        Ok(())
    }
    let problem = Problem { targets: |_| vec![target("ratio")], outliers: &[], estimate, validate: |_| Vec::new() };
    let rows = line([0.35, 4.0], 40, 3);
    let mut log = Log { time: (0..40).map(f64::from).collect(), ..Log::default() };
    log.push("x", (0..40).map(|i| rows.groups[0].row(i)[1]).collect::<Vec<_>>());
    log.push("y", rows.groups[0].y.clone());
    let declared = Declared { parameters: Vec::new(), inputs: Vec::new() };
    let request = FitRequest { profile: vec!["ratio".into()], loss: Loss::Ls, ..FitRequest::default() };
    let report = fit(&problem, "line", &declared, &[log], &request, &Progress::none()).unwrap();
    let told = &report.profiles[0];
    assert!(told.ends.contains(&ProfileEnd::Open), "{told:?}");
    assert_ne!(report.parameters["ratio"].verdict, Verdict::Identified);
    assert!(report.warnings.iter().any(|line| line.contains("profile has no")), "{:?}", report.warnings);
}

/// What is fitted is a mass, hardly, and a moment, well: the height is their quotient.
#[test]
fn the_product_that_the_logs_do_determine_is_said() {
    fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
        let mut rows = Rows::new("balance", "N", 2);
        for log in task.logs {
            let (x, y) = (log.require("x")?, log.require("y")?);
            for k in 0..log.len() {
                rows.push(&[0.002 * (0.7 * k as f64).cos(), x[k]], y[k], k as u32);
            }
        }
        let regression = Regression {
            name: "balance".into(),
            unknowns: vec![Unknown::free("m"), Unknown::free("m h")],
            groups: vec![rows],
            constraints: Vec::new(),
        };
        if let Some(fit) = session.solve(&regression, &["mass", "height"])? {
            session.estimate("mass", fit, |theta| theta[0]);
            session.estimate("height", fit, |theta| theta[1] / theta[0]);
        }
        Ok(())
    }
    let problem = Problem {
        targets: |_| ["mass", "height"].map(target).into(),
        outliers: &[],
        estimate,
        validate: |_| Vec::new(),
    };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut log = Log { time: (0..400).map(f64::from).collect(), ..Log::default() };
    let x: Vec<f64> = (0..400).map(|k| (0.31 * f64::from(k)).sin()).collect();
    let y = x.iter().enumerate().map(|(k, x)| {
        let noise: f64 = StandardNormal.sample(&mut rng);
        80.0 * 0.002 * (0.7 * k as f64).cos() + 64.0 * x + 0.5 * noise
    });
    let y: Vec<f64> = y.collect();
    log.push("x", x);
    log.push("y", y);
    let declared = Declared { parameters: Vec::new(), inputs: Vec::new() };
    let request = FitRequest { loss: Loss::Ls, ..FitRequest::default() };
    let report = fit(&problem, "balance", &declared, &[log], &request, &Progress::none()).unwrap();
    assert!(report.parameters.values().all(|parameter| !parameter.identified));
    let told: Vec<_> = report.notes.iter().filter(|note| note.contains("mass * height = 64")).collect();
    assert!(!told.is_empty(), "{:?}", report.notes);
}

/// A single straight climb: refits with a mass of half or twice as much fit as well, which its standard error does not see.
#[test]
fn a_parameter_whose_profile_is_wider_than_its_standard_error_is_not_identified() {
    let ride = Request { scenario: "climb".into(), seed: 1, settings: Vec::new() };
    let log = vehicles::wheelchair::VEHICLE.simulate(&ride).unwrap();
    let profile = vec!["chair.mass".to_owned()];
    let request = FitRequest { profile, ..FitRequest::default() };
    let report = vehicles::wheelchair::VEHICLE.fit(&[log], &request, &Progress::none()).unwrap();
    let (mass, [low, high]) = (&report.parameters["chair.mass"], report.profiles[0].ci95);
    assert!(high - low > 1.5 * (mass.ci95[1] - mass.ci95[0]), "{low} {high} {:?}", mass.ci95);
    assert!(!mass.identified && report.warnings.iter().any(|text| text.contains("its profile is wider")));
}
