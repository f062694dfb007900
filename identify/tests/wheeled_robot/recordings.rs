//! Recordings of real cars: lateral speed against the INS reference, with tyres from the other half.
#![allow(clippy::approx_constant)] // a wheel radius of 0.318 m is not 1/pi

use std::path::{Path, PathBuf};
use wheelstate::estimator::wheeled_robot::{Channels, Outputs, Parameters, WheeledRobot};
use wheelstate::{Estimator, Variables};
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
    p.sample_period = 0.005;
    (p.tire.front.stiffness, p.tire.rear.stiffness) = (45e3, 67e3);
    p
}

fn revs() -> Parameters {
    let mut p = car(982.0, 982.0 / 12.0 * (1.7f64.powi(2) + 4.09f64.powi(2)), 1.33, 1.07, 1.35, 0.45, 0.32);
    p.sample_period = 0.01;
    (p.tire.front.stiffness, p.tire.rear.stiffness) = (30.5e3, 47.5e3);
    p
}

/// As a new user begins: what can be measured at the car, typical tyres, all else at its default.
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
    let start = names.into_iter().zip(p.to_vec()).collect();
    let request = FitRequest { start, exact: true, ..FitRequest::default() };
    let report = wheeled_robot::VEHICLE.fit(std::slice::from_ref(log), &request, &Progress::none()).unwrap();
    let mut p = p.clone();
    for (name, parameter) in report.parameters.iter().filter(|(_, q)| q.identified || q.at_bound) {
        println!("   {name} = {:.4} ± {:.4}", parameter.value, parameter.std_error);
        p.set(name, parameter.value).unwrap();
    }
    p
}

/// What an estimate of the lateral speed is worth.
#[derive(Clone, Copy, Debug)]
struct Worth {
    rmse: f64,
    /// Shares of the samples: within two standard deviations, healthy, and healthy beyond three.
    within: f64,
    healthy: f64,
    wrong: f64,
}

fn worth(log: &Log, out: &[Outputs]) -> Worth {
    let truth = log.channel("speed_y").unwrap();
    let off = |o: &Outputs, t: &f64| (o.speed_y.value - t).abs() / o.speed_y.std;
    let share = |count: &dyn Fn(&Outputs, &f64) -> bool| {
        out.iter().zip(truth).filter(|(o, t)| count(o, t)).count() as f64 / out.len() as f64
    };
    let worth = Worth {
        rmse: rmse(log, out),
        within: share(&|o, t| off(o, t) < 2.0),
        healthy: share(&|o, _| o.diagnostics.healthy),
        wrong: share(&|o, t| o.diagnostics.healthy && off(o, t) > 3.0),
    };
    println!(
        "   {:.4} m/s, within 2 std {:.3}, healthy {:.3}, healthy and beyond 3 std {:.4}",
        worth.rmse, worth.within, worth.healthy, worth.wrong
    );
    worth
}

/// Lateral speed on each half, the tyres being fitted on the other half as the guide says: `fit`, then the estimator
/// with what it identified, all noise at its default.
fn crosswise(log: &Log, p: &Parameters) -> Worth {
    let (first, second) = log.split(0.5);
    let halves = [(&first, &second), (&second, &first)].map(|(train, test)| worth(test, &run(test, &fitted(train, p))));
    let [a, b] = halves;
    let mean = |of: fn(&Worth) -> f64| 0.5 * (of(&a) + of(&b));
    Worth {
        rmse: mean(|w| w.rmse * w.rmse).sqrt(),
        within: mean(|w| w.within),
        healthy: mean(|w| w.healthy),
        wrong: mean(|w| w.wrong),
    }
}

/// The car stands during the first half, which shows no tyre, so that the second one is driven with the start values;
/// the reference alone is as noisy as 0.011 m/s at rest.
#[test]
fn the_lateral_speed_of_niki_is_found_with_tyres_fitted_on_the_other_half() {
    let Some(log) = recording("niki_gti/Low_Speed.csv", "niki_gti.toml") else { return };
    let found = crosswise(&log, &niki());
    println!("Niki, low speed: {found:.4?}, open-loop bicycle 0.038 m/s");
    assert!(found.rmse < 0.028 && found.within > 0.85 && found.wrong < 0.01 && found.healthy > 0.98, "{found:?}");
}

/// Axle forces up to 1.6 g contradict the friction of 1.0 that a new user gives; the fit says so and finds another.
#[test]
fn the_lateral_speed_of_revs_at_the_limit_is_found_with_tyres_fitted_on_the_other_half() {
    let Some(log) = recording("revs_250lm/250lm_t150_400.csv", "revs_250lm.toml") else { return };
    let found = crosswise(&log, &revs());
    println!("REVS 250 LM: {found:.4?}, open-loop bicycle 0.22 m/s");
    assert!(found.rmse < 0.170 && found.within > 0.85 && found.wrong < 0.01 && found.healthy > 0.98, "{found:?}");
}

/// Without any fit: the raw accelerometers are noisier by far than the default says, tyres and friction are guesses.
#[test]
fn with_start_values_and_defaults_no_estimate_is_far_off_and_healthy() {
    let recordings = [
        ("niki_gti/Low_Speed.csv", "niki_gti.toml", niki(), 0.03),
        ("niki_gti/AA273_data.csv", "niki_aa273.toml", aa273(), 0.06),
        ("revs_250lm/250lm_t150_400.csv", "revs_250lm.toml", revs(), 0.3),
    ];
    for (name, map, p, limit) in recordings {
        let Some(log) = recording(name, map) else { return };
        println!("{name}");
        let found = worth(&log, &run(&log, &p));
        assert!(found.rmse < limit && found.within > 0.85 && found.wrong <= 0.01 && found.healthy > 0.9, "{name}");
    }
}

/// Rear wheel speeds, no accelerometer.
fn aa273() -> Parameters {
    let mut p = niki();
    p.sample_period = 0.01;
    (p.filter.channels, p.filter.use_speed) = (Channels::WheelSpeed, false);
    p
}

/// Without the yaw rate the tyres' model must not do worse than wheels that roll without slip: at the centre of gravity
/// `vy = lr vx tan(delta)/L`.
#[test]
fn without_the_yaw_rate_the_estimate_is_no_worse_than_the_kinematic_bicycle() {
    let recordings = [
        ("niki_gti/Low_Speed.csv", "niki_gti.toml", niki()),
        ("niki_gti/AA273_data.csv", "niki_aa273.toml", aa273()),
        ("revs_250lm/250lm_t150_400.csv", "revs_250lm.toml", revs()),
    ];
    for (name, map, p) in recordings {
        let Some(mut log) = recording(name, map) else { return };
        log.channels.retain(|channel| channel.name != "gyro_z");
        let [truth, speed, angle] = ["speed_y", "speed_x", "steering_angle"].map(|name| log.channel(name).unwrap());
        let share = p.vehicle.cg_to_rear / p.vehicle.wheelbase();
        let square = |k: usize| (share * speed[k] * angle[k].tan() - truth[k]).powi(2);
        let kinematic = ((0..log.len()).map(square).sum::<f64>() / log.len() as f64).sqrt();
        println!("{name}: kinematic bicycle {kinematic:.4} m/s");
        let found = worth(&log, &run(&log, &p));
        assert!(found.rmse < 1.1 * kinematic && found.wrong <= 0.01, "{name}");
    }
}
