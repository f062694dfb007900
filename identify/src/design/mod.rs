//! What to drive next: the manoeuvres of the built-in plants compared by what a fit with them would know.
//!
//! Nothing here knows how well a manoeuvre shows a parameter. Machines are drawn that the fit of the present logs allows
//! (`suppose`); each drives each manoeuvre on the built-in plant, with the noise of its sensors; the present logs and the new
//! one are fitted together, as they will be, and the standard error of that fit is what is promised. As it depends on
//! the machine, which is not known yet, and on the noise, the promise is a range with a probability (`promise`).
//! This is the expected posterior variance of Bayesian experimental design (Chaloner and Verdinelli, Statistical Science
//! 10(3), 1995, 273-304) by simulation, with the fit's own standard error as the posterior's.
//!
//! Settings within the user's limits are searched on a grid and by golden sections for the fitted machine; the promise is
//! made with other machines and seeds, so that the luck of the seed that a candidate was chosen by is not in it. Settings
//! stay those of the scenario unless the user gives limits: no plan is harsher than the user allows.

mod promise;
mod search;
mod study;
mod suppose;
mod words;

pub use promise::Promise;
pub use words::table;

use crate::checked::{self, Refused};
use crate::finding::Finding;
use crate::log::{Log, LogError};
use crate::problem::FitError;
use crate::progress::{Interrupted, Progress};
use crate::result::FitReport;
use crate::simulate::SimulateError;
use crate::vehicle::Vehicle;
use rayon::prelude::*;
use search::Point;
use serde::Serialize;
use std::collections::BTreeMap;
use study::Study;

/// A candidate helps if a standard error is expected to be smaller than this share of the present one.
const HELPS: f64 = 0.95;
/// How often the best manoeuvre is driven, besides once.
const REPEATS: [usize; 2] = [2, 4];
/// Machines that are drawn unless the user says how many, and the fewest that make a range.
const DRAWS: usize = 19;
const LEAST_DRAWS: usize = 5;

/// What is asked for.
#[derive(Clone, Debug)]
pub struct DesignRequest {
    /// A fit of the machine, whose known values are taken over; without logs it says what is known now.
    pub fit: Option<FitReport>,
    /// Start values, by FMU name.
    pub start: Vec<(String, f64)>,
    /// Known values by FMU name, and `plant.*` and `noise.*` of the simulation.
    pub settings: Vec<(String, f64)>,
    /// Values with a standard deviation, as of a fit (`--prior`).
    pub known: Vec<(String, f64, f64)>,
    /// Parameters of interest; empty takes those that are not identified, or else the one with the widest interval
    /// relative to its value.
    pub parameters: Vec<String>,
    /// Settings of the manoeuvre that are searched, with their ranges.
    pub limits: Vec<(String, f64, f64)>,
    /// Scenarios that come into question; empty for all.
    pub scenarios: Vec<String>,
    /// Standard deviations of sensors, as of a fit.
    pub sensors: Vec<(String, f64)>,
    /// Sensors and known values are exact but for noise, as of a fit.
    pub exact: bool,
    /// Codes of findings about the present logs that the user knows of.
    pub allow: Vec<String>,
    /// How many machines are drawn.
    pub draws: usize,
    /// Seed of every random draw.
    pub seed: u64,
}

impl Default for DesignRequest {
    fn default() -> Self {
        Self {
            fit: None,
            start: Vec::new(),
            settings: Vec::new(),
            known: Vec::new(),
            parameters: Vec::new(),
            limits: Vec::new(),
            scenarios: Vec::new(),
            sensors: Vec::new(),
            exact: false,
            allow: Vec::new(),
            draws: DRAWS,
            seed: 0,
        }
    }
}

/// Why there is no plan.
#[derive(Debug, thiserror::Error)]
pub enum DesignError {
    /// What was asked for cannot be done.
    #[error("{0}")]
    Request(String),
    /// A setting was refused.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// The fit refused what was asked for.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The present logs cannot be fitted.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// A log could not be used.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The user asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// The comparison, the best candidate first.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// The machine.
    pub vehicle: String,
    /// The parameters of interest as they are known now.
    pub parameters: Vec<Interest>,
    /// The candidates, each driven once.
    pub candidates: Vec<Candidate>,
    /// The best candidate driven more often: the shares of noise and of errors that driving does not make smaller.
    pub repeats: Vec<Repeat>,
    /// Whether the best candidate makes a standard error of interest smaller.
    pub helps: bool,
    /// How many machines the promises are made from.
    pub draws: usize,
    /// Probability that a standard error lies in its range, if the real machine is one of those that were drawn.
    pub probability: f64,
    /// What the promises rest on and where driving stops helping, in words.
    pub notes: Vec<String>,
    /// Commanded inputs of the best candidate, without noise.
    #[serde(skip)]
    pub inputs: Option<Log>,
}

/// A parameter of interest.
#[derive(Clone, Debug, Serialize)]
pub struct Interest {
    /// FMU name.
    pub name: String,
    /// Unit in the FMI spelling.
    pub unit: String,
    /// Its estimate now; `None` if the logs do not tell it.
    pub value: Option<f64>,
    /// The standard error of that.
    pub std_error: Option<f64>,
    /// Whether the present logs identify it.
    pub identified: bool,
    /// Range that the machines were drawn from where the logs do not tell it.
    pub supposed: Option<(f64, f64)>,
}

/// A manoeuvre with settings.
#[derive(Clone, Debug, Serialize)]
pub struct Candidate {
    /// The scenario.
    pub scenario: String,
    /// Its settings within the limits.
    pub settings: BTreeMap<String, f64>,
    /// How long it takes, s.
    pub duration: f64,
    /// For each parameter of interest the standard error of a fit of the present logs and this one; `None` if they do not
    /// tell it.
    pub promises: Vec<Option<Promise>>,
}

/// The best manoeuvre driven several times.
#[derive(Clone, Debug, Serialize)]
pub struct Repeat {
    /// How often.
    pub times: usize,
    /// How long that takes, s.
    pub duration: f64,
    /// As of a [`Candidate`].
    pub promises: Vec<Option<Promise>>,
}

/// Compares the manoeuvres of a machine for the fit of the present logs, if there are any. `warn` gets the findings about
/// the logs that are warnings.
///
/// ```
/// use wheelstate_identify::design::{DesignRequest, design};
/// use wheelstate_identify::progress::Progress;
/// use wheelstate_identify::simulate::Request;
/// use wheelstate_identify::vehicles;
///
/// let chair = vehicles::ALL.iter().find(|vehicle| vehicle.name == "wheelchair").expect("it is one of them");
/// let log = chair.simulate(&Request { scenario: "climb".into(), seed: 1, ..Request::default() })?;
/// let request = DesignRequest { parameters: vec!["chair.yaw_inertia".into()], ..DesignRequest::default() };
/// let plan = design(chair, vec![log], &request, |_| {}, &Progress::none())?;
/// assert_eq!(plan.candidates[0].scenario, "identification"); // the only one that turns much
/// let promise = plan.candidates[0].promises[0].as_ref().expect("it tells the yaw inertia");
/// assert!(promise.low < promise.std_error && promise.std_error < promise.high);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn design(
    vehicle: &Vehicle,
    logs: Vec<Log>,
    request: &DesignRequest,
    warn: impl FnMut(&Finding),
    progress: &Progress,
) -> Result<Plan, DesignError> {
    if request.draws < LEAST_DRAWS {
        return Err(DesignError::Request(format!("--draws {}: at least {LEAST_DRAWS} make a range", request.draws)));
    }
    let asked = study::Asked::new(vehicle, request)?;
    let present = if logs.is_empty() {
        None
    } else {
        Some(checked::fit(vehicle, logs.clone(), asked.fit.clone(), &request.allow, warn, progress)?)
    };
    let study = Study::new(vehicle, request, asked, logs, present)?;
    let scenarios = study.scenarios()?;
    let searched = scenarios.len() * usize::from(!request.limits.is_empty());
    let fits = searched + scenarios.len() * request.draws + REPEATS.len() * request.draws;
    progress.start("comparing manoeuvres", fits as u64);
    let found: Vec<Option<Point>> = scenarios
        .par_iter()
        .map(|scenario| study.best_settings(scenario, progress))
        .collect::<Result<_, Interrupted>>()?;
    let found: Vec<(&str, Point)> =
        scenarios.iter().zip(found).filter_map(|(scenario, point)| Some((*scenario, point?))).collect();
    let candidates: Vec<Option<Candidate>> = found
        .par_iter()
        .map(|(scenario, point)| study.candidate(scenario, study.settings_of(scenario, &point.values), progress))
        .collect::<Result<_, Interrupted>>()?;
    let mut candidates: Vec<Candidate> = candidates.into_iter().flatten().collect();
    candidates.sort_by(|a, b| study.score(&a.promises).total_cmp(&study.score(&b.promises)));
    let mut repeats = Vec::new();
    if let Some(best) = candidates.first() {
        for times in REPEATS {
            repeats.push(study.repeat(best, times, progress)?);
        }
    }
    let inputs = candidates.first().map(|best| study.inputs(best)).transpose()?;
    Ok(study.plan(candidates, repeats, inputs))
}
