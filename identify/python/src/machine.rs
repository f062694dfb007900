//! Machines: their names, simulated logs, FMUs.

use crate::error::error;
use crate::log::Log;
use crate::names::{Texts, numbers, vehicle};
use crate::work;
use pyo3::prelude::*;
use std::path::PathBuf;
use wheelstate_fmu::pack::fit::Fit;
use wheelstate_fmu::pack::library::Library;
use wheelstate_fmu::pack::params::Params;
use wheelstate_fmu::pack::{self as packing, PackError};
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicles;

/// Name on the command line, name of the FMU and one line about it, of every machine.
#[pyfunction]
pub fn machines() -> Vec<(&'static str, &'static str, &'static str)> {
    vehicles::ALL.into_iter().map(|vehicle| (vehicle.name, vehicle.estimator.name, vehicle.about)).collect()
}

/// The scenarios of a machine with one line about each.
#[pyfunction]
pub fn scenarios(name: &str) -> PyResult<Vec<(&'static str, &'static str)>> {
    Ok(vehicle(name)?.simulation.scenarios.iter().map(|scenario| (scenario.name, scenario.about)).collect())
}

/// Runs a scenario.
#[pyfunction]
#[pyo3(signature = (name, scenario, seed, settings))]
pub fn simulate(py: Python, name: &str, scenario: String, seed: u64, settings: Texts) -> PyResult<Log> {
    let vehicle = vehicle(name)?;
    let request = Request { scenario, seed, settings: numbers(vehicle, &settings)? };
    work::run(py, None, |_| vehicle.simulate(&request))?.map(Log::new).map_err(error)
}

/// Writes an FMU: its path, what was taken over, and the warnings. `library` is an FMU with the libraries to pack, unless
/// there is a folder of them; parameters are a file, or the text of a `fit.json`.
#[pyfunction]
#[pyo3(signature = (name, file, json, unidentified, settings, out, library, folder))]
#[allow(clippy::too_many_arguments, reason = "the options of a program, by name in Python")]
pub fn pack(
    py: Python,
    name: &str,
    file: Option<PathBuf>,
    json: Option<&str>,
    unidentified: bool,
    settings: Texts,
    out: PathBuf,
    library: PathBuf,
    folder: Option<PathBuf>,
) -> PyResult<(PathBuf, Vec<String>, Vec<String>)> {
    let work = || -> Result<_, PackError> {
        let mut model = packing::model(name)?;
        let params = match (&file, json) {
            (Some(path), _) => Some(Params::read(path)?),
            (None, Some(text)) => Some(Params::Fit(Fit::parse("parameters", text)?)),
            (None, None) => None,
        };
        let settings: Vec<String> = settings.iter().map(|(name, value)| format!("{name}={value}")).collect();
        let baked = packing::prepare(&mut model, params.as_ref(), unidentified, &settings)?;
        let libraries = match &folder {
            Some(folder) => Library::all(folder)?,
            None => Library::of_fmu(&library)?,
        };
        Ok((packing::write(&model, &libraries, &out)?, baked.taken, baked.warnings))
    };
    py.detach(work).map_err(error)
}
