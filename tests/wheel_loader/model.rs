//! The loader's model against reference vectors, finite differences and planar mechanics.

use crate::support::{Table, assert_close, vector_table};
use nalgebra::Vector3;
use proptest::prelude::*;
use wheelstate::model::wheel_loader::*;

fn loader(table: &Table, row: usize) -> WheelLoader {
    let limit = table.at(row, "mu_max(-1=inf)");
    let inertia = table.at(row, "I_e");
    let mut machine = with_tire(limit < 0.0, limit, inertia);
    if table.columns.iter().any(|c| c == "h_b") {
        machine.loader.bucket_height = table.at(row, "h_b");
        machine.loader.wheel_radius_rear = 0.548;
    }
    machine
}

/// The default loader with these tyres and axles.
fn with_tire(linear: bool, friction: f64, axle_inertia: f64) -> WheelLoader {
    let (axle_inertia_front, axle_inertia_rear) = (axle_inertia, axle_inertia);
    WheelLoader {
        loader: Loader { axle_inertia_front, axle_inertia_rear, ..Loader::default() },
        tire: Tire { friction: if linear { 1e6 } else { friction }, ..Tire::default() },
        ..WheelLoader::default()
    }
}

fn drive(table: &Table, row: usize) -> Drive {
    let at = |name| table.at(row, name);
    Drive {
        torque: [at("Tf"), at("Tr")],
        brake: [at("Bf"), at("Br")],
        slope: at("alpha"),
        force_x: at("Fx"),
        force_z: at("Fz"),
    }
}

fn point(table: &Table, row: usize) -> (Motion, Unknowns) {
    let at = |name| table.at(row, name);
    (Vector3::new(at("v"), at("wf"), at("wr")), Vector3::new(at("K"), at("h"), at("lam")))
}

#[test]
fn rates_loads_and_jacobian_match_the_reference() {
    let table = vector_table("wheel_loader/model_deriv.csv");
    assert_eq!(table.rows.len(), 240);
    let mut lifted = 0;
    for row in 0..table.rows.len() {
        let (x, p) = point(&table, row);
        let (machine, u) = (loader(&table, row), drive(&table, row));
        let (wide, jacobian, _) = machine.linearise(&x, &p, &u);
        let check = |name: &str, value: f64| {
            assert_close(&format!("row {row} {name}"), value, table.at(row, name), 1e-10, 1e-9);
        };
        for point in [machine.rates(&x, &p, &u), wide] {
            check("sig_f", point.slip[0]);
            check("sig_r", point.slip[1]);
            check("Fzf", point.load[0]);
            check("Fzr", point.load[1]);
            check("a_s", point.specific_force);
            check("D_raw", point.transfer);
            for (i, name) in ["v_dot", "wf_dot", "wr_dot"].iter().enumerate() {
                check(name, point.rates[i]);
            }
            assert_eq!(point.lift, table.at(row, "lift") != 0.0, "row {row}");
        }
        lifted += usize::from(wide.lift);
        for i in 0..3 {
            for j in 0..3 {
                check(&format!("J{i}{j}"), jacobian.motion[(i, j)]);
                check(&format!("J{i}{}", j + 3), jacobian.unknowns[(i, j)]);
            }
        }
    }
    assert!(lifted > 5, "the vectors hold lift-off: {lifted}");
}

#[test]
fn steps_match_the_reference() {
    let table = vector_table("wheel_loader/model_step.csv");
    assert_eq!(table.rows.len(), 100);
    for row in 0..table.rows.len() {
        let (x, p) = point(&table, row);
        let (loader, u) = (loader(&table, row), drive(&table, row));
        let (dt, substeps) = (table.at(row, "dt"), table.at(row, "n_sub") as u32);
        let (driven, radius) = (Driven::new(&loader, &u).overshooting(), loader.loader.wheel_radius());
        let plain = driven.advance(radius, &x, &p, dt, substeps);
        let (linearised, f) = driven.advance_linearised::<6>(radius, &x, &p, dt, substeps);
        for (i, name) in ["v1", "wf1", "wr1"].iter().enumerate() {
            assert_close(&format!("row {row} {name}"), plain[i], table.at(row, name), 1e-9, 1e-12);
            assert_close(&format!("row {row} {name} linearised"), linearised[i], table.at(row, name), 1e-9, 1e-12);
            for j in 0..6 {
                let name = format!("F{i}{j}");
                assert_close(&format!("row {row} {name}"), f[(i, j)], table.at(row, &name), 1e-9, 1e-12);
            }
        }
    }
}

/// Tyres that slip beyond their peak grip again within a millisecond, far less than a step. Against steps of 2.5 microseconds.
#[test]
fn steps_do_not_pass_rolling() {
    let of_22_t =
        Loader { mass: 22e3, wheelbase: 3.4, axle_inertia_front: 420.0, axle_inertia_rear: 420.0, ..Loader::default() };
    let (mut worst, mut passed) = (0.0_f64, 0.0_f64);
    for loader in [Loader::default(), of_22_t] {
        let machine = WheelLoader { loader, ..WheelLoader::default() };
        let (radius, u) = (loader.wheel_radius(), Drive { torque: [600.0, 500.0], ..Drive::default() });
        for k in 0..400 {
            let wave = |rate: f64| (rate * f64::from(k)).sin();
            let (v, p) = (2.3 + 2.0 * wave(0.37), Vector3::new(25.0 + 20.0 * wave(0.41), 1.0, 0.5 + 0.2 * wave(0.43)));
            let x = Vector3::new(v, v / radius[0] + 0.3 * wave(0.53), v / radius[1] + 0.3 * wave(0.59));
            let slip = |x: &Motion, i: usize| radius[i] * x[1 + i] - x[0];
            let driven = Driven::new(&machine, &u);
            let coarse = driven.advance(radius, &x, &p, 0.01, 2);
            let (linearised, _) = driven.advance_linearised::<3>(radius, &x, &p, 0.01, 2);
            let fine = driven.clone().overshooting().advance(radius, &x, &p, 0.01, 4000);
            let study = driven.overshooting().advance(radius, &x, &p, 0.01, 2);
            for i in 0..2 {
                worst = worst.max((slip(&coarse, i) - slip(&fine, i)).abs());
                passed = passed.max((slip(&study, i) - slip(&fine, i)).abs());
                assert_close("linearised", linearised[1 + i], coarse[1 + i], 1e-12, 1e-12);
            }
        }
    }
    println!("slip after 10 ms off by {worst:.4} m/s, by the study's steps {passed:.3} m/s");
    assert!(worst < 0.025 && passed > 0.5);
}

/// Newton and Euler in the plane, written down without elimination: the sum of forces along x and z
/// and of moments about the CG vanish for the loads and the acceleration that the model returns.
#[test]
fn loads_balance_forces_and_moments() {
    let loader = Loader { bucket_height: 0.4, ..Loader::default() };
    let machine = WheelLoader { loader, ..WheelLoader::default() };
    let (h, lambda, stiffness) = (0.95, 0.45, 19.0);
    let (m, l) = (loader.mass, loader.wheelbase);
    for (slope, force_x, force_z, spin) in
        [(0.0, 0.0, 0.0, 1.01), (0.12, 0.0, 0.0, 1.03), (-0.1, 4000.0, 2500.0, 1.02), (0.0, -900.0, 0.0, 0.97)]
    {
        let x = Vector3::new(2.0, 2.0 / 0.55 * spin, 2.0 / 0.55 * (2.0 - spin));
        let u = Drive { slope, force_x, force_z, ..Drive::default() };
        let at = machine.rates(&x, &Vector3::new(stiffness, h, lambda), &u);
        assert!(!at.lift && !at.guarded);
        let tractive = |i: usize| 0.75 * (stiffness * at.slip[i] / 0.75).tanh() * at.load[i];
        let resistance = machine.rolling.coefficient * (at.load[0] + at.load[1]);
        let along = tractive(0) + tractive(1) - resistance - force_x - m * GRAVITY * slope.sin() - m * at.rates[0];
        let normal = at.load[0] + at.load[1] - m * GRAVITY * slope.cos() - force_z;
        let (to_front, to_rear) = (l * (1.0 - lambda), l * lambda);
        // Pitch nose-up about the CG; forces at the ground act h below it.
        let tip = (to_front + loader.bucket_reach, loader.bucket_height - h);
        let pitch = at.load[0] * to_front - at.load[1] * to_rear + (tractive(0) + tractive(1) - resistance) * h
            - force_z * tip.0
            + force_x * tip.1;
        assert_close("along", along, 0.0, 0.0, 1e-8);
        assert_close("normal", normal, 0.0, 0.0, 1e-8);
        assert_close("pitch", pitch, 0.0, 0.0, 1e-7);
    }
}

proptest! {
    #[test]
    fn jacobian_is_the_derivative(
        v in -3.0..6.0f64, sf in -0.2..0.2f64, sr in -0.2..0.2f64, stiffness in 3.0..60.0f64, h in 0.4..2.2f64,
        lambda in 0.15..0.85f64, torque in -4000.0..4000.0f64, brake in 0.0..800.0f64, slope in -0.2..0.2f64,
        force in 0.0..6000.0f64, linear in any::<bool>()
    ) {
        let machine = with_tire(linear, 0.75, 36.0);
        let u = Drive { torque: [torque, 0.5 * torque], brake: [brake, 0.0], slope, force_x: force, force_z: 0.4 * force };
        let x = Vector3::new(v, v * (1.0 + sf) / 0.55, v * (1.0 + sr) / 0.55);
        let p = Vector3::new(stiffness, h, lambda);
        let (at, j, load) = machine.linearise(&x, &p, &u);
        // Away from the seams, where one-sided derivatives differ.
        let near_seam = |f: f64| (f - machine.tire.slip_speed).abs() < 1e-3;
        prop_assume!(!(0..2).any(|i| near_seam(v.abs()) || near_seam((0.55 * x[i + 1]).abs()) || at.slip[i].abs() < 1e-3));
        prop_assume!(at.load.iter().all(|load| *load == 0.0 || load.abs() > 50.0) && (at.transfer - 0.1).abs() > 1e-2);
        for k in 0..8 {
            let eps = 1e-6 * if k < 3 { x[k].abs().max(1.0) } else if k < 6 { p[k - 3] } else { 1.0 };
            let shifted = |s: f64| {
                let (mut x, mut p, mut machine) = (x, p, machine);
                match k {
                    0..3 => x[k] += s,
                    3..6 => p[k - 3] += s,
                    6 => machine.loader.wheel_radius_front *= s.exp(),
                    _ => machine.loader.wheel_radius_rear *= s.exp(),
                }
                machine.rates(&x, &p, &u)
            };
            let (up, down) = (shifted(eps), shifted(-eps));
            prop_assume!(up.lift == at.lift && down.lift == at.lift);
            let numeric = (up.rates - down.rates) / (2.0 * eps);
            if k < 6 {
                let numeric = (up.load[0] - down.load[0]) / (2.0 * eps);
                prop_assert!((load[k] - numeric).abs() <= 1e-5 * numeric.abs().max(1e3), "load {k}: {} {numeric}", load[k]);
            }
            for i in 0..3 {
                let analytic = match k {
                    0..3 => j.motion[(i, k)],
                    3..6 => j.unknowns[(i, k - 3)],
                    _ => j.radii[(i, k - 6)],
                };
                let scale = numeric.amax().max(analytic.abs()).max(1.0);
                prop_assert!((analytic - numeric[i]).abs() <= 1e-5 * scale, "J{i}{k}: {analytic} {numeric}");
            }
        }
    }

    #[test]
    fn steps_stay_finite(
        x in prop::array::uniform3(-50.0..50.0f64), torque in -1e5..1e5f64, stiffness in 2.0..80.0f64,
        h in 0.3..2.5f64, lambda in 0.1..0.9f64, force in -1e5..1e5f64, linear in any::<bool>()
    ) {
        let machine = with_tire(linear, 0.75, 3.33);
        let u = Drive { torque: [torque, -torque], force_x: force, force_z: -force, ..Drive::default() };
        let mut x = Vector3::from(x);
        for _ in 0..100 {
            x = machine.advance(&x, &Vector3::new(stiffness, h, lambda), &u, 0.01, 2);
        }
        prop_assert!(x.iter().all(|value| value.is_finite()));
    }
}
