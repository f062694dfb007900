//! The estimator as the scale of a real car: trips of an electric car, torque missing while a friction
//! brake may act. The recordings are not part of the repository.

use crate::support::median;
use std::path::{Path, PathBuf};
use wheelstate::Estimator;
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters, SwayStatus};

/// Motor torque to the torque of one wheel: gear ratio, gear efficiency, two driven wheels.
const GEAR: f64 = 9.665 * 0.96 / 2.0;
const RADIUS: f64 = 0.3498;
const DRAG_AREA: f64 = 0.29 * 2.38;
const ROTATING: f64 = 102.0;
const PERIOD: f64 = 0.1;

struct Trip {
    name: String,
    speed: Vec<f64>,
    /// Torque of one wheel; NaN where a friction brake may act.
    torque: Vec<f64>,
    accel: Vec<f64>,
}

fn trips() -> Option<Vec<Trip>> {
    let root = std::env::var_os("WHEELSTATE_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let folder = root.join("bmw_i3");
    let Ok(entries) = std::fs::read_dir(&folder) else {
        eprintln!("SKIPPED: no recordings in {}; set WHEELSTATE_DATA", folder.display());
        return None;
    };
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "csv"));
    files.sort();
    Some(files.iter().map(|file| read(file)).collect())
}

fn read(file: &Path) -> Trip {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let columns = ["v_kmh", "motor_torque_Nm", "ax_mps2"].map(column);
    let name = file.file_stem().unwrap().to_string_lossy().into_owned();
    let mut trip = Trip { name, speed: Vec::new(), torque: Vec::new(), accel: Vec::new() };
    for record in reader.records() {
        let record = record.unwrap();
        let [v, motor, accel] = columns.map(|i| record[i].parse().unwrap_or(f64::NAN));
        let certain = v >= 10.8 && motor > 5.0;
        trip.speed.push(v / 3.6);
        trip.torque.push(if certain { motor * GEAR } else { f64::NAN });
        trip.accel.push(accel);
    }
    trip
}

fn car(rolling: f64) -> Parameters {
    let mut p = Parameters { sample_period: PERIOD, ..Parameters::default() };
    (p.robot.mass, p.robot.wheel_radius) = (1300.0, RADIUS);
    (p.robot.wheel_inertia, p.robot.rotating_mass) = (0.0, ROTATING);
    (p.aero.drag_area, p.rolling.coefficient) = (DRAG_AREA, rolling);
    (p.human.swaying_fraction, p.human.nominal_mass) = (0.0, 100.0);
    p.mass.use_accelerometer = true;
    (p.limit.torque, p.limit.speed) = (2000.0, 60.0);
    (p.limit.load_mass, p.limit.slip_residual) = (1000.0, 5000.0);
    p
}

/// Mass and rolling coefficient by ordinary least squares over two-second means: another way to the
/// same numbers, as a reference.
fn offline(trip: &Trip) -> (f64, f64) {
    let n = trip.speed.len();
    let mut rows = Vec::new();
    const SPAN: usize = 20;
    for start in (0..n.saturating_sub(SPAN)).step_by(5) {
        let window = start..start + SPAN;
        if window.clone().any(|i| trip.torque[i].is_nan()) {
            continue;
        }
        let mean = |f: &dyn Fn(usize) -> f64| window.clone().map(f).sum::<f64>() / SPAN as f64;
        let force = mean(&|i| 2.0 * trip.torque[i] / RADIUS - 0.6 * DRAG_AREA * trip.speed[i].powi(2));
        let gain = (trip.speed[start + SPAN] - trip.speed[start]) / (SPAN as f64 * PERIOD);
        rows.push([mean(&|i| trip.accel[i]), 9.81, force - ROTATING * gain]);
    }
    let sum = |a: usize, b: usize| rows.iter().map(|row| row[a] * row[b]).sum::<f64>();
    let determinant = sum(0, 0) * sum(1, 1) - sum(0, 1).powi(2);
    let mass = (sum(1, 1) * sum(0, 2) - sum(0, 1) * sum(1, 2)) / determinant;
    let weight = (sum(0, 0) * sum(1, 2) - sum(0, 1) * sum(0, 2)) / determinant;
    (mass, weight / mass)
}

/// Runs the estimator over a trip; the last outputs and the total mass at every sample.
fn online(trip: &Trip, p: &Parameters) -> (Outputs, Vec<f64>) {
    let mut totals = Vec::new();
    let last = follow(trip, p, |outputs| totals.push(p.robot.mass + outputs.load_mass.value));
    (last, totals)
}

/// Runs the estimator over a trip and returns the last outputs.
fn follow(trip: &Trip, p: &Parameters, mut each: impl FnMut(&Outputs)) -> Outputs {
    let mut estimator = NursingRobot::new(p).unwrap();
    let mut outputs = Outputs::default();
    for i in 0..trip.speed.len() {
        let inputs = Inputs {
            torque_left: trip.torque[i],
            torque_right: trip.torque[i],
            speed: trip.speed[i],
            yaw_rate: f64::NAN,
            accel_x: trip.accel[i],
            ..Inputs::default()
        };
        estimator.step(&inputs, PERIOD);
        estimator.outputs(&inputs, 0.0, &mut outputs);
        each(&outputs);
    }
    outputs
}

/// As a new user begins: the published constants of the car, its rolling coefficient fitted or left at its default, which is
/// twice that of a car.
#[test]
fn the_mass_of_a_car_is_within_its_standard_deviation_all_the_way() {
    let Some(trips) = trips() else { return };
    for (what, known) in [("fitted", true), ("default", false)] {
        let (mut errors, mut counts) = (Vec::new(), [0; 3]);
        for trip in &trips {
            let (mass, rolling) = offline(trip);
            let p = car(if known { rolling } else { Parameters::default().rolling.coefficient });
            follow(trip, &p, |out| {
                let error = (p.robot.mass + out.load_mass.value - mass).abs();
                errors.push(error / mass);
                counts[0] += usize::from(error < 2.0 * out.load_mass.std);
                counts[1] += usize::from(out.diagnostics.healthy);
                counts[2] += usize::from(out.diagnostics.healthy && error > 3.0 * out.load_mass.std);
            });
        }
        let [within, healthy, wrong] = counts.map(|count: usize| count as f64 / errors.len() as f64);
        let error = 100.0 * median(&errors);
        println!(
            "rolling {what}: {error:.1} %, within 2 std {within:.3}, healthy {healthy:.3}, and beyond 3 std {wrong:.4}"
        );
        if known {
            assert!(error < 2.0 && within > 0.9 && wrong <= 0.01, "{error} {within} {wrong}");
        }
    }
}

/// The ordinary trips carry one or two people, TripB33 about 200 kg more. The rolling coefficient of each
/// trip is known from the reference fit, as it is when a fit has been packed.
#[test]
fn weighs_a_car_while_driving() {
    let Some(trips) = trips() else { return };
    let (mut ordinary, mut heavy, mut normalised) = (Vec::new(), Vec::new(), Vec::new());
    for trip in &trips {
        let (mass, rolling) = offline(trip);
        let p = car(rolling);
        let (out, totals) = online(trip, &p);
        let end = totals[totals.len() - 1];
        println!(
            "{}: online {end:.0} kg +- {:.0}, reference {mass:.0} kg, rolling {rolling:.4}",
            trip.name, out.load_mass.std
        );
        assert!((end / mass - 1.0).abs() < 0.03, "{}: {end} instead of {mass}", trip.name);
        assert!(out.diagnostics.healthy && !out.mass_implausible, "{}: {}", trip.name, out.diagnostics.status);
        assert!(totals.iter().all(|total| total.is_finite()));
        normalised.push((end - mass) / out.load_mass.std);
        if trip.name == "TripB33" { &mut heavy } else { &mut ordinary }.push(end);
    }
    assert!(ordinary.iter().all(|total| (1350.0..1570.0).contains(total)), "{ordinary:?}");
    assert!(heavy.iter().all(|total| total - median(&ordinary) > 120.0), "{heavy:?} above {ordinary:?}");
    let covered = normalised.iter().filter(|z| z.abs() < 2.0).count();
    assert!(covered * 10 >= normalised.len() * 9, "reported standard deviations are too small: {normalised:?}");
}

/// What a user may leave as declared: a swaying person in the car, and one rolling coefficient for all
/// weathers. The sway of 70 kg must not spoil the mass of the car.
#[test]
fn a_car_with_the_declared_person_is_weighed_too() {
    let Some(trips) = trips() else { return };
    for trip in &trips {
        let (mass, rolling) = offline(trip);
        let mut p = car(rolling);
        p.human = Parameters::default().human;
        let (out, totals) = online(trip, &p);
        assert!(out.diagnostics.healthy, "{}: {}", trip.name, out.diagnostics.status);
        assert_eq!(out.sway_status, SwayStatus::Off);
        assert!(out.body_pitch.std > 0.1 && out.sway_force.std > 0.0, "a body that nothing follows may do anything");
        let end = totals[totals.len() - 1];
        println!("{}: online {end:.0} kg, reference {mass:.0} kg", trip.name);
        assert!((end / mass - 1.0).abs() < 0.06, "{}: {end} instead of {mass}", trip.name);
    }
}
