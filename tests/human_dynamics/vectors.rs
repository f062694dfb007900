//! Whole-body dynamics against the reference vectors: means, variances, equations, derivatives.

use super::cases::*;
use crate::support::{assert_close, vector_text};
use wheelstate::filter::savitzky_golay;

#[test]
fn means_and_variances() {
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
fn entries_of_the_equations() {
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
fn orthogonal_method() {
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
fn savitzky_golay_derivatives() {
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
