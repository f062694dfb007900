//! Whole fits of the nursing robot: what is found, what is refused, and why.

use crate::support::{vector_table, vector_text};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::{FitError, FitRequest};
use wheelstate_identify::progress::Progress;
use wheelstate_identify::result::FitReport;
use wheelstate_identify::vehicles::nursing_robot;

/// The reference log, 40 s of excitation, with these channels besides torque, speed and yaw rate.
fn reference(channels: &[(&str, &str)]) -> Log {
    let table = vector_table("nursing_robot/ident_log.csv");
    let mut log = Log { source: "reference".into(), time: table.values("t").into(), ..Log::default() };
    for (name, column) in [("torque_left", "tau_l"), ("torque_right", "tau_r"), ("speed", "v"), ("yaw_rate", "omega")]
        .iter()
        .chain(channels)
    {
        log.push(name, table.values(column));
    }
    log
}

const ALL: [(&str, &str); 3] = [("tilt", "phi_y"), ("roll", "phi_x"), ("tilt_rate", "gyro_y")];

fn truth(name: &str) -> f64 {
    let expected: serde_json::Value = serde_json::from_str(&vector_text("nursing_robot/ident_expected.json")).unwrap();
    expected["truth"][name].as_f64().unwrap()
}

fn request() -> FitRequest {
    let settings = [
        ("human.nominal_mass", "m_h"),
        ("human.swaying_fraction", "mu"),
        ("human.com_height", "h"),
        ("human.gyration_radius", "rho"),
    ];
    let settings = settings.map(|(name, key)| (name.to_owned(), truth(key))).to_vec();
    FitRequest { settings, exact: true, ..FitRequest::default() }
}

fn run(log: &Log, request: &FitRequest) -> FitReport {
    let report = nursing_robot::VEHICLE.fit(std::slice::from_ref(log), request, &Progress::none()).unwrap();
    for (name, p) in &report.parameters {
        println!("{name}: {:.5} +- {:.5} {} {:?}", p.value, p.std_error, p.unit, p.verdict);
    }
    println!(
        "{:?}\n{:?}\ncond {} {:?}",
        report.warnings, report.notes, report.condition_number, report.correlation_worst_pair
    );
    for signal in &report.validation.signals {
        println!("{signal:?}");
    }
    report
}

const TRUTH: [(&str, &str); 7] = [
    ("human.stiffness_pitch", "k_y"),
    ("human.damping_pitch", "c_y"),
    ("human.rest_pitch", "phi_y0"),
    ("human.stiffness_roll", "k_x"),
    ("human.damping_roll", "c_x"),
    ("human.rest_roll", "phi_x0"),
    ("rolling.coefficient", "f"),
];

#[test]
fn everything_is_found_with_all_channels() {
    for refine in [false, true] {
        let report = run(&reference(&ALL), &FitRequest { refine, ..request() });
        // eight, and the errors that the estimator counts for three of them
        assert_eq!(report.parameters.len(), 11);
        for (name, key) in TRUTH {
            let p = &report.parameters[name];
            assert!(p.identified, "{name}: {:?}", report.warnings);
            assert!((p.value - truth(key)).abs() < 3.5 * p.std_error, "{name}: {} +- {}", p.value, p.std_error);
        }
        let eta = &report.parameters["robot.drive_efficiency"];
        assert!((eta.value - 1.0).abs() < 3.0 * eta.std_error && eta.std_error < 0.005);
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
        for signal in &report.validation.signals {
            // The tilt itself is hardly larger than its noise of 0.01 rad.
            let good = if signal.name == "tilt" { signal.rmse < 0.0115 } else { signal.fit_percent > 85.0 };
            assert!(good && signal.residual_correlation.abs() < 0.7, "{signal:?}");
        }
    }
}

#[test]
fn wheels_alone_give_the_sway_but_neither_rest_nor_roll() {
    let report = run(&reference(&[]), &request());
    let k = &report.parameters["human.stiffness_pitch"];
    assert!((k.value / truth("k_y") - 1.0).abs() < 0.15, "{}", k.value);
    for name in ["human.rest_pitch", "human.stiffness_roll", "human.damping_roll", "human.rest_roll"] {
        assert!(!report.parameters[name].identified && report.parameters[name].value.is_nan());
        assert!(report.warnings.iter().any(|warning| warning.starts_with(name)), "{name}");
    }
    assert!((report.parameters["rolling.coefficient"].value / truth("f") - 1.0).abs() < 0.05);
}

#[test]
fn the_person_can_be_weighed() {
    let only = vec!["human.nominal_mass".to_owned(), "rolling.coefficient".to_owned()];
    for channels in [&ALL[..], &[]] {
        let mut request = FitRequest { only: only.clone(), ..request() };
        request.settings.push(("human.stiffness_pitch".into(), truth("k_y")));
        request.settings.push(("human.damping_pitch".into(), truth("c_y")));
        let report = run(&reference(channels), &request);
        let p = &report.parameters["human.nominal_mass"];
        assert!((p.value / truth("m_h") - 1.0).abs() < 0.02, "{} with {} channels", p.value, channels.len());
        assert_eq!(report.parameters.len(), 2);
    }
    let only = vec!["robot.mass".to_owned(), "rolling.coefficient".to_owned()];
    let report = run(&reference(&ALL), &FitRequest { only, ..request() });
    assert!((report.parameters["robot.mass"].value / 160.0 - 1.0).abs() < 0.01);
}

/// A log of sensor noise around constant values.
fn still(speed: f64, torque: f64, noise: f64, seconds: usize) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
    let n = seconds * 100;
    let mut log = Log { source: "still".into(), time: (0..n).map(|i| i as f64 * 0.01).collect(), ..Log::default() };
    for (name, value, std) in [
        ("torque_left", torque, 0.3),
        ("torque_right", torque, 0.3),
        ("speed", speed, 0.005),
        ("yaw_rate", 0.0, 0.005),
        ("tilt", 0.05, 0.01),
        ("tilt_rate", 0.0, 0.01),
        ("roll", 0.0, 0.01),
    ] {
        log.push(name, (0..n).map(|_| value + noise * std * normal()).collect::<Vec<_>>());
    }
    log
}

#[test]
fn nothing_is_identified_without_excitation() {
    // Standing, with and without noise; constant speed; too short.
    let creep = 0.015 * 9.81 * 230.0 * 0.0825 / 2.0;
    for (what, log) in [
        ("standing", still(0.0, 0.0, 1.0, 40)),
        ("standing, no noise", still(0.0, 0.0, 0.0, 40)),
        ("constant speed", still(0.8, creep, 1.0, 40)),
        ("constant speed, no noise", still(0.8, creep, 0.0, 40)),
        ("short", still(0.0, 0.0, 1.0, 1)),
    ] {
        for channels in [true, false] {
            println!("--- {what} {channels}");
            let mut log = log.clone();
            if !channels {
                log.channels.retain(|channel| !channel.name.starts_with("tilt") && channel.name != "roll");
            }
            let report = run(&log, &FitRequest::default());
            // eight, and the errors that the estimator counts for three of them
            assert_eq!(report.parameters.len(), 11);
            for (name, p) in &report.parameters {
                // At constant speed the rolling resistance is what the torque shows, but not apart from the efficiency.
                assert!(!p.identified, "{what}: {name} {p:?}");
            }
            assert!(report.has_warnings());
        }
    }
}

#[test]
fn impossible_requests_are_refused() {
    let log = reference(&ALL);
    let refused = |only: &[&str]| -> FitError {
        let only = only.iter().map(|name| (*name).to_owned()).collect();
        nursing_robot::VEHICLE
            .fit(std::slice::from_ref(&log), &FitRequest { only, ..request() }, &Progress::none())
            .unwrap_err()
    };
    assert!(refused(&["robot.colour"]).to_string().contains("human.stiffness_pitch"));
    assert!(refused(&["robot.mass", "human.nominal_mass"]).to_string().contains("sum"));
    assert!(refused(&["robot.mass", "robot.drive_efficiency"]).to_string().contains("scales"));
    let mut without = log.clone();
    without.channels.retain(|channel| channel.name != "torque_left");
    let error = nursing_robot::VEHICLE.fit(&[without], &request(), &Progress::none()).unwrap_err();
    assert!(error.to_string().contains("torque_left"), "{error}");
}
