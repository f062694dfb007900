//! The seated body as an estimator: its contract with FMU and logs.

use super::cases::*;
use nalgebra::{Rotation3, Vector3};
use wheelstate::estimator::human_dynamics::variables::JOINTS;
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};
use wheelstate::{Estimator, Status, Variables};

fn estimator(set: &[(&str, f64)]) -> HumanDynamics {
    let mut parameters = Parameters::default();
    for (name, value) in set {
        parameters.set(name, *value).unwrap();
    }
    HumanDynamics::new(&parameters).unwrap()
}

fn outputs(estimator: &HumanDynamics, inputs: &Inputs) -> Outputs {
    let mut outputs = Outputs::default();
    estimator.outputs(inputs, 0.0, &mut outputs);
    outputs
}

const ALL: [(&str, f64); 4] =
    [("use.seat_wrench", 1.0), ("use.imu", 1.0), ("use.hand_wrench", 1.0), ("use.foot_wrench", 1.0)];

#[test]
fn declared_variables() {
    let names = |list: Vec<wheelstate::Variable>| list.into_iter().map(|v| v.name).collect::<Vec<_>>();
    let inputs = names(Inputs::declare());
    for name in ["q_lumbar_x", "qd_neck_z", "qdd_left_knee_y", "base_gyro_x", "base_angular_accel_z", "seat_force_x"] {
        assert!(inputs.contains(&name.to_owned()), "{name}");
    }
    for name in ["imu_right_forearm_accel_y", "left_foot_moment_z", "seat_moment_y", "right_hand_force_x"] {
        assert!(inputs.contains(&name.to_owned()), "{name}");
    }
    let outputs = names(Outputs::declare());
    for name in ["tau_lumbar_x", "tau_left_knee_y_std", "seat_wrench_moment_z_std", "com_x", "body_mass", "chi2_imu"] {
        assert!(outputs.contains(&name.to_owned()), "{name}");
    }
    let parameters = names(Parameters::declare());
    for name in ["use.imu", "variance.equation.net_wrench", "mount.imu_head.z", "differentiation.window", "body.height"]
    {
        assert!(parameters.contains(&name.to_owned()), "{name}");
    }
    assert_eq!(inputs.len(), Inputs::COUNT);
    let start: Vec<f64> = Inputs::declare().iter().map(|v| v.start).collect();
    assert!(start.iter().chain(&Inputs::default().to_vec()).all(|start| start.is_nan()), "missing until set");
    assert_eq!(outputs.len(), Outputs::COUNT);
    // what is written is read back in the order of the declarations
    let flat: Vec<f64> = (0..Inputs::COUNT).map(|i| i as f64).collect();
    let mut all = Inputs::default();
    all.read(&flat);
    assert_eq!(all.to_vec(), flat);
    assert_eq!(all.contact[3][5], flat[inputs.iter().position(|n| n == "left_foot_moment_z").unwrap()]);
    let mut out = Outputs::default();
    let flat: Vec<f64> = (0..Outputs::COUNT - 1).map(|i| i as f64).chain([1.0]).collect();
    out.read(&flat);
    assert_eq!(out.to_vec(), flat);
}

/// A vector's posture and truth fed through the estimator: the default sensors reproduce the
/// torques of inverse dynamics when all contacts are measured.
#[test]
fn torques_of_a_reference_posture() {
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

#[test]
fn sitting_still_the_seat_carries_the_weight_that_hands_and_feet_leave() {
    let mut estimator = estimator(&[]);
    let inputs = sitting();
    assert_eq!(estimator.step(&inputs, 0.01), Status::OK);
    let out = outputs(&estimator, &inputs);
    assert!(out.diagnostics.healthy);
    // with hands and feet unmeasured the seat force is known to about 80 N (reference study: 82 and
    // 80), and the priors of all wrenches, whose mean is zero, pull it down
    let weight = 65.0 * 9.80665;
    assert!((out.seat_wrench[2].value - weight).abs() < 2.2 * out.seat_wrench[2].std, "{:?}", out.seat_wrench);
    assert!(out.seat_wrench[..3].iter().all(|f| (75.0..90.0).contains(&f.std)), "{:?}", out.seat_wrench);
    assert!(estimator.machine().body().equations().variables() == 326);
}

#[test]
fn missing_and_infinite_samples() {
    let mut estimator = estimator(&ALL);
    let inputs = sitting();
    estimator.step(&inputs, 0.01);
    let full = outputs(&estimator, &inputs);

    // a sensor's sample: dropped, the standard deviation grows
    let mut holes = inputs.clone();
    holes.contact[2][0] = f64::NAN;
    let status = estimator.step(&holes, 0.01);
    assert!(status.contains(Status::MISSING) && !status.contains(Status::SKIPPED));
    let missing = outputs(&estimator, &holes);
    assert!(missing.tau[16].std > 1.5 * full.tau[16].std && missing.diagnostics.healthy);
    holes.contact[2][0] = f64::INFINITY;
    assert!(estimator.step(&holes, 0.01).contains(Status::INFINITE));
    assert_eq!(outputs(&estimator, &holes).tau, missing.tau);

    // posture: skipped, held, and the next sample is as if nothing had been
    for field in 0..3 {
        let mut bad = inputs.clone();
        match field {
            0 => bad.q[3] = f64::NAN,
            1 => bad.qd[3] = f64::NAN,
            _ => bad.base_gyro[1] = f64::NEG_INFINITY,
        }
        let status = estimator.step(&bad, 0.01);
        assert!(status.contains(Status::SKIPPED | Status::HOLD));
        let held = outputs(&estimator, &bad);
        assert_eq!(held.tau, missing.tau);
        assert!(!held.diagnostics.healthy);
    }
    estimator.step(&inputs, 0.01);
    assert_eq!(outputs(&estimator, &inputs), full);

    // nothing at all
    let mut nothing = inputs.clone();
    for part in [&mut nothing.qdd[..], &mut nothing.base_accel, &mut nothing.base_angular_accel, &mut nothing.seat] {
        part.fill(f64::NAN);
    }
    nothing.imu = [[f64::NAN; 3]; 4];
    nothing.contact = [[f64::NAN; 6]; 4];
    let status = estimator.step(&nothing, 0.01);
    assert!(status.contains(Status::NO_MEASUREMENT));
    let prior = outputs(&estimator, &nothing);
    assert!(!prior.diagnostics.healthy && prior.to_vec().iter().all(|v| v.is_finite()));
    assert_eq!(prior.chi2, [0.0; 6]);
}

#[test]
fn unusable_time_steps_change_nothing() {
    let mut estimator = estimator(&[]);
    let inputs = sitting();
    estimator.step(&inputs, 0.01);
    let before = estimator.state().clone();
    for dt in [0.0, -0.01, f64::NAN, f64::INFINITY] {
        assert!(estimator.step(&inputs, dt).contains(Status::BAD_STEP | Status::SKIPPED));
        assert_eq!(*estimator.state(), before);
    }
}

#[test]
fn differentiation_follows_a_cubic_and_survives_gaps() {
    let mut smooth = estimator(&[("differentiate", 1.0)]);
    let mut direct = estimator(&[]);
    let at = |t: f64| {
        let mut inputs = sitting();
        for joint in 0..19 {
            let s = 0.1 + 0.01 * joint as f64;
            inputs.q[joint] = s * (t - 0.5 * t * t + 0.4 * t * t * t);
            inputs.qd[joint] = s * (1.0 - t + 1.2 * t * t);
            inputs.qdd[joint] = s * (-1.0 + 2.4 * t);
        }
        inputs
    };
    for k in 0..60 {
        let mut inputs = at(0.01 * k as f64);
        direct.step(&inputs, 0.01);
        let expected = outputs(&direct, &inputs);
        if k == 40 || k == 41 {
            inputs.q[2] = f64::NAN;
        }
        let status = smooth.step(&inputs, 0.01);
        if k < 24 || k == 40 || k == 41 {
            assert!(status.contains(Status::SKIPPED), "{k}");
        } else {
            assert!(!status.contains(Status::SKIPPED));
            let actual = outputs(&smooth, &inputs);
            let off = largest_difference(&actual.tau.map(|t| t.value), &expected.tau.map(|t| t.value));
            assert!(off < 1e-5, "{k}: {off:e}");
        }
    }
    // another sample time empties the window
    assert!(smooth.step(&at(0.7), 0.05).contains(Status::SKIPPED | Status::RESTARTED));
}

#[test]
fn states_are_kept_restored_and_refused() {
    let mut a = estimator(&[("differentiate", 1.0), ("differentiation.window", 7.0)]);
    let mut inputs = sitting();
    let mut step = |estimator: &mut HumanDynamics, k: usize| {
        inputs.q[1] = (0.3 * k as f64).sin();
        estimator.step(&inputs, 0.01);
        outputs(estimator, &inputs).to_vec().iter().map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    (0..9).for_each(|k| drop(step(&mut a, k)));
    let kept = a.state().clone();
    let first: Vec<_> = (9..15).map(|k| step(&mut a, k)).collect();
    let mut b = estimator(&[("differentiate", 1.0), ("differentiation.window", 7.0)]);
    b.restore(&kept).unwrap();
    let second: Vec<_> = (9..15).map(|k| step(&mut b, k)).collect();
    assert_eq!(first, second);
    assert!(estimator(&[("differentiate", 1.0)]).restore(a.state()).is_err());
    assert!(estimator(&[]).restore(a.state()).is_err());
}

#[test]
fn parameters_are_checked() {
    let refused = |name: &str, value: f64| {
        let mut parameters = Parameters::default();
        let result = parameters.set(name, value).and_then(|()| HumanDynamics::new(&parameters).map(drop));
        let error = result.unwrap_err();
        assert_eq!(error.name, name);
        error.to_string()
    };
    refused("variance.seat_force", 0.0);
    refused("variance.equation.net_wrench", -1.0);
    refused("body.mass", f64::NAN);
    assert!(refused("differentiation.window", 24.0).contains("odd"));
}

/// Leaning the seat back is turning the pelvis's specific force: with hands and feet measured free,
/// the seat carries the whole weight along it.
#[test]
fn the_tilt_of_the_seat_turns_the_seat_force() {
    let mut estimator = estimator(&ALL[2..]);
    let mut inputs = sitting();
    for tilt in [0.0, 0.3, -0.5] {
        let g = Rotation3::from_euler_angles(0.0, tilt, 0.0).inverse() * Vector3::new(0.0, 0.0, 9.80665);
        inputs.base_accel = g.into();
        estimator.step(&inputs, 0.01);
        let out = outputs(&estimator, &inputs);
        let expected = g * 65.0;
        for k in 0..3 {
            let force = out.seat_wrench[k];
            assert!((force.value - expected[k]).abs() < force.std && force.std < 10.0, "{force:?}");
        }
    }
}
