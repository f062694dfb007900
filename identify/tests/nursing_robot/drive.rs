//! Runs the nursing robot's estimator over simulated logs.

use wheelstate::Estimator;
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters};
use wheelstate_identify::log::Log;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::tune::replay::Track;
use wheelstate_identify::vehicles::nursing_robot::simulate::{Run, run};

pub const PERIOD: f64 = 0.01;

pub fn simulated(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Run {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    let mut run = run(&Request { scenario: scenario.to_owned(), seed, settings }).expect("a scenario");
    // The estimator has the plant's hip or one that is some per cent off: as after a fit.
    (run.assumed.human.stiffness_pitch_std, run.assumed.human.damping_pitch_std) = (0.1, 0.2);
    run
}

/// The inputs of every sample.
pub fn inputs(log: &Log) -> Vec<Inputs> {
    Track::<NursingRobot>::new(log).inputs
}

/// Outputs at every sample of the log.
pub fn estimates(log: &Log, parameters: &Parameters) -> Vec<Outputs> {
    let mut estimator = NursingRobot::new(parameters).expect("valid parameters");
    let mut outputs = Outputs::default();
    let step = |inputs: &Inputs| {
        estimator.step(inputs, parameters.sample_period);
        estimator.outputs(inputs, 0.0, &mut outputs);
        outputs.clone()
    };
    inputs(log).iter().map(step).collect()
}

pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), x| (sum + x * x, n + 1));
    (sum / f64::from(n)).sqrt()
}
