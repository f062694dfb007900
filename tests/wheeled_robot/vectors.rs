//! Reference vectors of the wheeled robot: tyre, loads, motion, wheel-force observer, cubature filter.

use crate::support::{assert_close, vector_table, vector_text};
use nalgebra::{Vector3, Vector4};
use serde_json::Value;
use wheelstate::filter::discretise::runge_kutta;
use wheelstate::filter::gaussian::FactoredGaussian;
use wheelstate::filter::innovation::Gate;
use wheelstate::filter::sliding_mode::{Adaptation, SlidingMode};
use wheelstate::filter::srckf;
use wheelstate::model::tire::{Tire, TireSet};
use wheelstate::model::wheeled_robot::{Drive, Motion, Vehicle, Wheel, WheeledRobot, wheel_torque};

const FOLDER: &str = "wheeled_robot";

fn params() -> Value {
    // the file writes Infinity, which JSON does not know
    serde_json::from_str(&vector_text(&format!("{FOLDER}/params.json")).replace("Infinity", "1e300")).unwrap()
}

fn tire(v: &Value) -> Tire {
    let number = |key: &str| v[key].as_f64().unwrap();
    Tire {
        stiffness: number("K0"),
        nominal_load: number("Fz0"),
        load_sensitivity: number("c2"),
        shape: number("C"),
        friction: number("mu0"),
        friction_slope: number("mu1"),
        curvature: number("E"),
        ..Tire::default()
    }
}

fn robot(combined: bool) -> WheeledRobot {
    let params = params();
    let v = &params["vehicle"];
    let number = |key: &str| v[key].as_f64().unwrap();
    let vehicle = Vehicle {
        mass: number("m"),
        yaw_inertia: number("Iz"),
        cg_to_front: number("lf"),
        cg_to_rear: number("lr"),
        track_front: number("tf"),
        track_rear: number("tr"),
        cg_height: number("h"),
        ..Vehicle::default()
    };
    let tire = TireSet { front: tire(&v["front"]), rear: tire(&v["rear"]), combined };
    WheeledRobot::new(&vehicle, &tire, number("v_min"))
}

#[test]
fn the_magic_formula_matches_the_reference() {
    let params = params();
    let text = vector_text(&format!("{FOLDER}/magic.csv"));
    let sets: Vec<_> = text.lines().skip(1).map(|line| line.split(',').next().unwrap().to_owned()).collect();
    let table = vector_table(&format!("{FOLDER}/magic.csv"));
    for (row, set) in sets.iter().enumerate() {
        let tire = tire(&params["magic_sets"][set]);
        let at = |name| table.at(row, name);
        let c = tire.coefficients(at("fz"));
        for (name, value) in [("B", c.b), ("C", c.c), ("D", c.d), ("E", c.e)] {
            assert_close(&format!("{set} row {row} {name}"), value, at(name), 1e-12, 0.0);
        }
        let force = tire.lateral_force(at("alpha"), at("fz"));
        assert_close(&format!("{set} row {row} fy"), force, at("fy"), 1e-12, 1e-12 * tire.nominal_load);
    }
    assert_eq!(sets.len(), 231);
}

#[test]
fn wheel_loads_match_the_reference() {
    let (robot, table) = (robot(false), vector_table(&format!("{FOLDER}/loads.csv")));
    for row in 0..table.rows.len() {
        let loads = robot.loads(table.at(row, "ax"), table.at(row, "ay"));
        for (load, name) in loads.iter().zip(["fz_fl", "fz_fr", "fz_rl", "fz_rr"]) {
            assert_close(&format!("row {row} {name}"), *load, table.at(row, name), 1e-12, 1e-10);
            assert!(*load >= 0.0);
        }
        assert_close("sum of loads", loads.iter().sum(), 60.0 * 9.81, 1e-14, 0.0);
    }
}

#[test]
fn the_model_matches_the_reference() {
    let table = vector_table(&format!("{FOLDER}/model.csv"));
    for row in 0..table.rows.len() {
        let at = |name: &str| table.at(row, name);
        let four = |name: &str| ["fl", "fr", "rl", "rr"].map(|wheel| at(&format!("{name}_{wheel}")));
        let robot = robot(at("combined") != 0.0);
        let x = [at("vx"), at("vy"), at("r")];
        let drive = Drive::new(at("delta"), four("fx"));
        let driven = robot.driven(&drive);
        for forces in driven.forces_of(&[x]).into_iter().chain([robot.forces(&x, &drive)]) {
            for i in 0..4 {
                assert_close(&format!("row {row} alpha"), forces.slip_angle[i], four("alpha")[i], 1e-12, 1e-13);
                assert_close(&format!("row {row} fz"), forces.load[i], four("fz")[i], 1e-12, 1e-9);
                assert_close(&format!("row {row} fy"), forces.lateral[i], four("fy")[i], 1e-12, 1e-10);
            }
            assert_close(&format!("row {row} ax"), forces.accel_x, at("ax"), 1e-12, 1e-11);
            assert_close(&format!("row {row} ay"), forces.accel_y, at("ay"), 1e-12, 1e-11);
        }
        let rate = robot.derivative(&x, &drive);
        let euler: Motion = std::array::from_fn(|i| x[i] + 0.01 * rate[i]);
        let rk4 = runge_kutta(&Vector3::from(x), 0.01, |x| driven.derivatives_of(&[(*x).into()])[0].into());
        for (i, name) in ["vx", "vy", "r"].iter().enumerate() {
            assert_close(&format!("row {row} d{name}"), rate[i], at(&format!("d{name}")), 1e-12, 1e-10);
            assert_close(&format!("row {row} euler {name}"), euler[i], at(&format!("euler_{name}")), 1e-12, 1e-12);
            assert_close(&format!("row {row} rk4 {name}"), rk4[i], at(&format!("rk4_{name}")), 1e-12, 1e-12);
        }
    }
}

#[test]
fn the_sliding_mode_observer_matches_the_reference() {
    let params = params();
    for variant in ["fixed", "nominal", "feedforward", "adaptive", "limited"] {
        let v = &params["asmo"][variant];
        let number = |key: &str| v[key].as_f64().unwrap();
        let adaptive = v["adaptive"].as_bool().unwrap();
        let wheel = Wheel { inertia: number("J"), radius: number("R"), ..Wheel::default() };
        let observer = SlidingMode {
            gain: number("k"),
            amplitude: number("eps"),
            steepness: number("a"),
            nominal_rate: number("lam"),
            force_limit: number("f_max"),
            feedforward: v["feedforward"].as_bool().unwrap(),
            adaptation: adaptive.then(|| Adaptation {
                rate: number("gamma"),
                dead_zone: number("s_dead"),
                least: number("eps_min"),
                greatest: number("eps_max"),
            }),
        };
        let table = vector_table(&format!("{FOLDER}/asmo_{variant}.csv"));
        let (mut state, mut torque) = (observer.start(), 0.0);
        for row in 0..table.rows.len() {
            let at = |name| table.at(row, name);
            let (drive, brake, speed) = (at("t_drive"), at("t_brake"), at("omega"));
            if drive.is_finite() && brake.is_finite() {
                torque = wheel_torque(
                    drive,
                    brake,
                    if speed.is_finite() { speed } else { state.speed },
                    number("omega_stop"),
                    0.0,
                );
            }
            let force = observer.step(&wheel, &mut state, speed, torque, 0.01);
            let what = |name| format!("{variant} row {row} {name}");
            assert_close(&what("f_hat"), force, at("f_hat"), 1e-9, 1e-9);
            assert_close(&what("omega_hat"), state.speed, at("omega_hat"), 1e-9, 1e-9);
            assert_close(&what("f_bar"), state.nominal, at("f_bar"), 1e-9, 1e-9);
            assert_close(&what("eps"), state.amplitude, at("eps"), 1e-9, 1e-9);
            assert_eq!(f64::from(state.stale), at("stale"), "{}", what("stale"));
        }
        assert_eq!(table.rows.len(), 601);
    }
}

#[test]
fn the_cubature_filter_matches_the_reference() {
    let (params, robot) = (params(), robot(false));
    let v = &params["srckf"];
    let list = |key: &str| Vector3::from_iterator(v[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()));
    let channels = ["ax", "ay", "r", "vx"];
    let r_std = Vector4::from_iterator(channels.iter().map(|c| v["r_std"][c].as_f64().unwrap()));
    for name in ["p", "g", "w", "p_gaps", "g_gaps", "w_gaps"] {
        let table = vector_table(&format!("{FOLDER}/srckf_{name}.csv"));
        let mut filter = FactoredGaussian::independent(list("x0"), &list("p0_std"));
        let mut before: Option<Drive> = None;
        for row in 0..table.rows.len() {
            let at = |column: &str| table.at(row, column);
            let drive = Drive::new(at("delta"), ["fx_fl", "fx_fr", "fx_rl", "fx_rr"].map(at));
            if let Some(u) = before {
                srckf::predict(&mut filter, &list("q_std"), |x: &[Vector3<f64>; 6]| {
                    let rates = robot.driven(&u).derivatives_of(&x.map(Motion::from));
                    std::array::from_fn(|k| x[k] + Vector3::from(rates[k]) * 0.01)
                });
            }
            let column = |c: &str| table.columns.iter().position(|name| *name == format!("z_{c}"));
            let z = Vector4::from_iterator(channels.iter().map(|c| column(c).map_or(f64::NAN, |i| table.rows[row][i])));
            let innovation =
                srckf::correct(&mut filter, &z, &r_std, (Gate::OPEN, &mut 0), [false; 3], |x: &[Vector3<f64>; 6]| {
                    let accelerations = robot.driven(&drive).accelerations_of(&x.map(Motion::from));
                    std::array::from_fn(|k| Vector4::new(accelerations[k][0], accelerations[k][1], x[k][2], x[k][0]))
                });
            before = Some(drive);
            for (i, state) in ["vx", "vy", "r"].iter().enumerate() {
                assert_close(&format!("{name} row {row} {state}"), filter.mean[i], at(state), 1e-8, 1e-9);
                for j in 0..=i {
                    let what = format!("s{i}{j}");
                    assert_close(&format!("{name} row {row} {what}"), filter.factor[(i, j)], at(&what), 1e-8, 1e-9);
                }
            }
            // the reference writes NaN where nothing is measured
            let nis = if innovation.dof > 0 { at("nis") } else { 0.0 };
            assert_close(&format!("{name} row {row} nis"), innovation.nis, nis, 1e-8, 1e-9);
            assert_close(&format!("{name} row {row} loglik"), innovation.log_likelihood, at("loglik"), 1e-8, 1e-8);
        }
        assert_eq!(table.rows.len(), 501);
    }
}
