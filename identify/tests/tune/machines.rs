//! The tuner on the machines beside the wheeled robot: what it finds on two logs fits a third one, which it
//! did not see, no worse than the start values do.

use wheelstate_identify::log::Log;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::tune::{Objective, TuneReport, TuneRequest};
use wheelstate_identify::vehicle::Vehicle;
use wheelstate_identify::vehicles::{human_dynamics, nursing_robot, wheel_loader, wheelchair, wheeled_robot};

fn log(vehicle: &Vehicle, scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Log {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    vehicle.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap()
}

fn tuned(vehicle: &Vehicle, logs: [Log; 3], objective: Objective, settings: &[(&str, f64)]) -> TuneReport {
    let request = TuneRequest {
        objective,
        seed: 3,
        population: 12,
        iterations: 5,
        skip: 1.0,
        settings: settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
        ..TuneRequest::default()
    };
    let [a, b, unseen] = logs;
    let report = vehicle.tune(&[a, b], &[unseen], &request, &Progress::none()).unwrap();
    for entry in &report.tuning.nis {
        println!(
            "{vehicle} {} held out {}: {objective:?} {:.4} -> {:.4}, NIS {:.2} -> {:.2}",
            entry.log, entry.held_out, entry.objective_before, entry.objective_after, entry.before, entry.after
        );
    }
    for (name, parameter) in &report.fit.parameters {
        println!("  {name} {:?} -> {:.3e} {:?}", parameter.start, parameter.value, parameter.verdict);
    }
    report
}

#[track_caller]
fn assert_generalises(report: &TuneReport) {
    assert!(report.tuning.best <= report.tuning.start);
    let unseen = report.tuning.nis.iter().find(|entry| entry.held_out).unwrap();
    assert!(unseen.objective_after <= unseen.objective_before, "{unseen:?}");
    assert!(!report.fit.parameters.is_empty());
    let in_range = |p: &wheelstate_identify::result::Parameter| p.value.is_finite() && p.value > 0.0;
    assert!(report.fit.parameters.values().all(in_range));
}

#[test]
fn tuning_improves_the_nursing_robot_on_an_unseen_log() {
    let vehicle = &nursing_robot::VEHICLE;
    let logs = || [("coughs", 1), ("smooth-start", 2), ("lean", 3)].map(|(name, seed)| log(vehicle, name, seed, &[]));
    let report = tuned(vehicle, logs(), Objective::Nll, &[]);
    assert_generalises(&report);
    assert!(report.fit.parameters.keys().all(|name| name.starts_with("sway.")));
    let by_truth = tuned(vehicle, logs(), Objective::Rmse, &[]);
    assert_generalises(&by_truth);
    assert!(by_truth.fit.has_warnings());
    assert!(by_truth.fit.warnings.iter().any(|w| w.contains("degenerate")));
}

#[test]
fn tuning_improves_the_wheel_loader_on_an_unseen_log() {
    let vehicle = &wheel_loader::VEHICLE;
    let logs =
        [("bumpy-c", 1), ("bumpy-d", 2), ("accelerate-brake", 3)].map(|(name, seed)| log(vehicle, name, seed, &[]));
    assert_generalises(&tuned(vehicle, logs, Objective::Nll, &[]));
}

#[test]
fn tuning_improves_the_wheelchair_on_an_unseen_log() {
    let vehicle = &wheelchair::VEHICLE;
    let logs = || [("climb", 1), ("yaw-moment", 2), ("oblique", 3)].map(|(name, seed)| log(vehicle, name, seed, &[]));
    assert_generalises(&tuned(vehicle, logs(), Objective::Nll, &[]));
    let by_truth = tuned(vehicle, logs(), Objective::Rmse, &[]);
    assert!(by_truth.tuning.best < by_truth.tuning.start);
}

#[test]
fn tuning_improves_the_human_body_on_an_unseen_log() {
    let vehicle = &human_dynamics::VEHICLE;
    let logs = [1, 2, 3].map(|seed| {
        let log = log(vehicle, "seated-braking", seed, &[]);
        // a second and a half is enough to show it
        let kept = log.time.iter().take_while(|t| **t < 1.5).count();
        log.slice(0..kept, |_| true)
    });
    let settings = [("use.seat_wrench", 1.0), ("use.imu", 1.0)];
    // the plant has the noise that is declared: no setting is much better
    assert_generalises(&tuned(vehicle, logs.clone(), Objective::Nll, &settings));
    // from a wrong start the data lead back
    let wrong =
        [settings[0], settings[1], ("variance.imu_acceleration", 9e-2), ("variance.joint_acceleration", 2.5e-2)];
    let report = tuned(vehicle, logs, Objective::Nll, &wrong);
    assert_generalises(&report);
    assert!(report.tuning.best < report.tuning.start);
}

fn identify(folder: &std::path::Path, arguments: &str) -> Option<i32> {
    let mut command = assert_cmd::Command::cargo_bin("identify").unwrap();
    command.current_dir(folder).args(arguments.split_whitespace()).output().unwrap().status.code()
}

/// As a user meets it: the exit code tells of warnings, the file has the shape of fit.json with the estimator's own
/// parameter names, and it serves as start values.
#[test]
fn the_command_writes_start_values() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path();
    for (vehicle, scenario) in [
        (&nursing_robot::VEHICLE, "coughs"),
        (&wheel_loader::VEHICLE, "bumpy-c"),
        (&wheelchair::VEHICLE, "climb"),
        (&wheeled_robot::VEHICLE, "sine"),
    ] {
        let made = identify(path, &format!("simulate {vehicle} --scenario {scenario} --seed 1 --out log.csv"));
        assert_eq!(made, Some(0));
        for objective in ["nll", "rmse"] {
            let tune = format!("tune {vehicle} log.csv --objective {objective} --pop 5 --iters 1");
            let code = identify(path, &format!("{tune} --out tune.json"));
            let text = std::fs::read_to_string(path.join("tune.json")).unwrap();
            let report: serde_json::Value = serde_json::from_str(&text).unwrap();
            let sure =
                |parameter: &serde_json::Value| parameter["identified"] == true && parameter["at_bound"] == false;
            let all_sure = report["parameters"].as_object().unwrap().values().all(sure);
            let warned = !report["warnings"].as_array().unwrap().is_empty();
            assert!(objective == "nll" || warned, "rmse is degenerate and says so");
            assert_eq!(code, Some(i32::from(warned || !all_sure)), "{vehicle} {objective}");
            assert_eq!(report["vehicle"], vehicle.name);
            let declared = vehicle.parameters();
            for (name, parameter) in report["parameters"].as_object().unwrap() {
                let variable = declared.iter().find(|variable| variable.name == *name).unwrap();
                variable.check(parameter["value"].as_f64().unwrap()).unwrap();
            }
            let again = identify(path, &format!("{tune} --params tune.json --out again.json"));
            assert!(again == Some(0) || again == Some(1), "{vehicle} {objective} {again:?}");
        }
    }
}
