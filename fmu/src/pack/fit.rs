//! Identified values from `fit.json` (or `tune.json`) as start values.

use super::{PackError, read};
use crate::model::{Model, check_parameter};
use serde_json::{Map, Value};
use std::path::Path;
use wheelstate::Variable;
use wheelstate::variable::Kind;

/// The result of an identification, as far as packing needs it.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Where it came from, for messages.
    pub source: String,
    /// The vehicle, as on the command line.
    pub vehicle: String,
    parameters: Map<String, Value>,
    settings: Map<String, Value>,
}

/// What became of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Baked {
    /// Lines to be shown: what was taken over.
    pub taken: Vec<String>,
    /// Lines to be shown: what was not, and why.
    pub warnings: Vec<String>,
}

impl Fit {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, PackError> {
        read(path, Self::parse)
    }

    /// Reads the text of a `fit.json`; errors begin with `source`.
    pub fn parse(source: &str, text: &str) -> Result<Self, PackError> {
        let refuse = |what: String| PackError(format!("{source}: {what}"));
        let json: Value =
            serde_json::from_str(text).map_err(|error| refuse(format!("not readable as JSON: {error}")))?;
        match json.get("format_version") {
            Some(version) if version.as_u64() == Some(1) => {}
            Some(version) => return Err(refuse(format!("format_version {version} is not known to this program"))),
            None => return Err(refuse("no format_version: this is not a fit.json".to_owned())),
        }
        if let Some(why) = json.get("refused").and_then(Value::as_str) {
            return Err(refuse(format!("the fit was refused: {why}")));
        }
        let Some(vehicle) = json.get("vehicle").and_then(Value::as_str) else {
            return Err(refuse("it names no vehicle".to_owned()));
        };
        let Some(Value::Object(parameters)) = json.get("parameters") else {
            return Err(refuse("it has no parameters".to_owned()));
        };
        let settings = json.get("settings").and_then(Value::as_object).cloned().unwrap_or_default();
        Ok(Self { source: source.to_owned(), vehicle: vehicle.to_owned(), parameters: parameters.clone(), settings })
    }

    /// Whether it is a fit of this model.
    pub fn is_of(&self, model: &Model) -> bool {
        self.vehicle == model.command_name()
    }

    /// Puts its values into the model's start values: the known values that the fit relied on, and
    /// the identified ones; others only if `unidentified`. All or none, and only what the model accepts.
    pub fn bake(&self, model: &mut Model, unidentified: bool) -> Result<Baked, PackError> {
        let refuse = |what: String| PackError(format!("{}: {what}", self.source));
        if !self.is_of(model) {
            let (vehicle, asked) = (&self.vehicle, model.command_name());
            return Err(refuse(format!("it holds parameters of {vehicle}, not of {asked}")));
        }
        let mut baked = Baked::default();
        let mut values = Vec::new();
        for (name, value) in &self.settings {
            // a fit may have been given values that no parameter of the FMU stands for
            let Some((index, variable)) = model.parameter(name) else { continue };
            if self.parameters.contains_key(name) {
                continue;
            }
            let value = number(value).ok_or_else(|| refuse(format!("settings: {name} = {value} is not a number")))?;
            check_parameter(variable, value).map_err(&refuse)?;
            values.push((index, value));
            if value != variable.start {
                baked.taken.push(format!(
                    "{name} = {} (was {}; given to the fit)",
                    show(variable.kind, value),
                    shown(model, index)
                ));
            }
        }
        let mut foreign = Vec::new();
        for (name, entry) in &self.parameters {
            let Some((index, variable)) = model.parameter(name) else {
                foreign.push(name.as_str());
                continue;
            };
            let identified = entry.get("identified").and_then(Value::as_bool);
            let identified =
                identified.ok_or_else(|| refuse(format!("{name}: it does not say whether it is identified")))?;
            if !identified && !unidentified {
                baked.warnings.push(format!("{name}: not identified, stays at {}", shown(model, index)));
                continue;
            }
            let found = entry.get("value").and_then(number);
            let value = found.ok_or_else(|| refuse(format!("{name}: its value is not a number")))?;
            check_parameter(variable, value).map_err(&refuse)?;
            values.push((index, value));
            baked.taken.push(taken(model, index, value));
            if !identified {
                baked.warnings.push(format!("{name}: taken although it is not identified"));
            } else if entry.get("at_bound") == Some(&Value::Bool(true)) {
                baked.warnings.push(format!("{name}: the fit pushed it against a bound"));
            }
        }
        baked.warnings.extend(unknown(&foreign, self.parameters.len()));
        model.bake(&values).map_err(|error| refuse(format!("the model refuses these values together: {error}")))?;
        Ok(baked)
    }
}

/// The warning about names, of `all` given ones, that are no parameters of the model.
pub(super) fn unknown(names: &[&str], all: usize) -> Option<String> {
    match names {
        [] => None,
        [name] => Some(format!("{name}: the FMU has no such parameter")),
        [first, .., last] => {
            Some(format!("{first} .. {last}: the FMU has no such parameters ({} of {all})", names.len()))
        }
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Bool(truth) => Some(f64::from(u8::from(*truth))),
        other => other.as_f64(),
    }
}

fn shown(model: &Model, index: usize) -> String {
    let variable = &model.parameters[index];
    show(variable.kind, variable.start)
}

fn show(kind: Kind, value: f64) -> String {
    match kind {
        Kind::Boolean => (value != 0.0).to_string(),
        Kind::Choice(items) => items.get(value as usize).copied().unwrap_or_default().to_owned(),
        _ => value.to_string(),
    }
}

/// The line that reports a new start value.
pub(super) fn taken(model: &Model, index: usize, value: f64) -> String {
    let variable = &model.parameters[index];
    let unit = if variable.unit == "1" { String::new() } else { format!(" {}", variable.unit) };
    format!("{} = {}{unit} (was {})", variable.name, show(variable.kind, value), shown(model, index))
}

/// Reads `name=value` as a start value: a number, `true`, `false` or one of the choices.
pub fn setting(model: &Model, text: &str) -> Result<(usize, f64), PackError> {
    let Some((name, word)) = text.split_once('=').map(|(name, word)| (name.trim(), word.trim())) else {
        return Err(PackError(format!("'{text}': name=value is expected, as in sample_period=0.02")));
    };
    let Some((index, variable)) = model.parameter(name) else {
        return Err(PackError(format!("{} has no parameter '{name}'", model.name)));
    };
    let value = parse(variable, word).map_err(|why| PackError(format!("{name}: {why}")))?;
    check_parameter(variable, value).map_err(PackError)?;
    Ok((index, value))
}

/// The value that a word stands for: a number, `true`, `false` or one of the choices.
pub(super) fn parse(variable: &Variable, word: &str) -> Result<f64, String> {
    match (variable.kind, word) {
        (Kind::Choice(items), word) => {
            let index = items.iter().position(|item| *item == word);
            index.map(|index| index as f64).ok_or_else(|| format!("'{word}' is none of {}", items.join(", ")))
        }
        (Kind::Boolean, "true") => Ok(1.0),
        (Kind::Boolean, "false") => Ok(0.0),
        (_, word) => word.parse().map_err(|_| format!("'{}' is not a number", word.escape_debug())),
    }
}
