//! The independent plant against the reference torques, and the estimates against the plant.

use super::cases::*;
use super::truth;
use nalgebra::{Rotation3, Vector3};
use wheelstate::estimator::human_dynamics::whole_body::{Posture, WholeBody};
use wheelstate::model::multibody::equations::{Base, Kind};
use wheelstate::model::multibody::prior::Variances;
use wheelstate::model::multibody::sensors::{Noise, Quantity, Sensor};
use wheelstate::model::multibody::tree::Tree;
use wheelstate::plant::human_dynamics::{BaseMotion, Push, Rooted};
use wheelstate::{Estimator, Status};

/// Truth of a vector: q, qd, qdd by joint name, and external wrenches by link.
struct Truth {
    rooted: Rooted,
    base: BaseMotion,
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
    pushes: Vec<Push>,
}

/// The kinematic part of a vector's `true_d` as plant motion.
fn truth_of(case: &Case) -> Truth {
    let description = model(case.data["model"].as_str().unwrap());
    let base = text(&case.data["base"]);
    let fixed = case.data["variant"].as_str() == Some("fixed");
    let gravity = if fixed { Vector3::from(array::<3>(&case.data["gravity"])) } else { Vector3::zeros() };
    let rooted = truth::rooted(&description, &base, gravity);
    let true_d = numbers(&case.data["true_d"]);
    let equations = case.body.equations();
    let tree = equations.tree();
    let slice = |body: usize, kind: Kind| equations.slots()[body].map(|s| true_d[s.range(kind)].to_vec());
    let mut motion = BaseMotion::rest();
    if !fixed {
        let a = slice(0, Kind::Acceleration).unwrap();
        motion.rate = Vector3::from(case.base_rate);
        motion.acceleration = Vector3::new(a[0], a[1], a[2]);
        motion.angular_acceleration = Vector3::new(a[3], a[4], a[5]);
    }
    // the plant numbers joints by hinge, the model by name
    let names: Vec<&str> = rooted.hinge.iter().map(|&h| description.joints[h].name.as_str()).collect();
    let dof = |name: &&str| tree.coordinate(name).unwrap();
    let q: Vec<f64> = names.iter().map(|n| case.q[dof(n)]).collect();
    let qd: Vec<f64> = names.iter().map(|n| case.qd[dof(n)]).collect();
    let qdd: Vec<f64> = (names.iter())
        .map(|n| {
            let (body, k) = tree.dof_places[dof(n)];
            slice(body, Kind::JointAcceleration).unwrap()[k]
        })
        .collect();
    // external wrenches are in link axes, the plant wants them in its inertial frame
    let (_, states) = rooted.body.inverse(&motion, &q, &qd, &qdd, &[]);
    let mut pushes = vec![];
    for (b, body) in tree.bodies.iter().enumerate() {
        let link = description.links.iter().position(|l| l.name == body.name).unwrap();
        if let Some(fx) = slice(b, Kind::ExternalWrench) {
            let segment = rooted.segment[link];
            let turn = states[segment].rotation;
            pushes.push(Push {
                segment,
                at: rooted.place[link],
                force: turn * Vector3::new(fx[0], fx[1], fx[2]),
                moment: turn * Vector3::new(fx[3], fx[4], fx[5]),
            });
        }
    }
    Truth { rooted, base: motion, q, qd, qdd, pushes }
}

#[test]
fn the_plant_is_the_reference_dynamics() {
    for name in CASES {
        let case = case(name);
        let truth = truth_of(&case);
        let (tau, _) = truth.rooted.body.inverse(&truth.base, &truth.q, &truth.qd, &truth.qdd, &truth.pushes);
        let description = model(case.data["model"].as_str().unwrap());
        let order: Vec<String> = case.data["dof_names"].as_array().unwrap().iter().map(text).collect();
        let expected = numbers(&case.data["rnea_tau"]);
        for (k, &h) in truth.rooted.hinge.iter().enumerate() {
            let joint = &description.joints[h].name;
            let reference = expected[order.iter().position(|o| o == joint).unwrap()];
            assert!((tau[k] - reference).abs() < 1e-9, "{name} {joint}: {} {reference}", tau[k]);
        }
    }
}

#[test]
fn forward_dynamics_inverts_inverse_dynamics() {
    let case = case("seated12_moving_L1");
    let truth = truth_of(&case);
    let body = &truth.rooted.body;
    let (tau, _) = body.inverse(&truth.base, &truth.q, &truth.qd, &truth.qdd, &truth.pushes);
    let qdd = body.forward(&truth.base, &truth.q, &truth.qd, &tau, &truth.pushes).unwrap();
    assert!(largest_difference(&qdd, &truth.qdd) < 1e-8);
}

/// Sensors that measure everything exactly: joint accelerations and external wrenches.
fn exact(tree: &Tree, moving: bool) -> Vec<Sensor> {
    let tiny = || Noise::Scalar(1e-8);
    let mut sensors: Vec<Sensor> =
        tree.dof_names.iter().map(|j| Sensor::new(Quantity::JointAcceleration, j, tiny())).collect();
    let bodies = tree.bodies.iter().skip(usize::from(!moving));
    sensors.extend(bodies.map(|b| Sensor::new(Quantity::NetExtWrench, &b.name, tiny())));
    if moving {
        sensors.push(Sensor::new(Quantity::BaseAcceleration, "", tiny()));
    }
    sensors
}

fn exact_variances() -> Variances {
    Variances { equation: [1e-8; 4], prior: [1e10; 6], ..Default::default() }
}

/// A6: with exact sensors the torques are those of inverse dynamics.
#[test]
fn exact_sensors_give_inverse_dynamics() {
    for name in CASES {
        let case = case(name);
        let data = &case.data;
        let equations = case.body.equations();
        let moving = data["variant"].as_str() == Some("moving");
        let base = if moving { Base::Moving } else { Base::Fixed(Vector3::from(array::<3>(&data["gravity"]))) };
        let true_d = numbers(&data["true_d"]);
        let sensors = exact(equations.tree(), moving);
        let slice = |body: usize, kind: Kind| true_d[equations.slots()[body].unwrap().range(kind)].to_vec();
        let samples: Vec<f64> = (sensors.iter())
            .flat_map(|s| match s.quantity {
                Quantity::JointAcceleration => {
                    let (body, k) = equations.tree().dof_places[equations.tree().coordinate(&s.target).unwrap()];
                    vec![slice(body, Kind::JointAcceleration)[k]]
                }
                Quantity::BaseAcceleration => slice(0, Kind::Acceleration),
                _ => slice(equations.tree().place(&s.target).unwrap().body, Kind::ExternalWrench),
            })
            .collect();
        let mut body = WholeBody::new(equations.tree().clone(), base, sensors, &exact_variances()).unwrap();
        body.step(&Posture { q: &case.q, qd: &case.qd, base_rate: case.base_rate }, &samples, false).unwrap();
        let order: Vec<String> = data["dof_names"].as_array().unwrap().iter().map(text).collect();
        let expected = numbers(&data["rnea_tau"]);
        for (dof, joint) in equations.tree().dof_names.iter().enumerate() {
            let reference = expected[order.iter().position(|o| o == joint).unwrap()];
            let off = (body.mean()[body.torque_slot(dof)] - reference).abs();
            assert!(off < 1e-8, "{name} {joint}: {off:e}");
        }
    }
}

/// A8, first half: turning the base's frame and gravity together changes no torque.
#[test]
fn turning_base_and_gravity_together_changes_nothing() {
    let base_case = case("human48_LeftFoot_fixed_L3");
    let description = model("human48");
    let gravity = Vector3::from(array::<3>(&base_case.data["gravity"]));
    let torques = |turn: &Rotation3<f64>| {
        // the base link's content and the joints on it are written in turned axes
        let mut turned = description.clone();
        let back = turn.inverse();
        let root = "LeftFoot";
        for link in turned.links.iter_mut().filter(|l| l.name == root) {
            link.com = (back * Vector3::from(link.com)).into();
            let i = link.inertia;
            let m = nalgebra::Matrix3::new(i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5]);
            let m = back.matrix() * m * turn.matrix();
            link.inertia = [m.m11, m.m12, m.m13, m.m22, m.m23, m.m33];
        }
        for joint in &mut turned.joints {
            if joint.parent == root {
                joint.xyz = (back * Vector3::from(joint.xyz)).into();
                let (r, p, y) = back.euler_angles();
                joint.rpy = [r, p, y];
            }
            if joint.child == root {
                // the joint's frame is the child's: both turn, so the axis must be turned back
                let (r, p, y) = turn.euler_angles();
                joint.rpy = [r, p, y];
                joint.axis = (back * Vector3::from(joint.axis)).into();
            }
        }
        let tree = Tree::new(&turned, root, false, &[]).unwrap();
        let sensors: Vec<Sensor> =
            (exact(&tree, false).into_iter()).map(|s| Sensor { noise: Noise::Scalar(1e-2), ..s }).collect();
        let samples: Vec<f64> =
            (0..sensors.iter().map(|s| s.quantity.rows()).sum::<usize>()).map(|k| (k as f64).sin()).collect();
        let base = Base::Fixed(back * gravity);
        let mut body = WholeBody::new(tree, base, sensors, &Variances::default()).unwrap();
        let posture = Posture { q: &base_case.q, qd: &base_case.qd, base_rate: [0.0; 3] };
        body.step(&posture, &samples, false).unwrap();
        (0..48).map(|dof| body.mean()[body.torque_slot(dof)]).collect::<Vec<_>>()
    };
    let straight = torques(&Rotation3::identity());
    for turn in [(0.3, -0.5, 1.2), (2.5, 0.1, -0.7)] {
        let turned = torques(&Rotation3::from_euler_angles(turn.0, turn.1, turn.2));
        assert!(largest_difference(&straight, &turned) < 1e-9, "{:e}", largest_difference(&straight, &turned));
    }
}

/// A8, second half: the same motion seen from another base has the same torques.
#[test]
fn another_base_changes_no_torque() {
    let description = model("human48");
    let names: Vec<String> = description.joints.iter().map(|j| j.name.clone()).collect();
    let value = |name: &str, scale: f64| {
        let k = names.iter().position(|n| n == name).unwrap() as f64;
        scale * (1.3 * k + scale).sin()
    };
    // motion of the pelvis as base, everything else from the plant
    let rooted = truth::rooted(&description, "Pelvis", Vector3::new(0.0, 0.0, -9.81));
    let pick = |scale: f64| -> Vec<f64> { rooted.hinge.iter().map(|&h| value(&names[h], scale)).collect() };
    let (q, qd, qdd) = (pick(0.4), pick(0.8), pick(2.0));
    let base = BaseMotion {
        rate: Vector3::new(0.3, -0.2, 0.4),
        angular_acceleration: Vector3::new(1.0, 0.5, -0.7),
        acceleration: Vector3::new(0.4, 1.1, -0.6),
        ..BaseMotion::rest()
    };
    let (_, mut states) = rooted.body.inverse(&base, &q, &qd, &qdd, &[]);
    // hands and feet push so that nothing has to hold the pelvis: the pelvis's own reaction is
    // given to it as an external wrench
    let (free, _) = rooted.body.inverse(&base, &q, &qd, &qdd, &[]);
    let reaction = states[0];
    states[0].force = Vector3::zeros();
    for root in ["Pelvis", "LeftFoot", "RightHand", "Head"] {
        let tree = Tree::new(&description, root, false, &[]).unwrap();
        let sensors = exact(&tree, true);
        let link = description.links.iter().position(|l| l.name == root).unwrap();
        let state = &states[rooted.segment[link]];
        let turn = state.rotation.transpose();
        let a = turn * (state.acceleration - rooted.body.gravity);
        let alpha = turn * state.angular_acceleration;
        let rate = turn * state.rate;
        let mut samples = vec![];
        for sensor in &sensors {
            match sensor.quantity {
                Quantity::JointAcceleration => samples.push(value(&sensor.target, 2.0)),
                Quantity::BaseAcceleration => samples.extend([a.x, a.y, a.z, alpha.x, alpha.y, alpha.z]),
                _ if sensor.target == "Pelvis" => {
                    samples.extend(reaction.seen_at(&Vector3::zeros(), &reaction.force, &reaction.moment));
                }
                _ => samples.extend([0.0; 6]),
            }
        }
        let q: Vec<f64> = tree.dof_names.iter().map(|n| value(n, 0.4)).collect();
        let qd: Vec<f64> = tree.dof_names.iter().map(|n| value(n, 0.8)).collect();
        let mut body = WholeBody::new(tree, Base::Moving, sensors, &exact_variances()).unwrap();
        body.step(&Posture { q: &q, qd: &qd, base_rate: rate.into() }, &samples, false).unwrap();
        for (k, &h) in rooted.hinge.iter().enumerate() {
            let dof = body.equations().tree().coordinate(&names[h]).unwrap();
            let off = (body.mean()[body.torque_slot(dof)] - free[k]).abs();
            assert!(off < 1e-8, "{root} {}: {off:e}", names[h]);
        }
    }
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

/// Leaning the seat back is turning the pelvis's specific force: with hands and feet measured free,
/// the seat carries the whole weight along it.
#[test]
fn the_tilt_of_the_seat_turns_the_seat_force() {
    let mut inputs = sitting();
    for tilt in [0.0, 0.3, -0.5] {
        let mut estimator = estimator(&ALL[2..]);
        let g = Rotation3::from_euler_angles(0.0, tilt, 0.0).inverse() * Vector3::new(0.0, 0.0, 9.80665);
        inputs.base_accel = g.into();
        estimator.step(&inputs, 0.01);
        let out = outputs(&estimator, &inputs);
        let expected = g * 65.0;
        for k in 0..3 {
            let force = out.seat_wrench[k];
            // the person's mass is known to 1 kg
            assert!((force.value - expected[k]).abs() < force.std && force.std < 12.0, "{force:?}");
        }
    }
}
