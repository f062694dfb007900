//! One step of the nursing robot's filters.
//!
//! `cargo bench -p wheelstate --bench nursing_robot`; beside it `tests/bench/filterpy_ukf.py` times
//! filterpy's UKF of the same size.

use divan::{Bencher, black_box};
use wheelstate::Estimator;
use wheelstate::estimator::nursing_robot::mass::{MassEstimator, MassSample};
use wheelstate::estimator::nursing_robot::sway::{SwayEstimator, SwaySample};
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters};

fn main() {
    divan::main();
}

const PERIOD: f64 = 0.01;

/// A drive that keeps every part of the filters busy: always moving, mostly accelerating.
fn inputs() -> Vec<Inputs> {
    (0..1000)
        .map(|row| {
            let t = row as f64 * PERIOD;
            let acceleration = 0.5 * (std::f64::consts::TAU * t / 2.5).cos();
            let torque = 0.5 * 0.0825 * (230.0 * acceleration + 33.8);
            Inputs {
                torque_left: torque,
                torque_right: torque,
                speed: 0.9 + 0.2 * (std::f64::consts::TAU * t / 2.5).sin(),
                tilt: 0.02 * (5.0 * t).sin(),
                tilt_rate: 0.1 * (5.0 * t).cos(),
                ..Inputs::default()
            }
        })
        .collect()
}

fn parameters(imu: bool) -> Parameters {
    let mut p = Parameters::default();
    (p.sway.use_tilt, p.sway.use_tilt_rate) = (imu, imu);
    p
}

/// The mass filter alone.
#[divan::bench(sample_count = 1000, sample_size = 1000)]
fn mass_step(bencher: Bencher) {
    let p = parameters(false);
    let (estimator, inputs) = (MassEstimator::new(&p), inputs());
    let mut state = estimator.start();
    let mut row = 0;
    bencher.bench_local(|| {
        let x = &inputs[row % inputs.len()];
        row += 1;
        let force = (x.torque_left + x.torque_right) / 0.0825;
        let sample = MassSample { force, speed: x.speed, specific_force: f64::NAN };
        estimator.step(&mut state, black_box(&sample), PERIOD)
    });
}

fn sway_step(bencher: Bencher, imu: bool) {
    let p = parameters(imu);
    let estimator = SwayEstimator::new(&p).expect("a swaying person");
    let inputs = inputs();
    let mut state = estimator.start();
    let mut row = 0;
    bencher.bench_local(|| {
        let x = &inputs[row % inputs.len()];
        row += 1;
        let force = (x.torque_left + x.torque_right) / 0.0825;
        let sample = SwaySample { force, yaw_rate: 0.1, channels: [x.speed, x.tilt, x.tilt_rate] };
        estimator.step(&mut state, black_box(&sample), 70.0, PERIOD)
    });
}

/// The sway filter with 3 states and 1 measurement.
#[divan::bench(sample_count = 1000, sample_size = 1000)]
fn sway_step_3_states(bencher: Bencher) {
    sway_step(bencher, false);
}

/// The sway filter with 4 states and 3 measurements.
#[divan::bench(sample_count = 1000, sample_size = 1000)]
fn sway_step_4_states(bencher: Bencher) {
    sway_step(bencher, true);
}

/// The whole estimator: both filters and all outputs.
#[divan::bench(args = [false, true], sample_count = 1000, sample_size = 1000)]
fn estimator_step(bencher: Bencher, imu: bool) {
    let mut estimator = NursingRobot::new(&parameters(imu)).expect("valid parameters");
    let inputs = inputs();
    let mut outputs = Outputs::default();
    let mut row = 0;
    bencher.bench_local(|| {
        let x = &inputs[row % inputs.len()];
        row += 1;
        let status = estimator.step(black_box(x), PERIOD);
        estimator.outputs(x, 0.0, &mut outputs);
        status
    });
}
