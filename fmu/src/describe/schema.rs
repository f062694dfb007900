//! JSON schema of the parameter files of a model: `fit.json`, or a plain map of names to values.

use crate::model::Model;
use serde_json::{Map, Value, json};
use wheelstate::Variable;
use wheelstate::variable::Kind;

/// The schema (draft 2020-12) of a file that `pack --params` takes for this model.
pub fn schema(model: &Model) -> Value {
    let each = |entry: fn(Value) -> Value| -> Map<String, Value> {
        model.parameters.iter().map(|variable| (variable.name.clone(), entry(value(variable)))).collect()
    };
    let fitted = |value: Value| {
        json!({
            "type": "object",
            "required": ["value"],
            "properties": {
                "value": value,
                "unit": { "type": "string" },
                "std_error": { "type": ["number", "null"] },
                "ci95": { "type": ["array", "null"], "items": { "type": ["number", "null"] } },
                "identified": { "type": "boolean" },
                "at_bound": { "type": "boolean" }
            }
        })
    };
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": format!("{} parameters", model.name),
        "type": "object",
        "properties": {
            "vehicle": { "const": model.command_name() },
            "parameters": { "type": "object", "properties": each(fitted) }
        }
    })
}

/// Type, range and meaning of one value.
fn value(variable: &Variable) -> Value {
    let mut schema = json!({ "description": variable.description, "default": variable.start });
    let (low, high) = variable.range;
    match variable.kind {
        Kind::Real => schema["type"] = "number".into(),
        Kind::Integer | Kind::Code(_) => schema["type"] = "integer".into(),
        Kind::Boolean => {
            schema["type"] = "boolean".into();
            schema["default"] = (variable.start != 0.0).into();
            return schema;
        }
        Kind::Choice(items) => {
            schema["enum"] = items.into();
            schema["default"] = items[variable.start as usize].into();
            return schema;
        }
    }
    if low.is_finite() {
        schema["minimum"] = low.into();
    }
    if high.is_finite() {
        schema["maximum"] = high.into();
    }
    if variable.unit != "1" {
        schema["$comment"] = variable.unit.into();
    }
    schema
}
