//! CSV in, CSV out.

use crate::columns::{ColumnMap, Columns};
use std::fmt::Write as _;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// A log with its times.
pub struct LogFile {
    /// Path, for messages.
    pub name: String,
    /// Times, s, increasing.
    pub time: Vec<f64>,
    /// The other columns.
    pub columns: Columns,
    lines: Vec<u64>,
}

impl LogFile {
    /// The place of a row, for messages.
    pub fn place(&self, row: usize) -> String {
        format!("{}:{}", self.name, self.lines.get(row).copied().unwrap_or(0))
    }

    /// The median time between two rows, s.
    pub fn period(&self) -> f64 {
        let mut gaps: Vec<_> = self.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps.sort_by(f64::total_cmp);
        gaps[gaps.len() / 2]
    }
}

/// Reads a log; messages name the file, and the line where there is one.
pub fn read(path: &Path, map: Option<&ColumnMap>) -> Result<LogFile, String> {
    let name = path.display().to_string();
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    if matches!(ending.as_deref(), Some("parquet" | "mf4" | "mdf")) {
        return Err(format!(
            "{name}: only CSV is read here; turn it into CSV first: identify convert VEHICLE {name} --out log.csv"
        ));
    }
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(|error| format!("{name}: {error}"))?;
    let headers = reader.headers().map_err(|error| format!("{name}:1: {error}"))?.clone();
    let mut columns: Columns =
        headers.iter().map(|header| (header.trim_start_matches('\u{feff}').to_owned(), Vec::new())).collect();
    let mut spare = vec![false; columns.len()];
    let mut lines = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| format!("{name}: {error}"))?;
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != columns.len() {
            return Err(format!("{name}:{line}: {} cells, but the header has {} columns", record.len(), columns.len()));
        }
        for ((cell, (column, values)), spare) in record.iter().zip(&mut columns).zip(&mut spare) {
            match number(cell) {
                Some(value) => values.push(value),
                // text does not matter in a column that the map leaves aside
                None if map.is_some_and(|map| !map.uses(column)) => *spare = true,
                None => {
                    return Err(format!("{name}:{line}: column '{column}': '{}' is not a number", cell.escape_debug()));
                }
            }
        }
        lines.push(line);
    }
    let mut keep = spare.iter().map(|spare| !spare);
    columns.retain(|_| keep.next().unwrap_or(true));
    let (time, columns) = match map {
        Some(map) => map.apply(&name, columns).map_err(|error| error.to_string())?,
        None => {
            let index = columns.iter().position(|(column, _)| column == "time");
            let index = index.ok_or_else(|| format!("{name}: no column 'time'; a column map can name another one"))?;
            (columns.remove(index).1, columns)
        }
    };
    let log = LogFile { name, time, columns, lines };
    check_time(&log)?;
    Ok(log)
}

fn check_time(log: &LogFile) -> Result<(), String> {
    if log.time.len() < 2 {
        return Err(format!("{}: {} rows; at least 2 are needed", log.name, log.time.len()));
    }
    if let Some(row) = log.time.iter().position(|time| !time.is_finite()) {
        return Err(format!("{}: the time is missing or not finite", log.place(row)));
    }
    match log.time.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(row) => {
            let (last, now) = (log.time[row], log.time[row + 1]);
            Err(format!("{}: the time does not increase: {now} s after {last} s", log.place(row + 1)))
        }
        None => Ok(()),
    }
}

/// A cell as a number: NaN if empty, `None` if it is text.
fn number(cell: &str) -> Option<f64> {
    match cell {
        "" => Some(f64::NAN),
        "True" | "true" => Some(1.0),
        "False" | "false" => Some(0.0),
        _ => cell.parse().ok(),
    }
}

/// The outputs of a run, row by row.
pub struct Table {
    /// Names, the first of which is `time`.
    pub names: Vec<String>,
    /// All rows, one after the other.
    pub values: Vec<f64>,
}

/// Writes a table with every digit.
pub fn write(to: impl Write, table: &Table) -> io::Result<()> {
    let mut to = BufWriter::new(to);
    writeln!(to, "{}", table.names.join(","))?;
    let mut line = String::new();
    for row in table.values.chunks(table.names.len()) {
        line.clear();
        for (i, value) in row.iter().enumerate() {
            let comma = if i == 0 { "" } else { "," };
            // whole numbers stand without a point, as flags and counters are read
            let _ = if value.fract() == 0.0 && value.abs() < 1e15 {
                write!(line, "{comma}{value:.0}")
            } else {
                write!(line, "{comma}{value:?}")
            };
        }
        writeln!(to, "{line}")?;
    }
    to.flush()
}

/// Writes a file that appears whole or not at all.
pub fn write_whole(path: &Path, table: &Table) -> Result<(), String> {
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(format!(".{}", std::process::id()));
    let written = std::fs::File::create(&temporary)
        .and_then(|file| write(file, table))
        .and_then(|()| std::fs::rename(&temporary, path));
    written.map_err(|error| {
        // what is left of it is of no use; the first error is the one to report
        let _ = std::fs::remove_file(&temporary);
        format!("{}: {error}", path.display())
    })
}
