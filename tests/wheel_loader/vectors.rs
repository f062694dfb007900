//! The loader's filters, sample by sample, against reference vectors.

use super::runs;
use crate::support::{Table, assert_close, vector_table};
use wheelstate::Estimator;
use wheelstate::estimator::wheel_loader::*;

const COLUMNS: [&str; 10] = ["Tf", "Tr", "Bf", "Br", "alpha", "Fx", "Fz", "yv", "ywf", "ywr"];

fn inputs(table: &Table, row: usize) -> Inputs {
    let [torque_front, torque_rear, brake_front, brake_rear, slope, spading_force_x, spading_force_z, y @ ..] =
        COLUMNS.map(|name| table.at(row, name));
    Inputs {
        torque_front,
        torque_rear,
        brake_front,
        brake_rear,
        slope,
        spading_force_x,
        spading_force_z,
        speed: y[0],
        wheel_speed_front: y[1],
        wheel_speed_rear: y[2],
        steering_angle: f64::NAN,
    }
}

/// Parameters as in the vectors: `[K, h, lambda]` and logit standard deviations.
fn parameters(initial: [f64; 3], std: [f64; 3]) -> Parameters {
    let mut p = Parameters::default();
    (p.initial.slip_stiffness, p.initial.cg_height, p.initial.cg_ratio) = initial.into();
    let slope = |p: f64, lo: f64, hi: f64| (p - lo) * (hi - p) / (hi - lo);
    p.initial.slip_stiffness_std = std[0] * slope(initial[0], 2.0, 80.0);
    p.initial.cg_height_std = std[1] * slope(initial[1], 0.3, 2.5);
    p.initial.cg_ratio_std = std[2] * slope(initial[2], 0.1, 0.9);
    as_in_the_study(&mut p);
    p
}

/// Switches off what this estimator does beyond the study.
fn as_in_the_study(p: &mut Parameters) {
    p.filter.radii = Radii::Fixed;
    p.filter.overshoot = true;
    (p.filter.measurement_std.speed, p.filter.measurement_std.wheel_speed) = (0.03, 0.05);
    p.filter.measurement_std.speed_delay = 0.0;
    p.filter.adaptation.enabled = false;
    p.filter.minimum_std.cg_height = 0.02;
    p.hold.settle_time = 0.0;
    p.filter.alpha = 1.0;
    // The reference reports the filter's own standard deviations.
    let error = &mut p.model_error;
    (error.slip_stiffness, error.cg_height, error.radius_softness) = (0.0, 0.0, 0.0);
}

fn vector_parameters() -> Parameters {
    let mut p = parameters([14.0, 1.05, 0.52], [0.8, 0.35, 0.5]);
    p.filter.interpolate_inputs = false;
    p
}

fn begun(p: &Parameters) -> WheelLoader {
    let mut estimator = WheelLoader::new(p).unwrap();
    let first = vector_table("wheel_loader/initial_measurement.csv");
    let first = Inputs {
        speed: first.at(0, "yv"),
        wheel_speed_front: first.at(0, "ywf"),
        wheel_speed_rear: first.at(0, "ywr"),
        ..Inputs::default()
    };
    estimator.step(&first, 0.01);
    estimator
}

fn compare(p: &Parameters, file: &str) -> usize {
    let table = vector_table(&format!("wheel_loader/{file}.csv"));
    assert_eq!(table.rows.len(), 299);
    let mut estimator = begun(p);
    let mut out = Outputs::default();
    let mut held = 0;
    for row in 0..table.rows.len() {
        let inputs = inputs(&table, row);
        estimator.step(&inputs, 0.01);
        let belief = estimator.state().machine.belief;
        for i in 0..6 {
            let z = format!("z{i}");
            assert_close(&format!("{file} row {row} {z}"), belief.mean[i], table.at(row, &z), 0.0, 1e-7);
            for j in 0..=i {
                let s = format!("S{i}{j}");
                assert_close(&format!("{file} row {row} {s}"), belief.factor[(i, j)], table.at(row, &s), 0.0, 1e-6);
            }
        }
        estimator.outputs(&inputs, 0.0, &mut out);
        for (name, value) in [
            ("K", out.slip_stiffness.value),
            ("h", out.cg_height.value),
            ("lam", out.cg_ratio.value),
            ("sdK", out.slip_stiffness.std),
            ("sdh", out.cg_height.std),
            ("sdlam", out.cg_ratio.std),
        ] {
            assert_close(&format!("{file} row {row} {name}"), value, table.at(row, name), 1e-6, 1e-7);
        }
        assert_eq!(out.hold, table.at(row, "hold") != 0.0, "{file} row {row}");
        held += usize::from(out.hold);
    }
    held
}

#[test]
fn srukf_in_array_form_matches_the_reference() {
    let held = compare(&vector_parameters(), "srukf_logit_array");
    println!("{held} rows held");
}

#[test]
fn srukf_in_andrews_form_matches_the_reference() {
    let mut p = vector_parameters();
    p.filter.form = Form::Andrews;
    compare(&p, "srukf_logit_andrews");
}

#[test]
fn ekf_matches_the_reference() {
    let mut p = vector_parameters();
    p.filter.kind = Kind::Extended;
    compare(&p, "ekf_logit");
}

#[test]
fn srukf_in_direct_coordinates_with_the_narrow_spread_matches_the_reference() {
    let mut p = vector_parameters();
    p.filter.parameters = Coordinates::Direct;
    p.filter.alpha = 0.01;
    p.filter.supervise = false;
    (p.initial.slip_stiffness_std, p.initial.cg_height_std, p.initial.cg_ratio_std) = (5.0, 0.15, 0.1);
    // The random walks are declared as densities in logit units, the study's per 10 ms.
    let slope = |p: f64, lo: f64, hi: f64| (p - lo) * (hi - p) / (hi - lo);
    let walk = &mut p.filter.process_psd;
    walk.slip_stiffness = (0.02 / slope(14.0, 2.0, 80.0)).powi(2) / 0.01;
    walk.cg_height = (2e-4 / slope(1.05, 0.3, 2.5)).powi(2) / 0.01;
    walk.cg_ratio = (1.5e-4 / slope(0.52, 0.1, 0.9)).powi(2) / 0.01;
    compare(&p, "srukf_direct_array_alpha001");
}

/// The reference propagates the covariance itself with Joseph's form: an independent check of the
/// square-root form.
#[test]
fn ekf_agrees_with_the_covariance_form() {
    let mut p = vector_parameters();
    p.filter.kind = Kind::Extended;
    p.filter.supervise = false;
    let table = vector_table("wheel_loader/ekf_cov_logit.csv");
    assert_eq!(table.rows.len(), 199);
    let mut estimator = begun(&p);
    for row in 0..table.rows.len() {
        estimator.step(&inputs(&table, row), 0.01);
        let belief = estimator.state().machine.belief;
        let covariance = belief.factor * belief.factor.transpose();
        for i in 0..6 {
            assert_close(&format!("row {row} z{i}"), belief.mean[i], table.at(row, &format!("z{i}")), 0.0, 1e-7);
            for j in 0..=i {
                let name = format!("P{i}{j}");
                assert_close(&format!("row {row} {name}"), covariance[(i, j)], table.at(row, &name), 0.0, 1e-8);
            }
        }
    }
}

#[test]
fn logs_of_the_reference_plant_are_replayed() {
    for (file, lambda) in [("plantlog_bumpy_C", 0.45), ("plantlog_spade6k_C", 0.45), ("plantlog_accbrake_A", 0.45)] {
        let table = vector_table(&format!("wheel_loader/{file}.csv"));
        let mut p = parameters([15.0, 1.05, 0.5], [0.8, 0.35, 0.5]);
        p.loader.wheel_radius_front = 0.55 * (1.0 + 0.03 / 19.0);
        p.loader.wheel_radius_rear = p.loader.wheel_radius_front;
        let mut estimator = WheelLoader::new(&p).unwrap();
        let mut out = Outputs::default();
        let mut worst: f64 = 0.0;
        for row in 0..table.rows.len() {
            let inputs = inputs(&table, row);
            estimator.step(&inputs, 0.01);
            estimator.outputs(&inputs, 0.0, &mut out);
            for (name, value) in [
                ("K", out.slip_stiffness.value),
                ("h", out.cg_height.value),
                ("lam", out.cg_ratio.value),
                ("sdK", out.slip_stiffness.std),
                ("sdh", out.cg_height.std),
                ("sdlam", out.cg_ratio.std),
            ] {
                worst = worst.max((value / table.at(row, name) - 1.0).abs());
                assert_close(&format!("{file} row {row} {name}"), value, table.at(row, name), 1e-6, 0.0);
            }
        }
        println!("{file}: largest relative difference {worst:.1e}, lambda at the end {:.4}", out.cg_ratio.value);
        assert!((out.cg_ratio.value - lambda).abs() < 0.02 && out.cg_height.std > 0.0);
    }
}

#[test]
fn array_and_andrews_agree_at_every_step() {
    for file in ["plantlog_bumpy_C", "plantlog_accbrake_A"] {
        let table = vector_table(&format!("wheel_loader/{file}.csv"));
        let mut p = Parameters::default();
        let mut array = runs::begun(&p);
        p.filter.form = Form::Andrews;
        let mut andrews = runs::begun(&p);
        for row in &table.rows {
            let inputs = Inputs {
                torque_front: row[1],
                torque_rear: row[2],
                slope: row[5],
                spading_force_x: row[6],
                spading_force_z: row[7],
                speed: row[8],
                wheel_speed_front: row[9],
                wheel_speed_rear: row[10],
                ..Inputs::default()
            };
            array.step(&inputs, 0.01);
            andrews.step(&inputs, 0.01);
            let (a, b) = (array.state().machine.belief, andrews.state().machine.belief);
            assert!((a.mean - b.mean).amax() < 1e-9 && (a.factor - b.factor).amax() < 1e-9);
        }
    }
}
