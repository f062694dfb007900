//! The unsupervised square-root filter against filterpy: sigma points, prediction and covariance of
//! `tests/oracles/wheel_loader_filterpy.py`, whose model is written anew.

use wheelstate::Estimator;
use wheelstate::estimator::wheel_loader::*;

fn parameters(alpha: f64, form: Form) -> Parameters {
    let mut p = Parameters::default();
    let slope = |p: f64, lo: f64, hi: f64| (p - lo) * (hi - p) / (hi - lo);
    p.initial.slip_stiffness = 14.0;
    p.initial.cg_height = 1.05;
    p.initial.cg_ratio = 0.52;
    p.initial.slip_stiffness_std = 0.8 * slope(14.0, 2.0, 80.0);
    p.initial.cg_height_std = 0.35 * slope(1.05, 0.3, 2.5);
    p.initial.cg_ratio_std = 0.5 * slope(0.52, 0.1, 0.9);
    p.filter.alpha = alpha;
    p.filter.form = form;
    p.filter.radii = Radii::Fixed;
    p.filter.overshoot = true;
    p.filter.supervise = false;
    p.filter.interpolate_inputs = false;
    (p.filter.measurement_std.speed, p.filter.measurement_std.wheel_speed) = (0.03, 0.05);
    p
}

#[test]
fn filterpy_agrees_to_twelve_digits() {
    let text = include_str!("../oracles/wheel_loader_filterpy.csv");
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 148);
    for form in [Form::Array, Form::Andrews] {
        let (mut worst_mean, mut worst_covariance) = (0.0_f64, 0.0_f64);
        let mut estimator = WheelLoader::new(&parameters(1.0, form)).unwrap();
        for row in &rows {
            if row[1] == 1.0 {
                estimator = WheelLoader::new(&parameters(row[0], form)).unwrap();
                // The first sample of the script's drive.
                let slip = 900.0 / (0.55 * 19.0 * 23000.0);
                let first = Inputs {
                    speed: 2.0,
                    wheel_speed_front: 2.0 * (1.0 + 1.1 * slip) / 0.55 + 0.02 * 1f64.sin(),
                    wheel_speed_rear: 2.0 * (1.0 + 0.8 * slip) / 0.55 + 0.02 * 2f64.sin(),
                    ..Inputs::default()
                };
                estimator.step(&first, 0.01);
            }
            let inputs = Inputs {
                torque_front: row[2],
                torque_rear: row[3],
                slope: row[4],
                spading_force_x: row[5],
                spading_force_z: row[6],
                speed: row[7],
                wheel_speed_front: row[8],
                wheel_speed_rear: row[9],
                ..Inputs::default()
            };
            estimator.step(&inputs, 0.01);
            let belief = estimator.state().machine.belief;
            let covariance = belief.factor * belief.factor.transpose();
            let mut expected = row[16..].iter();
            for i in 0..6 {
                worst_mean = worst_mean.max((belief.mean[i] - row[10 + i]).abs());
                for j in 0..=i {
                    worst_covariance = worst_covariance.max((covariance[(i, j)] - expected.next().unwrap()).abs());
                }
            }
        }
        println!("{form:?}: mean off by {worst_mean:.1e}, covariance by {worst_covariance:.1e}");
        assert!(worst_mean < 1e-12 && worst_covariance < 1e-12);
    }
}
