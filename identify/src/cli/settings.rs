//! `--set name=value` and `--params file`: numbers, truth values and choices by FMU name.

use super::Refusal;
use crate::values;
use crate::vehicle::Vehicle;
use std::path::{Path, PathBuf};

/// A setting as it stands on the command line.
#[derive(Clone, Debug)]
pub struct Setting {
    name: String,
    value: String,
}

/// Parser for clap.
pub fn parse(text: &str) -> Result<Setting, String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok(Setting { name: name.trim().to_owned(), value: value.trim().to_owned() })
        }
        _ => Err("name=value is expected, as in robot.mass=165".to_owned()),
    }
}

/// Settings of single logs, each with the index of its log.
pub type OwnSettings = Vec<(usize, Setting)>;

/// Settings for all logs, and those for one log, `FILE:name=value`, by the index of the log.
pub fn by_log(settings: &[Setting], logs: &[PathBuf]) -> Result<(Vec<Setting>, OwnSettings), Refusal> {
    let (mut general, mut own) = (Vec::new(), Vec::new());
    for setting in settings {
        let Some((file, name)) = setting.name.rsplit_once(':') else {
            general.push(setting.clone());
            continue;
        };
        let is_it =
            |log: &PathBuf| log.as_path() == Path::new(file) || log.file_name().is_some_and(|name| name == file);
        let setting = Setting { name: name.to_owned(), value: setting.value.clone() };
        let before = own.len();
        own.extend(logs.iter().enumerate().filter(|(_, log)| is_it(log)).map(|(index, _)| (index, setting.clone())));
        if own.len() == before {
            return Err(Refusal(format!("--set {file}:{name}: none of the logs is {file}")));
        }
    }
    Ok((general, own))
}

/// A name with two numbers, parted by one of the separators.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Name.
    pub name: String,
    /// The two numbers.
    pub numbers: (f64, f64),
}

/// `name=value+-std`.
pub fn parse_prior(text: &str) -> Result<Pair, String> {
    pair(text, &["+-", "\u{b1}"])
        .ok_or_else(|| "name=value+-std is expected, as in human.nominal_mass=72+-2".to_owned())
}

/// `name=low..high`.
pub fn parse_bound(text: &str) -> Result<Pair, String> {
    pair(text, &[".."]).ok_or_else(|| "name=low..high is expected, as in rolling.coefficient=0.005..0.03".to_owned())
}

/// `from..to`, in s.
pub fn parse_span(text: &str) -> Result<(f64, f64), String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    ends.filter(|(a, b)| a < b).ok_or_else(|| "from..to in s is expected, as in 12.5..14".to_owned())
}

/// `name`, or `name=channel`.
pub fn parse_law(text: &str) -> (String, Option<String>) {
    match text.split_once('=') {
        Some((name, channel)) => (name.trim().to_owned(), Some(channel.trim().to_owned())),
        None => (text.trim().to_owned(), None),
    }
}

fn pair(text: &str, separators: &[&str]) -> Option<Pair> {
    let (name, rest) = text.split_once('=')?;
    let (a, b) = separators.iter().find_map(|separator| rest.split_once(separator))?;
    let numbers = (a.trim().parse().ok()?, b.trim().parse().ok()?);
    let name = name.trim().to_owned();
    (!name.is_empty()).then_some(Pair { name, numbers })
}

/// Settings as numbers. Names that the vehicle's estimator declares are checked against their
/// declaration; others are left to the caller, but must be numbers or truth values.
pub fn numbers(vehicle: &Vehicle, settings: &[Setting]) -> Result<Vec<(String, f64)>, Refusal> {
    let pairs = settings.iter().map(|setting| (setting.name.as_str(), setting.value.as_str()));
    values::settings(vehicle, pairs).map_err(Refusal)
}

/// Start values from a file, see [`values::start`].
pub fn start_values(vehicle: &Vehicle, path: &Path) -> Result<Vec<(String, f64)>, Refusal> {
    let source = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|e| Refusal(format!("{source}: {e}")))?;
    values::start(vehicle, &source, &text).map_err(Refusal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_needs_a_name_and_a_value() {
        let setting = parse(" robot.mass = 165 ").unwrap();
        assert_eq!((setting.name.as_str(), setting.value.as_str()), ("robot.mass", "165"));
        for text in ["robot.mass", "=3", "robot.mass="] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn pairs_are_read_and_anything_else_is_refused() {
        let prior = parse_prior("robot.mass = 165 +- 2.5").unwrap();
        assert_eq!((prior.name.as_str(), prior.numbers), ("robot.mass", (165.0, 2.5)));
        assert_eq!(parse_bound("x=-1..2e-3").unwrap().numbers, (-1.0, 2e-3));
        assert_eq!(parse_span("1..2.5"), Ok((1.0, 2.5)));
        assert!(parse_prior("robot.mass=165").is_err() && parse_bound("x=1").is_err() && parse_span("3..2").is_err());
    }

    #[test]
    fn a_setting_of_one_log_names_its_file() {
        let logs = [PathBuf::from("a/one.csv"), PathBuf::from("two.csv")];
        let settings = [parse("one.csv:human.nominal_mass=60").unwrap(), parse("robot.mass=1").unwrap()];
        let (general, own) = by_log(&settings, &logs).unwrap();
        assert_eq!((general.len(), own.len(), own[0].0, own[0].1.name.as_str()), (1, 1, 0, "human.nominal_mass"));
        assert!(by_log(&[parse("three.csv:robot.mass=1").unwrap()], &logs).is_err());
    }
}
