//! Logs run through an estimator, again and again with other parameters.

use crate::log::Log;
use wheelstate::{Estimator, Variables};

/// A log in the form that an estimator takes: typed inputs and time steps.
#[derive(Clone, Debug)]
pub struct Track<E: Estimator> {
    /// Where the log came from.
    pub source: String,
    /// Sample times, s.
    pub time: Vec<f64>,
    /// Inputs per sample; channels that the log lacks are NaN, never sampled.
    pub inputs: Vec<E::Inputs>,
}

impl<E: Estimator> Track<E> {
    /// From a log.
    pub fn new(log: &Log) -> Self {
        let declared = E::Inputs::declare();
        let channels: Vec<_> = declared.iter().map(|variable| log.channel(&variable.name)).collect();
        let mut flat = vec![0.0; declared.len()];
        let inputs = (0..log.len()).map(|k| {
            for ((value, variable), channel) in flat.iter_mut().zip(&declared).zip(&channels) {
                *value = match channel {
                    Some(values) => values[k],
                    None if variable.measured => f64::NAN,
                    None => variable.start,
                };
            }
            let mut inputs = E::Inputs::default();
            inputs.read(&flat);
            inputs
        });
        Self { source: log.source.clone(), time: log.time.clone(), inputs: inputs.collect() }
    }

    /// Runs a fresh estimator over the log and shows the outputs after each sample.
    pub fn run(&self, mut estimator: E, mut see: impl FnMut(usize, &E::Outputs)) {
        let mut outputs = E::Outputs::default();
        for (k, inputs) in self.inputs.iter().enumerate() {
            let dt = if k == 0 { estimator.sample_period() } else { self.time[k] - self.time[k - 1] };
            estimator.step(inputs, dt);
            estimator.outputs(inputs, 0.0, &mut outputs);
            see(k, &outputs);
        }
    }
}
