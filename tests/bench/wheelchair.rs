//! Cost of the wheelchair's filter: one time update and one measurement update with all six rows, and
//! the whole estimator step with inputs checked, standstill watched and outputs written.

use divan::{Bencher, black_box};
use nalgebra::SVector;
use wheelstate::Estimator;
use wheelstate::estimator::wheelchair::observer::{Drive, Form, Observer};
use wheelstate::estimator::wheelchair::{Basic, Biased, GravityVector, Inputs, Kind, Outputs, Parameters, Wheelchair};
use wheelstate::filter::ekf::Ekf;
use wheelstate::model::wheelchair::{Command, Output};

fn main() {
    divan::main();
}

fn predict_and_update<const N: usize, const P: usize, F: Form<N, P>>(bencher: Bencher, form: F) {
    let p = Parameters::default();
    let observer = Observer { chair: p.chair(), noise: p.noise(), limits: p.limits(), gate: p.gate(), form };
    let mut filter = Ekf::new(SVector::<f64, N>::zeros(), SVector::repeat(1e-3));
    let mut counters = [0; 6];
    let y = Output::from([0.0, 0.0, 0.001, 0.02, 0.01, 9.8]);
    bencher.bench_local(|| {
        let drive = Drive { command: Command::new(black_box(2.0), 0.1), accel_x: Some(0.02), still: false };
        let _ = observer.predict(&mut filter, 0.01, &drive);
        let _ = black_box(observer.update(&mut filter, &mut counters, &black_box(y).into(), &drive));
    });
}

#[divan::bench(sample_size = 200)]
fn six_states(bencher: Bencher) {
    predict_and_update(bencher, Basic);
}

#[divan::bench(sample_size = 200)]
fn eight_states(bencher: Bencher) {
    predict_and_update(bencher, GravityVector);
}

#[divan::bench(sample_size = 200)]
fn eleven_states(bencher: Bencher) {
    predict_and_update(bencher, Biased { acceleration_input: false });
}

#[divan::bench(sample_size = 200, args = ["basic", "bias", "acceleration_input", "gravity_vector"])]
fn estimator_step(bencher: Bencher, kind: &str) {
    let mut parameters = Parameters::default();
    parameters.filter.detect_standstill = false;
    parameters.filter.kind = match kind {
        "basic" => Kind::Basic,
        "bias" => Kind::Bias,
        "acceleration_input" => Kind::AccelerationInput,
        _ => Kind::GravityVector,
    };
    let mut estimator = Wheelchair::new(&parameters).unwrap();
    let mut outputs = Outputs::default();
    bencher.bench_local(|| {
        let inputs = Inputs { drive_force: black_box(1.0), ..Inputs::default() };
        estimator.step(&inputs, 0.01);
        estimator.outputs(&inputs, 0.01, &mut outputs);
        black_box(&outputs);
    });
}
