//! Cost of the wheelchair's filter: one time update and one measurement update with all six rows, and
//! the whole estimator step with inputs checked, standstill watched and outputs written. Every step is
//! one of a drive onto the ramp, so that no branch and no function sees the same numbers all the time.

#[path = "../wheelchair/runs.rs"]
mod runs;

use divan::{Bencher, black_box};
use nalgebra::SVector;
use runs::{Drive as Setup, Normal};
use wheelstate::Estimator;
use wheelstate::estimator::wheelchair::ekf::{ChairEkf, Drive, Form, Sample};
use wheelstate::estimator::wheelchair::{
    Basic, Biased, GravityVector, Inputs, Kind, Mover, Outputs, Parameters, Wheelchair,
};
use wheelstate::filter::gaussian::Gaussian;
use wheelstate::model::wheelchair::{Command, Output, wheel_travel};
use wheelstate::plant::wheelchair::Course;

fn main() {
    divan::main();
}

/// Four seconds in motion, of which two are on the slope.
fn drive() -> Vec<Inputs> {
    let rows = runs::drive(&Setup::nominal(Course::Oblique), &mut Normal::new(1));
    rows.into_iter().skip(100).take(400).map(|row| row.inputs).collect()
}

fn parameters() -> Parameters {
    let mut parameters = Parameters::default();
    parameters.initial.heading = Course::Oblique.heading();
    parameters.filter.detect_standstill = false;
    parameters
}

fn predict_and_update<const N: usize, const K: usize, const P: usize, F: Form<N, K, P>>(bencher: Bencher, form: F) {
    let p = parameters();
    let filter = ChairEkf { chair: p.chair(), noise: p.noise(), limits: p.limits(), gate: p.gate(), form };
    let steps: Vec<(Sample, Drive)> = drive()
        .iter()
        .map(|i| {
            let (travel, heading) = wheel_travel(&filter.chair, i.encoder_right, i.encoder_left);
            let y = Output::from([travel, heading, i.gyro_pitch, i.accel_x, i.accel_y, i.accel_z]);
            let command = Command::new(i.drive_force, i.drive_moment);
            (y.into(), Drive { accel_x: Some(i.accel_x), ..Drive::reported(command, false) })
        })
        .collect();
    let mut mean = SVector::<f64, N>::zeros();
    mean[1] = p.initial.heading;
    let start = Gaussian::independent(mean, &SVector::repeat(0.03));
    let (mut belief, mut counters, mut k) = (start, [0; 6], 0);
    bencher.bench_local(|| {
        if k == steps.len() {
            (belief, k) = (start, 0);
        }
        let (sample, drive) = black_box(&steps[k]);
        filter.predict(&mut belief, 0.01, drive);
        let _ = black_box(filter.correct(&mut belief, &mut counters, sample, drive));
        k += 1;
    });
}

#[divan::bench(sample_size = 4000)]
fn six_states(bencher: Bencher) {
    predict_and_update(bencher, Basic);
}

#[divan::bench(sample_size = 4000)]
fn fifteen_states(bencher: Bencher) {
    predict_and_update(bencher, GravityVector { mover: Mover::Force });
}

#[divan::bench(sample_size = 4000)]
fn thirteen_states(bencher: Bencher) {
    predict_and_update(bencher, Biased { mover: Mover::Force });
}

#[divan::bench(sample_size = 4000, args = ["basic", "bias", "acceleration_input", "gravity_vector"])]
fn estimator_step(bencher: Bencher, kind: &str) {
    let mut parameters = parameters();
    parameters.filter.kind = match kind {
        "basic" => Kind::Basic,
        "bias" => Kind::Bias,
        "acceleration_input" => Kind::AccelerationInput,
        _ => Kind::GravityVector,
    };
    let samples = drive();
    let start = Wheelchair::new(&parameters).unwrap();
    let mut estimator = start.clone();
    let mut outputs = Outputs::default();
    let mut k = 0;
    bencher.bench_local(|| {
        if k == samples.len() {
            estimator.restore(start.state()).unwrap();
            k = 0;
        }
        let inputs = black_box(&samples[k]);
        estimator.step(inputs, 0.01);
        estimator.outputs(inputs, 0.01, &mut outputs);
        black_box(&outputs);
        k += 1;
    });
}
