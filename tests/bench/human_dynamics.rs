//! Cost of a whole step of whole-body estimation: kinematics, assembly, factorisation, corrections,
//! without and with the variances of all variables; on the reference models, and on chains of
//! growing length. `tests/oracles/idyntree_compare.py` times the anchor on the same models.

#[path = "../human_dynamics/cases.rs"]
mod cases;
#[path = "../support/mod.rs"]
mod support;

use divan::{Bencher, black_box};
use nalgebra::Vector3;
use wheelstate::estimator::human_dynamics::whole_body::{Posture, WholeBody};
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Parameters};
use wheelstate::model::multibody::equations::Base;
use wheelstate::model::multibody::prior::Variances;
use wheelstate::model::multibody::sensors::{Noise, Quantity, Sensor};
use wheelstate::model::multibody::tree::{Description, Joint, JointKind, Link, Tree};
use wheelstate::{Estimator, Variables};

fn main() {
    for name in REFERENCE {
        let body = cases::case(name).body;
        let ldl = body.map().ldl();
        println!("{name}: factor {} flops, {} nonzeros", ldl.factor_flops(), ldl.nonzeros());
    }
    divan::main();
}

const REFERENCE: [&str; 4] =
    ["human48_LeftFoot_fixed_L3", "human48_Pelvis_moving_compact", "seated12_fixed_L3", "seated12_moving_compact"];

fn reference(bencher: Bencher, name: &str, variances: bool) {
    let mut case = cases::case(name);
    let mut k = 0.0_f64;
    bencher.bench_local(|| {
        k += 0.01;
        for (i, q) in case.q.iter_mut().enumerate() {
            *q = 0.4 * (k + 0.3 * i as f64).sin();
        }
        let posture = Posture { q: &case.q, qd: &case.qd, base_rate: case.base_rate };
        case.body.step(black_box(&posture), &case.samples, variances).unwrap()
    });
}

#[divan::bench(args = REFERENCE)]
fn mean_only(bencher: Bencher, name: &str) {
    reference(bencher, name, false);
}

#[divan::bench(args = REFERENCE)]
fn with_variances(bencher: Bencher, name: &str) {
    reference(bencher, name, true);
}

#[divan::bench(args = REFERENCE)]
fn by_orthogonal_elimination(bencher: Bencher, name: &str) {
    let mut case = cases::case(name);
    bencher.bench_local(|| case.step_by_qr());
}

#[divan::bench(args = ["default", "all sensors"])]
fn seated_estimator(bencher: Bencher, sensors: &str) {
    let mut parameters = Parameters::default();
    if sensors != "default" {
        let used = &mut parameters.r#use;
        (used.seat_wrench, used.imu, used.hand_wrench, used.foot_wrench) = (true, true, true, true);
    }
    let mut estimator = HumanDynamics::new(&parameters).unwrap();
    let mut inputs = Inputs::default();
    inputs.map(&mut |_| 0.0);
    inputs.base_accel = [0.0, 0.0, 9.80665];
    bencher.bench_local(|| {
        inputs.q[1] += 1e-4;
        estimator.step(black_box(&inputs), 0.01)
    });
}

fn chain(links: usize) -> WholeBody {
    let mut description = Description { name: "chain".into(), ..Default::default() };
    for k in 0..=links {
        description.links.push(Link {
            name: format!("l{k}"),
            mass: 1.0,
            com: [0.02, -0.01, 0.1],
            inertia: [0.01, 0.001, 0.0, 0.012, 0.0005, 0.008],
        });
        if k > 0 {
            let turn = 0.4 * (k as f64).sin();
            description.joints.push(Joint {
                name: format!("j{k}"),
                kind: JointKind::Revolute,
                parent: format!("l{}", k - 1),
                child: format!("l{k}"),
                xyz: [0.0, 0.01, 0.2],
                rpy: [turn, 0.5 * turn, -turn],
                axis: [0.3, 1.0, 0.5],
            });
        }
    }
    let tree = Tree::new(&description, "l0", false, &[]).unwrap();
    let mut sensors: Vec<Sensor> =
        tree.dof_names.iter().map(|j| Sensor::new(Quantity::JointAcceleration, j, Noise::Scalar(1e-2))).collect();
    let bodies = tree.bodies.iter().skip(1);
    sensors.extend(bodies.map(|b| Sensor::new(Quantity::NetExtWrench, &b.name, Noise::Scalar(1e-4))));
    WholeBody::new(tree, Base::Fixed(Vector3::new(0.0, 0.0, -9.81)), sensors, &Variances::default()).unwrap()
}

#[divan::bench(args = [10, 50, 100, 200])]
fn chain_of_links(bencher: Bencher, links: usize) {
    let mut body = chain(links);
    let (mut q, qd) = (vec![0.2; links], vec![0.1; links]);
    let samples = vec![0.0; body.samples()];
    bencher.bench_local(|| {
        q[0] += 1e-3;
        body.step(black_box(&Posture { q: &q, qd: &qd, base_rate: [0.0; 3] }), &samples, false).unwrap()
    });
}
