//! Logs through an estimator, once: its estimates over a whole ride, at native speed.
//!
//! [`Vehicle::run`](crate::vehicle::Vehicle::run) is the machine of a name; [`run()`] that of a type. The parameters
//! come from a file ([`Parameters::read`]) or from the caller. [`assess`] says in words what a run is worth.
//!
//! Beside the outputs of the FMU a run has for every measured channel `x` of the filter `measured_x`, `innovation_x`
//! (measured minus predicted) and `innovation_x_std`, of the sample that `nis` is of; NaN without a sample.
//!
//! With [`Settings::smooth`] it also has for every estimate `x` that can be smoothed `x_smoothed` and
//! `x_smoothed_std`, from all samples of the ride.

mod chi_square;
mod parameters;
mod smooth;
mod ssv;
mod verdict;

pub use crate::replay::Sampling;
pub use chi_square::chi_square_quantile;
pub use parameters::{Parameters, ParametersError};
pub use smooth::smooth_step;
pub use verdict::{Assessment, ChannelFit, Remark, Span, Truth, assess, nis_bounds};

use crate::log::{Channel, Log};
use crate::progress::{Interrupted, Progress};
use crate::replay::{Source, replay};
use std::cell::RefCell;
use wheelstate::estimator::one_step::OneStepPrediction;
use wheelstate::variable::Kind;
use wheelstate::{Estimator, ParameterError, Variable, Variables};

/// What a run is asked for, besides the log.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Parameters of the estimator by FMU name; of two with one name the later counts. Others stand at their defaults.
    pub parameters: Vec<(String, f64)>,
    /// Which rows are samples.
    pub sampling: Sampling,
    /// Adds smoothed estimates, see the [module](self)'s page; every row is a sample then.
    pub smooth: bool,
}

impl Default for Settings {
    /// Defaults of the FMU, sampled as a host does.
    fn default() -> Self {
        Self { parameters: Vec::new(), sampling: Sampling::AsFmu, smooth: false }
    }
}

/// The estimates of one log.
#[derive(Clone, Debug)]
pub struct Run {
    /// [`Estimator::NAME`], also the name of the FMU.
    pub model: &'static str,
    /// Where the log came from.
    pub source: String,
    /// The estimator's sample period, s: the given one or, if the rows are further apart, their distance.
    pub sample_period: f64,
    /// Which rows were samples.
    pub sampling: Sampling,
    /// Times of the estimates, s: those of the log's rows, and with [`Sampling::AsFmu`] one more at the end.
    pub time: Vec<f64>,
    /// All outputs of the FMU, in their order; then the channels' innovations; then smoothed estimates.
    pub columns: Vec<Column>,
    /// The channels that have innovations.
    pub channels: Vec<&'static str>,
    /// What is good to know of the log and of the parameters, one line each.
    pub notes: Vec<String>,
}

/// One output over time.
#[derive(Clone, Debug)]
pub struct Column {
    /// Name, unit, kind and meaning.
    pub variable: Variable,
    /// One value per time; truth values are 0 and 1, `status` is the sum of its bits.
    pub values: Vec<f64>,
}

impl Run {
    /// The values of an output.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|column| column.variable.name == name).map(|column| column.values.as_slice())
    }

    /// As a log, to be written as CSV, Parquet or MDF4.
    pub fn into_log(self) -> Log {
        let channel = |column: Column| Channel { name: column.variable.name, values: column.values.into() };
        let channels = self.columns.into_iter().map(channel).collect();
        Log { source: self.source, time: self.time.into(), channels, ..Log::default() }
    }
}

/// Why there is no run.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The log has no row.
    #[error("{0}: there is no sample")]
    Empty(String),
    /// Times that stand still or run backwards, or a channel of another length: no file has them.
    #[error("{log}: sample {sample}: {what}")]
    Uneven {
        /// The log.
        log: String,
        /// Number of the sample, from 1.
        sample: usize,
        /// What is wrong with it.
        what: String,
    },
    /// A host refuses such a step.
    #[error(
        "{log}: no sample from {from} s to {to} s, and the FMU takes no step of more than {MOST_SAMPLES} samples; \
         --clock log bridges gaps"
    )]
    Gap {
        /// The log.
        log: String,
        /// Last sample before the gap, s.
        from: f64,
        /// First one after it, s.
        to: f64,
    },
    /// Smoothing was asked for and the estimator has nothing to be smoothed.
    #[error("{model} cannot be smoothed: {reason}")]
    NotSmooth {
        /// The estimator.
        model: &'static str,
        /// Why not.
        reason: &'static str,
    },
    /// A state that the estimator had does not fit it.
    #[error("the run cannot be repeated: {0}")]
    State(String),
    /// A parameter was refused.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The user asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Samples that one step of the FMU may take.
const MOST_SAMPLES: f64 = 1e5;

/// Rows between two looks at the progress bar.
const STRIDE: usize = 4096;

/// Runs a fresh estimator over a log.
pub fn run<E: Estimator>(log: &Log, settings: &Settings, progress: &Progress) -> Result<Run, RunError> {
    check(log)?;
    let sampling = if settings.smooth { Sampling::EveryRow } else { settings.sampling };
    let (parameters, notes) = parameters_for::<E>(log, settings, sampling)?;
    let mut estimator = E::new(&parameters)?;
    smooth::check(&estimator, settings)?;
    let period = estimator.sample_period();
    if sampling == Sampling::AsFmu
        && let Some(pair) = log.time.windows(2).find(|pair| pair[1] - pair[0] > MOST_SAMPLES * period)
    {
        return Err(RunError::Gap { log: log.source.clone(), from: pair[0], to: pair[1] });
    }
    let rows = log.len() + usize::from(sampling == Sampling::AsFmu);
    let mut recorder = Recorder::<E>::new(rows, settings.smooth);
    let source = Source::of::<E>(log);
    let mut flat = vec![0.0; E::Inputs::COUNT];
    let last = if log.len() > 1 { log.period() } else { period };
    progress.start(format!("running {}", E::NAME), rows as u64);
    let expectations = RefCell::new(Expectations::default());
    replay(
        &mut estimator,
        (sampling, last),
        &log.time,
        |k, inputs| {
            source.row(k, &mut flat);
            inputs.read(&flat);
        },
        |estimator, inputs, dt| expectations.borrow_mut().expect(estimator, inputs, dt, &mut recorder.kept),
        |row, now, outputs| {
            recorder.columns.record(now, outputs, &mut expectations.borrow_mut());
            if row % STRIDE == STRIDE - 1 {
                progress.advance(STRIDE as u64);
                progress.check()?;
            }
            Ok::<(), Interrupted>(())
        },
    )?;
    progress.finish();
    let Recorder { columns: Columns { time, outputs, channels, .. }, kept } = recorder;
    let mut columns = outputs;
    if settings.smooth {
        let smoother = smooth::Smoother::<E> { log, parameters: &parameters, kept: kept.states, filtered: &columns };
        let smoothed = smoother.run(progress)?;
        columns.extend(smoothed);
    }
    let names = channels.iter().map(|channel| channel.name).collect();
    let outputs = E::Outputs::COUNT;
    columns.splice(outputs..outputs, channels.into_iter().flat_map(ChannelTrace::columns));
    let source = log.source.clone();
    Ok(Run { model: E::NAME, source, sample_period: period, sampling, time, columns, channels: names, notes })
}

/// What a run has recorded.
struct Recorder<E: Estimator> {
    columns: Columns,
    kept: Kept<E>,
}

/// Outputs and channels over time.
struct Columns {
    time: Vec<f64>,
    outputs: Vec<Column>,
    channels: Vec<ChannelTrace>,
    flat: Vec<f64>,
}

/// States before every [`smooth::CHUNK`]th sample.
struct Kept<E: Estimator> {
    states: Vec<E::State>,
    wanted: bool,
    samples: usize,
}

/// One channel over time.
struct ChannelTrace {
    name: &'static str,
    unit: &'static str,
    measured: Vec<f64>,
    innovation: Vec<f64>,
    std: Vec<f64>,
}

/// What is expected of the present sample.
#[derive(Default)]
struct Expectations {
    prediction: OneStepPrediction,
    fresh: bool,
}

impl Expectations {
    fn expect<E: Estimator>(&mut self, estimator: &E, inputs: &E::Inputs, dt: f64, kept: &mut Kept<E>) {
        if kept.wanted && kept.samples.is_multiple_of(smooth::CHUNK) {
            kept.states.push(estimator.state().clone());
        }
        kept.samples += 1;
        estimator.predict_one_step(inputs, dt, &mut self.prediction);
        self.fresh = true;
    }
}

impl<E: Estimator> Recorder<E> {
    fn new(rows: usize, keep: bool) -> Self {
        let column = |variable| Column { variable, values: Vec::with_capacity(rows) };
        let columns = Columns {
            time: Vec::with_capacity(rows),
            outputs: E::Outputs::declare().into_iter().map(column).collect(),
            channels: Vec::new(),
            flat: vec![0.0; E::Outputs::COUNT],
        };
        Self { columns, kept: Kept { states: Vec::new(), wanted: keep, samples: 0 } }
    }
}

impl Columns {
    /// One row; its channels are those of the last sample, if there was one since the row before.
    fn record(&mut self, now: f64, outputs: &impl Variables, expectations: &mut Expectations) {
        let before = self.time.len();
        self.time.push(now);
        outputs.write(&mut self.flat);
        for (column, value) in self.outputs.iter_mut().zip(&self.flat) {
            column.values.push(*value);
        }
        let expected = if expectations.fresh { expectations.prediction.expected.as_slice() } else { &[] };
        expectations.fresh = false;
        if self.channels.is_empty() && !expected.is_empty() {
            // Rows before the first sample have nothing.
            self.channels = expected.iter().map(|e| ChannelTrace::new(e.channel, e.unit, before)).collect();
        }
        for (k, channel) in self.channels.iter_mut().enumerate() {
            let (measured, predicted, std) =
                expected.get(k).map_or((f64::NAN, f64::NAN, f64::NAN), |e| (e.measured, e.predicted, e.std));
            channel.measured.push(measured);
            channel.innovation.push(measured - predicted);
            channel.std.push(std);
        }
    }
}

impl ChannelTrace {
    fn new(name: &'static str, unit: &'static str, before: usize) -> Self {
        let nothing = vec![f64::NAN; before];
        Self { name, unit, measured: nothing.clone(), innovation: nothing.clone(), std: nothing }
    }

    fn columns(self) -> [Column; 3] {
        let Self { name, unit, .. } = self;
        let column = |name: String, about: &'static str, values| {
            let any = (f64::NEG_INFINITY, f64::INFINITY);
            Column { variable: Variable::new(name, about, unit, Kind::Real, any), values }
        };
        [
            column(format!("measured_{name}"), "What was measured; NaN if there was no sample.", self.measured),
            column(
                format!("innovation_{name}"),
                "Measured minus predicted, before the sample was used.",
                self.innovation,
            ),
            column(format!("innovation_{name}_std"), "Standard deviation of the innovation.", self.std),
        ]
    }
}

/// Refuses what no log read from a file has.
fn check(log: &Log) -> Result<(), RunError> {
    let uneven = |sample: usize, what: String| RunError::Uneven { log: log.source.clone(), sample: sample + 1, what };
    if log.is_empty() {
        return Err(RunError::Empty(log.source.clone()));
    }
    if let Some(k) = log.time.iter().position(|time| !time.is_finite()) {
        return Err(uneven(k, format!("its time {} is not finite", log.time[k])));
    }
    if let Some(k) = log.time.windows(2).position(|pair| pair[1] <= pair[0]) {
        return Err(uneven(k + 1, format!("its time {} s is not after {} s", log.time[k + 1], log.time[k])));
    }
    match log.channels.iter().find(|channel| channel.values.len() != log.len()) {
        Some(channel) => {
            let (name, there, times) = (&channel.name, channel.values.len(), log.len());
            Err(uneven(there.min(times), format!("{name} has {there} values for {times} times")))
        }
        None => Ok(()),
    }
}

/// Rows may be this much further apart than samples.
const APART: f64 = 1.01;

/// The parameters that hold for a log, with what to know of them. Unless it is given, `sample_period` is the default
/// of the FMU; where the rows are further apart it is their distance, so that no row counts twice, and where every row
/// is a sample it always is.
fn parameters_for<E: Estimator>(
    log: &Log,
    settings: &Settings,
    sampling: Sampling,
) -> Result<(E::Parameters, Vec<String>), ParameterError> {
    let mut parameters = E::Parameters::default();
    let mut notes = Vec::new();
    let own = E::new(&parameters)?.sample_period();
    let given = settings.parameters.iter().any(|(name, _)| name == "sample_period");
    let rows = rounded(log.period());
    if !given && log.len() > 1 {
        if sampling == Sampling::EveryRow {
            parameters.set("sample_period", rows)?;
        } else if rows > APART * own {
            parameters.set("sample_period", rows)?;
            notes.push(format!("sample_period = {rows} s, the distance of the rows (the FMU's own is {own} s)"));
        } else if APART * rows < own {
            notes.push(format!("sample_period = {own} s, so not every row is used (they are {rows} s apart)"));
        }
    }
    for (name, value) in &settings.parameters {
        parameters.set(name, *value)?;
    }
    let lacking: Vec<_> =
        E::Inputs::declare().into_iter().map(|input| input.name).filter(|name| log.channel(name).is_none()).collect();
    if !lacking.is_empty() {
        notes.push(format!("never set, the log has no column for it: {}", lacking.join(", ")));
    }
    Ok((parameters, notes))
}

/// To nine digits: times in a file are rounded.
fn rounded(period: f64) -> f64 {
    (period * 1e9).round() / 1e9
}
