//! Tables that other programs hold in memory become logs as files do: by the same column maps, units and checks.

use crate::columns::ColumnMap;
use crate::csv::name_and_unit;
use crate::error::LogError;
use crate::progress::Progress;
use crate::recording::{Clock, Column, Group, Place, Recording, Values};
use crate::wanted::Wanted;
use crate::{Input, Log, hash};
use std::path::Path;

/// One column of a table.
#[derive(Clone, Debug)]
pub struct TableColumn {
    /// Its name; a unit may follow, as in `speed [km/h]`.
    pub name: String,
    /// What it holds.
    pub samples: Samples,
}

/// What a column of a table holds.
#[derive(Clone, Debug)]
pub enum Samples {
    /// Numbers, as recorded; NaN is a missing one.
    Numbers(Vec<f64>),
    /// Times, dates or durations, in s.
    Times(Vec<f64>),
    /// Something that is no number, in words: `text`.
    Other(String),
}

impl Log {
    /// A log from a table; `name` stands for the file in messages and for [`source`](Self::source). The rules are those
    /// of [`read`](Self::read), or with `inputs` those of [`read_inputs`](Self::read_inputs); the hash is that of the
    /// names and samples.
    ///
    /// ```
    /// use wheelstate_log::{ColumnMap, Log, Samples, TableColumn};
    ///
    /// let column = |name: &str, samples| TableColumn { name: name.into(), samples };
    /// let table = vec![
    ///     column("time", Samples::Numbers(vec![0.0, 0.01])),
    ///     column("v [km/h]", Samples::Numbers(vec![36.0, f64::NAN])),
    /// ];
    /// let map = ColumnMap::parse("map.toml", "speed = 'v'")?;
    /// let log = Log::from_table("ride", table, Some(&map), None)?;
    /// assert!(log.require("speed")?[0] == 10.0 && log.require("speed")?[1].is_nan());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn from_table(
        name: &str,
        table: Vec<TableColumn>,
        map: Option<&ColumnMap>,
        inputs: Option<&[Input]>,
    ) -> Result<Self, LogError> {
        let sha256 = digest(&table);
        let lengths = table.iter().filter_map(|column| Some((&column.name, column.samples.numbers()?.len())));
        let lengths: Vec<_> = lengths.collect();
        if let [(first, length), rest @ ..] = lengths.as_slice()
            && let Some((other, another)) = rest.iter().find(|(_, other)| other != length)
        {
            let what = format!("'{first}' has {length} samples and '{other}' has {another}");
            return Err(LogError::file(name, what));
        }
        let group = Group {
            name: String::new(),
            clock: Clock::Undecided,
            columns: table.into_iter().map(TableColumn::recorded).collect(),
        };
        let recording = Recording {
            file: name.to_owned(),
            sha256,
            groups: vec![group],
            own: 1,
            notes: Vec::new(),
            place: Place::Samples,
            loader: None,
        };
        let mut log = Self::finish(recording, Path::new(name), map, inputs, &Wanted::all(), &Progress::none())?;
        log.drop_infinite();
        Ok(log)
    }
}

impl Samples {
    fn numbers(&self) -> Option<&[f64]> {
        match self {
            Self::Numbers(values) | Self::Times(values) => Some(values),
            Self::Other(_) => None,
        }
    }
}

impl TableColumn {
    fn recorded(self) -> Column {
        let (name, unit) = name_and_unit(&self.name);
        let (plain, unit) = (name.to_owned(), unit.map(str::to_owned));
        let title = (plain != self.name).then(|| self.name.clone());
        match self.samples {
            Samples::Numbers(values) => {
                Column { name: plain, title, unit, values: Values::Numbers(values.into()), typed: false }
            }
            Samples::Times(values) => Column {
                name: plain,
                title,
                unit: Some("s".to_owned()),
                values: Values::Numbers(values.into()),
                typed: true,
            },
            Samples::Other(what) => Column::other(plain, what),
        }
    }
}

/// SHA-256 of the names and samples, hexadecimal.
fn digest(table: &[TableColumn]) -> String {
    let mut bytes = Vec::new();
    for column in table {
        bytes.extend_from_slice(column.name.as_bytes());
        bytes.push(0);
        let values = column.samples.numbers().unwrap_or_default();
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }
    hash::of_bytes(&bytes)
}
