//! Values of parameters as people and programs write them: settings by name, and the texts of files.

use crate::result::FitReport;
use crate::vehicle::Vehicle;
use serde_json::Value;
use wheelstate::variable::{Kind, Variable};

/// Settings as numbers. Names that the vehicle's estimator declares are checked against their declaration; others are
/// left to the caller, but must be numbers or truth values.
pub fn settings<'a>(
    vehicle: &Vehicle,
    settings: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Result<Vec<(String, f64)>, String> {
    let declared = vehicle.parameters();
    let number = |(name, text): (&str, &str)| {
        let variable = declared.iter().find(|variable| variable.name == name);
        let value = value(variable, text).map_err(|e| format!("--set {name}: {e}"))?;
        Ok((name.to_owned(), value))
    };
    settings.into_iter().map(number).collect()
}

/// A value as text: a number, `true` or `false`, or one of the variable's choices.
fn value(variable: Option<&Variable>, text: &str) -> Result<f64, String> {
    let kind = variable.map(|variable| variable.kind);
    let number = match (kind, text) {
        (Some(Kind::Choice(choices)), text) => {
            let index = choices.iter().position(|choice| *choice == text);
            return index
                .map(|index| index as f64)
                .ok_or_else(|| format!("'{text}' is none of {}", choices.join(", ")));
        }
        (Some(Kind::Boolean) | None, "true") => 1.0,
        (Some(Kind::Boolean) | None, "false") => 0.0,
        (_, text) => text.parse().map_err(|_| format!("'{}' is not a number", text.escape_debug()))?,
    };
    if let Some(variable) = variable {
        variable.check(number).map_err(|e| e.to_string())?;
    }
    Ok(number)
}

/// Start values from the text of a file: a `fit.json` (its identified parameters) or a plain `{name: value}`; `source`
/// is named in errors.
pub fn start(vehicle: &Vehicle, source: &str, text: &str) -> Result<Vec<(String, f64)>, String> {
    let refuse = |what: String| format!("{source}: {what}");
    let json: Value = serde_json::from_str(text).map_err(|e| refuse(format!("not readable as JSON: {e}")))?;
    let Value::Object(top) = &json else {
        return Err(refuse("an object {\"name\": value, ...} or a fit.json is expected".to_owned()));
    };
    let is_fit = top.contains_key("format_version") || top.get("parameters").is_some_and(Value::is_object);
    if let Some(version) = top.get("format_version")
        && version.as_u64() != Some(crate::result::FORMAT_VERSION.into())
    {
        return Err(refuse(format!("format_version {version} is not known to this program")));
    }
    if let Some(Value::String(other)) = top.get("vehicle").filter(|_| is_fit)
        && other != vehicle.name
    {
        return Err(refuse(format!("holds parameters of {other}, not of {vehicle}")));
    }
    let parameters = match top.get("parameters") {
        Some(Value::Object(parameters)) => parameters,
        _ if is_fit => return Err(refuse("has no parameters".to_owned())),
        _ => top,
    };
    let declared = vehicle.parameters();
    let mut values = Vec::new();
    for (name, entry) in parameters {
        let unidentified = entry.get("identified") == Some(&Value::Bool(false));
        if unidentified {
            continue;
        }
        let variable = declared.iter().find(|variable| variable.name == *name);
        let number = match entry.get("value").unwrap_or(entry) {
            Value::Number(number) => number.as_f64().unwrap_or(f64::NAN),
            Value::Bool(truth) => f64::from(u8::from(*truth)),
            Value::String(word) => value(variable, word).map_err(|e| refuse(format!("{name}: {e}")))?,
            other => return Err(refuse(format!("{name}: {other} is not a number"))),
        };
        if let Some(variable) = variable {
            variable.check(number).map_err(|e| refuse(e.to_string()))?;
        }
        values.push((name.clone(), number));
    }
    Ok(values)
}

/// What is known before an experiment: a whole fit, or start values by FMU name.
pub type Before = (Option<FitReport>, Vec<(String, f64)>);

/// What is known before an experiment, from the text of a file: a whole `fit.json`, or start values as [`start`] reads
/// them.
pub fn known(vehicle: &Vehicle, source: &str, text: &str) -> Result<Before, String> {
    let values = start(vehicle, source, text)?;
    let json: Value = serde_json::from_str(text).map_err(|e| format!("{source}: {e}"))?;
    if json.get("format_version").is_none() {
        return Ok((None, values));
    }
    let fit = serde_json::from_value(json).map_err(|e| format!("{source}: not readable as fit.json: {e}"))?;
    Ok((Some(fit), Vec::new()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_words_and_truth_values_are_not_numbers_elsewhere() {
        let kind = Kind::Choice(&["threshold", "exponential"]);
        let mut variable = Variable::new("mass.law".to_owned(), "", "1", kind, (0.0, 1.0));
        assert_eq!(value(Some(&variable), "exponential"), Ok(1.0));
        assert!(value(Some(&variable), "1").unwrap_err().contains("threshold, exponential"));
        variable.kind = Kind::Real;
        assert!(value(Some(&variable), "true").is_err());
        assert!(value(Some(&variable), "2").unwrap_err().contains("0..=1"));
        assert_eq!(value(None, "true"), Ok(1.0));
    }
}
