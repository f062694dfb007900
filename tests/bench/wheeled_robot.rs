//! Cost of the wheeled robot's estimator: observers of four wheels, cubature filter, whole step.

use divan::{Bencher, black_box};
use nalgebra::{Vector3, Vector4};
use wheelstate::Estimator;
use wheelstate::estimator::wheeled_robot::{Inputs, Outputs, Parameters, WheeledRobot as Robot};
use wheelstate::filter::gaussian::FactoredGaussian;
use wheelstate::filter::innovation::Gate;
use wheelstate::filter::sliding_mode::SlidingMode;
use wheelstate::filter::srckf;
use wheelstate::model::tire::TireSet;
use wheelstate::model::wheeled_robot::{Drive, Motion, Vehicle, Wheel, WheeledRobot};

fn main() {
    divan::main();
}

fn robot() -> WheeledRobot {
    WheeledRobot::new(&Vehicle::default(), &TireSet::default(), 0.5)
}

#[divan::bench]
fn observers_of_four_wheels(bencher: Bencher) {
    let wheel = Wheel::default();
    let observer = SlidingMode {
        gain: 10.0,
        amplitude: 246.0,
        steepness: 20.0 / 246.0,
        nominal_rate: 7.5,
        force_limit: f64::INFINITY,
        feedforward: false,
        adaptation: None,
    };
    let mut states = [observer.start(); 4];
    let mut time = 0.0;
    bencher.bench_local(|| {
        time += 0.01;
        for state in &mut states {
            observer.step(&wheel, state, black_box(20.0 + 0.1 * time), black_box(1.0), 0.01);
        }
    });
}

#[divan::bench]
fn forces(bencher: Bencher) {
    let (robot, drive) = (robot(), Drive::new(0.1, [3.0; 4]));
    bencher.bench_local(|| robot.driven(black_box(&drive)).forces_of(black_box(&[[3.0, 0.1, 0.4]])));
}

#[divan::bench]
fn cubature_filter(bencher: Bencher) {
    let (robot, drive) = (robot(), Drive::new(0.1, [0.0; 4]));
    let mut filter = FactoredGaussian::independent(Vector3::new(3.0, 0.0, 0.0), &Vector3::new(0.5, 0.2, 0.2));
    let (q, r) = (Vector3::repeat(0.02), Vector4::new(0.1, 0.1, 0.01, 0.05));
    let z = Vector4::new(0.0, 1.0, 0.35, 3.0);
    bencher.bench_local(|| {
        let driven = robot.driven(black_box(&drive));
        srckf::predict(&mut filter, &q, |x: &[Vector3<f64>; 6]| {
            let rates = driven.derivatives_of(&x.map(Motion::from));
            std::array::from_fn(|k| x[k] + Vector3::from(rates[k]) * 0.01)
        });
        let driven = robot.driven(black_box(&drive));
        srckf::correct(&mut filter, black_box(&z), &r, (Gate::OPEN, &mut 0), [false; 3], |x: &[Vector3<f64>; 6]| {
            let forces = driven.accelerations_of(&x.map(Motion::from));
            std::array::from_fn(|k| Vector4::new(forces[k][0], forces[k][1], x[k][2], x[k][0]))
        })
    });
}

#[divan::bench]
fn whole_step(bencher: Bencher) {
    let mut parameters = Parameters::default();
    parameters.initial.speed_x = 3.0;
    let mut estimator = Robot::new(&parameters).unwrap();
    let mut outputs = Outputs::default();
    let inputs = Inputs {
        steering_angle: 0.1,
        wheel_speed_fl: 20.0,
        wheel_speed_fr: 20.0,
        wheel_speed_rl: 20.0,
        wheel_speed_rr: 20.0,
        accel_y: 1.0,
        gyro_z: 0.35,
        ..Inputs::default()
    };
    bencher.bench_local(|| {
        estimator.step(black_box(&inputs), 0.01);
        estimator.outputs(&inputs, 0.0, &mut outputs);
        outputs.speed_x.value
    });
}
