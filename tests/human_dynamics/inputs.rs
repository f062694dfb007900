//! What is wrong with a model, its sensors or its samples is named, never a panic or a silent number.

use super::cases::*;
use nalgebra::Vector3;
use wheelstate::estimator::human_dynamics::whole_body::{Posture, StepError, WholeBody};
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};
use wheelstate::filter::map::{Map, Method, Numbers, Pattern};
use wheelstate::model::multibody::equations::{Base, Equation, Kind};
use wheelstate::model::multibody::error::{ModelError, ModelWarning};
use wheelstate::model::multibody::prior::Variances;
use wheelstate::model::multibody::sensors::{Noise, Quantity, Sensor};
use wheelstate::model::multibody::tree::{Description, JointKind, Tree};
use wheelstate::{Estimator, Status, Variables};

fn tree(change: impl Fn(&mut Description)) -> Result<Tree, ModelError> {
    let mut description = model("chain3");
    change(&mut description);
    Tree::new(&description, "base", false, &[])
}

#[test]
fn bodies_that_are_no_trees_are_refused() {
    use ModelError::*;
    let refused = |change: &dyn Fn(&mut Description)| tree(change).unwrap_err();
    assert!(matches!(refused(&|d| d.joints[2].child = "l1".into()), KinematicLoop(_)));
    assert!(matches!(refused(&|d| d.joints[0].parent = "l3".into()), KinematicLoop(_)));
    // a loop apart from the root
    let apart = |d: &mut Description| {
        d.joints[1].parent = "l3".into();
        d.joints[2].parent = "l2".into();
    };
    assert!(matches!(refused(&apart), KinematicLoop(_)));
    assert!(matches!(refused(&|d| drop(d.joints.remove(1))), Disconnected(..)));
    assert_eq!(refused(&|d| d.joints[1].child = "nose".into()), UnknownLink("nose".into()));
    assert!(matches!(Tree::new(&model("chain3"), "nose", false, &[]).unwrap_err(), UnknownLink(_)));
    assert!(matches!(refused(&|d| d.links[1].name = "l2".into()), DuplicateName(_, "link")));
    assert!(matches!(refused(&|d| d.joints[1].name = "j1".into()), DuplicateName(_, "joint")));
    assert!(matches!(refused(&|d| d.links[1].mass = -0.1), NegativeMass(..)));
    assert!(matches!(refused(&|d| d.links[1].mass = f64::NAN), NotFinite(_)));
    assert!(matches!(refused(&|d| d.links[2].inertia[1] = f64::INFINITY), NotFinite(_)));
    assert!(matches!(refused(&|d| d.joints[2].xyz[0] = f64::NAN), NotFinite(_)));
    assert!(matches!(refused(&|d| d.links[2].inertia[5] = -1e-3), InertiaNotPsd(..)));
    assert!(matches!(refused(&|d| d.links[2].inertia[1] = 0.5), InertiaNotPsd(..)));
    assert!(matches!(refused(&|d| d.joints[0].axis = [0.0; 3]), BadAxis(_)));
    assert!(matches!(refused(&|d| d.joints[0].kind = JointKind::Other("planar".into())), UnsupportedJoint(..)));
    assert!(matches!(refused(&|d| d.links.iter_mut().for_each(|l| l.mass = 0.0)), ZeroTotalMass));
    assert!(matches!(refused(&|d| *d = Description::default()), Empty));
    // messages name what is wrong
    assert!(refused(&|d| d.links[1].mass = -0.1).to_string().contains("'l1'"));
    // unusual but accepted
    let thin = tree(|d| d.links[3].inertia[5] = 3.0).unwrap();
    assert_eq!(thin.warnings, [ModelWarning::TriangleInequality("l3".into())]);
    assert!(tree(|_| ()).unwrap().warnings.is_empty());
}

fn body(tree: Tree, sensors: Vec<Sensor>, variances: &Variances) -> Result<WholeBody, ModelError> {
    WholeBody::new(tree, Base::Fixed(Vector3::new(0.0, 0.0, -9.81)), sensors, variances)
}

#[test]
fn impossible_sensors_and_variances_are_refused() {
    use ModelError::*;
    let plain = || tree(|_| ()).unwrap();
    let refused = |quantity: Quantity, target: &str, noise: Noise| {
        body(plain(), vec![Sensor::new(quantity, target, noise)], &Variances::default()).unwrap_err()
    };
    let one = || Noise::Scalar(1.0);
    assert_eq!(refused(Quantity::Accelerometer, "nose", one()), UnknownLink("nose".into()));
    assert_eq!(refused(Quantity::JointTorque, "nose", one()), UnknownJoint("nose".into()));
    assert!(matches!(refused(Quantity::Accelerometer, "base", one()), SensorOnFixedBase(..)));
    assert!(matches!(refused(Quantity::AngularAccelerometer, "base", one()), SensorOnFixedBase(..)));
    assert!(matches!(refused(Quantity::BaseWrench, "", one()), BaseIsFixed(_)));
    assert!(matches!(refused(Quantity::BaseAcceleration, "", one()), BaseIsFixed(_)));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-320] {
        let error = refused(Quantity::JointTorque, "j2", Noise::Scalar(bad));
        assert!(matches!(error, BadVariance(..)) && error.to_string().contains("j2"), "{error}");
    }
    let error = refused(Quantity::Accelerometer, "l1", Noise::Diagonal(vec![1.0, 2.0]));
    assert!(matches!(error, VarianceCount(_, 2, 3)));
    for full in [[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0], [1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]] {
        let error = refused(Quantity::Accelerometer, "l1", Noise::Full(full.to_vec()));
        assert!(matches!(error, CovarianceNotSpd(_)));
    }
    let bad = Variances { equation: [1e-4, 0.0, 1e-4, 1e-4], ..Default::default() };
    assert!(matches!(body(plain(), vec![], &bad).unwrap_err(), BadVariance(..)));
    let bad = Variances { prior: [f64::NAN; 6], ..Default::default() };
    assert!(matches!(body(plain(), vec![], &bad).unwrap_err(), BadVariance(..)));
    let bad = Variances { equation_of: vec![(1, Equation::Torque, -1.0)], ..Default::default() };
    assert!(matches!(body(plain(), vec![], &bad).unwrap_err(), BadVariance(..)));
    let bad = Variances { prior_of: vec![(1, Kind::Torque, [1.0, 0.0])], ..Default::default() };
    assert!(matches!(body(plain(), vec![], &bad).unwrap_err(), BadVariance(..)));
    // a joint that does not move has no torque
    let fixed = tree(|d| d.joints[1].kind = JointKind::Fixed).unwrap();
    let sensor = Sensor::new(Quantity::JointTorque, "j2", one());
    assert!(matches!(body(fixed, vec![sensor], &Variances::default()).unwrap_err(), FixedJoint(_)));
}

/// The reference's figures for a chain without any measurement.
#[test]
fn no_sensors_is_the_prior_through_the_model() {
    for sensors in [vec![], vec![Sensor::new(Quantity::JointAcceleration, "j1", Noise::Scalar(1.0))]] {
        let mut body = body(tree(|_| ()).unwrap(), sensors, &Variances::default()).unwrap();
        let missing = vec![f64::NAN; body.samples()];
        let status = body.step(&Posture { q: &[0.0; 3], qd: &[0.0; 3], base_rate: [0.0; 3] }, &missing, true).unwrap();
        assert!(status.contains(Status::NO_MEASUREMENT));
        let slots = [0, 1, 2].map(|dof| body.torque_slot(dof));
        let std = slots.map(|slot| body.variance()[slot].sqrt());
        println!("tau {:?} std {std:?}", slots.map(|slot| body.mean()[slot]));
        assert!(body.mean().iter().chain(body.variance()).all(|v| v.is_finite()));
        assert!(std.iter().all(|s| (40.0..80.0).contains(s)), "{std:?}");
    }
}

#[test]
fn massless_links_are_accepted() {
    for k in [1, 2, 3] {
        let tree = tree(|d| {
            d.links[k].mass = 0.0;
            d.links[k].inertia = [0.0; 6];
        })
        .unwrap();
        let mut body = body(tree, vec![], &Variances::default()).unwrap();
        body.step(&Posture { q: &[0.3; 3], qd: &[0.1; 3], base_rate: [0.0; 3] }, &[], true).unwrap();
        assert!(body.mean().iter().all(|v| v.is_finite()) && body.variance().iter().all(|v| *v > 0.0));
    }
}

#[test]
fn a_posture_that_is_not_finite_is_refused_and_leaves_no_trace() {
    let mut case = case("seated12_moving_L1");
    case.step(true);
    let before = (case.body.mean().to_vec(), case.body.variance().to_vec());
    for bad in [f64::NAN, f64::INFINITY] {
        let (mut q, mut qd, mut rate) = (case.q.clone(), case.qd.clone(), case.base_rate);
        q[4] = bad;
        let step = |body: &mut WholeBody, q: &[f64], qd: &[f64], rate: [f64; 3]| {
            body.step(&Posture { q, qd, base_rate: rate }, &case.samples, true)
        };
        assert_eq!(step(&mut case.body, &q, &qd, rate), Err(StepError::NotFinite));
        q[4] = 0.0;
        qd[0] = bad;
        assert_eq!(step(&mut case.body, &q, &qd, rate), Err(StepError::NotFinite));
        qd[0] = 0.0;
        rate[1] = bad;
        assert_eq!(step(&mut case.body, &q, &qd, rate), Err(StepError::NotFinite));
        assert_eq!((case.body.mean(), case.body.variance()), (&before.0[..], &before.1[..]));
    }
}

#[test]
fn missing_and_infinite_samples_are_dropped_and_said_so() {
    let mut case = case("chain3_fixed_L3");
    assert_eq!(case.step(true), Status::OK);
    let before = case.body.variance().to_vec();
    case.samples[0] = f64::NAN;
    assert_eq!(case.step(true), Status::MISSING);
    assert!(case.body.variance().iter().zip(&before).all(|(now, before)| *now >= before * (1.0 - 1e-9)));
    let missing = case.body.mean().to_vec();
    case.samples[0] = f64::NEG_INFINITY;
    assert_eq!(case.step(true), Status::INFINITE);
    assert_eq!(case.body.mean(), missing);
}

/// Where the sparse factor's pivot vanishes the orthogonal method takes over, and where nothing
/// determines an unknown in double precision there is an error and no number.
#[test]
fn bad_pivots_are_never_silent() {
    // x0 + x1 = 2 and x0 + (1 + 2e-9) x1 = 2 with weights that swamp the prior
    let (start, column) = ([0, 2, 4], [0, 1, 0, 1]);
    let value = [1.0, 1.0, 1.0, 1.0 + 2e-9];
    let pattern =
        Pattern { unknowns: 2, start: &start, column: &column, varies: &[true; 4], monitored: 0..0, front: &[0, 0] };
    let mut map = Map::new(&pattern);
    let numbers = |precision: &'static [f64; 2]| Numbers {
        value: &value,
        right: &[2.0, 2.0],
        weight: &[1e8, 1e8],
        precision,
        mean: &[0.0, 0.0],
    };
    let method = map.solve(&numbers(&[1e-18; 2]), true).unwrap();
    assert_eq!(method, Method::TreeQr);
    assert!((map.mean()[0] + map.mean()[1] - 2.0).abs() < 1e-6, "{:?}", map.mean());
    assert!(map.variance().iter().all(|v| v.is_finite() && *v > 0.0));
    // a weight that is not a number reaches neither mean nor variance
    let bad = Numbers { weight: &[f64::NAN, 1.0], ..numbers(&[1e-18; 2]) };
    assert!(map.solve(&bad, true).is_err());
}

/// The setting at which the anchor's two-stage solver fails silently.
#[test]
fn stiff_models_stay_accurate() {
    for (model_variance, prior) in [(1e-6, 1e6), (1e-8, 1e8), (1e-10, 1e6)] {
        let reference = case("human48_LeftFoot_fixed_L3");
        let tree = reference.body.equations().tree().clone();
        let base = Base::Fixed(Vector3::from(array::<3>(&reference.data["gravity"])));
        let variances = Variances { equation: [model_variance; 4], prior: [prior; 6], ..Default::default() };
        let mut body = WholeBody::new(tree, base, sensors(&reference.data), &variances).unwrap();
        let posture = Posture { q: &reference.q, qd: &reference.qd, base_rate: [0.0; 3] };
        let mut other = body.clone();
        body.step(&posture, &reference.samples, true).unwrap();
        other.step_by_qr(&posture, &reference.samples, true).unwrap();
        let mean = largest_difference(body.mean(), other.mean());
        let variance = largest_relative(body.variance(), other.variance());
        println!("{model_variance:e} {prior:e}: mean {mean:.1e} variance {variance:.1e}");
        assert!(mean < 1e-8 && variance < 1e-4);
    }
}

#[test]
fn the_names_of_the_contract_are_declared() {
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

#[test]
fn missing_and_infinite_samples_of_the_seated_body_are_left_out() {
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
    let values = |outputs: &Outputs| outputs.tau.map(|tau| tau.value);
    let before = outputs(&estimator, &holes);
    assert_eq!(values(&before), values(&missing));

    // posture: skipped, held, and the next sample is as if nothing had been, but for what the torques have changed of late
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
        assert_eq!(held.tau, before.tau);
        assert!(!held.diagnostics.healthy);
    }
    estimator.step(&inputs, 0.01);
    let again = outputs(&estimator, &inputs);
    assert_eq!((values(&again), again.diagnostics.healthy), (values(&full), true));

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

/// Every input that no sensor reads is left alone, and every one that a sensor reads counts.
#[test]
fn exactly_the_inputs_of_the_sensors_that_are_switched_on_change_the_estimates() {
    let parts: [(&str, &[&str]); 6] = [
        ("use.joint_acceleration", &["qdd_"]),
        ("use.base_acceleration", &["base_accel_", "base_angular_accel_"]),
        ("use.seat_wrench", &["seat_"]),
        ("use.imu", &["imu_"]),
        ("use.hand_wrench", &["right_hand_", "left_hand_"]),
        ("use.foot_wrench", &["right_foot_", "left_foot_"]),
    ];
    let declared = Inputs::declare();
    for (on, _) in parts {
        let only: Vec<(&str, f64)> = parts.iter().map(|(name, _)| (*name, f64::from(u8::from(*name == on)))).collect();
        let mut estimator = estimator(&only);
        let inputs = sitting();
        estimator.step(&inputs, 0.01);
        let before = outputs(&estimator, &inputs);
        for (index, input) in declared.iter().enumerate() {
            let Some((part, _)) = parts.iter().find(|(_, stems)| stems.iter().any(|s| input.name.starts_with(s)))
            else {
                continue;
            };
            let mut flat = inputs.to_vec();
            flat[index] += 1.0;
            let mut changed = inputs.clone();
            changed.read(&flat);
            estimator.step(&changed, 0.01);
            let now = outputs(&estimator, &changed);
            let differ = now.tau.iter().zip(&before.tau).any(|(now, before)| now.value != before.value);
            assert_eq!(differ, *part == on, "{} with {on} alone", input.name);
        }
    }
}
