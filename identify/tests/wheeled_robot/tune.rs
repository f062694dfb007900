//! Tuning of the wheeled robot's noise settings: generalises, repeats its bytes, and the source's
//! objective does what it is accused of.

use wheelstate::estimator::wheeled_robot::{Outputs, Parameters, WheeledRobot};
use wheelstate::{Estimator, Variables};
use wheelstate_identify::log::Log;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::tune::replay::Track;
use wheelstate_identify::tune::{Objective, TuneReport, TuneRequest};
use wheelstate_identify::vehicles::wheeled_robot;

fn log(scenario: &str, seed: u64, duration: f64) -> Log {
    let settings = vec![("plant.duration".to_owned(), duration)];
    wheeled_robot::VEHICLE.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap()
}

fn request(objective: Objective) -> TuneRequest {
    TuneRequest {
        objective,
        seed: 7,
        population: 30,
        iterations: 10,
        skip: 1.0,
        settings: vec![("initial.speed_x".to_owned(), 3.0)],
        ..TuneRequest::default()
    }
}

fn apply(report: Option<&TuneReport>, settings: &[(String, f64)]) -> Parameters {
    let mut p = Parameters::default();
    // The plant's gyro has no constant errors.
    (p.imu.gyro_z_bias_std, p.imu.gyro_z_scale_std, p.imu.gyro_z_delay_std) = (0.0, 0.0, 0.0);
    settings.iter().for_each(|(name, value)| p.set(name, *value).unwrap());
    let tuned = report.map(|report| &report.fit.parameters);
    tuned.into_iter().flatten().for_each(|(name, parameter)| p.set(name, parameter.value).unwrap());
    p
}

/// RMSE of vx, vy, r after the first second, the mean NEES over its dimension, and the output's RMSE.
fn judge(log: &Log, p: &Parameters) -> ([f64; 3], f64, f64) {
    let truth = ["true_speed_x", "true_speed_y", "true_yaw_rate"].map(|name| log.channel(name).unwrap());
    let (mut square, mut nees, mut output, mut count) = ([0.0; 3], 0.0, 0.0, 0.0);
    Track::<WheeledRobot>::new(log).run(WheeledRobot::new(p).unwrap(), |k, o: &Outputs| {
        if k < 100 {
            return;
        }
        let estimates = [o.speed_x, o.speed_y, o.yaw_rate];
        let errors: [f64; 3] = std::array::from_fn(|i| estimates[i].value - truth[i][k]);
        let stds = estimates.map(|estimate| estimate.std);
        (0..3).for_each(|i| square[i] += errors[i] * errors[i]);
        nees += errors.iter().zip(stds).map(|(e, s)| (e / s).powi(2)).sum::<f64>() / 3.0;
        output += o.output_error;
        count += 1.0;
    });
    (square.map(|s| f64::sqrt(s / count)), nees / count, f64::sqrt(output / count))
}

#[test]
fn likelihood_with_floors_generalises_and_repeats_its_bytes() {
    let logs = [log("sine", 1, 5.0), log("accelerate-brake", 2, 5.0)];
    let held_out = [log("lane-change", 3, 10.0)];
    let run = |threads| {
        let request = TuneRequest { threads, ..request(Objective::Nll) };
        wheeled_robot::VEHICLE.tune(&logs, &held_out, &request, &Progress::none()).unwrap()
    };
    let (one, two) = (run(1), run(2));
    assert_eq!(one.to_json().unwrap(), two.to_json().unwrap());
    assert_eq!(one.tuning.evaluations, 330);
    assert!(one.tuning.best < one.tuning.start);
    assert!(one.tuning.history.windows(2).all(|w| w[1] <= w[0]));

    let settings = request(Objective::Nll).settings;
    let (before, after) = (apply(None, &settings), apply(Some(&one), &settings));
    for scenario in ["lane-change", "step-steer", "vector"] {
        let log = log(scenario, 11, 10.0);
        let (start, start_nees, _) = judge(&log, &before);
        let (tuned, nees, _) = judge(&log, &after);
        println!("{scenario}: {start:.4?} NEES {start_nees:.2} -> {tuned:.4?} NEES {nees:.2}");
        assert!(tuned[1] < start[1] && tuned[2] < start[2], "{scenario}");
        assert!((0.3..3.0).contains(&nees), "{scenario} {nees}");
    }
    let unseen = one.tuning.nis.iter().find(|entry| entry.held_out).unwrap();
    println!("held out: NIS {:.2} -> {:.2}", unseen.before, unseen.after);
    assert!((unseen.after - 1.0).abs() < (unseen.before - 1.0).abs());
}

#[test]
fn the_sources_objective_pays_for_following_noise() {
    let logs = [log("sine", 1, 5.0)];
    let mut request = request(Objective::Rmse);
    request.settings.push(("filter.channels".to_owned(), 0.0));
    let report = wheeled_robot::VEHICLE.tune(&logs, &[], &request, &Progress::none()).unwrap();
    assert!(report.fit.has_warnings());
    assert!(report.fit.warnings.iter().any(|w| w.contains("degenerate")), "{:?}", report.fit.warnings);
    assert!(report.fit.parameters.values().all(|p| !p.identified));
    let (before, after) = (apply(None, &request.settings), apply(Some(&report), &request.settings));
    let (start, _, start_output) = judge(&logs[0], &before);
    let (tuned, nees, output) = judge(&logs[0], &after);
    println!("output {start_output:.4} -> {output:.4}; state {start:.4?} -> {tuned:.4?}, NEES {nees:.1}");
    assert!(output < start_output, "its own figure is better");
    assert!(tuned[1] > start[1] && tuned[2] > start[2], "and the state is worse");
}
