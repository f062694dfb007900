//! A parameter set (SSP 1.0 `.ssv`) with the parameters of a model: a preset to copy and edit.

use crate::model::Model;
use wheelstate::parameter_set::{Entry, Value, write};
use wheelstate::variable::Kind;

/// The parameter set of the model's start values. Enumerations are left out: they stand at their start values, and
/// several hosts refuse a set that names one.
pub fn text(model: &Model) -> String {
    let entries = model.parameters.iter().filter_map(|variable| {
        let value = match variable.kind {
            Kind::Real => Value::Real(variable.start, variable.unit),
            Kind::Integer | Kind::Code(_) => Value::Integer(variable.start as i32),
            Kind::Boolean => Value::Boolean(variable.start != 0.0),
            Kind::Choice(_) => return None,
        };
        Some(Entry { name: &variable.name, description: &variable.description, value })
    });
    write(model.name, entries)
}
