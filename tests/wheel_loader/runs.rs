//! Drives of the plant with noise, and the estimator's outputs on them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::Estimator;
use wheelstate::estimator::wheel_loader::*;
use wheelstate::plant::road::Road;
use wheelstate::plant::wheel_loader::{Action, Machine, Plant};

/// A drive on a flat road: `torque(t, v)` acts on both axles; sensors are noisy.
pub fn drive(seconds: f64, speed: f64, seed: u64, torque: impl Fn(f64, f64) -> f64) -> Vec<Inputs> {
    let rolling = 0.55 / (1.0 + 0.03 / 19.0);
    let machine = Machine { wheel_radius: [rolling; 2], ..Machine::default() };
    let mut plant = Plant::new(machine, Road::flat(), speed);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut noisy = |value: f64, std: f64| {
        let draw: f64 = StandardNormal.sample(&mut random);
        value + std * draw
    };
    (0..(100.0 * seconds) as usize)
        .map(|k| {
            let t = 0.01 * k as f64;
            let now = torque(t, plant.speed());
            let [front, rear] = plant.wheel_speeds();
            let inputs = Inputs {
                torque_front: noisy(now, 10.0),
                torque_rear: noisy(now, 10.0),
                slope: noisy(0.0, 0.003),
                speed: noisy(plant.speed(), 0.02),
                wheel_speed_front: noisy(front, 0.02),
                wheel_speed_rear: noisy(rear, 0.02),
                ..Inputs::default()
            };
            for i in 0..10 {
                let torque = torque(t + 1e-3 * f64::from(i), plant.speed());
                plant.advance(&Action { torque: [torque; 2], ..Action::default() }, 1e-3);
            }
            inputs
        })
        .collect()
}

/// Torque that holds a speed of about 2.5 m/s but changes all the time.
pub fn lively(t: f64, v: f64) -> f64 {
    380.0 + 900.0 * (0.9 * t).sin() + 800.0 * (2.5 - v)
}

pub fn begun(parameters: &Parameters) -> WheelLoader {
    WheelLoader::new(parameters).unwrap()
}

pub fn out(estimator: &WheelLoader, inputs: &Inputs) -> Outputs {
    let mut out = Outputs::default();
    estimator.outputs(inputs, 0.0, &mut out);
    out
}

/// Runs all samples and checks that no output is ever NaN or infinite.
pub fn run(estimator: &mut WheelLoader, inputs: &[Inputs]) -> Vec<Outputs> {
    inputs
        .iter()
        .map(|inputs| {
            estimator.step(inputs, 0.01);
            let out = out(estimator, inputs);
            finite(&out);
            out
        })
        .collect()
}

pub fn finite(out: &Outputs) {
    use wheelstate::Variables;
    let values = out.to_vec();
    assert!(values.iter().all(|value| value.is_finite()), "{out:?}");
}

pub fn unknowns(out: &Outputs) -> [f64; 6] {
    [
        out.slip_stiffness.value,
        out.cg_height.value,
        out.cg_ratio.value,
        out.slip_stiffness.std,
        out.cg_height.std,
        out.cg_ratio.std,
    ]
}
