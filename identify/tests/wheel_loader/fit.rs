//! The loader's identification on simulated logs whose truth is known.

use rayon::prelude::*;
use wheelstate::estimator::wheel_loader::Parameters;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::{FitRequest, Known};
use wheelstate_identify::progress::Progress;
use wheelstate_identify::result::{FitReport, Parameter};
use wheelstate_identify::simulate::Request;
use wheelstate_identify::solve::{Loss, Options, solve};
use wheelstate_identify::vehicles::wheel_loader;

use crate::support::{median, quantile};

fn log(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Log {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    wheel_loader::VEHICLE.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap()
}

fn fitted(log: Log, request: &FitRequest) -> FitReport {
    wheel_loader::VEHICLE.fit(&[log], request, &Progress::default()).unwrap()
}

/// The machine's user starts from a wrong idea of it.
fn request() -> FitRequest {
    let start = [
        ("initial.slip_stiffness", 15.0),
        ("initial.cg_height", 1.1),
        ("initial.cg_ratio", 0.5),
        ("rolling.coefficient", 0.02),
    ];
    FitRequest {
        start: start.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
        ..FitRequest::default()
    }
}

fn errors(reports: &[FitReport], name: &str, truth: f64) -> Vec<f64> {
    reports.iter().map(|report| (report.parameters[name].value - truth).abs()).collect()
}

fn describe(what: &str, reports: &[FitReport]) {
    for (name, truth) in [
        ("initial.slip_stiffness", 19.0),
        ("initial.cg_height", 0.95),
        ("initial.cg_ratio", 0.45),
        ("rolling.coefficient", 0.03),
        ("loader.wheel_radius_front", 0.55),
        ("loader.wheel_radius_rear", 0.55),
    ] {
        let Some(_) = reports[0].parameters.get(name) else { continue };
        let error = errors(reports, name, truth);
        let std: Vec<f64> = reports.iter().map(|report| report.parameters[name].std_error).collect();
        let covered = reports.iter().zip(&error).filter(|(r, e)| **e < 2.0 * r.parameters[name].std_error).count();
        let identified = reports.iter().filter(|report| report.parameters[name].identified).count();
        println!(
            "{what:28} {name:26} error median {:7.3} % p95 {:7.3} %, std {:7.3} %, {covered} of {} in 2 std, {identified} identified",
            100.0 * median(&error) / truth,
            100.0 * quantile(&error, 0.95) / truth,
            100.0 * median(&std) / truth,
            reports.len(),
        );
    }
}

fn study(scenario: &str, settings: &[(&str, f64)], request: &FitRequest, seeds: u64) -> Vec<FitReport> {
    (0..seeds).into_par_iter().map(|seed| fitted(log(scenario, seed, settings), request)).collect()
}

#[test]
fn accelerating_and_braking_identifies_everything() {
    let reports = study("accelerate-brake", &[], &request(), 20);
    describe("accelerate-brake", &reports);
    assert!(median(&errors(&reports, "initial.cg_height", 0.95)) <= 0.08 * 0.95);
    assert!(median(&errors(&reports, "initial.cg_ratio", 0.45)) <= 0.02 * 0.45);
    assert!(quantile(&errors(&reports, "rolling.coefficient", 0.03), 0.95) <= 0.001);
}

#[test]
fn with_known_radii_the_centre_of_gravity_is_found() {
    let only = ["rolling.coefficient", "initial.slip_stiffness", "initial.cg_ratio", "initial.cg_height"];
    let request = FitRequest { only: only.map(str::to_owned).to_vec(), ..request() };
    let reports = study("accelerate-brake", &[], &request, 20);
    describe("accelerate-brake, radii known", &reports);
    assert!(median(&errors(&reports, "initial.cg_height", 0.95)) <= 0.08 * 0.95);
    assert!(median(&errors(&reports, "initial.cg_ratio", 0.45)) <= 0.02 * 0.45);
}

#[test]
fn wrong_radii_are_found() {
    let mut wide = request();
    wide.settings.push(("initial.wheel_radius_std".to_owned(), 0.003));
    let reports = study("accelerate-brake", &[("plant.wheel_radius_front_error", 0.003)], &wide, 20);
    describe("accelerate-brake, r_f +0.3 %", &reports);
    let truth = 0.55 * 1.003;
    assert!(median(&errors(&reports, "loader.wheel_radius_front", truth)) < 4e-4 * truth);
    assert!(median(&errors(&reports, "initial.cg_ratio", 0.45)) <= 0.02 * 0.45);
}

#[test]
fn constant_torque_says_nothing_about_the_height() {
    let reports = study("bumpy-c", &[], &request(), 20);
    describe("bumpy-c", &reports);
    for report in &reports {
        assert!(!report.parameters["initial.cg_height"].identified, "{:?}", report.parameters["initial.cg_height"]);
        let mut told = report.warnings.iter().chain(&report.notes);
        assert!(told.any(|text| text.starts_with("initial.cg_height is not identified")));
        for name in ["loader.wheel_radius_front", "loader.wheel_radius_rear"] {
            assert!(!report.parameters[name].identified, "{name}: {:?}", report.parameters[name]);
        }
    }
    let errors = errors(&reports, "initial.cg_ratio", 0.45);
    let within = reports.iter().zip(&errors).filter(|(r, e)| **e < 2.0 * r.parameters["initial.cg_ratio"].std_error);
    assert!(median(&errors) < 0.12 * 0.45 && within.count() >= 16);
}

/// A speed that is late by as much as the whole slip: the delay is found, and with it the stiffness, which would be half as
/// large without; a gap of a second does not matter.
#[test]
fn a_late_speed_is_fitted_along_with_its_interval() {
    let mut errors = Vec::new();
    for (seed, samples) in [(31, 1), (32, 2), (33, 2), (34, 3), (35, 5)] {
        let mut log = log("accelerate-brake", seed, &[]);
        let speed = &mut log.channels.iter_mut().find(|channel| channel.name == "speed").unwrap().values;
        speed.rotate_right(samples);
        speed[1000..1100].fill(f64::NAN);
        let report = fitted(log, &request());
        let (delay, truth) = (&report.delays[0], 0.01 * samples as f64);
        println!("{truth} s: {:.4} +- {:.4} s", delay.value, delay.std_error);
        assert!(delay.channel == "speed" && delay.std_error < 0.003, "{delay:?}");
        errors.push((delay.value - truth) / delay.std_error);
        let stiffness = &report.parameters["initial.slip_stiffness"];
        assert!((stiffness.value - 19.0).abs() < 2.5 * stiffness.std_error, "{stiffness:?}");
        assert!(stiffness.std_error < 4.0, "{stiffness:?}");
    }
    assert!(errors.iter().all(|z| z.abs() < 3.0), "{errors:?}");
}

/// The log with one wheel speed later than the others by so many samples, or earlier.
fn with_late(mut log: Log, channel: &str, samples: isize) -> Log {
    let values = &mut log.channels.iter_mut().find(|other| other.name == channel).unwrap().values;
    let last = values.len() as isize - 1;
    *values = (0..=last).map(|k| values[(k - samples).clamp(0, last) as usize]).collect();
    log
}

/// Wheel speeds of one axle with a clock of their own look like slip that goes from one axle to the other: the delay is found
/// and the ratio of the loads keeps within its interval.
#[test]
fn a_late_wheel_speed_of_one_axle_is_no_load() {
    for (seed, channel, samples) in [
        (51, "wheel_speed_front", 1),
        (52, "wheel_speed_front", -1),
        (53, "wheel_speed_rear", 1),
        (54, "wheel_speed_rear", -1),
        (55, "wheel_speed_front", 2),
        (56, "wheel_speed_rear", 2),
    ] {
        let report = fitted(with_late(log("accelerate-brake", seed, &[]), channel, samples), &request());
        let ratio = &report.parameters["initial.cg_ratio"];
        let delay = report.delays.iter().find(|delay| delay.channel == "wheel_speed_front").unwrap();
        let truth = 0.01 * samples as f64 * if channel == "wheel_speed_front" { 1.0 } else { -1.0 };
        println!(
            "{channel} {samples}: {:.4} +- {:.4} s, ratio {:.3} +- {:.3}",
            delay.value, delay.std_error, ratio.value, ratio.std_error
        );
        assert!((ratio.value - 0.45).abs() < 3.0 * ratio.std_error, "{channel} {samples}: {ratio:?}");
        assert!((delay.value - truth).abs() < 3.0 * delay.std_error, "{channel} {samples}: {delay:?}");
        assert!(delay.std_error < 0.004, "{delay:?}");
    }
}

/// At constant torque nothing tells a delay from slip: the interval contains what a delay would do, says so, and a user who
/// knows of one clock gets a narrower one.
#[test]
fn where_a_delay_between_the_wheel_speeds_does_not_show_it_is_considered() {
    let usual = fitted(log("bumpy-c", 57, &[]), &request());
    let one_clock = vec![("wheel_speed.delay_std".to_owned(), 0.0)];
    let known = fitted(log("bumpy-c", 57, &[]), &FitRequest { sensors: one_clock, ..request() });
    let [usual, known] = [&usual, &known].map(|report| &report.parameters["initial.cg_ratio"]);
    println!("{usual:?}\n{known:?}");
    let named = |ratio: &Parameter| ratio.contributions.iter().any(|part| part.cause.contains("delay of wheel_speed"));
    assert!(named(usual) && !named(known) && known.std_error < usual.std_error);
}

/// The slip is noisier than it is large: least squares must fail, and its failure must be seen.
#[test]
fn plain_least_squares_fails_and_is_caught() {
    let known = Known::new(wheel_loader::VEHICLE.parameters());
    let log = log("accelerate-brake", 1, &[]);
    let options = Options { loss: Loss::Ls, ..Options::default() };
    let plain = solve(&wheel_loader::problem::slip_regression(&log, &known, false).unwrap(), &options).unwrap();
    let instrumented = solve(&wheel_loader::problem::slip_regression(&log, &known, true).unwrap(), &options).unwrap();
    println!(
        "K: plain {:.1}, instrumented {:.1}; noise share {:.2}",
        plain.theta[0], instrumented.theta[0], plain.noise_share[0]
    );
    assert!(plain.theta[0] < 0.7 * 19.0 && (instrumented.theta[0] - 19.0).abs() < 0.1 * 19.0);
    assert!(plain.noise_share[0] > 0.5, "the warning that the regressor is noise");
}

/// Windows and clusters are times: exact sensors give the same answer, as certain, at every rate.
#[test]
fn exact_sensors_give_the_truth_at_every_rate() {
    let exact = ["noise.speed", "noise.wheel_speed", "noise.torque", "noise.slope"].map(|name| (name, 0.0));
    let report = |period: f64| {
        let settings: Vec<(&str, f64)> = exact.into_iter().chain([("sample_period", period)]).collect();
        fitted(log("accelerate-brake", 1, &settings), &FitRequest { exact: true, ..FitRequest::default() })
    };
    let usual = report(0.01);
    for period in [0.02, 0.01, 0.002] {
        let report = report(period);
        for (name, truth, bound) in [
            ("rolling.coefficient", 0.03, 0.005),
            ("initial.cg_ratio", 0.45, 0.002),
            ("initial.cg_height", 0.95, 0.04),
            ("initial.slip_stiffness", 19.0, 0.02),
            ("loader.wheel_radius_front", 0.55, 2e-4),
            ("loader.wheel_radius_rear", 0.55, 2e-4),
        ] {
            let found = &report.parameters[name];
            assert!(found.identified && (found.value / truth - 1.0).abs() < bound, "{name} at {period} s: {found:?}");
        }
        for name in ["rolling.coefficient", "initial.cg_ratio", "initial.slip_stiffness"] {
            let ratio = report.parameters[name].std_error / usual.parameters[name].std_error;
            assert!((0.7..1.4).contains(&ratio), "{name} at {period} s: standard error {ratio} times that at 0.01 s");
        }
    }
}

/// At walking pace against the brakes, `(T - B s)/r = f s W/2` per axle with `s = tanh(v/v_s)`: what the user says of
/// `v_s` reaches brakes and rolling resistance of the fit.
#[test]
fn the_speed_over_which_signs_change_is_the_users() {
    let (speed, smoothing, brake, rolling, radius) = (0.5, 0.5, 400.0, 0.02, 0.55);
    let sign = f64::tanh(speed / smoothing);
    let torque = sign * (brake + 0.5 * rolling * 4700.0 * 9.80665 * radius);
    let samples = 2000;
    let mut log = Log {
        source: "creeping".to_owned(),
        time: (0..samples).map(|k| 0.01 * f64::from(k)).collect(),
        ..Log::default()
    };
    let constant = |value: f64| vec![value; samples as usize];
    for side in ["front", "rear"] {
        // A little ripple, without which there is no noise to weigh windows by.
        let ripple = (0..samples).map(|k| torque + (0.7 * f64::from(k)).sin());
        log.push(&format!("torque_{side}"), ripple.collect::<Vec<_>>());
        log.push(&format!("brake_{side}"), constant(brake));
        log.push(&format!("wheel_speed_{side}"), constant(speed / radius));
    }
    log.push("speed", constant(speed));
    let request = FitRequest {
        settings: vec![("rolling.smoothing_speed".to_owned(), smoothing)],
        only: vec!["rolling.coefficient".to_owned()],
        ..FitRequest::default()
    };
    let found = fitted(log, &request).parameters["rolling.coefficient"].value;
    assert!((found / rolling - 1.0).abs() < 1e-3, "{found} instead of {rolling}");
}

/// Back and forth on a constant grade, `m v' + sum I v'/r^2 = sum T/r - f m g cos(grade) s(v) - m g sin(grade)`, wheels that
/// slip by `T/(r K N)`, and a slope sensor that is wrong by `bias`.
fn back_and_forth(bias: f64) -> Log {
    let known = Parameters::default();
    let (machine, unknowns) = (&known.loader, &known.initial);
    let (mass, radius, base) = (machine.mass, machine.wheel_radius_front, machine.wheelbase);
    let inertia = (machine.axle_inertia_front + machine.axle_inertia_rear) / (radius * radius);
    let (rolling, grade, gravity) = (0.03, 0.02_f64, 9.80665);
    let samples = 4000;
    let mut log = Log {
        source: "back and forth".to_owned(),
        time: (0..samples).map(|k| 0.01 * f64::from(k)).collect(),
        ..Log::default()
    };
    // A little ripple, without which there is no noise to weigh windows by.
    let ripple = |k: usize| (0.7 * k as f64).sin();
    let mut columns = vec![Vec::new(); 4];
    for (k, t) in log.time.iter().enumerate() {
        let (speed, rate) = (2.0 * (0.5 * t).sin(), (0.5 * t).cos());
        let resistance = rolling * grade.cos() * (speed / 0.05_f64).tanh() + grade.sin();
        let force = (mass + inertia) * rate + mass * gravity * resistance;
        let transfer = mass * unknowns.cg_height / base * (rate + gravity * grade.sin());
        let front = mass * gravity * grade.cos() * unknowns.cg_ratio - transfer;
        for (axle, load) in [front, mass * gravity * grade.cos() - front].into_iter().enumerate() {
            let slip = 0.5 * force / (unknowns.slip_stiffness * load);
            columns[axle].push(0.5 * radius * force + ripple(k));
            columns[2 + axle].push((speed + speed.abs() * slip + 1e-4 * ripple(3 * k)) / radius);
        }
    }
    let names = ["torque_front", "torque_rear", "wheel_speed_front", "wheel_speed_rear"];
    names.into_iter().zip(columns).for_each(|(name, values)| log.push(name, values));
    log.push("slope", (0..log.len()).map(|k| grade + bias + 1e-4 * ripple(k)).collect::<Vec<_>>());
    log.push("speed", log.time.iter().map(|t| 2.0 * (0.5 * t).sin()).collect::<Vec<_>>());
    log
}

/// Driven both ways the error of the slope is fitted along; one way it looks like rolling resistance, which is then
/// identified only if the user says how well the slope is known.
#[test]
fn a_biased_slope_is_no_rolling_resistance() {
    let both = FitRequest { only: vec!["rolling.coefficient".to_owned()], ..FitRequest::default() };
    for bias in [-0.06, -0.03, -0.005, 0.005, 0.03, 0.06] {
        let report = fitted(back_and_forth(bias), &both);
        let rolling = &report.parameters["rolling.coefficient"];
        println!("bias {bias}: {:.4} +- {:.4}, {:?}", rolling.value, rolling.std_error, report.warnings);
        assert!(rolling.identified && (rolling.value - 0.03).abs() < 5e-4, "bias {bias}: {rolling:?}");
        let told = report.notes.iter().any(|note| note.starts_with("slope of back and forth is in the mean"));
        assert!(told, "bias {bias}: {:?}", report.notes);

        let mut one_way = log("accelerate-brake", 3, &[]);
        let slope = one_way.channels.iter_mut().find(|channel| channel.name == "slope").unwrap();
        slope.values.iter_mut().for_each(|slope| *slope += bias);
        assert!(!fitted(one_way.clone(), &request()).parameters["rolling.coefficient"].identified, "bias {bias}");
        let declared = vec![("slope.bias_std".to_owned(), bias.abs())];
        let report = fitted(one_way, &FitRequest { sensors: declared, ..request() });
        let rolling = &report.parameters["rolling.coefficient"];
        assert_eq!(rolling.identified, bias.abs() < 0.01, "bias {bias}: {rolling:?}");
        let within = (rolling.value - 0.03).abs() < 2.0 * rolling.std_error;
        assert!(within || !rolling.identified, "bias {bias}: {rolling:?}");
    }
}

/// At constant torque slip stiffness and radii are one unknown: a note says which of them go together. Of a machine whose radii
/// are others than given, that leads back to the stiffness which the same drive gives with the right ones.
#[test]
fn constant_torque_says_which_stiffness_goes_with_which_radii() {
    let stiffness = |errors: [f64; 2], seed: u64| {
        let names = ["plant.wheel_radius_front_error", "plant.wheel_radius_rear_error"];
        let settings: Vec<(&str, f64)> = names.into_iter().zip(errors.map(|error| 1e-3 * error)).collect();
        let report = fitted(log("bumpy-c", seed, &settings), &request());
        let note = report.notes.iter().find(|note| note.starts_with("determined is the slip")).unwrap();
        let words = note.split(|c: char| c.is_whitespace() || c == ',');
        let numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
        let [as_given, _, front, _, rear] = numbers[..] else { panic!("{note}") };
        println!("{errors:?}, seed {seed}: {note}");
        (as_given, as_given + front * errors[0] + rear * errors[1])
    };
    for errors in [[1.0, 0.0], [0.0, -1.0]] {
        let (mut off, mut left) = (0.0, 0.0);
        for seed in 20..26 {
            let (truth, (as_given, on_the_line)) = (stiffness([0.0; 2], seed).0, stiffness(errors, seed));
            off += (as_given - truth) / 6.0;
            left += (on_the_line - truth) / 6.0;
        }
        assert!(off.abs() > 1.0 && left.abs() < 0.3 * off.abs(), "{errors:?}: {off} as given, {left} on the line");
    }
}
