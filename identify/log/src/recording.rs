//! What the readers deliver before a column map turns it into a log.

use crate::LogError;
use crate::columns::unit;
use crate::error::quoted;
use crate::series::Series;
use std::collections::HashSet;

/// The groups of a file under their own names.
pub(crate) struct Recording {
    pub file: String,
    pub sha256: String,
    pub groups: Vec<Group>,
    /// How many of the groups are of the file itself; the others were joined.
    pub own: usize,
    /// What was detected or repaired, one line each.
    pub notes: Vec<String>,
    pub place: Place,
    /// Reads the columns that are needed, in formats that hold much more than that.
    pub loader: Option<Box<dyn Loader>>,
}

/// Reads columns once it is known which ones are needed.
pub(crate) trait Loader {
    /// What to say where nothing is asked for.
    fn what(&self, groups: &[Group]) -> String;

    /// Fills the wanted columns (group and place) and the clocks of their groups; returns what to say of it.
    fn load(&mut self, groups: &mut [Group], wanted: &HashSet<(usize, usize)>) -> Result<Vec<String>, LogError>;
}

/// Columns that were sampled together. All have the same length.
#[derive(Debug)]
pub(crate) struct Group {
    /// As the file calls it; may be empty.
    pub name: String,
    pub clock: Clock,
    pub columns: Vec<Column>,
}

/// What says when the samples of a group were taken.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Clock {
    /// What the column map says; without one the column `time`.
    Undecided,
    /// This column of the group.
    Column(usize),
    /// Nothing that could be compared with other groups, and why.
    None(String),
}

/// One column.
#[derive(Clone, Debug)]
pub(crate) struct Column {
    pub name: String,
    /// The name with everything that stands there, if that is more: `speed [km/h]`.
    pub title: Option<String>,
    /// The unit that the file states.
    pub unit: Option<String>,
    pub values: Values,
    /// The file's own type made these times, in s: no unit of a map applies.
    pub typed: bool,
}

/// What a column holds.
#[derive(Clone, Debug)]
pub(crate) enum Values {
    /// One per sample, as recorded; NaN is a missing one.
    Numbers(Series),
    /// Numbers that nobody has asked for yet.
    Unread,
    /// Text: the place and content of the first.
    Text { at: String, text: String },
    /// Something that is no number, in words: `a byte array`.
    Other(String),
}

/// How to name the place of a sample in an error.
#[derive(Debug)]
pub(crate) enum Place {
    /// The line of the header and of every sample in a text file.
    Lines { header: u64, samples: Vec<u32> },
    /// The file has no lines; samples count from 1.
    Samples,
}

impl Column {
    pub fn numbers(name: impl Into<String>, values: impl Into<Series>) -> Self {
        Self { name: name.into(), title: None, unit: None, values: Values::Numbers(values.into()), typed: false }
    }

    pub fn other(name: impl Into<String>, what: impl Into<String>) -> Self {
        Self { name: name.into(), title: None, unit: None, values: Values::Other(what.into()), typed: false }
    }

    /// Its numbers, or the error that it has none; `file` is named in it.
    pub fn as_numbers(&self, file: &str) -> Result<Series, LogError> {
        match &self.values {
            Values::Numbers(values) => Ok(values.clone()),
            Values::Unread => Ok(Series::default()),
            Values::Text { at, text } => {
                let what = format!("column {}: {} is not a number", quoted(&self.name), quoted(text));
                Err(LogError::file(at, what))
            }
            Values::Other(what) => {
                Err(LogError::file(file, format!("column {} holds {what}, not numbers", quoted(&self.name))))
            }
        }
    }

    /// The unit that the file states, if it is known.
    pub fn known_unit(&self) -> Option<Result<unit::Unit, String>> {
        self.unit.as_deref().filter(|text| !matches!(text.trim(), "" | "-")).map(unit::find)
    }

    /// Its numbers as times in s, by the unit that the file states.
    pub fn seconds(&self, file: &str) -> Result<Series, LogError> {
        let values = self.as_numbers(file)?;
        let factor = self.second().map_err(|what| LogError::file(file, what))?;
        Ok(if factor == 1.0 { values } else { values.iter().map(|value| value * factor).collect() })
    }

    /// What one of the column's numbers is in s.
    pub fn second(&self) -> Result<f64, String> {
        let fail = |what: &str| format!("time {}: {what}; unit = \"...\" in a column map decides", quoted(&self.name));
        match self.known_unit() {
            None => Ok(1.0),
            Some(Err(what)) => Err(fail(&format!("is recorded in an {what}"))),
            Some(Ok(unit)) if unit.si != "s" => {
                Err(fail(&format!("is recorded in {}", self.unit.as_deref().unwrap_or(""))))
            }
            Some(Ok(unit)) => Ok(unit.factor),
        }
    }
}

impl Group {
    /// Number of samples.
    pub fn len(&self) -> usize {
        let lengths = self.columns.iter().map(|column| match &column.values {
            Values::Numbers(values) => values.len(),
            _ => 0,
        });
        lengths.max().unwrap_or(0)
    }
}

impl Recording {
    /// How a group is called in messages.
    pub fn group(&self, index: usize) -> String {
        match self.groups[index].name.as_str() {
            "" => format!("group {index}"),
            name => format!("group {index} ({})", quoted(name)),
        }
    }

    /// An error about one sample.
    pub fn fail_at(&self, group: usize, sample: usize, what: &str) -> LogError {
        match &self.place {
            Place::Lines { samples, .. } => {
                LogError::line(&self.file, samples.get(sample).copied().unwrap_or(0).into(), what)
            }
            Place::Samples if self.groups.len() > 1 => {
                LogError::file(&self.file, format!("{}, sample {}: {what}", self.group(group), sample + 1))
            }
            Place::Samples => LogError::file(&self.file, format!("sample {}: {what}", sample + 1)),
        }
    }
}
