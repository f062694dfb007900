//! How logs become regressions and regressions become parameters; what all vehicles share.
//!
//! # The seam
//!
//! A [`Problem`] is two functions and two lists. `estimate` reads a [`Task`] (logs, known parameters,
//! which parameters are wanted) and works with a [`Session`]:
//!
//! ```
//! use wheelstate::Variables;
//! use wheelstate::estimator::wheelchair::Parameters;
//! use wheelstate_identify::log::{Channel, Log};
//! use wheelstate_identify::problem::{FitError, FitRequest, Problem, Session, Target, Task, fit};
//! use wheelstate_identify::progress::Progress;
//! use wheelstate_identify::solve::{Affine, Constraint, Regression, Rows, Unknown};
//!
//! fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
//!     let mut rows = Rows::new("force", "N", 2);
//!     for log in task.logs {
//!         let (force, speed, acceleration) = (log.require("force")?, log.require("speed")?, log.require("acceleration")?);
//!         for k in 0..log.len() {
//!             // rows with NaN drop out; four neighbours count as one in the covariance
//!             rows.push(&[acceleration[k], speed[k]], force[k], k as u32 / 4);
//!         }
//!     }
//!     let regression = Regression {
//!         name: "force balance".into(),
//!         unknowns: vec![Unknown::within("M", 0.0, 500.0), Unknown::within("D", 0.0, 100.0)],
//!         groups: vec![rows],
//!         constraints: vec![Constraint::NonNegative(Affine::new(&[(0, 1.0), (1, -1.0)], 0.0))],
//!     };
//!     // solves with the user's loss; too few rows: the parameters are reported as not identifiable
//!     if let Some(fit) = session.solve(&regression, &["chair.mass", "chair.drag"])? {
//!         session.estimate("chair.mass", fit, |theta| theta[0]); // any smooth function of the unknowns:
//!         session.estimate("chair.drag", fit, |theta| theta[1]); // interval by the delta method
//!     }
//!     Ok(())
//! }
//!
//! let problem = Problem {
//!     targets: |_| ["chair.mass", "chair.drag"].map(|name| Target::declared(&Parameters::declare(), name, true)).into(),
//!     estimate,
//!     validate: |_| Vec::new(),
//! };
//! // 90 kg and 15 N s/m, with 1 N of noise
//! let time: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
//! let channel = |name: &str, f: &dyn Fn(f64) -> f64| Channel { name: name.into(), values: time.iter().map(|t| f(*t)).collect() };
//! let log = Log {
//!     channels: vec![
//!         channel("speed", &|t| t.sin()),
//!         channel("acceleration", &|t| t.cos()),
//!         channel("force", &|t| 90.0 * t.cos() + 15.0 * t.sin() + (1e4 * t).sin()),
//!     ],
//!     time: time.clone(),
//!     ..Log::default()
//! };
//! let report = fit(&problem, "chair", Parameters::declare(), &[log], &FitRequest::default(), &Progress::none())?;
//! let mass = &report.parameters["chair.mass"];
//! assert!(mass.identified && (mass.value - 90.0).abs() < 0.5);
//! # Ok::<(), FitError>(())
//! ```
//!
//! Stages that build on each other (radius, then friction, then centre of gravity) are simply written
//! one after the other; `session.value("...")` and `session.solution(fit)` give what came before.
//! [`Session::refine`] takes smooth residuals (a simulation, a tyre curve) through sequential convex
//! refinement; groups with instruments ([`Rows::push_instrumented`](crate::solve::Rows)) are solved
//! by instrumental variables.
//!
//! `validate` predicts measured signals with given parameters. [`fit`] calls `estimate` on the whole
//! logs for the result, and again on the first 60 % of each log to `validate` on the rest.

pub mod known;
pub mod noise;
mod request;
pub mod session;
pub mod weak_form;

pub use crate::assess::validation::Prediction;
pub use known::Known;
pub use request::FitRequest;
pub use session::{Fitted, Judgement, Session};

use crate::assess::validation::signal_fit;
use crate::log::{Log, LogError};
use crate::progress::{Interrupted, Progress};
use crate::result::{FORMAT_VERSION, FitReport, LogEntry, SignalFit, Trace, Validation};
use crate::solve::SolveError;
use wheelstate::{ParameterError, Variable};

/// Share of each log that the validation's fit may see.
pub const TRAINING_SHARE: f64 = 0.6;

/// How the parameters of one vehicle are identified.
#[derive(Clone, Copy)]
pub struct Problem {
    /// Parameters that can be fitted from these logs.
    pub targets: fn(&[Log]) -> Vec<Target>,
    /// Estimates what the task wants.
    pub estimate: fn(&Task, &mut Session) -> Result<(), FitError>,
    /// Predicts measured signals of the task's logs with the task's known parameters, estimates included.
    pub validate: fn(&Task) -> Vec<Prediction>,
}

/// A parameter that can be fitted.
#[derive(Clone, Debug)]
pub struct Target {
    /// FMU name.
    pub name: String,
    /// Unit in the FMI spelling.
    pub unit: String,
    /// Physical range: an estimate at its end is reported as at its bound.
    pub range: (f64, f64),
    /// Fitted unless the user asks for others.
    pub usual: bool,
}

impl Target {
    /// A target that is one of the declared variables; `range` narrows what the declaration allows.
    pub fn declared(declared: &[Variable], name: &str, usual: bool) -> Self {
        let variable = declared.iter().find(|variable| variable.name == name);
        let (unit, range) = variable.map_or(("1", (f64::NEG_INFINITY, f64::INFINITY)), |v| (v.unit, v.range));
        Self { name: name.to_owned(), unit: unit.to_owned(), range, usual }
    }

    /// The same within a narrower range.
    pub fn within(mut self, low: f64, high: f64) -> Self {
        self.range = (low, high);
        self
    }
}

/// What `estimate` and `validate` work on.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    /// The logs.
    pub logs: &'a [Log],
    /// The known parameters.
    pub known: &'a Known,
    /// Names of the wanted parameters.
    pub wanted: &'a [String],
    /// Whether the user named them.
    pub only: bool,
    /// Whether to refine by output error.
    pub refine: bool,
    /// Where to report progress: by [`Progress::reach`] and [`Progress::part`], in shares of this task.
    pub progress: &'a Progress,
}

impl Task<'_> {
    /// Whether this parameter is wanted.
    pub fn wants(&self, name: &str) -> bool {
        self.wanted.iter().any(|wanted| wanted == name)
    }

    /// Which of these parameters are wanted.
    pub fn wanted_of<'n>(&self, names: &[&'n str]) -> Vec<&'n str> {
        names.iter().copied().filter(|name| self.wants(name)).collect()
    }
}

/// Why there is no fit.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// No log at all.
    #[error("no log was given")]
    NoLog,
    /// A parameter that cannot be fitted was asked for.
    #[error("--only {asked}: cannot be fitted; there are {known}")]
    UnknownTarget {
        /// What was asked for.
        asked: String,
        /// What there is.
        known: String,
    },
    /// A log cannot be used, or lacks a channel that the fit cannot do without.
    #[error(transparent)]
    Log(#[from] LogError),
    /// What was asked for makes no sense together.
    #[error("{0}")]
    Request(String),
    /// A setting was refused.
    #[error(transparent)]
    Setting(#[from] ParameterError),
    /// The solver failed.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The user asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Fits a vehicle's parameters to logs and judges the result.
///
/// The parameters come from the whole logs. For the validation the same fit is made on the first 60 %
/// of each log and its predictions are compared with the other 40 %. A parameter that the logs do not
/// determine is part of the report with its reason among the warnings; errors are for logs,
/// settings and solver states that allow no report at all.
///
/// `vehicle` is the name that the report gets, `parameters` the declaration of what may be given as known.
pub fn fit(
    problem: &Problem,
    vehicle: &str,
    parameters: Vec<Variable>,
    logs: &[Log],
    request: &FitRequest,
    progress: &Progress,
) -> Result<FitReport, FitError> {
    if logs.is_empty() {
        return Err(FitError::NoLog);
    }
    let mut known = Known::new(parameters);
    for (name, value) in request.start.iter().chain(&request.settings) {
        known.set(name, *value)?;
    }
    let targets = (problem.targets)(logs);
    let wanted = wanted(&targets, &request.only)?;
    let task =
        Task { logs, known: &known, wanted: &wanted, only: !request.only.is_empty(), refine: request.refine, progress };
    progress.start_shares("fitting");
    let mut session = Session::new(request, &targets);
    (problem.estimate)(&Task { progress: &progress.part(0.0..0.5), ..task }, &mut session)?;
    session.complete(&wanted);
    for (name, _) in request.settings.iter().filter(|(name, _)| wanted.contains(name)) {
        session.note(format!("{name} was fitted although it was given; --only leaves parameters out"));
    }

    progress.describe("validating");
    let (training, held_out): (Vec<Log>, Vec<Log>) = logs.iter().map(split).unzip();
    let task = Task { progress: &progress.part(0.5..1.0), ..task };
    let validation = validate(problem, &task, &targets, request, &training, &held_out)?;
    progress.reach(1.0);

    let report = session.report(&known);
    Ok(FitReport {
        format_version: FORMAT_VERSION,
        vehicle: vehicle.to_owned(),
        loss: request.loss.word().to_owned(),
        logs: logs.iter().map(LogEntry::from).collect(),
        settings: request.start.iter().chain(&request.settings).cloned().collect(),
        validation: validation.0,
        traces: validation.1,
        ..report
    })
}

fn wanted(targets: &[Target], only: &[String]) -> Result<Vec<String>, FitError> {
    if only.is_empty() {
        return Ok(targets.iter().filter(|target| target.usual).map(|target| target.name.clone()).collect());
    }
    if let Some(asked) = only.iter().find(|asked| targets.iter().all(|target| target.name != **asked)) {
        let known = targets.iter().map(|target| target.name.as_str()).collect::<Vec<_>>().join(", ");
        return Err(FitError::UnknownTarget { asked: asked.clone(), known });
    }
    Ok(only.to_vec())
}

/// The part of a log that the validation's fit sees and the rest, both without the references
/// (`true_*`) that no fit looks at: they may be most of a simulated log.
fn split(log: &Log) -> (Log, Log) {
    let at = (log.len() as f64 * TRAINING_SHARE).round() as usize;
    let part = |samples: std::ops::Range<usize>| log.slice(samples, |name| !name.starts_with("true_"));
    (part(0..at), part(at..log.len()))
}

/// Fits the first part and predicts the second.
fn validate(
    problem: &Problem,
    task: &Task,
    targets: &[Target],
    request: &FitRequest,
    training: &[Log],
    held_out: &[Log],
) -> Result<(Validation, Vec<Trace>), FitError> {
    let mut session = Session::new(request, targets);
    let part = |from: f64, to: f64| task.progress.part(from..to);
    match (problem.estimate)(&Task { logs: training, progress: &part(0.0, 0.6), ..*task }, &mut session) {
        Ok(()) => {}
        Err(FitError::Interrupted(stop)) => return Err(stop.into()),
        // The first part alone may not suffice: then there is nothing to validate with.
        Err(_) => return Ok((Validation::default(), Vec::new())),
    }
    let mut known = task.known.clone();
    for (name, value) in session.values() {
        known.assume(name, value);
    }
    let ahead = (problem.validate)(&Task { logs: held_out, known: &known, progress: &part(0.6, 0.8), ..*task });
    let behind = (problem.validate)(&Task { logs: training, known: &known, progress: &part(0.8, 1.0), ..*task });
    let mut signals: Vec<SignalFit> = ahead.iter().map(signal_fit).collect();
    for signal in &mut signals {
        let same = behind.iter().find(|prediction| prediction.trace.name == signal.name);
        signal.fit_percent_training = same.map_or(f64::NAN, |prediction| signal_fit(prediction).fit_percent);
    }
    let traces = ahead.into_iter().map(|prediction| prediction.trace).collect();
    Ok((Validation { held_out: 1.0 - TRAINING_SHARE, signals }, traces))
}
