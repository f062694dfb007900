//! `resources/start_values.json`: the start values of an FMU that was packed with its own.

use crate::model::Model;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Name of the file below `resources`.
pub const FILE: &str = "start_values.json";

/// What the file holds: the parameters whose start values differ from the model's defaults.
/// Enumerations count from 0, Booleans are 0 or 1.
#[derive(Serialize, Deserialize)]
pub struct StartValues {
    format_version: u32,
    model: String,
    parameters: BTreeMap<String, f64>,
}

impl StartValues {
    /// Whether no start value differs.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty()
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        // maps with text keys and finite numbers always have a JSON form
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}

/// The start values of `model` that differ from those of `default`.
pub fn differences(model: &Model, default: &Model) -> StartValues {
    let pairs = model.parameters.iter().zip(&default.parameters);
    let changed = pairs.filter(|(own, other)| own.start.to_bits() != other.start.to_bits());
    let parameters = changed.map(|(own, _)| (own.name.clone(), own.start)).collect();
    StartValues { format_version: 1, model: model.name.to_owned(), parameters }
}

/// Puts the start values of the FMU's resources into the model.
pub fn load(model: &mut Model, guid: &str, resource_location: Option<&str>) -> Result<(), String> {
    let why = format!("the GUID '{guid}' says that this FMU has start values of its own");
    let Some(location) = resource_location.filter(|location| !location.is_empty()) else {
        return Err(format!("{why}, but fmuResourceLocation is not given"));
    };
    let folder = path(location).ok_or_else(|| format!("{why}, but fmuResourceLocation '{location}' is no file URI"))?;
    let file = folder.join(FILE);
    let text = std::fs::read_to_string(&file).map_err(|error| format!("{why}, but {}: {error}", file.display()))?;
    let broken = |what: String| format!("{why}, but {}: {what}", file.display());
    let values: StartValues = serde_json::from_str(&text).map_err(|error| broken(error.to_string()))?;
    if values.format_version != 1 {
        return Err(broken(format!("format_version {} is not known", values.format_version)));
    }
    if values.model != model.name {
        return Err(broken(format!("it is for {}, not for {}", values.model, model.name)));
    }
    let mut list = Vec::new();
    for (name, value) in &values.parameters {
        let (index, _) = model.parameter(name).ok_or_else(|| broken(format!("there is no parameter {name}")))?;
        list.push((index, *value));
    }
    model.bake(&list).map_err(broken)
}

/// The folder of a resource location: `file:///a`, `file:/a`, `file://localhost/a`, `file:///C:/a`
/// with percent signs decoded, or a plain absolute path.
pub fn path(location: &str) -> Option<PathBuf> {
    let lower = location.get(..5).map(str::to_ascii_lowercase);
    if lower.as_deref() != Some("file:") {
        let plain = PathBuf::from(location);
        return plain.is_absolute().then_some(plain);
    }
    let rest = &location[5..];
    let rest = match rest.strip_prefix("//") {
        Some(authority) => match authority.find('/') {
            Some(0) => authority,
            Some(slash) if authority[..slash].eq_ignore_ascii_case("localhost") => &authority[slash..],
            _ => return None,
        },
        None => rest,
    };
    let decoded = decode(rest)?;
    let bytes = decoded.as_bytes();
    let drive = bytes.len() >= 3 && bytes[0] == b'/' && bytes[1].is_ascii_alphabetic() && bytes[2] == b':';
    Some(PathBuf::from(if drive { &decoded[1..] } else { &decoded }))
}

fn decode(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, after @ ..] = rest {
        rest = after;
        if *first == b'%' {
            let [high, low, after @ ..] = rest else { return None };
            let digit = |byte: u8| char::from(byte).to_digit(16);
            bytes.push((digit(*high)? * 16 + digit(*low)?) as u8);
            rest = after;
        } else {
            bytes.push(*first);
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_a_file_location_is_understood() {
        let found = |location| path(location).map(|path| path.to_string_lossy().into_owned());
        for (location, expected) in [
            ("file:///a/b", "/a/b"),
            ("file:/a/b", "/a/b"),
            ("file://localhost/a/b", "/a/b"),
            ("FILE:///a%20b/%C3%BC", "/a b/\u{fc}"),
            ("file:///C:/a", "C:/a"),
            ("/a/b", "/a/b"),
        ] {
            assert_eq!(found(location).as_deref(), Some(expected), "{location}");
        }
        for location in ["http://a/b", "file://server/a", "file:///a%2", "file:///a%zz", "relative"] {
            assert_eq!(found(location), None, "{location}");
        }
    }
}
