//! How the seated person couples to a vehicle: the seat wrench loads it, mass and centre of mass
//! feed the estimators that treat the person as a load.
//!
//! ```text
//! IMU on the seat, joint angles -> HumanDynamics -> body_mass, com_x, com_z -> human.* of the nursing robot,
//!                                                                              chair.* of the wheelchair
//!                                                -> -seat_wrench            -> disturbance on the vehicle
//! ```
//! One or the other: the seat wrench already holds weight and inertia of the person.

use super::cases::sitting;
use nalgebra::Vector3;
use wheelstate::Estimator;
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};
use wheelstate::estimator::{nursing_robot, wheelchair};

const GRAVITY: f64 = 9.80665;

fn estimate(estimator: &mut HumanDynamics, inputs: &Inputs) -> Outputs {
    let mut outputs = Outputs::default();
    estimator.step(inputs, 0.01);
    estimator.outputs(inputs, 0.0, &mut outputs);
    outputs
}

/// A seated person whose hands and feet rest on the vehicle: with those wrenches measured, what the
/// person puts on the vehicle is weight and inertia, wherever it goes through.
#[test]
fn the_person_loads_the_vehicle_with_weight_and_inertia() {
    let mut parameters = Parameters::default();
    let used = &mut parameters.r#use;
    (used.seat_wrench, used.hand_wrench, used.foot_wrench) = (false, true, true);
    let mut human = HumanDynamics::new(&parameters).unwrap();
    for ahead in [0.0, -2.5, 1.5] {
        let mut inputs = Inputs { base_accel: [ahead, 0.0, GRAVITY], ..sitting() };
        inputs.contact[2] = [-10.0, 0.0, 70.0, 0.0, 0.0, 0.0];
        inputs.contact[3] = [-10.0, 0.0, 70.0, 0.0, 0.0, 0.0];
        let out = estimate(&mut human, &inputs);
        // what seat and foot rests feel, in the vehicle's axes (shanks hang straight in this posture)
        let feet = Vector3::new(-20.0, 0.0, 140.0);
        let seat: Vector3<f64> = Vector3::from_fn(|k, _| out.seat_wrench[k].value);
        let load: Vector3<f64> = -seat - feet;
        let expected = Vector3::new(ahead, 0.0, GRAVITY) * -65.0;
        assert!((load - expected).norm() < 5.0, "{load} {expected}");
    }
}

/// Leaning forward moves the person's centre of mass; the vehicle's parameters that depend on it
/// follow from `body_mass` and `com_*`, and the vehicle's estimator takes them.
#[test]
fn centre_of_mass_feeds_the_vehicles() {
    let mut human = HumanDynamics::new(&Parameters::default()).unwrap();
    let upright = estimate(&mut human, &sitting());
    let mut leaning = sitting();
    leaning.q[1] = 0.5; // lumbar_y
    let leaning = estimate(&mut human, &leaning);
    assert!(leaning.com[0] > upright.com[0] + 0.05 && leaning.com[2] < upright.com[2]);

    // nursing robot: the person's mass and the height of its centre over the seat
    let mut robot = nursing_robot::Parameters::default();
    robot.human.nominal_mass = upright.body_mass;
    robot.human.com_height = upright.com[2];
    nursing_robot::NursingRobot::new(&robot).unwrap();

    // wheelchair: chair and person together, the pelvis 5 cm ahead of the axle
    let (chair_mass, pelvis_ahead) = (25.0, 0.05);
    let ahead = |person: &Outputs| (pelvis_ahead + person.com[0]) * person.body_mass / (chair_mass + person.body_mass);
    let mut chair = wheelchair::Parameters::default();
    chair.chair.mass = chair_mass + upright.body_mass;
    chair.chair.com_ahead = ahead(&upright);
    wheelchair::Wheelchair::new(&chair).unwrap();
    assert!(ahead(&leaning) > ahead(&upright) + 0.03, "{} {}", ahead(&leaning), ahead(&upright));
}
