//! Parameters from a file, as `pack --params` takes them.

use super::ssv;
use crate::result::{FORMAT_VERSION, FitReport};
use serde_json::Value;
use std::path::Path;
use wheelstate::Variable;
use wheelstate::variable::Kind;

/// Values by FMU name, with what was left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters {
    /// The values, in the order in which they are to be set.
    pub values: Vec<(String, f64)>,
    /// What was not taken over, and why, one line each.
    pub notes: Vec<String>,
}

/// A file that gives no parameters.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{source_name}: {reason}")]
pub struct ParametersError {
    /// The file.
    pub source_name: String,
    /// What is wrong with it.
    pub reason: String,
}

impl Parameters {
    /// Reads `fit.json`, `tune.json`, a parameter set (`.ssv`) or a plain `{"name": value, ...}` for a machine with these
    /// parameters.
    pub fn read(path: &Path, vehicle: &str, declared: &[Variable]) -> Result<Self, ParametersError> {
        let source_name = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ssv")) => {
                ssv::parse(&text, declared).map_err(|reason| ParametersError { source_name, reason })
            }
            Ok(text) => Self::parse(&source_name, &text, vehicle, declared),
            Err(error) => Err(ParametersError { source_name, reason: error.to_string() }),
        }
    }

    /// Reads the text of such a file; `source` is named in errors.
    pub fn parse(source: &str, text: &str, vehicle: &str, declared: &[Variable]) -> Result<Self, ParametersError> {
        let refuse = |reason: String| ParametersError { source_name: source.to_owned(), reason };
        let json: Value = serde_json::from_str(text).map_err(|e| refuse(format!("not readable as JSON: {e}")))?;
        let found = match json.as_object() {
            None => Err("an object {\"name\": value, ...} or a fit.json is expected".to_owned()),
            Some(top) if top.contains_key("format_version") || top.contains_key("vehicle") => {
                match serde_json::from_value::<FitReport>(json.clone()) {
                    Ok(fit) => Self::of_fit(&fit, vehicle, declared),
                    Err(e) => Err(format!("not readable as a fit: {e}")),
                }
            }
            Some(top) => Self::plain(top, declared),
        };
        found.map_err(refuse)
    }

    /// Of a fit or a tuning: the known values that it relied on and the identified ones; the error is the reason.
    pub fn of_fit(fit: &FitReport, vehicle: &str, declared: &[Variable]) -> Result<Self, String> {
        if fit.format_version != FORMAT_VERSION {
            return Err(format!("format_version {} is not known to this program", fit.format_version));
        }
        if let Some(why) = &fit.refused {
            return Err(format!("the fit was refused: {why}"));
        }
        if fit.vehicle != vehicle {
            return Err(format!("it holds parameters of {}, not of {vehicle}", fit.vehicle));
        }
        let mut all = Self::default();
        // A fit may have been given values that no parameter of the estimator stands for.
        let settings = fit.settings.iter().filter(|(name, _)| !fit.parameters.contains_key(*name));
        for (name, value) in settings {
            if let Some(variable) = declared.iter().find(|variable| variable.name == *name) {
                variable.check(*value).map_err(|e| e.to_string())?;
                all.values.push((name.clone(), *value));
            }
        }
        for (name, parameter) in &fit.parameters {
            let Some(variable) = declared.iter().find(|variable| variable.name == *name) else {
                all.notes.push(format!("{name}: the estimator has no such parameter"));
                continue;
            };
            if !parameter.identified {
                all.notes.push(format!("{name}: not identified, stays at {}", variable.start));
                continue;
            }
            if parameter.at_bound {
                all.notes.push(format!("{name}: the fit pushed it against a bound"));
            }
            variable.check(parameter.value).map_err(|e| e.to_string())?;
            all.values.push((name.clone(), parameter.value));
        }
        Ok(all)
    }

    /// Of `{name: value}`.
    fn plain(top: &serde_json::Map<String, Value>, declared: &[Variable]) -> Result<Self, String> {
        let mut all = Self::default();
        for (name, value) in top {
            let variable = declared.iter().find(|variable| variable.name == *name);
            let variable = variable.ok_or_else(|| format!("the estimator has no parameter '{name}'"))?;
            let number = match (variable.kind, value) {
                (Kind::Choice(choices), Value::String(word)) => {
                    let place = choices.iter().position(|choice| choice == word);
                    place
                        .map(|place| place as f64)
                        .ok_or_else(|| format!("{name}: '{}' is none of {}", word.escape_debug(), choices.join(", ")))?
                }
                (Kind::Boolean, Value::Bool(truth)) => f64::from(u8::from(*truth)),
                (_, Value::Number(number)) => number.as_f64().unwrap_or(f64::NAN),
                (_, other) => return Err(format!("{name}: {other} is not a value of it")),
            };
            variable.check(number).map_err(|e| e.to_string())?;
            all.values.push((name.clone(), number));
        }
        Ok(all)
    }
}
