//! Accuracy of the nursing robot's identification over simulated patients, and whether the intervals
//! hold the truth as often as they say. The plant is the exact five-coordinate robot with motor lag, sensor noise and quantisation.

use crate::support::{median, quantile};
use wheelstate::Variables;
use wheelstate::estimator::nursing_robot::Parameters;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::result::FitReport;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicles::nursing_robot;
use wheelstate_identify::vehicles::nursing_robot::simulate::run;

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
    (run.log, run.truth, FitRequest { settings, exact: true, ..FitRequest::default() })
}

fn truth(parameters: &Parameters, name: &str) -> f64 {
    let index = Parameters::declare().iter().position(|variable| variable.name == name).unwrap();
    parameters.to_vec()[index]
}

fn run_fit(log: &Log, request: &FitRequest) -> FitReport {
    nursing_robot::VEHICLE.fit(std::slice::from_ref(log), request, &Progress::none()).unwrap()
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

/// Median and 95 % of the relative errors, and the errors in standard errors, by parameter.
struct Scores {
    name: String,
    errors: Vec<f64>,
    z: Vec<f64>,
}

fn scores(seeds: std::ops::Range<u64>, flags: &FitRequest) -> Vec<Scores> {
    let mut all: Vec<Scores> = Vec::new();
    for seed in seeds {
        let (log, parameters, request) = patient(seed);
        let report = run_fit(&log, &FitRequest { settings: request.settings, exact: true, ..flags.clone() });
        // the errors that the estimator counts have no truth
        let with_truth = report.parameters.iter().filter(|(_, p)| p.std_error > 0.0);
        for (index, (name, p)) in with_truth.enumerate() {
            assert!(p.identified, "seed {seed}: {:?}", report.warnings);
            if index == all.len() {
                all.push(Scores { name: name.clone(), errors: Vec::new(), z: Vec::new() });
            }
            all[index].errors.push(error(&report, &parameters, name));
            all[index].z.push((p.value - truth(&parameters, name)) / p.std_error);
        }
    }
    for Scores { name, errors, z } in &all {
        println!(
            "{name}: median {:.2} %, 95 % {:.2} %; z mean {:.2} rms {:.2}, inside {:.3}",
            median(errors),
            quantile(errors, 0.95),
            z.iter().sum::<f64>() / z.len() as f64,
            rms(z),
            inside(z)
        );
    }
    all
}

fn rms(z: &[f64]) -> f64 {
    (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt()
}

/// Share of truths inside the 95 % interval.
fn inside(z: &[f64]) -> f64 {
    z.iter().filter(|z| z.abs() < 1.96).count() as f64 / z.len() as f64
}

/// Each parameter's interval is as wide as its errors (over 160 patients the root mean square is 0.3 to 1.2
/// standard errors), and nearly all truths are inside.
fn assert_honest(all: &[Scores]) {
    for Scores { name, z, .. } in all {
        assert!((0.25..1.4).contains(&rms(z)) && inside(z) > 0.86, "{name}: {} {}", rms(z), inside(z));
    }
    let mean = all.iter().map(|one| inside(&one.z)).sum::<f64>() / all.len() as f64;
    println!("truth inside the 95 % interval: {:.1} %", 100.0 * mean);
    assert!(mean > 0.92);
}

#[test]
fn the_weak_form_finds_the_joints_of_many_patients() {
    let all = scores(0..64, &FitRequest::default());
    for (name, typical, rare) in BOUNDS {
        let of = all.iter().find(|one| one.name == name).unwrap();
        let (m, q) = (median(&of.errors), quantile(&of.errors, 0.95));
        assert!(m <= typical && q <= rare, "{name}: {m} {q}");
    }
    assert_honest(&all);
}

#[test]
fn correction_removes_the_bias() {
    let plain = scores(100..132, &FitRequest::default());
    let corrected = scores(100..132, &FitRequest { correct: true, ..FitRequest::default() });
    assert_honest(&corrected);
    for (plain, corrected) in plain.iter().zip(&corrected) {
        let mean = |z: &[f64]| (z.iter().sum::<f64>() / z.len() as f64).abs();
        assert!(mean(&corrected.z) < 0.5, "{}: {}", corrected.name, mean(&corrected.z));
        if ["rolling.coefficient", "human.stiffness_pitch", "human.damping_pitch"].contains(&plain.name.as_str()) {
            let rare = |one: &Scores| quantile(&one.errors, 0.95);
            assert!(rare(corrected) < 0.75 * rare(plain), "{}: {} {}", plain.name, rare(corrected), rare(plain));
        }
    }
}

#[test]
fn a_mass_alone_allows_for_the_rolling_coefficient() {
    let mut z = Vec::new();
    for seed in 0..32 {
        let (log, _, mut request) = patient(seed);
        // The floor is up to 30 % off the coefficient that is taken as known.
        request
            .settings
            .push(("robot.drive_efficiency".into(), log.channel("true_robot.drive_efficiency").unwrap()[0]));
        request.only = vec!["robot.mass".into()];
        let report = run_fit(&log, &request);
        let p = &report.parameters["robot.mass"];
        assert!(report.notes.iter().any(|note| note.contains("rolling.coefficient = 0.015")));
        z.push((p.value - 160.0) / p.std_error);
    }
    println!("robot.mass alone: z rms {:.2}, inside {:.2}", rms(&z), inside(&z));
    assert!((0.5..1.3).contains(&rms(&z)));
}

#[test]
fn the_intervals_of_the_output_error_fit_hold_the_truth() {
    let refined = FitRequest { refine: true, ..FitRequest::default() };
    assert_honest(&scores(0..24, &refined));
    assert_honest(&scores(0..24, &FitRequest { correct: true, ..refined }));
}

#[test]
fn the_output_error_fit_finds_the_joints_from_wheels_alone() {
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

/// With a posture that was measured once a robot without tilt sensor knows the body's pitch to 40 mrad.
#[test]
fn a_measured_posture_narrows_the_pitch_of_a_robot_without_tilt_sensor() {
    use super::drive::{estimates, simulated};
    for seed in 0..6 {
        let (log, _, request) = patient(seed);
        let names = ["human.stiffness_pitch", "human.damping_pitch", "human.rest_pitch", "human.rest_pitch_std"];
        let only = names.map(str::to_owned).to_vec();
        let report = run_fit(&log, &FitRequest { only, ..request.clone() });
        assert!(names.iter().all(|name| report.parameters[*name].identified), "{:?}", report.warnings);
        let settings: Vec<(&str, f64)> = request.settings.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        let ride = simulated("smooth-start", seed, &settings);
        let mut p = ride.assumed.clone();
        for name in names {
            p.set(name, report.parameters[name].value).unwrap();
        }
        let stds: Vec<f64> = estimates(&ride.log, &p)[200..].iter().map(|out| 1e3 * out.body_pitch.std).collect();
        println!(
            "patient {seed}: rest within {:.1} mrad, pitch within {:.1} mrad",
            1e3 * report.parameters["human.rest_pitch_std"].value,
            median(&stds)
        );
        assert!(median(&stds) < 40.0, "patient {seed}: {}", median(&stds));
    }
}
