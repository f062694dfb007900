//! Blocks that travel, and two fits beside each other.

use crate::error::error;
use crate::fit::Fit;
use crate::log::Log;
use crate::names::vehicle;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use wheelstate_identify::fleet::{self, Block};

/// What the fit of a machine reads of a log, as bytes.
#[pyfunction]
pub fn compress<'py>(py: Python<'py>, name: &str, log: &Log) -> PyResult<Bound<'py, PyBytes>> {
    let (vehicle, log) = (vehicle(name)?, log.inner.clone());
    let bytes = py.detach(|| Block::new(vehicle, &log).to_bytes());
    Ok(PyBytes::new(py, &bytes))
}

/// The machine and the logs of blocks, in the order of their sources, each once.
#[pyfunction]
pub fn merge(py: Python, blocks: Vec<Vec<u8>>) -> PyResult<(String, Vec<Log>)> {
    let merged = py.detach(|| {
        let read = |(index, bytes): (usize, &Vec<u8>)| Block::from_bytes(&format!("block {}", index + 1), bytes);
        let blocks: Result<Vec<Block>, _> = blocks.iter().enumerate().map(read).collect();
        fleet::merge(blocks?)
    });
    let (vehicle, logs) = merged.map_err(error)?;
    Ok((vehicle, logs.into_iter().map(Log::new).collect()))
}

/// What two fits say of each other, as JSON.
#[pyfunction]
pub fn compare(one: &Fit, other: &Fit, same_sensors: bool) -> PyResult<String> {
    let differences = fleet::compare(&one.report, &other.report, same_sensors).map_err(error)?;
    serde_json::to_string(&differences).map_err(error)
}
