//! Logs run through an estimator, again and again with other parameters.

use crate::log::Log;
use wheelstate::{Estimator, Variable, Variables};

/// A log in the form that an estimator takes: typed inputs and time steps.
#[derive(Clone, Debug)]
pub struct Track<E: Estimator> {
    /// Where the log came from.
    pub source: String,
    /// Sample times, s.
    pub time: Vec<f64>,
    /// Inputs per sample; channels that the log lacks are NaN, never sampled.
    pub inputs: Vec<E::Inputs>,
    /// Columns `true_x` of the log for outputs `x`.
    pub references: Vec<Reference>,
}

/// What an output should have been.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Place among the outputs.
    pub index: usize,
    /// One value per sample, NaN where it is not known.
    pub values: Vec<f64>,
    /// Standard deviation of the values.
    pub scale: f64,
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
                    None if variable.may_be_missing() => f64::NAN,
                    None => variable.start,
                };
            }
            let mut inputs = E::Inputs::default();
            inputs.read(&flat);
            inputs
        });
        let inputs = inputs.collect();
        let outputs = E::Outputs::declare();
        let reference = |(index, output): (usize, &Variable)| {
            let values = log.channel(&format!("true_{}", output.name))?.to_vec();
            let known = || values.iter().filter(|value| value.is_finite());
            let count = known().count().max(1) as f64;
            let mean = known().sum::<f64>() / count;
            let scale = (known().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt();
            Some(Reference { index, values, scale })
        };
        let moves = |reference: &Reference| reference.scale > 1e-9;
        let references = outputs.iter().enumerate().filter_map(reference).filter(moves).collect();
        Self { source: log.source.clone(), time: log.time.clone(), inputs, references }
    }

    /// Mean square error of a sample's outputs against the references, each over its standard deviation.
    pub fn reference_error(&self, k: usize, outputs: &[f64]) -> f64 {
        let square =
            |reference: &Reference| ((outputs[reference.index] - reference.values[k]) / reference.scale).powi(2);
        let squares = self.references.iter().map(square).filter(|square| square.is_finite());
        let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), square| (sum + square, count + 1.0));
        sum / f64::max(count, 1.0)
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
