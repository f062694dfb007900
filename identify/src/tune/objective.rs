//! What a noise setting is judged by: the estimator replays the logs with it.

use crate::replay::Track;
use wheelstate::{Estimator, Variables};

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

/// Logs, a vehicle and the places of the noise parameters to be tried.
pub struct Replay<E: Estimator> {
    /// The logs.
    pub tracks: Vec<Track<E>>,
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
    /// The outputs are compared with references of their tracks.
    References,
}

impl<E: Estimator> Replay<E> {
    /// Nothing if the estimator does not report what the objective needs.
    pub fn new(tracks: Vec<Track<E>>, base: Vec<f64>, objective: Objective, skip: f64) -> Option<Self> {
        let declared = E::Outputs::declare();
        let place = |name: &str| declared.iter().position(|variable| variable.name == name);
        let judged = match objective {
            Objective::Nll => Judged::Output(place("log_likelihood")?, -1.0),
            Objective::Rmse => match place("output_error") {
                Some(index) => Judged::Output(index, 1.0),
                None if tracks.iter().any(|track| track.references.is_empty()) => return None,
                None => Judged::References,
            },
        };
        Some(Self { tracks, base, tuned: Vec::new(), objective, skip, judged, nis: place("nis") })
    }

    /// The parameters with these values of the tuned ones, given as decimal logarithms.
    pub fn parameters(&self, logarithms: &[f64]) -> E::Parameters {
        let mut flat = self.base.clone();
        self.tuned.iter().zip(logarithms).for_each(|(index, value)| flat[*index] = 10f64.powf(*value));
        let mut parameters = E::Parameters::default();
        parameters.read(&flat);
        parameters
    }

    /// One log with one setting; nothing if the estimator refuses the setting.
    pub fn score(&self, track: &Track<E>, logarithms: &[f64]) -> Option<Score> {
        let estimator = E::new(&self.parameters(logarithms)).ok()?;
        let mut flat = vec![0.0; E::Outputs::COUNT];
        let mut score = Score::default();
        let from = track.time.first().map_or(0.0, |t| t + self.skip);
        track.run(estimator, |k, outputs| {
            if track.time[k] < from {
                return;
            }
            outputs.write(&mut flat);
            score.sum += match self.judged {
                Judged::Output(index, sign) => sign * flat[index],
                Judged::References => track.reference_error(k, &flat),
            };
            score.nis += self.nis.map_or(f64::NAN, |index| flat[index]);
            score.samples += 1;
        });
        Some(score)
    }

    /// The objective over all logs: mean negative log-likelihood per sample, or root mean square error.
    /// Infinite if the setting is refused.
    pub fn value(&self, logarithms: &[f64]) -> f64 {
        let mut all = Score::default();
        for track in &self.tracks {
            let Some(score) = self.score(track, logarithms) else { return f64::INFINITY };
            all.sum += score.sum;
            all.samples += score.samples;
        }
        let value = all.value(self.objective);
        if value.is_finite() { value } else { f64::INFINITY }
    }

    /// Whether the objective compares with references and not with measurements.
    pub fn knows_the_truth(&self) -> bool {
        matches!(self.judged, Judged::References)
    }

    /// Number of samples that count.
    pub fn samples(&self) -> usize {
        let counted = |track: &Track<E>| {
            let from = track.time.first().map_or(0.0, |t| t + self.skip);
            track.time.iter().filter(|t| **t >= from).count()
        };
        self.tracks.iter().map(counted).sum()
    }
}
