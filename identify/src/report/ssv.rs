//! The result as a parameter set of the System Structure and Parameterization standard (SSP 1.0).

use crate::result::FitReport;
use wheelstate::parameter_set::{Entry, Value, write};

/// The XML text; identified parameters only.
pub fn ssv(report: &FitReport) -> String {
    let entries = report.identified().map(|(name, parameter)| Entry {
        name,
        description: "",
        value: Value::Real(parameter.value, &parameter.unit),
    });
    write(&report.vehicle, entries)
}
