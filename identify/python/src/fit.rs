//! Looking at logs, fitting, tuning.

use crate::error::{Refused, error, log_error};
use crate::log::Log;
use crate::names::{Texts, numbers, vehicle};
use crate::work;
use pyo3::prelude::*;
use std::path::PathBuf;
use wheelstate_identify::checked;
use wheelstate_identify::finding::{Finding, Severity};
use wheelstate_identify::log::Log as Inner;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::report;
use wheelstate_identify::result::{FORMAT_VERSION, FitReport};
use wheelstate_identify::run::Parameters;
use wheelstate_identify::solve::Loss;
use wheelstate_identify::tune::{Objective, TuneError, TuneRequest};
use wheelstate_identify::values;
use wheelstate_identify::vehicle::Vehicle;

/// The result of a fit or of a tuning.
#[pyclass(frozen, module = "wheelstate._native")]
pub struct Fit {
    pub report: FitReport,
    json: String,
}

impl Fit {
    pub fn new(report: FitReport) -> PyResult<Self> {
        Ok(Self { json: report.to_json().map_err(error)?, report })
    }
}

#[pymethods]
impl Fit {
    /// From the text of a `fit.json`.
    #[staticmethod]
    fn parse(source: &str, text: &str) -> PyResult<Self> {
        let report: FitReport =
            serde_json::from_str(text).map_err(|e| error(format!("{source}: not readable as fit.json: {e}")))?;
        if report.format_version != FORMAT_VERSION {
            return Err(error(format!(
                "{source}: format_version {} is not known to this program",
                report.format_version
            )));
        }
        Ok(Self { report, json: text.to_owned() })
    }

    fn json(&self) -> &str {
        &self.json
    }

    fn table(&self) -> String {
        report::table(&self.report)
    }

    fn html(&self, py: Python) -> PyResult<String> {
        py.detach(|| report::html(&self.report)).map_err(error)
    }

    fn ssv(&self) -> String {
        report::ssv(&self.report)
    }

    fn residuals(&self) -> String {
        report::residuals(&self.report)
    }

    #[getter]
    fn has_warnings(&self) -> bool {
        self.report.has_warnings()
    }
}

/// Known values: a file, or the text of a `fit.json` or of `{name: value}`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Start {
    file: Option<PathBuf>,
    text: Option<String>,
}

impl Start {
    fn values(&self, vehicle: &Vehicle) -> PyResult<Vec<(String, f64)>> {
        match self.source()? {
            Some((source, text)) => values::start(vehicle, &source, &text).map_err(error),
            None => Ok(Vec::new()),
        }
    }

    /// Where the values come from, for messages, and their text.
    fn source(&self) -> PyResult<Option<(String, String)>> {
        let Some(path) = &self.file else {
            return Ok(self.text.clone().map(|text| ("parameters".to_owned(), text)));
        };
        let source = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|e| error(format!("{source}: {e}")))?;
        Ok(Some((source, text)))
    }

    /// What is known before an experiment: a whole fit, or start values.
    pub fn known(&self, vehicle: &Vehicle) -> PyResult<values::Before> {
        match self.source()? {
            Some((source, text)) => values::known(vehicle, &source, &text).map_err(error),
            None => Ok((None, Vec::new())),
        }
    }
}

impl Start {
    /// As [`values`](Self::values), for an estimator: with the known values that a fit relied on, and what was left out.
    pub fn parameters(&self, vehicle: &Vehicle) -> PyResult<Parameters> {
        let (name, declared) = (vehicle.name, vehicle.parameters());
        let parameters = match (&self.file, &self.text) {
            (Some(path), _) => Parameters::read(path, name, &declared),
            (None, Some(text)) => Parameters::parse("parameters", text, name, &declared),
            (None, None) => Ok(Parameters::default()),
        };
        parameters.map_err(error)
    }
}

/// Findings as JSON.
fn json(findings: &[Finding]) -> PyResult<String> {
    serde_json::to_string(findings).map_err(error)
}

pub fn inner(logs: &[Log]) -> Vec<Inner> {
    logs.iter().map(|log| (*log.inner).clone()).collect()
}

/// What is wrong with logs, as JSON.
#[pyfunction]
#[pyo3(signature = (name, logs, settings, start, allow, parameters, tell))]
#[allow(clippy::too_many_arguments, reason = "the options of a program, by name in Python")]
pub fn check(
    py: Python,
    name: &str,
    logs: Vec<Log>,
    settings: Texts,
    start: Start,
    allow: Vec<String>,
    parameters: Option<bool>,
    tell: Option<&Bound<PyAny>>,
) -> PyResult<String> {
    let vehicle = vehicle(name)?;
    let known: Vec<_> = start.values(vehicle)?.into_iter().chain(numbers(vehicle, &settings)?).collect();
    let found = work::run(py, tell, |progress| {
        let mut all = Vec::new();
        for log in &logs {
            let log = &*log.inner;
            let found =
                checked::findings(vehicle, std::slice::from_ref(log), &known, &allow).map_err(|e| e.to_string())?;
            let usable = checked::worst(&found) < Severity::Refusal;
            all.extend(found);
            if usable && parameters.unwrap_or(log.len() <= vehicle.checks.quick) {
                all.extend(checked::expected(vehicle, log, &known, progress).map_err(|e| e.to_string())?);
            }
        }
        checked::allow(&mut all, &allow);
        Ok::<_, String>(all)
    })?;
    json(&found.map_err(error)?)
}

/// What a fit is asked for; the names are those of Python's `fit`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct FitOptions {
    settings: Texts,
    of_log: Vec<(usize, Texts)>,
    known: Vec<(String, f64, f64)>,
    bounds: Vec<(String, f64, f64)>,
    sensors: Texts,
    only: Vec<String>,
    profile: Vec<String>,
    per_log: Vec<String>,
    varies: Vec<(String, Option<String>)>,
    allow: Vec<String>,
    loss: String,
    exact: bool,
    refine: bool,
    correct: bool,
    skip_bad: bool,
    residuals: bool,
}

/// Fits; gives the result and the warnings about the logs.
#[pyfunction]
#[pyo3(signature = (name, logs, held_out, start, options, tell))]
pub fn fit(
    py: Python,
    name: &str,
    logs: Vec<Log>,
    held_out: Vec<Log>,
    start: Start,
    options: FitOptions,
    tell: Option<&Bound<PyAny>>,
) -> PyResult<Fit> {
    let vehicle = vehicle(name)?;
    let losses = [Loss::Ls, Loss::Huber, Loss::L1];
    let loss = losses.into_iter().find(|loss| loss.word() == options.loss);
    let loss = loss.ok_or_else(|| error(format!("loss: '{}' is none of ls, huber, l1", options.loss)))?;
    let mut of_log = Vec::new();
    for (index, settings) in &options.of_log {
        of_log.extend(numbers(vehicle, settings)?.into_iter().map(|(name, value)| (*index, name, value)));
    }
    let request = FitRequest {
        start: start.values(vehicle)?,
        settings: numbers(vehicle, &options.settings)?,
        known: options.known,
        bounds: options.bounds,
        per_log: options.per_log,
        varies: options.varies,
        of_log,
        sensors: numbers(vehicle, &options.sensors)?,
        exact: options.exact,
        skip_bad: options.skip_bad,
        held_out: inner(&held_out),
        residuals: options.residuals,
        only: options.only,
        profile: options.profile,
        loss,
        refine: options.refine,
        correct: options.correct,
    };
    let logs = inner(&logs);
    let allow = options.allow;
    let result = work::run(py, tell, |progress| checked::fit(vehicle, logs, request, &allow, |_| {}, progress))?;
    match result {
        Ok(report) => Fit::new(report),
        Err(checked::Refused::Logs(report)) => {
            let refused = Refused::new_err(report.refused.clone().unwrap_or_default());
            refused.value(py).setattr("fit", Py::new(py, Fit::new(*report)?)?)?;
            Err(refused)
        }
        Err(other) => Err(error(other)),
    }
}

/// What a tuning is asked for; the names are those of Python's `tune`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TuneOptions {
    settings: Texts,
    floor: Texts,
    floors: Option<bool>,
    only: Vec<String>,
    objective: String,
    seed: u64,
    population: usize,
    iterations: usize,
    skip: f64,
    threads: usize,
}

/// Tunes noise settings.
#[pyfunction]
#[pyo3(signature = (name, logs, held_out, start, options, tell))]
pub fn tune(
    py: Python,
    name: &str,
    logs: Vec<Log>,
    held_out: Vec<Log>,
    start: Start,
    options: TuneOptions,
    tell: Option<&Bound<PyAny>>,
) -> PyResult<Fit> {
    let vehicle = vehicle(name)?;
    let objective = [Objective::Nll, Objective::Rmse].into_iter().find(|one| one.word() == options.objective);
    let objective =
        objective.ok_or_else(|| error(format!("objective: '{}' is none of nll, rmse", options.objective)))?;
    let request = TuneRequest {
        objective,
        seed: options.seed,
        population: options.population,
        iterations: options.iterations,
        threads: options.threads,
        settings: start.values(vehicle)?.into_iter().chain(numbers(vehicle, &options.settings)?).collect(),
        only: options.only,
        floors: options.floors,
        floor: numbers(vehicle, &options.floor)?,
        skip: options.skip,
    };
    let (logs, held_out) = (inner(&logs), inner(&held_out));
    match work::run(py, tell, |progress| vehicle.tune(&logs, &held_out, &request, progress))? {
        Ok(report) => Ok(Fit { json: report.to_json().map_err(error)?, report: report.fit }),
        Err(TuneError::Log(log)) => Err(log_error(log)),
        Err(other) => Err(error(other)),
    }
}
