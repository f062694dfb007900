//! An independent car: the 29-state multi-body model of commonroad-vehicle-models, whose logs
//! tests/oracles/multibody_car.py wrote. Tyres are the nominal ones of that package, or fitted ones.

use crate::support::{Table, vector_table};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::Estimator;
use wheelstate::estimator::wheeled_robot::{Inputs, Outputs, Parameters, WheeledRobot};

pub fn car(fitted: bool, friction: f64) -> Parameters {
    let mut p = Parameters::default();
    let v = &mut p.vehicle;
    (v.mass, v.yaw_inertia, v.cg_to_front, v.cg_to_rear) = (1093.3, 1791.6, 1.1562, 1.4227);
    (v.track_front, v.track_rear, v.cg_height) = (1.3868, 1.3640, 0.5749);
    (p.wheel.radius, p.wheel.inertia) = (0.344, 1.7);
    for (tire, load, stiffness, shape, curvature) in
        [(&mut p.tire.front, 2959.0, 75_300.0, 1.32, 0.36), (&mut p.tire.rear, 2404.0, 66_700.0, 1.30, 0.0)]
    {
        (tire.nominal_load, tire.stiffness, tire.shape, tire.curvature) = (load, stiffness, shape, curvature);
        if !fitted {
            (tire.nominal_load, tire.stiffness, tire.shape, tire.curvature) = (2681.3, 58_774.0, 1.3507, -0.0075);
        }
        tire.load_sensitivity = 1.6;
        (tire.friction, tire.friction_slope) = (1.049 * friction, -0.15 * friction);
    }
    let o = &mut p.observer;
    (o.gain, o.amplitude, o.steepness, o.nominal_rate) = (10.0, 400.0, 0.1, 12.5);
    o.measurement_std.torque = 10.0;
    let q = &mut p.filter.process_psd;
    (q.speed_x, q.speed_y, q.yaw_rate) = (0.04, 0.09, 0.01);
    let r = &mut p.filter.measurement_std;
    (r.accel_x, r.accel_y, r.gyro_z, r.speed) = (0.15, 0.6, 0.006, 0.1);
    (p.filter.minimum_speed, p.filter.substeps) = (1.0, 4);
    p.initial.speed_x = 15.0;
    p
}

/// What sensors with noise make of a log, with the true motion.
pub fn sensors(table: &Table, seed: u64) -> Vec<(Inputs, [f64; 3])> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |std: f64| std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    (0..table.rows.len())
        .map(|row| {
            let at = |name: &str| table.at(row, name);
            let four = |name: &str| ["fl", "fr", "rl", "rr"].map(|wheel| at(&format!("{name}_{wheel}")));
            let torque = four("drive_torque").map(|t| t + noise(10.0));
            let speed = four("wheel_speed").map(|w| w + noise(0.03));
            let inputs = Inputs {
                steering_angle: at("steering_angle") + noise(0.001),
                drive_torque_fl: torque[0],
                drive_torque_fr: torque[1],
                drive_torque_rl: torque[2],
                drive_torque_rr: torque[3],
                wheel_speed_fl: speed[0],
                wheel_speed_fr: speed[1],
                wheel_speed_rl: speed[2],
                wheel_speed_rr: speed[3],
                accel_x: at("accel_x") + noise(0.1),
                accel_y: at("accel_y") + noise(0.1),
                gyro_z: at("gyro_z") + noise(0.005),
                speed: f64::NAN,
                ..Inputs::default()
            };
            (inputs, [at("true_speed_x"), at("true_speed_y"), at("gyro_z")])
        })
        .collect()
}

/// RMSE after the first second: longitudinal force of a wheel, torque over radius, vx, vy, r; and the mean squared
/// errors of vx, vy, r over their claimed variances.
fn errors(table: &Table, p: &Parameters) -> ([f64; 5], [f64; 3]) {
    let mut estimator = WheeledRobot::new(p).unwrap();
    let mut out = Outputs::default();
    let (mut sum, mut claimed, mut count) = ([0.0; 5], [0.0; 3], 0.0);
    for (row, (inputs, motion)) in sensors(table, 5).iter().enumerate() {
        estimator.step(inputs, 0.01);
        estimator.outputs(inputs, 0.0, &mut out);
        if row < 100 {
            continue;
        }
        let truth = ["fl", "fr", "rl", "rr"].map(|wheel| table.at(row, &format!("true_wheel_force_x_{wheel}")));
        let torque = [inputs.drive_torque_fl, inputs.drive_torque_fr, inputs.drive_torque_rl, inputs.drive_torque_rr];
        let force = [out.wheel_force_x_fl, out.wheel_force_x_fr, out.wheel_force_x_rl, out.wheel_force_x_rr];
        let force = force.map(|force| force.value);
        for i in 0..4 {
            sum[0] += 0.25 * (force[i] - truth[i]).powi(2);
            sum[1] += 0.25 * (torque[i] / p.wheel.radius - truth[i]).powi(2);
        }
        for (i, estimate) in [out.speed_x, out.speed_y, out.yaw_rate].into_iter().enumerate() {
            let error = estimate.value - motion[i];
            sum[2 + i] += error * error;
            claimed[i] += (error / estimate.std).powi(2);
        }
        count += 1.0;
    }
    (sum.map(|s| f64::sqrt(s / count)), claimed.map(|s| s / count))
}

#[test]
fn motion_and_forces_of_a_multibody_car_are_followed() {
    println!("scenario: Fx observer, Fx torque/radius, N; fitted tyres: vx vy m/s, r rad/s; nominal tyres: vy");
    // limits of the force (N) and of the longitudinal speed (m/s)
    for (name, friction, force, speed_x) in [
        ("sine", 1.0, 21.0, 0.05),
        ("dlc", 1.0, 21.0, 0.05),
        ("step", 1.0, 21.0, 0.05),
        ("accel_brake", 1.0, 65.0, 0.30), // torques jump by 500 N m here
        ("low_mu", 0.45, 21.0, 0.05),
    ] {
        let table = vector_table(&format!("wheeled_robot/multibody_{name}.csv"));
        let ((fitted, claimed), (nominal, _)) =
            (errors(&table, &car(true, friction)), errors(&table, &car(false, friction)));
        println!(
            "{name}: {:.1} {:.1}; {:.3} {:.4} {:.4}; {:.4}; squared errors over variances {claimed:.2?}",
            fitted[0], fitted[1], fitted[2], fitted[3], fitted[4], nominal[3]
        );
        assert!(fitted[0] < force && fitted[0] < 0.8 * fitted[1], "{name}");
        assert!(fitted[2] < speed_x, "{name}");
        assert!(fitted[3] <= 0.030 && fitted[3] < nominal[3], "{name}");
        assert!(fitted[4] < 0.005, "{name}");
        assert!(claimed[1] < 1.0 && claimed[2] < 1.0, "{name} {claimed:?}");
    }
}

#[test]
fn slip_stiffness_corrects_the_speed_of_slipping_wheels() {
    let table = vector_table("wheeled_robot/multibody_accel_brake.csv");
    let mut p = car(true, 1.0);
    let (rigid, doubt) = errors(&table, &p);
    p.wheel.slip_stiffness = 25.0;
    let (corrected, sure) = errors(&table, &p);
    println!(
        "accelerate and brake: speed_x {:.3} m/s, with wheel.slip_stiffness {:.3} m/s; squared over variance {:.1}, {:.2}",
        rigid[2], corrected[2], doubt[0], sure[0]
    );
    assert!(corrected[2] < 0.7 * rigid[2] && sure[0] < 1.0);
}
