//! Accuracy of the nursing robot's identification over simulated patients, and whether the intervals
//! are honest. The plant is the exact five-coordinate robot with motor lag, sensor noise and quantisation.

#[path = "../../tests/support/mod.rs"]
mod support;

use support::{median, quantile};
use wheelstate::Variables;
use wheelstate::estimator::nursing_robot::Parameters;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::fit;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::report::FitReport;
use wheelstate_identify::request::FitRequest;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::simulate::nursing_robot::run;
use wheelstate_identify::vehicle::Vehicle;

/// Patients of 50 to 100 kg and 1.55 to 1.85 m, weighed and measured before the drive.
fn patient(seed: u64) -> (Log, Parameters, FitRequest) {
    let share = |k: u64| ((seed * 7919 + k * 104_729) % 1000) as f64 / 999.0;
    let height = 1.55 + 0.3 * share(1);
    let settings = vec![
        ("human.nominal_mass".to_owned(), 50.0 + 50.0 * share(2)),
        ("human.com_height".to_owned(), 0.1803 * height),
        ("human.gyration_radius".to_owned(), 0.1428 * height),
    ];
    let request = Request { scenario: "identification".into(), seed, settings: settings.clone() };
    let run = run(&request).unwrap();
    (run.log, run.truth, FitRequest { settings, ..FitRequest::default() })
}

fn truth(parameters: &Parameters, name: &str) -> f64 {
    let index = Parameters::declare().iter().position(|variable| variable.name == name).unwrap();
    parameters.to_vec()[index]
}

fn run_fit(log: &Log, request: &FitRequest) -> FitReport {
    fit(Vehicle::NursingRobot, std::slice::from_ref(log), request, &Progress::none()).unwrap()
}

fn without_angles(log: &Log) -> Log {
    let mut log = log.clone();
    log.channels.retain(|c| !["tilt", "tilt_rate", "roll", "roll_rate"].contains(&c.name.as_str()));
    log
}

/// Relative error in percent.
fn error(report: &FitReport, parameters: &Parameters, name: &str) -> f64 {
    100.0 * (report.parameters[name].value / truth(parameters, name) - 1.0).abs()
}

const BOUNDS: [(&str, f64, f64); 6] = [
    ("human.stiffness_pitch", 1.2, 4.0),
    ("human.damping_pitch", 6.0, 15.0),
    ("rolling.coefficient", 1.0, 2.0),
    ("robot.drive_efficiency", 0.3, 0.6),
    ("human.stiffness_roll", 2.0, 6.0),
    ("human.damping_roll", 8.0, 20.0),
];

#[test]
fn weak_form_over_patients() {
    let mut errors = vec![Vec::new(); BOUNDS.len()];
    let (mut inside, mut all) = (0, 0);
    let mut z = Vec::new();
    for seed in 0..32 {
        let (log, parameters, request) = patient(seed);
        let report = run_fit(&log, &request);
        for (sample, (name, ..)) in errors.iter_mut().zip(BOUNDS) {
            sample.push(error(&report, &parameters, name));
        }
        for (name, p) in &report.parameters {
            let t = truth(&parameters, name);
            all += 1;
            inside += usize::from(p.ci95[0] <= t && t <= p.ci95[1]);
            z.push((name.clone(), (p.value - t) / p.std_error));
            assert!(p.identified, "seed {seed}: {:?}", report.warnings);
        }
    }
    for (sample, (name, typical, rare)) in errors.iter().zip(BOUNDS) {
        let (m, q) = (median(sample), quantile(sample, 0.95));
        let zs: Vec<f64> = z.iter().filter(|(n, _)| n == name).map(|(_, z)| *z).collect();
        let mean = zs.iter().sum::<f64>() / zs.len() as f64;
        let rms = (zs.iter().map(|z| z * z).sum::<f64>() / zs.len() as f64).sqrt();
        println!(
            "{name}: median {m:.2} % (bound {typical}), 95 % {q:.2} % (bound {rare}); z mean {mean:.2} rms {rms:.2}"
        );
        assert!(m <= typical && q <= rare, "{name}");
    }
    println!("truth inside the 95 % interval: {inside} of {all}");
    assert!(inside as f64 > 0.85 * all as f64);
}

#[test]
fn output_error_from_wheels_alone() {
    let (mut stiffness, mut damping) = (Vec::new(), Vec::new());
    for seed in 0..16 {
        let (log, parameters, request) = patient(seed);
        let report = run_fit(&without_angles(&log), &request);
        stiffness.push(error(&report, &parameters, "human.stiffness_pitch"));
        damping.push(error(&report, &parameters, "human.damping_pitch"));
    }
    let figures = |sample: &[f64]| (median(sample), quantile(sample, 0.95));
    println!("stiffness {:?}, damping {:?} %", figures(&stiffness), figures(&damping));
    assert!(median(&stiffness) <= 5.0 && quantile(&stiffness, 0.95) <= 15.0);
}
