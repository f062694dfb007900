//! What to drive next.

use crate::error::{Refused, error};
use crate::fit::{Fit, Start, inner};
use crate::log::Log;
use crate::names::{Texts, numbers, vehicle};
use crate::work;
use pyo3::prelude::*;
use wheelstate_identify::checked;
use wheelstate_identify::design::{DesignError, DesignRequest, design as compare, table};

/// What a design is asked for; the names are those of Python's `design`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct DesignOptions {
    settings: Texts,
    known: Vec<(String, f64, f64)>,
    parameters: Vec<String>,
    limits: Vec<(String, f64, f64)>,
    scenarios: Vec<String>,
    sensors: Texts,
    exact: bool,
    allow: Vec<String>,
    draws: Option<usize>,
    seed: u64,
}

/// Compares manoeuvres: the plan as JSON and as a table, and the commanded inputs of the best one.
#[pyfunction]
#[pyo3(signature = (name, logs, start, options, tell))]
pub fn design(
    py: Python,
    name: &str,
    logs: Vec<Log>,
    start: Start,
    options: DesignOptions,
    tell: Option<&Bound<PyAny>>,
) -> PyResult<(String, String, Option<Log>)> {
    let vehicle = vehicle(name)?;
    let (fit, start) = start.known(vehicle)?;
    let request = DesignRequest {
        fit,
        start,
        settings: numbers(vehicle, &options.settings)?,
        known: options.known,
        parameters: options.parameters,
        limits: options.limits,
        scenarios: options.scenarios,
        sensors: numbers(vehicle, &options.sensors)?,
        exact: options.exact,
        allow: options.allow,
        draws: options.draws.unwrap_or(DesignRequest::default().draws),
        seed: options.seed,
    };
    let logs = inner(&logs);
    match work::run(py, tell, |progress| compare(vehicle, logs, &request, |_| {}, progress))? {
        Ok(plan) => {
            let json = serde_json::to_string(&plan).map_err(error)?;
            Ok((json, table(&plan), plan.inputs.map(Log::new)))
        }
        Err(DesignError::Refused(checked::Refused::Logs(report))) => {
            let refused = Refused::new_err(report.refused.clone().unwrap_or_default());
            refused.value(py).setattr("fit", Py::new(py, Fit::new(*report)?)?)?;
            Err(refused)
        }
        Err(other) => Err(error(other)),
    }
}
