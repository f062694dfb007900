//! Logs through an estimator.

use crate::error::error;
use crate::fit::Start;
use crate::log::Log;
use crate::names::{Texts, numbers, vehicle};
use crate::work;
use pyo3::prelude::*;
use wheelstate_identify::run::{Parameters, Sampling, Settings};

/// The estimates, the unit of each, the sample period, and what is good to know.
type Estimates = (Log, Vec<(String, &'static str)>, f64, Vec<String>);

/// Runs an estimator over a log; `clock` is that of a host of the FMU or that of the log.
#[pyfunction]
#[pyo3(signature = (name, log, start, settings, clock, tell))]
pub fn run(
    py: Python,
    name: &str,
    log: &Log,
    start: Start,
    settings: Texts,
    clock: &str,
    tell: Option<&Bound<PyAny>>,
) -> PyResult<Estimates> {
    let vehicle = vehicle(name)?;
    let sampling = match clock {
        "fmu" => Sampling::AsFmu,
        "log" => Sampling::EveryRow,
        other => return Err(error(format!("clock: '{other}' is none of fmu, log"))),
    };
    let Parameters { values: mut parameters, mut notes } = start.parameters(vehicle)?;
    parameters.extend(numbers(vehicle, &settings)?);
    let log = log.inner.clone();
    let run = work::run(py, tell, |progress| vehicle.run(&log, &Settings { parameters, sampling }, progress))?;
    let run = run.map_err(error)?;
    let units = run.columns.iter().map(|column| (column.variable.name.clone(), column.variable.unit)).collect();
    let period = run.sample_period;
    notes.extend(run.notes.iter().cloned());
    Ok((Log::new(run.into_log()), units, period, notes))
}
