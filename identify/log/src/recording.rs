//! What the readers deliver before a column map turns it into a log.

use crate::LogError;
use crate::columns::unit;
use crate::error::quoted;
use crate::series::Series;
use crate::store::{LONG, PIECE, Store, Stored};
use std::collections::HashSet;
use std::io;

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
    Lines { header: u64, samples: Lines },
    /// The file has no lines; samples count from 1.
    Samples,
}

/// The line of every sample. Most follow each other, so that only the others are noted.
#[derive(Debug, Default)]
pub(crate) struct Lines {
    len: usize,
    /// Samples that do not stand in the line after the one before, and where they stand.
    jumps: Vec<(usize, u64)>,
}

impl Lines {
    pub fn push(&mut self, line: u64) {
        if self.last() != Some(line.wrapping_sub(1)) {
            self.jumps.push((self.len, line));
        }
        self.len += 1;
    }

    fn last(&self) -> Option<u64> {
        let (first, line) = self.jumps.last()?;
        Some(line + (self.len - 1 - first) as u64)
    }

    pub fn len(&self) -> usize {
        self.len
    }

    fn of(&self, sample: usize) -> u64 {
        let jumps = self.jumps.partition_point(|(first, _)| *first <= sample);
        jumps.checked_sub(1).map_or(0, |last| self.jumps[last].1 + (sample - self.jumps[last].0) as u64)
    }
}

/// The numbers of a column while it is read: in memory, and in a file once they are many.
#[derive(Default)]
pub(crate) struct Growing {
    /// Those that are not in the file.
    pub tail: Vec<f64>,
    stored: Option<Stored>,
}

/// The file for the columns of a long log, which is made when it is needed. Without one they stay in memory.
#[derive(Default)]
pub(crate) struct Shelf {
    store: Option<Store>,
    /// The log will be long: nothing waits in memory until it is.
    pub expected: bool,
}

impl Shelf {
    fn store(&mut self) -> Option<&Store> {
        if self.store.is_none() {
            self.store = Store::new().ok();
        }
        self.store.as_ref()
    }

    /// Puts a column of a long log into the file.
    pub fn put_away(&mut self, column: &mut Series) -> io::Result<()> {
        let store = if column.len() < LONG { None } else { self.store() };
        store.map_or(Ok(()), |store| column.put_away(store))
    }
}

impl Growing {
    pub fn len(&self) -> usize {
        self.stored.as_ref().map_or(0, Stored::len) + self.tail.len()
    }

    /// Makes room for more numbers, but not for more than are kept in memory.
    pub fn reserve(&mut self, more: usize) {
        self.tail.reserve(more.min(if self.stored.is_some() { PIECE } else { LONG }));
    }

    /// Takes back what was added last.
    pub fn truncate(&mut self, len: usize) {
        self.tail.truncate(len - self.stored.as_ref().map_or(0, Stored::len));
    }

    /// Moves what is many enough into the file.
    pub fn settle(&mut self, shelf: &mut Shelf) -> io::Result<()> {
        let whole = self.tail.len() - self.tail.len() % PIECE;
        if whole == 0 || (self.stored.is_none() && whole < LONG && !shelf.expected) {
            return Ok(());
        }
        if self.stored.is_none() {
            self.stored = shelf.store().map(Stored::new);
        }
        if let Some(stored) = &mut self.stored {
            stored.append(&self.tail[..whole])?;
            self.tail.drain(..whole);
            self.tail.shrink_to(2 * PIECE);
        }
        Ok(())
    }

    /// All numbers.
    pub fn finish(self) -> io::Result<Series> {
        match self.stored {
            None => Ok(self.tail.into()),
            Some(mut stored) => {
                stored.append(&self.tail)?;
                Ok(stored.into())
            }
        }
    }
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
            Place::Lines { samples, .. } => LogError::line(&self.file, samples.of(sample), what),
            Place::Samples if self.groups.len() > 1 => {
                LogError::file(&self.file, format!("{}, sample {}: {what}", self.group(group), sample + 1))
            }
            Place::Samples => LogError::file(&self.file, format!("sample {}: {what}", sample + 1)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_has_its_line() {
        let all = [3_u64, 4, 5, 9, 10, 12, 12, 20, 21];
        let mut lines = Lines::default();
        all.iter().for_each(|line| lines.push(*line));
        assert_eq!((0..lines.len()).map(|sample| lines.of(sample)).collect::<Vec<_>>(), all);
        assert_eq!(lines.jumps.len(), 5);
    }

    #[test]
    fn a_column_that_grows_long_is_the_same_in_a_file() {
        let mut column = Growing::default();
        let mut shelf = Shelf::default();
        let value = |k: usize| (k as f64).sqrt();
        for k in 0..LONG + PIECE + 11 {
            column.tail.push(value(k));
            if k % 5000 == 0 {
                column.settle(&mut shelf).unwrap();
            }
        }
        column.tail.push(7.0);
        column.truncate(column.len() - 1);
        assert!(column.tail.len() < 2 * PIECE);
        let series = column.finish().unwrap();
        assert_eq!(series.len(), LONG + PIECE + 11);
        assert!(series.iter().enumerate().all(|(k, of)| *of == value(k)));
    }
}
