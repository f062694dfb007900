//! Persons whose segments are not those of the table, on seats that are not quite level: the standard deviations hold them.

use super::cases::*;
use super::truth;
use nalgebra::{Rotation3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::Estimator;
use wheelstate::estimator::human_dynamics::variables::{CONTACTS, DOF, JOINTS};
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};
use wheelstate::model::multibody::anthropometry::{BodyParameters, seated12};
use wheelstate::model::multibody::scatter::ScatterParameters;
use wheelstate::model::multibody::tree::Description;
use wheelstate::plant::human_dynamics::{BaseMotion, Push};

struct Draw(ChaCha8Rng);

impl Draw {
    fn of(&mut self, std: f64) -> f64 {
        let draw: f64 = StandardNormal.sample(&mut self.0);
        std * draw
    }

    fn three(&mut self, std: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.of(std))
    }
}

/// The table's person with segments that differ by as much as tables do, of the mass that the scales show within `mass_std`.
fn another_person(draw: &mut Draw) -> Description {
    let s = ScatterParameters::default();
    let mut person = seated12(&BodyParameters::default());
    let mut off: Vec<f64> = person.links.iter().map(|link| draw.of(s.segment_mass_std * link.mass)).collect();
    let square: f64 = person.links.iter().map(|link| link.mass * link.mass).sum();
    let excess = off.iter().sum::<f64>() - draw.of(s.mass_std);
    for (off, link) in off.iter_mut().zip(&mut person.links) {
        *off -= excess * link.mass * link.mass / square;
        if link.mass == 0.0 {
            continue;
        }
        let scale = (1.0 + *off / link.mass).max(0.3);
        let gyration = (0.5 * (link.inertia[0] + link.inertia[3] + link.inertia[5]) / link.mass).sqrt();
        let shift = draw.three(s.segment_com_std * gyration);
        let turn = scale * (1.0 + draw.of(s.segment_inertia_std)).max(0.3);
        link.mass *= scale;
        link.inertia.iter_mut().for_each(|i| *i *= turn);
        (0..3).for_each(|k| link.com[k] += shift[k]);
    }
    person
}

/// One sample of a moving person, and what the joints and the seat truly do.
fn sample(person: &Description, draw: &mut Draw) -> (Inputs, [f64; DOF], [f64; 6]) {
    let rooted = truth::rooted(person, "Pelvis", Vector3::new(0.0, 0.0, -9.80665));
    let names: Vec<&str> = rooted.hinge.iter().map(|&h| person.joints[h].name.as_str()).collect();
    let joint: Vec<usize> = JOINTS.iter().map(|(_, name, _)| names.iter().position(|n| n == name).unwrap()).collect();
    let (mut q, mut qd, mut qdd) = (vec![0.0; DOF], vec![0.0; DOF], vec![0.0; DOF]);
    for k in 0..DOF {
        (q[k], qd[k], qdd[k]) = (draw.of(0.3), draw.of(0.7), draw.of(3.0));
    }
    let seat = *Rotation3::from_scaled_axis(draw.three(0.05)).matrix();
    let base = BaseMotion {
        rotation: seat,
        rate: seat * draw.three(0.2),
        angular_acceleration: seat * draw.three(0.5),
        acceleration: draw.three(1.0),
    };
    let link = |name: &str| person.links.iter().position(|l| l.name == name).unwrap();
    let mounts = [-0.2, -0.2, -0.4, -0.4];
    let mut pushes = vec![];
    for (k, (_, name)) in CONTACTS.iter().enumerate() {
        let at = rooted.place[link(name)] + Vector3::new(0.0, 0.0, mounts[k]);
        let force = draw.three(10.0) + Vector3::new(0.0, 0.0, if k < 2 { 0.0 } else { 70.0 });
        pushes.push(Push { segment: rooted.segment[link(name)], at, force, moment: draw.three(1.0) });
    }
    let (torque, states) = rooted.body.inverse(&base, &q, &qd, &qdd, &pushes);
    let mut inputs = sitting();
    let mut tau = [0.0; DOF];
    for (outside, &k) in joint.iter().enumerate() {
        (inputs.q[outside], inputs.qd[outside], inputs.qdd[outside]) = (q[k], qd[k], qdd[k] + draw.of(0.5));
        tau[outside] = torque[k];
    }
    // the accelerometer's axes are not quite the pelvis's
    let crooked = Rotation3::from_scaled_axis(draw.three(ScatterParameters::default().inclination_std));
    let felt = crooked * states[0].specific_force(&Vector3::zeros(), &rooted.body.gravity);
    inputs.base_accel = (felt + draw.three(0.05)).into();
    inputs.base_gyro = (seat.transpose() * base.rate).into();
    inputs.base_angular_accel = (seat.transpose() * base.angular_acceleration + draw.three(0.3)).into();
    for (k, push) in pushes.iter().enumerate() {
        let state = &states[push.segment];
        let about = push.moment + (state.rotation * push.at).cross(&push.force);
        let [force, moment] = if k < 2 { [0.5, 0.05] } else { [2.0, 0.3] };
        let seen = state.seen_at(&push.at, &push.force, &about);
        inputs.contact[k] = std::array::from_fn(|i| seen[i] + draw.of(if i < 3 { force } else { moment }));
    }
    let root = &states[0];
    let at_seat = root.seen_at(&Vector3::new(0.0, 0.0, -0.1), &root.force, &root.moment);
    inputs.seat = std::array::from_fn(|i| at_seat[i] + draw.of(if i < 3 { 2.0 } else { 0.3 }));
    (inputs, tau, root.seen_at(&Vector3::zeros(), &root.force, &root.moment))
}

/// Of all torques and the seat's wrench over many persons: share healthy and beyond three standard deviations, root mean square
/// of the errors over theirs, median of what is said.
fn judge(parameters: &Parameters, persons: u64) -> (f64, f64, f64) {
    let (mut beyond, mut square, mut count) = (0, 0.0, 0);
    let mut said = vec![];
    for seed in 0..persons {
        let mut draw = Draw(ChaCha8Rng::seed_from_u64(700 + seed));
        let person = another_person(&mut draw);
        for _ in 0..4 {
            let (inputs, tau, wrench) = sample(&person, &mut draw);
            // none of the samples follows from another
            let mut estimator = HumanDynamics::new(parameters).unwrap();
            estimator.step(&inputs, 0.01);
            let mut out = Outputs::default();
            estimator.outputs(&inputs, 0.0, &mut out);
            // a seat's sensor sees that the person is another
            let healthy = out.diagnostics.healthy;
            assert!(healthy || parameters.r#use.seat_wrench);
            let estimates = out.tau.iter().zip(&tau).chain(out.seat_wrench.iter().zip(&wrench));
            for (estimate, truth) in estimates {
                let error = (estimate.value - truth) / estimate.std;
                beyond += usize::from(healthy && error.abs() > 3.0);
                square += error * error;
                count += 1;
                said.push(estimate.std);
            }
        }
    }
    said.sort_by(f64::total_cmp);
    (beyond as f64 / count as f64, (square / count as f64).sqrt(), said[said.len() / 2])
}

fn with_sensors(seat: bool, contacts: bool) -> Parameters {
    let mut parameters = Parameters::default();
    let used = &mut parameters.r#use;
    (used.seat_wrench, used.hand_wrench, used.foot_wrench) = (seat, contacts, contacts);
    parameters
}

#[test]
fn persons_of_other_segments_than_the_tables_are_within_the_standard_deviations() {
    for (what, seat, contacts, honest) in [
        ("no wrench measured", false, false, 0.2..=1.2),
        ("hands and feet measured", false, true, 0.8..=1.15),
        ("seat, hands and feet measured", true, true, 0.8..=1.15),
    ] {
        let parameters = with_sensors(seat, contacts);
        let (beyond, ratio, median) = judge(&parameters, 60);
        let exact = Parameters { scatter: ScatterParameters::NONE, ..parameters.clone() };
        let (sure, _, narrow) = judge(&exact, 60);
        println!(
            "{what}: beyond 3 std {beyond:.4} (taken as exact {sure:.3}), error over std {ratio:.2}, std {median:.2} ({narrow:.2})"
        );
        assert!(beyond <= 0.01, "{what}: {beyond}");
        assert!(honest.contains(&ratio), "{what}: {ratio}");
        assert!(seat || !contacts || sure > 0.1, "{what}: {sure}");
    }
}

/// With hands and feet measured and no seat, nothing else says what the segments weigh: the solver's influences are those of
/// statics.
#[test]
fn influences_by_statics_are_the_solvers_where_no_wrench_is_redundant() {
    let mut machine = HumanDynamics::new(&with_sensors(false, true)).unwrap();
    for seed in 0..5 {
        let mut draw = Draw(ChaCha8Rng::seed_from_u64(40 + seed));
        let (inputs, ..) = sample(&seated12(&BodyParameters::default()), &mut draw);
        machine.step(&inputs, 0.01);
        let mut body = machine.machine().body().clone();
        let (solved, statics) = (body.scattered().to_vec(), body.scattered_by_statics().to_vec());
        for (k, (solved, statics)) in solved.iter().zip(&statics).enumerate() {
            let ratio = (solved / statics).sqrt();
            assert!((0.97..=1.03).contains(&ratio), "estimate {k}: {solved} {statics}");
        }
    }
}
