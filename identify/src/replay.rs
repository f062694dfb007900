//! Logs run through an estimator: once for its estimates, or again and again with other parameters.

use crate::log::{Log, Series};
use std::convert::Infallible;
use wheelstate::clock::Clock;
use wheelstate::{Estimator, Variable, Variables};

/// When an estimator takes the rows of a log for samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sampling {
    /// Every row is one sample at its own time: time steps are what they are, and a gap is a gap.
    #[default]
    EveryRow,
    /// As the FMU in a host: every `sample_period` the inputs that hold there, which are those of the last row. Rows in
    /// between are not used, and across a gap the last row counts again and again.
    AsFmu,
}

/// Where the inputs of an estimator stand in a log.
#[derive(Clone, Debug)]
pub struct Source<'a> {
    /// One per declared input.
    channels: Vec<Channel<'a>>,
}

#[derive(Clone, Copy, Debug)]
enum Channel<'a> {
    Samples(&'a [f64]),
    /// The log has no such channel.
    Absent(f64),
}

impl<'a> Source<'a> {
    /// The channels with the names of the estimator's inputs; an input that the log lacks is never sampled.
    pub fn of<E: Estimator>(log: &'a Log) -> Self {
        let channel = |variable: &Variable| match log.channel(&variable.name) {
            Some(values) => Channel::Samples(values),
            None if variable.may_be_missing() => Channel::Absent(f64::NAN),
            None => Channel::Absent(variable.start),
        };
        Self { channels: E::Inputs::declare().iter().map(channel).collect() }
    }

    /// The inputs of one row.
    pub fn row(&self, k: usize, flat: &mut [f64]) {
        for (value, channel) in flat.iter_mut().zip(&self.channels) {
            *value = match channel {
                Channel::Samples(values) => values[k],
                Channel::Absent(start) => *start,
            };
        }
    }
}

/// Runs an estimator over rows at these times, which increase; `read` gives the inputs of a row, `before` is shown the
/// estimator before each sample with the arguments of its step, `see` the
/// number of each estimate, its time and the estimates, and may stop the run.
///
/// - [`Sampling::EveryRow`]: as many estimates as rows, each at its row's time and after its row's sample.
/// - [`Sampling::AsFmu`]: one more than rows, at the time of each row from the samples before it, carried forward by the
///   model: what a host reads there. The last one stands `last` seconds after the last row.
pub fn replay<E: Estimator, S>(
    estimator: &mut E,
    (sampling, last): (Sampling, f64),
    time: &[f64],
    mut read: impl FnMut(usize, &mut E::Inputs),
    mut before: impl FnMut(&E, &E::Inputs, f64),
    mut see: impl FnMut(usize, f64, &E::Outputs) -> Result<(), S>,
) -> Result<(), S> {
    let (mut inputs, mut outputs) = (E::Inputs::default(), E::Outputs::default());
    let period = estimator.sample_period();
    match sampling {
        Sampling::EveryRow => {
            for (k, now) in time.iter().enumerate() {
                read(k, &mut inputs);
                let dt = if k == 0 { period } else { now - time[k - 1] };
                before(estimator, &inputs, dt);
                estimator.step(&inputs, dt);
                estimator.outputs(&inputs, 0.0, &mut outputs);
                see(k, *now, &outputs)?;
            }
        }
        Sampling::AsFmu => {
            let Some(start) = time.first() else { return Ok(()) };
            let mut clock = Clock::new(*start);
            read(0, &mut inputs);
            estimator.outputs(&inputs, 0.0, &mut outputs);
            see(0, *start, &outputs)?;
            for (k, now) in time.iter().enumerate() {
                let end = time.get(k + 1).copied().unwrap_or(now + last);
                let until = clock.advance(*now, end - now, period);
                if clock.samples() < until {
                    // The inputs of a row without a sample act on nothing, not on the prediction either.
                    read(k, &mut inputs);
                }
                while clock.samples() < until {
                    clock.tick(period);
                    before(estimator, &inputs, period);
                    estimator.step(&inputs, period);
                }
                estimator.outputs(&inputs, clock.horizon(period), &mut outputs);
                see(k + 1, end, &outputs)?;
            }
        }
    }
    Ok(())
}

/// A log in the form that an estimator takes, for many runs: typed inputs, and what the outputs should have been.
#[derive(Clone, Debug)]
pub struct Track<E: Estimator> {
    /// Where the log came from.
    pub source: String,
    /// Sample times, s.
    pub time: Series,
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
    pub values: Series,
    /// Standard deviation of the values.
    pub scale: f64,
}

impl<E: Estimator> Track<E> {
    /// From a log.
    pub fn new(log: &Log) -> Self {
        let source = Source::of::<E>(log);
        let mut flat = vec![0.0; E::Inputs::COUNT];
        let inputs = (0..log.len()).map(|k| {
            source.row(k, &mut flat);
            let mut inputs = E::Inputs::default();
            inputs.read(&flat);
            inputs
        });
        let inputs = inputs.collect();
        let outputs = E::Outputs::declare();
        let reference = |(index, output): (usize, &Variable)| {
            let values = log.series(&format!("true_{}", output.name))?;
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
        let Ok(()) = replay(
            &mut estimator,
            (Sampling::EveryRow, f64::NAN),
            &self.time,
            |k, inputs| inputs.clone_from(&self.inputs[k]),
            |_, _, _| {},
            |k, _, outputs| {
                see(k, outputs);
                Ok::<(), Infallible>(())
            },
        );
    }
}
