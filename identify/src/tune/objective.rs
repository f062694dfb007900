//! What a noise setting is judged by: the estimator replays the logs with it.

use crate::replay::Track;
use rayon::prelude::*;
use wheelstate::{Estimator, Variable, Variables};

/// What a noise setting is judged by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Objective {
    /// Negative log-likelihood of the innovations.
    #[default]
    Nll,
    /// Root mean square error: of the filtered outputs against the measured ones where the estimator reports it,
    /// the source's choice; else of the estimates against the log's true_* columns, each over its standard
    /// deviation. Degenerate: it does not know the scale of the noises, and the first pays for following noise.
    Rmse,
}

impl Objective {
    /// The word on the command line and in `tune.json`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Nll => "nll",
            Self::Rmse => "rmse",
        }
    }

    /// What it is made of.
    pub fn source(self) -> &'static str {
        match self {
            Self::Nll => "output log_likelihood",
            Self::Rmse => "output output_error, and the logs have no true_* column of an output",
        }
    }
}

/// What one replay of one log gives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Sum over the samples: negative log-likelihood, or squared output error.
    pub sum: f64,
    /// Sum of the normalised innovations squared, per channel.
    pub nis: f64,
    /// Samples.
    pub samples: usize,
}

impl Score {
    /// The objective.
    pub fn value(&self, objective: Objective) -> f64 {
        let mean = self.sum / self.samples.max(1) as f64;
        if objective == Objective::Nll { mean } else { mean.sqrt() }
    }

    /// Mean NIS per channel.
    pub fn mean_nis(&self) -> f64 {
        self.nis / self.samples as f64
    }
}

/// A [`Track`], whatever its estimator.
pub trait AnyTrack: Send + Sync {
    /// Where the log came from.
    fn source(&self) -> &str;

    /// Sample times, s.
    fn time(&self) -> &[f64];

    /// Whether the log knows what an output should have been.
    fn has_references(&self) -> bool;

    /// Mean square error of a sample's outputs against the references, each over its standard deviation.
    fn reference_error(&self, k: usize, outputs: &[f64]) -> f64;

    /// Runs it with these parameters and shows the outputs after each sample; false if it refuses the parameters.
    fn run_with(&self, parameters: &[f64], see: &mut dyn FnMut(usize, &[f64])) -> bool;
}

impl<E: Estimator> AnyTrack for Track<E> {
    fn source(&self) -> &str {
        &self.source
    }

    fn time(&self) -> &[f64] {
        &self.time
    }

    fn has_references(&self) -> bool {
        !self.references.is_empty()
    }

    fn reference_error(&self, k: usize, outputs: &[f64]) -> f64 {
        self.reference_error(k, outputs)
    }

    fn run_with(&self, flat: &[f64], see: &mut dyn FnMut(usize, &[f64])) -> bool {
        let mut parameters = E::Parameters::default();
        parameters.read(flat);
        let Ok(estimator) = E::new(&parameters) else { return false };
        let mut flat = vec![0.0; E::Outputs::COUNT];
        self.run(estimator, |k, outputs| {
            outputs.write(&mut flat);
            see(k, &flat);
        });
        true
    }
}

/// Logs, an estimator and the places of the noise parameters to be tried.
pub struct Replay {
    /// The logs.
    pub tracks: Vec<Box<dyn AnyTrack>>,
    /// Parameters, with the start values of those to be tuned.
    pub base: Vec<f64>,
    /// Which of them are tuned.
    pub tuned: Vec<usize>,
    /// Objective.
    pub objective: Objective,
    /// Seconds at the start of each log that do not count.
    pub skip: f64,
    judged: Judged,
    nis: Option<usize>,
}

/// What of the outputs is judged.
#[derive(Clone, Debug)]
enum Judged {
    /// One output, by its index, times a sign, is the value itself.
    Output(usize, f64),
    /// The outputs are compared with references of their logs.
    References,
}

impl Replay {
    /// Nothing if the estimator, with these outputs, does not report what the objective needs.
    pub fn new(
        tracks: Vec<Box<dyn AnyTrack>>,
        outputs: &[Variable],
        base: Vec<f64>,
        objective: Objective,
        skip: f64,
    ) -> Option<Self> {
        let place = |name: &str| outputs.iter().position(|variable| variable.name == name);
        let judged = match objective {
            Objective::Nll => Judged::Output(place("log_likelihood")?, -1.0),
            Objective::Rmse => match place("output_error") {
                Some(index) => Judged::Output(index, 1.0),
                None if tracks.iter().any(|track| !track.has_references()) => return None,
                None => Judged::References,
            },
        };
        Some(Self { tracks, base, tuned: Vec::new(), objective, skip, judged, nis: place("nis") })
    }

    /// One log with one setting of the tuned parameters, given as decimal logarithms; nothing if the estimator refuses it.
    pub fn score(&self, track: &dyn AnyTrack, logarithms: &[f64]) -> Option<Score> {
        let mut parameters = self.base.clone();
        self.tuned.iter().zip(logarithms).for_each(|(index, value)| parameters[*index] = 10f64.powf(*value));
        let mut score = Score::default();
        let (time, from) = (track.time(), self.counts_from(track));
        let accepted = track.run_with(&parameters, &mut |k, outputs| {
            if time[k] < from {
                return;
            }
            score.sum += match self.judged {
                Judged::Output(index, sign) => sign * outputs[index],
                Judged::References => track.reference_error(k, outputs),
            };
            score.nis += self.nis.map_or(f64::NAN, |index| outputs[index]);
            score.samples += 1;
        });
        accepted.then_some(score)
    }

    /// Time from which a log's samples count, s.
    fn counts_from(&self, track: &dyn AnyTrack) -> f64 {
        track.time().first().map_or(0.0, |t| t + self.skip)
    }

    /// The objective over all logs: mean negative log-likelihood per sample, or root mean square error.
    /// Infinite if the setting is refused.
    pub fn value(&self, logarithms: &[f64]) -> f64 {
        let mut all = Score::default();
        for track in &self.tracks {
            let Some(score) = self.score(&**track, logarithms) else { return f64::INFINITY };
            all.sum += score.sum;
            all.samples += score.samples;
        }
        let value = all.value(self.objective);
        if value.is_finite() { value } else { f64::INFINITY }
    }

    /// The objective at several settings at once, on all processors.
    pub fn values(&self, settings: &[Vec<f64>]) -> Vec<f64> {
        settings.par_iter().map(|logarithms| self.value(logarithms)).collect()
    }

    /// Whether the objective compares with references and not with measurements.
    pub fn knows_the_truth(&self) -> bool {
        matches!(self.judged, Judged::References)
    }

    /// Number of samples that count.
    pub fn samples(&self) -> usize {
        let counted = |track: &dyn AnyTrack| track.time().iter().filter(|t| **t >= self.counts_from(track)).count();
        self.tracks.iter().map(|track| counted(&**track)).sum()
    }
}
