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
//! use wheelstate_identify::problem::{Declared, FitError, FitRequest, Problem, Session, Target, Task, fit};
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
//!     outliers: &[],
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
//!     time: time.clone().into(),
//!     ..Log::default()
//! };
//! let declared = Declared { parameters: Parameters::declare(), inputs: vec![] };
//! let report = fit(&problem, "chair", &declared, &[log], &FitRequest::default(), &Progress::none())?;
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
//! `validate` predicts measured signals with given parameters. [`fit()`] calls `estimate` on the whole
//! logs for the result, again on the first 60 % of each log to `validate` on the rest, again on each of several
//! logs to compare them, and, on fewer windows, with every cause of error that no log shows one step off.

pub mod angles;
pub mod blocks;
mod considered;
mod findings;
mod fit;
mod imposed;
pub mod known;
mod log_set;
pub mod noise;
pub mod outliers;
mod profiled;
mod request;
pub mod session;
mod several;
mod validate;
mod varying;
pub mod weak_form;

pub use crate::assess::validation::Prediction;
pub use considered::{Quality, device, known_std, quality};
pub use findings::Offset;
#[cfg(test)]
pub(crate) use fit::fit_from;
pub use fit::{Declared, fit};
pub use known::Known;
pub use request::FitRequest;
pub use session::{Fitted, Judgement, Session};

use crate::log::{Log, LogError};
use crate::progress::{Interrupted, Progress};
use crate::solve::SolveError;
use wheelstate::{ParameterError, Variable};

/// Share of each log that the validation's fit may see.
pub const TRAINING_SHARE: f64 = 0.6;

/// How the parameters of one vehicle are identified.
#[derive(Clone, Copy)]
pub struct Problem {
    /// Parameters that can be fitted from these logs.
    pub targets: fn(&[Log]) -> Vec<Target>,
    /// Channels whose outliers are replaced before anything else, see [`outliers`]; a `*` stands for any text.
    pub outliers: &'static [&'static str],
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
    /// Only special manoeuvres or sensors show it: that it is not found is no warning unless it was asked for.
    pub optional: bool,
    /// A given value is a prior that the machine's own fit keeps unless the logs contradict it, and then says so.
    pub contested: bool,
}

impl Target {
    /// A target that is one of the declared variables; `range` narrows what the declaration allows.
    pub fn declared(declared: &[Variable], name: &str, usual: bool) -> Self {
        let variable = declared.iter().find(|variable| variable.name == name);
        let (unit, range) = variable.map_or(("1", (f64::NEG_INFINITY, f64::INFINITY)), |v| (v.unit, v.range));
        Self { name: name.to_owned(), unit: unit.to_owned(), range, usual, optional: false, contested: false }
    }

    /// The same, but only special manoeuvres or sensors show it.
    pub fn optional(mut self) -> Self {
        self.optional = true;
        self
    }

    /// The same, and a given value is a prior that the machine's own fit weighs.
    pub fn contested(mut self) -> Self {
        self.contested = true;
        self
    }

    /// The same within a narrower range; what the declaration excludes stays excluded.
    pub fn within(mut self, low: f64, high: f64) -> Self {
        self.range = (low.max(self.range.0), high.min(self.range.1));
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
    /// Whether sensors and known values are exact but for noise.
    pub exact: bool,
    /// Standard deviations that the user gave for sensors, as `CHANNEL.delay_std`.
    pub sensors: &'a [(String, f64)],
    /// The channels of the machine's logs.
    pub inputs: &'a [Variable],
    /// Only what considered causes change is looked for: fewer windows that overlap will do.
    pub coarse: bool,
    /// Samples from which a log is to be taken in [`blocks`], where a machine can.
    pub long: usize,
    /// Whether predictions of long logs may be told by a part of their values, see [`Prediction`].
    pub brief: bool,
    /// Where to report progress: by [`Progress::reach`] and [`Progress::part`], in shares of this task.
    pub progress: &'a Progress,
}

impl Task<'_> {
    /// Standard deviations of a channel's gain, bias and delay: what the user said, or those of a good sensor; zeros if it
    /// is exact. For what a fit estimates along.
    pub fn quality(&self, channel: &str) -> Quality {
        let unit = self.inputs.iter().find(|input| input.name == channel).map_or("", |input| input.unit);
        considered::quality_of(self.sensors, self.exact, channel, unit)
    }

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
