//! CSV: a header with names, and a row for each sample; empty or `nan` is a missing one.
//!
//! What is usual elsewhere (separators, decimal commas, rows of units, encodings, comments, packed files) is
//! detected from the start of the file and reported in one line.

mod cell;
mod dialect;
mod number;
mod rows;
mod source;

pub(super) use dialect::name_and_unit;

use super::columns::CsvOptions;
use super::error::quoted;
use super::recording::{Clock, Column, Group, Growing, Lines, Place, Recording, Shelf, Values};
use super::{LONG, Log, LogError};
use crate::hash::{self, Hashed};
use crate::progress::Progress;
use crate::wanted::Wanted;
use cell::{Cells, Kind};
use dialect::{Dialect, bare};
use memchr::{memchr, memchr_iter};
use rows::{Row, Rows};
use source::Source;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Rows between two looks at the progress handle.
const STRIDE: usize = 1 << 14;

/// Reads a file row by row.
pub(super) fn read(
    path: &Path,
    options: &CsvOptions,
    wanted: &Wanted,
    progress: &Progress,
) -> Result<Recording, LogError> {
    let name = path.display().to_string();
    let opened = File::open(path).and_then(|file| Ok((file.metadata()?, file)));
    let (meta, file) = opened.map_err(|e| LogError::file(&name, e.to_string()))?;
    if meta.is_dir() {
        return Err(LogError::file(&name, "is a directory, not a log"));
    }
    let what = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    progress.start(format!("reading {what}"), meta.len());
    // What is no file, such as a pipe, cannot be read by two.
    let recording = if meta.is_file() {
        let read = || parse(&name, (Hashed::beside(file), meta.len()), options, wanted, progress);
        let (recording, sha256) = hash::beside(path, read);
        recording.and_then(|recording| {
            Ok(Recording { sha256: sha256.map_err(|e| LogError::file(&name, e.to_string()))?, ..recording })
        })
    } else {
        parse(&name, (Hashed::new(file), 0), options, wanted, progress)
    };
    progress.finish();
    recording
}

/// A column that is being read.
struct Reading {
    title: String,
    unit: Option<String>,
    kind: Kind,
    values: Growing,
    /// Place and content of the first text, after which nothing more is read.
    text: Option<(String, String)>,
}

impl Reading {
    fn name_and_unit(&self) -> (&str, Option<&str>) {
        match &self.unit {
            Some(unit) => (&self.title, Some(unit)),
            None => name_and_unit(&self.title),
        }
    }

    fn wanted(&self, wanted: &Wanted, place: usize) -> bool {
        wanted.has(self.name_and_unit().0, &self.title, place)
    }
}

/// The parser itself, over any bytes, of which there are about as many as said.
pub(super) fn parse(
    file: &str,
    (from, size): (Hashed, u64),
    options: &CsvOptions,
    wanted: &Wanted,
    to: &Progress,
) -> Result<Recording, LogError> {
    let mut source = Source::open(file, from, options.encoding)?;
    let dialect = Dialect::detect(file, &source, options)?;
    let lines = source.lines(dialect.skip.0, dialect.ends);
    let mut rows = Rows::new(lines, &dialect);
    let fail = |e: io::Error| LogError::file(file, e.to_string());
    let Some(row) = rows.next().map_err(fail)? else {
        return Err(LogError::file(file, "the file is empty"));
    };
    let header = dialect.skip.1 + row.line;
    let mut columns = columns(file, row, header, &source, &dialect)?;
    if dialect.unit_row
        && let Some(row) = rows.next().map_err(fail)?
    {
        for (column, cell) in columns.iter_mut().zip(row.iter()) {
            let text = source.decode(cell);
            let text = bare(&text);
            if !text.is_empty() {
                column.unit = Some(text.to_owned());
            }
        }
    }
    let read: Vec<usize> = (0..columns.len()).filter(|place| columns[*place].wanted(wanted, *place)).collect();
    let mut samples = Lines::default();
    let mut shelf = Shelf::default();
    let mut empty = 0;
    let mut seen = 0;
    let look = |row: usize, columns: &mut [Reading], shelf: &mut Shelf, source: &Source, seen: &mut u64| {
        if row.is_multiple_of(STRIDE) {
            columns.iter_mut().try_for_each(|column| column.values.settle(shelf)).map_err(fail)?;
            to.advance(source.position() - *seen);
            *seen = source.position();
            to.check()?;
        }
        Ok::<_, LogError>(())
    };
    let mut usual = usual(&columns, &read, &dialect);
    loop {
        if let Some(usual) = &usual
            && let Some((text, length)) = rows.plain().map_err(fail)?
            && usual.read(text, length, &mut columns, samples.len())
        {
            samples.push(dialect.skip.1 + rows.pass());
            empty = 0;
            look(samples.len(), &mut columns, &mut shelf, &source, &mut seen)?;
            if samples.len() == STRIDE {
                // Columns that grow are copied again and again; the rows so far tell about how many there will be. A cell takes
                // two bytes, its separator included.
                let share = size.saturating_sub(source.position()) as f64 / source.position().max(1) as f64;
                let more = ((1.02 * share * STRIDE as f64) as u64).min(size / (2 * usual.width as u64)) as usize;
                shelf.expected = more >= LONG;
                let more = if shelf.expected { 2 * STRIDE } else { more };
                usual.places.iter().for_each(|place| columns[*place].values.reserve(more));
            }
            continue;
        }
        let Some(row) = rows.next().map_err(fail)? else { break };
        let line = dialect.skip.1 + row.line;
        let blank = row.iter().all(<[u8]>::is_empty);
        let surplus = row.len() > columns.len() && row.iter().skip(columns.len()).all(<[u8]>::is_empty);
        if row.len() != columns.len() && !surplus && !blank {
            let what = format!("{} cells, but the header has {} columns", row.len(), columns.len());
            return Err(LogError::line(file, line, what));
        }
        empty = if blank { empty + 1 } else { 0 };
        for &index in &read {
            let column = &mut columns[index];
            if column.text.is_some() {
                continue;
            }
            let cell = row.get(index).unwrap_or_default();
            match dialect.cells.value(cell, &mut column.kind) {
                Some(value) => column.values.tail.push(value),
                None => {
                    column.text = Some((format!("{file}:{line}"), source.decode(cell).into_owned()));
                    column.values = Growing::default();
                }
            }
        }
        samples.push(line);
        look(samples.len(), &mut columns, &mut shelf, &source, &mut seen)?;
        usual = self::usual(&columns, &read, &dialect);
    }
    let mut notes: Vec<String> = dialect.note.iter().cloned().collect();
    if empty > 0 {
        notes.push(format!("{empty} empty row{} at the end left out", if empty == 1 { "" } else { "s" }));
    }
    let count = samples.len() - empty;
    if count == 0 {
        return Err(LogError::line(file, header, "there is a header but no sample"));
    }
    for column in columns.iter().filter(|column| column.text.is_none()) {
        match column.kind {
            Kind::Stamp => notes.push(format!("{}: dates in UTC become s since 1970-01-01", column.title)),
            Kind::OfDay => notes.push(format!("{}: times of day become s since midnight", column.title)),
            Kind::Unknown | Kind::Number => {}
        }
    }
    drop(rows);
    let sha256 = source.sha256().map_err(|e| LogError::file(file, e.to_string()))?;
    let columns = columns.into_iter().enumerate();
    let columns = columns.map(|(place, column)| finished(column, read.binary_search(&place).is_ok(), count));
    let columns = columns.collect::<io::Result<_>>().map_err(fail)?;
    Ok(Recording {
        file: file.to_owned(),
        sha256,
        groups: vec![Group { name: String::new(), clock: Clock::Undecided, columns }],
        own: 1,
        notes,
        place: Place::Lines { header, samples },
        loader: None,
    })
}

/// How rows are read that are nothing but numbers and missing samples: in one go, without cutting them into cells first.
struct Usual<'a> {
    cells: &'a Cells,
    separator: u8,
    /// Columns of a row, and those that are read, in order.
    width: usize,
    places: Vec<usize>,
}

/// None where columns hold times, numbers have a decimal comma, or texts of the map's choice mean missing samples.
fn usual<'a>(columns: &[Reading], read: &[usize], dialect: &'a Dialect) -> Option<Usual<'a>> {
    let numbers = |place: &usize| matches!(columns[*place].kind, Kind::Number | Kind::Unknown);
    let places: Vec<usize> = read.iter().copied().filter(|place| columns[*place].text.is_none()).collect();
    let plain = dialect.cells.are_plain() && dialect.separator != b' ' && places.iter().all(numbers);
    let (cells, separator) = (&dialect.cells, dialect.separator);
    plain.then_some(Usual { cells, separator, width: columns.len(), places })
}

impl Usual<'_> {
    /// Adds the row of this length, with which a text begins, to the columns, which have `rows` values; false, with nothing
    /// added, if it is of another kind.
    fn read(&self, text: &[u8], length: usize, columns: &mut [Reading], rows: usize) -> bool {
        let read = self.try_read(text, length, columns).is_some();
        if !read {
            self.places.iter().for_each(|place| columns[*place].values.truncate(rows));
        }
        read
    }

    fn try_read(&self, text: &[u8], length: usize, columns: &mut [Reading]) -> Option<()> {
        let line = &text[..length];
        // Where the next cell begins; none behind the last one.
        let mut start = Some(0);
        let (mut next, mut filled) = (0, 0);
        for &place in &self.places {
            let mut at = start?;
            if place > next {
                at += memchr_iter(self.separator, &line[at..]).nth(place - next - 1)? + 1;
            }
            next = place + 1;
            let column = &mut columns[place];
            // Mostly a number stands alone in its cell.
            let (value, end) = match number::leading(&text[at..]) {
                Some((number, count)) if self.ends(line, at + count) => {
                    column.kind = Kind::Number;
                    (Some(number), at + count)
                }
                _ => self.other(line, at, &mut column.kind)?,
            };
            filled += usize::from(value.is_some());
            column.values.tail.push(value.unwrap_or(f64::NAN));
            start = (end < length).then_some(end + 1);
        }
        let cells = next + start.map_or(0, |start| memchr_iter(self.separator, &line[start..]).count() + 1);
        // Rows of nothing are counted elsewhere.
        (cells == self.width && filled > 0).then_some(())
    }

    #[inline]
    fn ends(&self, line: &[u8], at: usize) -> bool {
        line.get(at).is_none_or(|byte| *byte == self.separator)
    }

    /// Any cell, from a place of a line on: nothing, a number with spaces or an exponent, or a word that means a number or a
    /// missing sample; and where the cell ends.
    #[inline(never)]
    fn other(&self, line: &[u8], at: usize, kind: &mut Kind) -> Option<(Option<f64>, usize)> {
        let spaces = |at: usize| line[at..].iter().take_while(|byte| **byte == b' ').count();
        let at = at + spaces(at);
        if self.ends(line, at) {
            return Some((None, at));
        }
        if let Ok((number, count)) = fast_float2::parse_partial(&line[at..]) {
            let end = at + count + spaces(at + count);
            if self.ends(line, end) {
                *kind = Kind::Number;
                return Some((Some(number), end));
            }
        }
        let end = memchr(self.separator, &line[at..]).map_or(line.len(), |length| at + length);
        let cell = line[at..end].trim_ascii();
        let mut found = *kind;
        let value = self.cells.value(cell, &mut found).filter(|_| !cell.is_empty())?;
        if !matches!(found, Kind::Number | Kind::Unknown) {
            return None;
        }
        *kind = found;
        Some((Some(value), end))
    }
}

/// The column with so many samples.
fn finished(column: Reading, read: bool, count: usize) -> io::Result<Column> {
    let (name, unit) = column.name_and_unit();
    let (name, unit) = (name.to_owned(), unit.map(str::to_owned));
    let typed = matches!(column.kind, Kind::Stamp | Kind::OfDay);
    let unit = if typed { Some("s".to_owned()) } else { unit };
    let values = match column.text {
        None if !read => Values::Unread,
        None => Values::Numbers(column.values.finish()?.part(0..count)),
        Some((at, text)) => Values::Text { at, text },
    };
    let title = (name != column.title).then(|| column.title.clone());
    Ok(Column { name, title, unit, values, typed })
}

fn columns(file: &str, row: Row<'_>, line: u64, source: &Source, dialect: &Dialect) -> Result<Vec<Reading>, LogError> {
    let mut columns: Vec<Reading> = Vec::with_capacity(row.len());
    for (index, cell) in row.iter().enumerate() {
        let name = source.decode(cell);
        let name = name.trim();
        let name = name.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')).unwrap_or(name);
        // Spreadsheets break names over several lines.
        let name = name.split(char::is_control).collect::<Vec<_>>().join(" ");
        let title = if name.is_empty() { format!("column_{}", index + 1) } else { name };
        columns.push(Reading { title, unit: None, kind: Kind::Unknown, values: Growing::default(), text: None });
    }
    if row.iter().all(|cell| !cell.is_empty() && dialect.cells.is_value(cell)) {
        let what = "a header with the names of the columns is expected, but here are values";
        return Err(LogError::line(file, line, format!("{what}, {} first", quoted(&columns[0].title))));
    }
    Ok(columns)
}

/// Writes a log so that this reader and fmpy's `read_csv` return the same numbers.
pub(super) fn write(log: &Log, to: impl Write) -> io::Result<()> {
    let mut to = BufWriter::with_capacity(1 << 16, to);
    write!(to, "time")?;
    for channel in &log.channels {
        if channel.name.contains([',', '"', '\n', '\r']) {
            write!(to, ",\"{}\"", channel.name.replace('"', "\"\""))?;
        } else {
            write!(to, ",{}", channel.name)?;
        }
    }
    writeln!(to)?;
    for (sample, time) in log.time.iter().enumerate() {
        write!(to, "{time:?}")?;
        for channel in &log.channels {
            let value = channel.values[sample];
            if value.is_nan() {
                write!(to, ",nan")?
            } else if value.fract() == 0.0 && value.abs() < 1e15 {
                // Without a point, as flags and counters are read.
                write!(to, ",{value:.0}")?
            } else {
                // Shortest decimal that reads back as the same number.
                write!(to, ",{value:?}")?
            };
        }
        writeln!(to)?;
    }
    to.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cell() -> impl Strategy<Value = String> {
        prop_oneof![
            4 => any::<f64>().prop_map(|value| format!("{value:?}")),
            2 => (-1e6..1e6).prop_map(|value: f64| format!(" {value:.3} ")),
            2 => any::<i64>().prop_map(|value| value.to_string()),
            1 => "[0-9]{0,30}[.][0-9]{1,30}(e-?[0-9]{1,3})?",
            1 => Just(String::new()),
            1 => Just("NaN".to_owned()),
            1 => Just("NA ".to_owned()),
            1 => Just("\"2.5\"".to_owned()),
        ]
    }

    proptest! {
        /// The standard library's reading of the cells that the csv crate cuts.
        #[test]
        fn numbers_are_the_nearest_ones(rows in prop::collection::vec(prop::collection::vec(cell(), 5), 1..8)) {
            let rows: Vec<String> = rows.iter().enumerate().map(|(k, row)| format!("{k},{}", row.join(","))).collect();
            let text = format!("time,a,b,c,d,e\n{}\n", rows.join("\n"));
            let mut reader = ::csv::ReaderBuilder::new();
            let mut reader = reader.trim(::csv::Trim::All).from_reader(text.as_bytes());
            let expected: Vec<Vec<u64>> = reader
                .records()
                .map(|record| record.unwrap().iter().map(|cell| cell.parse().unwrap_or(f64::NAN).to_bits()).collect())
                .collect();
            let keep = |name: &str| name == "b" || name == "d";
            for wanted in [Wanted::all(), Wanted::new(None, &[], &keep)] {
                let options = CsvOptions::default();
                let recording = parse("log.csv", (Hashed::new(text.as_bytes()), 0), &options, &wanted, &Progress::none()).unwrap();
                for (place, column) in recording.groups[0].columns.iter().enumerate() {
                    let Values::Numbers(values) = &column.values else { continue };
                    let bits = values.iter().map(|value| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() });
                    prop_assert_eq!(bits.collect::<Vec<_>>(), expected.iter().map(|row| row[place]).collect::<Vec<_>>());
                }
            }
        }
    }
}
