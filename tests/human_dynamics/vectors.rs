//! Whole-body dynamics against the reference vectors: means, variances, equations, derivatives.

use super::cases::*;
use crate::support::{assert_close, vector_text};
use nalgebra::Vector3;
use wheelstate::estimator::human_dynamics::variables::JOINTS;
use wheelstate::filter::savitzky_golay;
use wheelstate::{Estimator, Status};

#[test]
fn means_and_variances_match_the_reference() {
    for name in CASES {
        let mut case = case(name);
        let status = case.step(true);
        let stiff = name.ends_with("stiff") || name.ends_with("missing");
        let mean = largest_difference(case.body.mean(), &case.mean);
        let variance = largest_relative(case.body.variance(), &case.variance);
        println!("{name:32} mean {mean:.1e} variance {variance:.1e} {status}");
        let bound = if stiff && name.starts_with("seated") { 1e-7 } else { 1e-8 };
        assert!(mean <= bound, "{name}: mean off by {mean:e}");
        let bound = if name.ends_with("stiff") { 1e-4 } else { 1e-8 };
        assert!(variance <= bound, "{name}: variance off by {variance:e}");
        assert_eq!(status.contains(wheelstate::Status::MISSING), name.ends_with("missing"));
        assert!(!status.contains(wheelstate::Status::RECOVERED));

        let check = &case.data["check"];
        assert_eq!(case.body.equations().variables() as u64, case.data["n_var"].as_u64().unwrap());
        assert_eq!(case.body.equations().constraint_rows() as u64, case.data["n_eq"].as_u64().unwrap());
        assert_eq!(case.body.measurements() as u64, case.data["n_meas"].as_u64().unwrap());
        let chi2 = check["chi2"].as_f64().unwrap();
        assert_close(name, case.body.objective(), chi2, if name.ends_with("stiff") { 1e-4 } else { 1e-8 }, 0.0);
    }
}

#[test]
fn entries_of_the_equations_match_the_reference() {
    for name in CASES {
        let mut case = case(name);
        case.step(false);
        let rows = case.body.equations().rows();
        let constraints = case.body.equations().constraint_rows();
        let norm = |from: usize, to: usize| {
            let present = (from..to).filter(|&r| case.body.residual(r).1 > 0.0);
            present.fold((0.0, 0.0), |(a, b), r| {
                let row: f64 = rows.value[rows.start[r]..rows.start[r + 1]].iter().map(|v| v.abs()).sum();
                (a + row, b + rows.offset[r].abs())
            })
        };
        let (d, b_d) = norm(0, constraints);
        let (y, b_y) = norm(constraints, rows.len());
        let check = &case.data["check"];
        for (what, actual) in [("norm_D", d), ("norm_bD", b_d), ("norm_Y", y), ("norm_bY", b_y)] {
            assert_close(&format!("{name} {what}"), actual, check[what].as_f64().unwrap(), 1e-10, 0.0);
        }
    }
}

#[test]
fn the_orthogonal_method_matches_the_reference() {
    for name in CASES {
        let mut case = case(name);
        case.step_by_qr();
        let mean = largest_difference(case.body.mean(), &case.mean);
        let variance = largest_relative(case.body.variance(), &case.variance);
        println!("{name:32} mean {mean:.1e} variance {variance:.1e}");
        assert!(mean <= 1e-8, "{name}: mean off by {mean:e}");
        assert!(variance <= 1e-9, "{name}: variance off by {variance:e}");
    }
}

#[test]
fn savitzky_golay_derivatives_match_the_reference() {
    let data: serde_json::Value = serde_json::from_str(&vector_text("human_dynamics/savgol.json")).unwrap();
    let window = 2 * data["m"].as_u64().unwrap() as usize + 1;
    let dt = data["dt"].as_f64().unwrap();
    let x = numbers(&data["x"]);
    for derivative in 0..3 {
        let expected = numbers(&data[format!("d{derivative}")]);
        let actual = savitzky_golay::smooth(&x, window, derivative, dt);
        let scale = expected.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(largest_difference(&actual, &expected) <= 1e-12 * scale);
    }
    for derivative in 1..3 {
        let expected = numbers(&data[format!("causal_weights_d{derivative}")]);
        let actual = savitzky_golay::weights(window, window - 1, derivative, dt);
        let scale = expected.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(largest_difference(&actual, &expected) <= 1e-12 * scale);
    }
}

/// A vector's posture and truth fed through the estimator: the default sensors reproduce the
/// torques of inverse dynamics when all contacts are measured.
#[test]
fn torques_of_a_posture_match_the_reference() {
    let case = case("seated12_moving_compact");
    let mut estimator = estimator(&ALL);
    let order: Vec<String> = case.data["dof_names"].as_array().unwrap().iter().map(text).collect();
    let layout = case.data["layout"].as_array().unwrap();
    let truth = numbers(&case.data["true_d"]);
    let slot = |body: &str, kind: &str| {
        let entry = layout.iter().find(|e| text(&e[0]) == body && text(&e[1]) == kind).unwrap();
        truth[entry[2].as_u64().unwrap() as usize..entry[3].as_u64().unwrap() as usize].to_vec()
    };
    let mut inputs = sitting();
    let tau = numbers(&case.data["rnea_tau"]);
    let qdd_of = |c: usize| case.body.equations().tree().dof_places[c];
    for (joint, (_, name, _)) in JOINTS.iter().enumerate() {
        let c = order.iter().position(|o| o == name).unwrap();
        inputs.q[joint] = case.q[c];
        inputs.qd[joint] = case.qd[c];
        let (body, k) = qdd_of(c);
        inputs.qdd[joint] = slot(&case.body.equations().tree().bodies[body].name, "qdd")[k];
    }
    inputs.base_gyro = case.base_rate;
    let a0 = slot("Pelvis", "a");
    inputs.base_accel.copy_from_slice(&a0[..3]);
    inputs.base_angular_accel.copy_from_slice(&a0[3..]);
    // wrenches move from the link origin to the sensor: m_s = m - p x f
    let at = |wrench: &[f64], z: f64| {
        let f = Vector3::new(wrench[0], wrench[1], wrench[2]);
        let m = Vector3::new(wrench[3], wrench[4], wrench[5]) - Vector3::new(0.0, 0.0, z).cross(&f);
        [f.x, f.y, f.z, m.x, m.y, m.z]
    };
    inputs.seat = at(&slot("Pelvis", "f"), -0.1);
    for (k, (link, z)) in
        [("RightForeArm", -0.2), ("LeftForeArm", -0.2), ("RightShank", -0.4), ("LeftShank", -0.4)].iter().enumerate()
    {
        inputs.contact[k] = at(&slot(link, "fx"), *z);
    }
    inputs.imu = [[f64::NAN; 3]; 4];
    let status = estimator.step(&inputs, 0.01);
    assert!(status.contains(Status::MISSING) && !status.contains(Status::SKIPPED));
    let outputs = outputs(&estimator, &inputs);
    assert!(outputs.diagnostics.healthy);
    for (joint, (name, model, _)) in JOINTS.iter().enumerate() {
        let expected = tau[order.iter().position(|o| o == model).unwrap()];
        let off = (outputs.tau[joint].value - expected).abs();
        assert!(off < 0.25 * outputs.tau[joint].std + 0.02, "{name}: {} {expected}", outputs.tau[joint].value);
    }
    let seat = slot("Pelvis", "f");
    for (estimate, truth) in outputs.seat_wrench.iter().zip(&seat) {
        assert!((estimate.value - truth).abs() < estimate.std, "{estimate:?} {truth}");
    }
    let com = numbers(&case.data["com_base"]);
    assert!(largest_difference(&outputs.com, &com) < 1e-12);
    assert!((outputs.body_mass - 65.0).abs() < 1e-12);
}
