//! Recordings of real cars: lateral speed against the INS reference, with tyres from the other half.
#![allow(clippy::approx_constant)] // a wheel radius of 0.318 m is not 1/pi

use std::path::{Path, PathBuf};
use wheelstate::estimator::wheeled_robot::{Channels, Outputs, Parameters, WheeledRobot};
use wheelstate::{Estimator, Status, Variables};
use wheelstate_identify::log::{ColumnMap, Log};
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::tune::replay::Track;
use wheelstate_identify::vehicles::wheeled_robot;

fn recording(name: &str, map: &str) -> Option<Log> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let data = std::env::var_os("WHEELSTATE_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let path = data.join(name);
    if !path.exists() {
        println!("SKIPPED: {} is not there; set WHEELSTATE_DATA", path.display());
        return None;
    }
    let map = ColumnMap::read(&root.join("tests/maps").join(map)).unwrap();
    Some(Log::read(&path, Some(&map), &Progress::none()).unwrap())
}

fn niki() -> Parameters {
    let mut p = car(1926.2, 2763.49, 1.264, 1.367, 1.55, 0.55, 0.318);
    with_period(&mut p, 0.005);
    (p.tire.front.stiffness, p.tire.rear.stiffness) = (45e3, 67e3);
    p
}

fn revs() -> Parameters {
    let mut p = car(982.0, 982.0 / 12.0 * (1.7f64.powi(2) + 4.09f64.powi(2)), 1.33, 1.07, 1.35, 0.45, 0.32);
    with_period(&mut p, 0.01);
    (p.tire.front.stiffness, p.tire.rear.stiffness) = (30.5e3, 47.5e3);
    p
}

/// Samples this far apart, with a process noise of 0.05 m/s, 0.003 m/s and 0.01 rad/s per sample.
fn with_period(p: &mut Parameters, period: f64) {
    p.sample_period = period;
    let q = &mut p.filter.process_psd;
    [q.speed_x, q.speed_y, q.yaw_rate] = [0.05f64, 0.003, 0.01].map(|std| std * std / period);
}

fn car(mass: f64, inertia: f64, front: f64, rear: f64, track: f64, height: f64, radius: f64) -> Parameters {
    let mut p = Parameters::default();
    let base = front + rear;
    let v = &mut p.vehicle;
    (v.mass, v.yaw_inertia, v.cg_to_front, v.cg_to_rear) = (mass, inertia, front, rear);
    (v.track_front, v.track_rear, v.cg_height) = (track, track, height);
    p.wheel.radius = radius;
    p.wheel.inertia = 1.2;
    for (tire, lever) in [(&mut p.tire.front, rear), (&mut p.tire.rear, front)] {
        tire.nominal_load = 0.5 * mass * 9.81 * lever / base;
        (tire.friction, tire.curvature, tire.shape) = (1.0, 0.0, 1.3);
    }
    p.filter.channels = Channels::Gyro;
    p.filter.use_speed = true;
    p.filter.minimum_speed = 1.0;
    let r = &mut p.filter.measurement_std;
    (r.accel_x, r.accel_y, r.gyro_z, r.speed) = (0.5, 3.0, 0.01, 0.05);
    p
}

fn run(log: &Log, p: &Parameters) -> Vec<Outputs> {
    let mut all = Vec::with_capacity(log.len());
    Track::<WheeledRobot>::new(log).run(WheeledRobot::new(p).unwrap(), |_, outputs| all.push(outputs.clone()));
    all
}

fn rmse(log: &Log, out: &[Outputs]) -> f64 {
    let truth = log.channel("speed_y").unwrap();
    let errors: Vec<f64> =
        out.iter().zip(truth).map(|(o, t)| (o.speed_y.value - t).powi(2)).filter(|e| e.is_finite()).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
}

/// Tyres fitted on a part of a log; unidentified ones stay.
fn fitted(log: &Log, p: &Parameters) -> Parameters {
    let names: Vec<String> = Parameters::declare().into_iter().map(|v| v.name).collect();
    let settings = names.into_iter().zip(p.to_vec()).collect();
    let request = FitRequest { settings, ..FitRequest::default() };
    let report = wheeled_robot::VEHICLE.fit(std::slice::from_ref(log), &request, &Progress::none()).unwrap();
    let mut p = p.clone();
    for (name, parameter) in report.parameters.iter().filter(|(_, q)| q.identified || q.at_bound) {
        println!("   {name} = {:.4} ± {:.4}", parameter.value, parameter.std_error);
        p.set(name, parameter.value).unwrap();
    }
    p
}

/// As [`fitted`], the friction too: where the tyres' forces do not show it, the lateral speed that the filter
/// then finds on the same part of the log judges.
fn fitted_with_friction(log: &Log, p: &Parameters) -> Parameters {
    let tried = [1.0, 1.3, 1.6, 1.9, 2.2].map(|friction| {
        let mut p = p.clone();
        (p.tire.front.friction, p.tire.rear.friction) = (friction, friction);
        let p = fitted(log, &p);
        let error = rmse(log, &run(log, &p));
        println!("   friction {friction}: {error:.4} m/s on its own half");
        (error, p)
    });
    let best = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    best.1
}

/// RMSE of the lateral speed on each half, the tyres being fitted on the other half.
fn crosswise(log: &Log, p: &Parameters, fitted: impl Fn(&Log, &Parameters) -> Parameters) -> f64 {
    let (first, second) = log.split(0.5);
    let mut sum = 0.0;
    for (train, test) in [(&first, &second), (&second, &first)] {
        let fitted = fitted(train, p);
        let outputs = run(test, &fitted);
        assert!(outputs.iter().all(|o| !o.diagnostics.status.contains(Status::CONTRADICTED)), "noise as given");
        let (before, after) = (rmse(test, &run(test, p)), rmse(test, &outputs));
        println!("   unseen half: {before:.4} m/s with the start values, {after:.4} m/s fitted");
        sum += after * after;
    }
    (0.5 * sum).sqrt()
}

#[test]
fn niki_at_low_speed_beats_the_open_loop_bicycle() {
    let Some(log) = recording("niki_gti/Low_Speed.csv", "niki_gti.toml") else { return };
    let rmse = crosswise(&log, &niki(), fitted);
    println!("Niki, low speed: speed_y {rmse:.4} m/s, open-loop bicycle 0.038 m/s");
    assert!(rmse < 0.030, "{rmse}");
}

#[test]
fn revs_at_the_limit_beats_the_open_loop_bicycle() {
    let Some(log) = recording("revs_250lm/250lm_t150_400.csv", "revs_250lm.toml") else { return };
    let rmse = crosswise(&log, &revs(), fitted_with_friction);
    println!("REVS 250 LM: speed_y {rmse:.4} m/s, open-loop bicycle 0.22 m/s");
    assert!(rmse < 0.22, "{rmse}");
}

/// The raw accelerometers are noisier by far than the default says; the estimates, some of them tens of metres per
/// second off, are then contradicted.
#[test]
fn with_the_default_noise_no_estimate_is_far_off_and_healthy() {
    let recordings = [
        ("niki_gti/Low_Speed.csv", "niki_gti.toml", niki()),
        ("revs_250lm/250lm_t150_400.csv", "revs_250lm.toml", revs()),
    ];
    for (name, map, mut p) in recordings {
        let Some(log) = recording(name, map) else { return };
        let default = Parameters::default().filter;
        (p.filter.process_psd, p.filter.measurement_std) = (default.process_psd, default.measurement_std);
        let out = run(&log, &p);
        let truth = log.channel("speed_y").unwrap();
        let far = |(o, t): (&Outputs, &f64)| (o.speed_y.value - t).abs() > 3.0 * o.speed_y.std;
        let wrong = out.iter().zip(truth).filter(|&(o, t)| o.diagnostics.healthy && far((o, t))).count();
        let share = wrong as f64 / out.len() as f64;
        println!("{name}: speed_y {:.2} m/s, healthy and beyond three deviations {share:.4}", rmse(&log, &out));
        assert!(share < 0.01, "{name} {share}");
    }
}
