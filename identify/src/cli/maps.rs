//! `--columns`: one column map for all logs, or one for each pattern of file names.

use super::Refusal;
use crate::log::ColumnMap;
use crate::vehicle::Vehicle;
use std::path::Path;

/// The column maps of a command, each with the pattern of the logs that it is for.
pub(super) struct Maps(Vec<(Option<String>, ColumnMap)>);

impl Maps {
    /// Reads `MAP.toml` or `PATTERN=MAP.toml`, and checks the maps against the vehicle's inputs.
    pub fn read(vehicle: &Vehicle, arguments: &[String]) -> Result<Self, Refusal> {
        let mut maps = Vec::new();
        for argument in arguments {
            let (pattern, path) = match argument.split_once('=') {
                Some((pattern, path)) if !Path::new(argument).exists() => (Some(pattern.to_owned()), path),
                _ => (None, argument.as_str()),
            };
            let map = ColumnMap::read(Path::new(path))?;
            check(vehicle, &map)?;
            maps.push((pattern, map));
        }
        Ok(Self(maps))
    }

    /// The first map for this log; none if no map was named at all.
    pub fn of(&self, log: &Path) -> Result<Option<&ColumnMap>, Refusal> {
        let name = log.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        let fits = |pattern: &str| matches(pattern.as_bytes(), name.as_bytes()) || Path::new(pattern) == log;
        match self.0.iter().find(|(pattern, _)| pattern.as_deref().is_none_or(fits)) {
            Some((_, map)) => Ok(Some(map)),
            None if self.0.is_empty() => Ok(None),
            None => Err(Refusal(format!("{}: no pattern of --columns fits this log", log.display()))),
        }
    }
}

/// Refuses units that do not fit the vehicle's inputs and points out names that look misspelt.
fn check(vehicle: &Vehicle, map: &ColumnMap) -> Result<(), Refusal> {
    let inputs = vehicle.inputs();
    for (channel, unit) in map.units() {
        if let Some(input) = inputs.iter().find(|input| input.name == channel && input.unit != unit) {
            let what = format!("{channel}: the unit leads to {unit}, but {vehicle} takes {channel} in {}", input.unit);
            return Err(map.error(what).into());
        }
    }
    // What only the fit reads is no misspelt input.
    let mut names: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
    vehicle.checks.channels().for_each(|name| names.push(name));
    for channel in map.channels().filter(|channel| !names.contains(channel)) {
        let used = |name: &str| map.channels().any(|other| other == name);
        if let Some(near) = crate::log::columns::nearest(channel, &names).filter(|near| !used(near)) {
            let program = super::program();
            eprintln!("{program}: note: {channel} in the column map is not an input of {vehicle}; {near} is");
        }
    }
    Ok(())
}

/// Whether a name fits a pattern in which `*` stands for any text and `?` for one character.
fn matches(pattern: &[u8], name: &[u8]) -> bool {
    match (pattern, name) {
        ([b'*', rest @ ..], name) => (0..=name.len()).any(|skip| matches(rest, &name[skip..])),
        ([b'?', pattern @ ..], [_, name @ ..]) => matches(pattern, name),
        ([a, pattern @ ..], [b, name @ ..]) if a == b => matches(pattern, name),
        ([], []) => true,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn stars_and_question_marks_stand_for_other_characters() {
        for (pattern, name, fits) in [
            ("trip*.csv", "trip07.csv", true),
            ("trip?.csv", "trip07.csv", false),
            ("*", "", true),
            ("*B*", "TripB33.csv", true),
            ("TripA*", "TripB33.csv", false),
        ] {
            assert_eq!(matches(pattern.as_bytes(), name.as_bytes()), fits, "{pattern} {name}");
        }
    }
}
