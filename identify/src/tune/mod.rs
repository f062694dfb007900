//! Noise settings by replaying logs: CN117406607B, claim 1, step 4.
//!
//! The dung beetle optimiser ([`dung_beetle`]) searches the decimal logarithms of the noise settings
//! in centred coordinates, `w = 2 (x - low)/(high - low) - 1`. The objective is the negative
//! log-likelihood of the innovations, with physical floors: without them the filter of a good model
//! is tuned until it trusts nothing but the model.
//!
//! # Other machines
//! Every estimator reports `log_likelihood`. The whole-body estimate of a person has no filter: there it is the
//! likelihood of the readings and equations of each instant. With `rmse`, an estimator that does not report
//! `output_error` is judged by the log's `true_*` columns.
//!
//! # The source's objective
//! The root mean square difference between measured and filtered outputs is degenerate: scaling all
//! noises together does not change it, and following the measurement noise lowers it. It is kept to
//! show that; its result carries a warning and no parameter of it counts as identified. Erratum: the
//! source divides by the sampling time; it must be the number of samples.

mod candidates;
pub mod dung_beetle;
mod needed;
mod objective;
mod report;
pub mod rng;

pub use crate::replay;
pub use candidates::{Candidate, candidates};
pub use objective::Objective;
pub use report::{LogNis, TuneReport, Tuning};

use crate::log::{Log, LogError, listed};
use crate::progress::{Interrupted, Progress};
use dung_beetle::{Optimum, SearchError, Settings, minimise};
use objective::{AnyTrack, Replay};
use replay::Track;
use wheelstate::{Estimator, ParameterError, Variable, Variables};

/// What a tuning is asked for, besides the logs.
#[derive(Clone, Debug, Default)]
pub struct TuneRequest {
    /// Objective.
    pub objective: Objective,
    /// Seed of the search.
    pub seed: u64,
    /// Number of beetles.
    pub population: usize,
    /// Number of generations.
    pub iterations: usize,
    /// Threads; 0 takes as many as there are processors. The result does not depend on it.
    pub threads: usize,
    /// Known parameters and start values by FMU name.
    pub settings: Vec<(String, f64)>,
    /// Only these noise settings; empty means all that have an effect.
    pub only: Vec<String>,
    /// Whether physical floors hold; unset: with `nll` only.
    pub floors: Option<bool>,
    /// Own floors by FMU name.
    pub floor: Vec<(String, f64)>,
    /// Seconds at the start of each log that do not count.
    pub skip: f64,
}

/// Why there is no tuning.
#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    /// No estimator of this vehicle, or one that does not report what the objective needs.
    #[error("tune is not available for {vehicle}: its estimator has no {output}")]
    Unavailable {
        /// The vehicle.
        vehicle: &'static str,
        /// The output that it would need.
        output: &'static str,
    },
    /// No log.
    #[error("no log was given")]
    NoLog,
    /// A log is of another machine.
    #[error(transparent)]
    Log(#[from] LogError),
    /// Nothing is left to tune.
    #[error("no noise setting of {vehicle} has an effect on {logs}{lacking}")]
    Nothing {
        /// The vehicle.
        vehicle: &'static str,
        /// The logs.
        logs: String,
        /// What they lack.
        lacking: String,
    },
    /// A name that is not a noise setting.
    #[error("--only {asked}: is not a noise setting; there are {known}")]
    Unknown {
        /// What was asked for.
        asked: String,
        /// What there is.
        known: String,
    },
    /// The estimator diverges on the logs whatever the setting.
    #[error("no setting gives a finite {0}: do parameters and logs belong together?")]
    Diverged(&'static str),
    /// A setting was refused.
    #[error(transparent)]
    Setting(#[from] ParameterError),
    /// The search cannot begin.
    #[error(transparent)]
    Search(#[from] SearchError),
    /// The user asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
    /// No threads.
    #[error("cannot start the threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// What a tuning must know of a machine beyond the declaration of its estimator.
#[derive(Clone, Copy)]
pub struct Subject {
    /// Name of the machine, for reports and messages.
    pub vehicle: &'static str,
    /// Groups of inputs, `*` standing for any ending: a log needs samples of at least one input of each.
    pub needed: &'static [&'static [&'static str]],
    /// Floors of the process noise by FMU name, from the values of the parameters.
    pub noise_floors: fn(&[f64]) -> Vec<(String, f64)>,
}

/// Tunes the noise settings of an estimator on logs; `held_out` logs only judge the result.
pub fn tune<E: Estimator + 'static>(
    subject: &Subject,
    logs: &[Log],
    held_out: &[Log],
    request: &TuneRequest,
    progress: &Progress,
) -> Result<TuneReport, TuneError> {
    if logs.is_empty() {
        return Err(TuneError::NoLog);
    }
    let inputs = E::Inputs::declare();
    logs.iter().chain(held_out).try_for_each(|log| needed::check(subject, &inputs, log))?;
    let mut parameters = E::Parameters::default();
    let own_period = request.settings.iter().any(|(name, _)| name == "sample_period");
    if let Some(period) = typical_period(logs).filter(|_| !own_period) {
        // to nine digits: times in a file are rounded
        parameters.set("sample_period", (period * 1e9).round() / 1e9)?;
    }
    for (name, value) in &request.settings {
        parameters.set(name, *value)?;
    }
    E::new(&parameters)?;
    let tracks = |logs: &[Log]| -> Vec<Box<dyn AnyTrack>> {
        logs.iter().map(|log| Box::new(Track::<E>::new(log)) as Box<dyn AnyTrack>).collect()
    };
    let unavailable = || TuneError::Unavailable { vehicle: subject.vehicle, output: request.objective.source() };
    let (outputs, base) = (E::Outputs::declare(), parameters.to_vec());
    let replay = Replay::new(tracks(logs), &outputs, base, request.objective, request.skip).ok_or_else(unavailable)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(request.threads).build()?;
    let parameters = E::Parameters::declare();
    let tuner = Tuner { subject, parameters: &parameters, inputs: &inputs, logs, request, progress };
    pool.install(|| tuner.tune(replay, &tracks(held_out)))
}

/// One tuning.
struct Tuner<'a> {
    subject: &'a Subject,
    parameters: &'a [Variable],
    inputs: &'a [Variable],
    logs: &'a [Log],
    request: &'a TuneRequest,
    progress: &'a Progress,
}

/// The middle of the intervals between samples, s.
fn typical_period(logs: &[Log]) -> Option<f64> {
    let mut steps: Vec<f64> = logs.iter().flat_map(|log| log.time.windows(2).map(|t| t[1] - t[0])).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied()
}

impl Tuner<'_> {
    fn tune(&self, mut replay: Replay, held_out: &[Box<dyn AnyTrack>]) -> Result<TuneReport, TuneError> {
        let request = self.request;
        let floors = request.floors.unwrap_or(request.objective == Objective::Nll);
        let physical = floors.then(|| (self.subject.noise_floors)(&replay.base));
        let all = candidates(self.parameters, &replay.base, physical.as_deref(), &request.floor);
        let found = self.choose(&mut replay, all)?;
        replay.tuned = found.iter().map(|c| c.index).collect();
        let mut optimum = self.search(&replay, &found)?;
        let start: Vec<f64> = found.iter().map(|c| c.start.log10()).collect();
        let start_value = replay.value(&start);
        if start_value <= optimum.value {
            // the search never visits the start values; where nothing beats them they stay
            (optimum.position, optimum.value) = (start, start_value);
        }
        if !optimum.value.is_finite() {
            return Err(TuneError::Diverged(request.objective.word()));
        }
        Ok(self.report(&replay, held_out, &found, &optimum))
    }

    /// Keeps the wanted settings that have an effect.
    fn choose(&self, replay: &mut Replay, all: Vec<Candidate>) -> Result<Vec<Candidate>, TuneError> {
        let name = |c: &Candidate| self.parameters[c.index].name.as_str();
        if let Some(asked) = self.request.only.iter().find(|asked| all.iter().all(|c| name(c) != asked.as_str())) {
            let known = all.iter().map(name).collect::<Vec<_>>().join(", ");
            return Err(TuneError::Unknown { asked: asked.clone(), known });
        }
        let wanted = |c: &Candidate| self.request.only.is_empty() || self.request.only.iter().any(|n| n == name(c));
        let all: Vec<Candidate> = all.into_iter().filter(wanted).collect();
        replay.tuned = all.iter().map(|c| c.index).collect();
        let start: Vec<f64> = all.iter().map(|c| c.start.log10()).collect();
        let moved = |i: usize| {
            let mut moved = start.clone();
            let (low, high) = all[i].range;
            moved[i] = if all[i].start < 0.5 * high { high.log10() } else { low.log10() };
            moved
        };
        let mut probes: Vec<Vec<f64>> = (0..all.len()).map(moved).collect();
        probes.push(start.clone());
        let values = replay.values(&probes);
        let unmoved = values[all.len()].to_bits();
        let kept: Vec<Candidate> =
            all.into_iter().zip(values).filter(|(_, value)| value.to_bits() != unmoved).map(|(c, _)| c).collect();
        if kept.is_empty() { Err(self.nothing()) } else { Ok(kept) }
    }

    fn nothing(&self) -> TuneError {
        let sources = self.logs.iter().map(|log| log.source.as_str());
        let lacking = needed::lacking(self.inputs, self.logs);
        let lacking = match lacking.is_empty() {
            true => String::new(),
            false => format!("; there is no sample of {}", listed(lacking.iter().map(String::as_str))),
        };
        TuneError::Nothing { vehicle: self.subject.vehicle, logs: listed(sources), lacking }
    }

    /// The search in centred coordinates.
    fn search(&self, replay: &Replay, found: &[Candidate]) -> Result<Optimum, TuneError> {
        let request = self.request;
        let settings = Settings { population: request.population, iterations: request.iterations, seed: request.seed };
        let total = (request.population * (request.iterations + 1)) as u64;
        self.progress.start("tuning", total);
        let evaluate = |batch: &[Vec<f64>]| -> Vec<f64> {
            let settings: Vec<Vec<f64>> = batch.iter().map(|w| place(found, w)).collect();
            let values = replay.values(&settings);
            self.progress.advance(batch.len() as u64);
            values
        };
        let mut interrupted = None;
        let optimum = minimise(&vec![(-1.0, 1.0); found.len()], &settings, evaluate, |_, best| {
            self.progress.describe(format!("tuning, best {} {best:.5}", request.objective.word()));
            interrupted = self.progress.check().err();
            interrupted.is_none()
        });
        self.progress.finish();
        match interrupted {
            Some(stop) => Err(stop.into()),
            None => {
                let optimum = optimum?;
                Ok(Optimum { position: place(found, &optimum.position), ..optimum })
            }
        }
    }
}

/// Decimal logarithms at centred coordinates.
fn place(found: &[Candidate], centred: &[f64]) -> Vec<f64> {
    found
        .iter()
        .zip(centred)
        .map(|(c, w)| {
            let (low, high) = (c.range.0.log10(), c.range.1.log10());
            low + 0.5 * (w + 1.0) * (high - low)
        })
        .collect()
}
