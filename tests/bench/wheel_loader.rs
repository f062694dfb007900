//! Time of one sample of the wheel loader's estimators, two implicit sub-steps included.

use divan::{Bencher, black_box};
use wheelstate::Estimator;
use wheelstate::estimator::wheel_loader::{Form, Inputs, Kind, Parameters, Radii, WheelLoader};

fn main() {
    divan::main();
}

/// A machine under way: active estimation, changing torque.
fn inputs() -> Vec<Inputs> {
    (0..1000)
        .map(|k| {
            let t = 0.01 * f64::from(k);
            let torque = 1000.0 + 400.0 * t.sin();
            let speed = 2.0 + 0.5 * (0.3 * t).sin();
            Inputs {
                torque_front: torque,
                torque_rear: torque,
                slope: 0.01 * (0.7 * t).sin(),
                speed: speed + 0.01 * (37.0 * t).sin(),
                wheel_speed_front: speed / 0.55 * (1.0 + torque / 0.55 / 19.0 / 20_700.0) + 0.01 * (53.0 * t).sin(),
                wheel_speed_rear: speed / 0.55 * (1.0 + torque / 0.55 / 19.0 / 25_300.0) + 0.01 * (71.0 * t).sin(),
                ..Inputs::default()
            }
        })
        .collect()
}

/// Timed: one whole sample, supervision included, inputs rotating; 100 samples per timing, so that neither the
/// clock nor cold caches count.
fn step(bencher: Bencher, kind: Kind, form: Form, radii: Radii) {
    let mut parameters = Parameters::default();
    parameters.filter.kind = kind;
    parameters.filter.form = form;
    parameters.filter.radii = radii;
    let mut estimator = WheelLoader::new(&parameters).expect("the defaults are valid");
    let inputs = inputs();
    for sample in &inputs {
        estimator.step(sample, 0.01);
    }
    let mut next = inputs.iter().cycle();
    bencher.bench_local(|| {
        let sample = next.next().unwrap_or(&inputs[0]);
        black_box(estimator.step(black_box(sample), 0.01))
    });
}

#[divan::bench(sample_size = 100)]
fn srukf_array(bencher: Bencher) {
    step(bencher, Kind::SquareRootUnscented, Form::Array, Radii::Fixed);
}

#[divan::bench(sample_size = 100)]
fn srukf_andrews(bencher: Bencher) {
    step(bencher, Kind::SquareRootUnscented, Form::Andrews, Radii::Fixed);
}

#[divan::bench(sample_size = 100)]
fn srukf_array_with_radii(bencher: Bencher) {
    step(bencher, Kind::SquareRootUnscented, Form::Array, Radii::Estimated);
}

#[divan::bench(sample_size = 100)]
fn ekf(bencher: Bencher) {
    step(bencher, Kind::Extended, Form::Array, Radii::Fixed);
}

#[divan::bench(sample_size = 100)]
fn ekf_with_radii(bencher: Bencher) {
    step(bencher, Kind::Extended, Form::Array, Radii::Estimated);
}
