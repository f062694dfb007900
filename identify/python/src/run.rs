//! Logs through an estimator.

use crate::error::error;
use crate::fit::Start;
use crate::log::Log;
use crate::names::{Texts, numbers, vehicle};
use crate::work;
use pyo3::prelude::*;
use wheelstate_identify::report;
use wheelstate_identify::run::{Parameters, Sampling, Settings, assess};

/// The estimates, the unit of each, the sample period, what is good to know, what must be known, and the page of a report.
type Estimates = (Log, Vec<(String, &'static str)>, f64, Vec<String>, Vec<String>, String);

/// Runs an estimator over a log; `clock` is that of a host of the FMU or that of the log.
#[pyfunction]
#[pyo3(signature = (name, log, start, settings, clock, smooth, tell))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn run(
    py: Python,
    name: &str,
    log: &Log,
    start: Start,
    settings: Texts,
    clock: &str,
    smooth: bool,
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
    let run = work::run(py, tell, |progress| vehicle.run(&log, &Settings { parameters, sampling, smooth }, progress))?;
    let run = run.map_err(error)?;
    let (assessment, page) = py.detach(|| {
        let assessment = assess(&run, &log);
        let page = report::run(&run, &log, &assessment);
        (assessment, page)
    });
    let page = page.map_err(error)?;
    let units = run.columns.iter().map(|column| (column.variable.name.clone(), column.variable.unit)).collect();
    let period = run.sample_period;
    notes.extend(assessment.notes);
    Ok((Log::new(run.into_log()), units, period, notes, assessment.warnings, page))
}
