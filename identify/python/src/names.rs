//! Machines and their parameters by name.

use crate::error::error;
use pyo3::prelude::*;
use wheelstate_identify::values;
use wheelstate_identify::vehicle::Vehicle;
use wheelstate_identify::vehicles;

/// The machine of this name, spelt as the FMU or as on the command line.
pub fn vehicle(name: &str) -> PyResult<&'static Vehicle> {
    let plain = |text: &str| text.to_lowercase().replace(['-', '_'], "");
    let found = vehicles::ALL.into_iter().find(|vehicle| plain(vehicle.name) == plain(name));
    found.ok_or_else(|| {
        let names = vehicles::ALL.map(|vehicle| vehicle.name).join(", ");
        error(format!("there is no machine '{name}'; there are: {names}"))
    })
}

/// Settings as texts by name, as on the command line.
pub type Texts = Vec<(String, String)>;

/// Settings as numbers.
pub fn numbers(vehicle: &Vehicle, settings: &Texts) -> PyResult<Vec<(String, f64)>> {
    values::settings(vehicle, settings.iter().map(|(name, text)| (name.as_str(), text.as_str()))).map_err(error)
}
