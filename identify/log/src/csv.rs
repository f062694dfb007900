//! CSV: header row, comma, `.` decimal; empty or `nan` is a missing sample.

use super::columns::ColumnMap;
use super::error::quoted;
use super::table::{Place, Table, time_column};
use super::{Log, LogError};
use crate::progress::Progress;
use ::csv::{ByteRecord, ReaderBuilder, Trim};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;

/// Rows between two looks at the progress handle.
const STRIDE: usize = 1 << 14;

/// Reads a file row by row. Text is an error, except in columns that a given map does not use.
pub(super) fn read(path: &Path, map: Option<&ColumnMap>, progress: &Progress) -> Result<Table, LogError> {
    let name = path.display().to_string();
    let opened = File::open(path).and_then(|file| Ok((file.metadata()?, file)));
    let (meta, file) = opened.map_err(|e| LogError::file(&name, e.to_string()))?;
    if meta.is_dir() {
        return Err(LogError::file(&name, "is a directory, not a log"));
    }
    let what = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    progress.start(format!("reading {what}"), meta.len());
    let table = parse(&name, file, map, progress);
    progress.finish();
    table
}

/// The parser itself, over any bytes.
pub(super) fn parse(file: &str, from: impl Read, map: Option<&ColumnMap>, to: &Progress) -> Result<Table, LogError> {
    let from = Lines { from, hash: Sha256::new(), ended: true };
    let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).trim(Trim::All).from_reader(from);
    let mut record = ByteRecord::new();
    let fail = |e: ::csv::Error| LogError::file(file, e.to_string());
    if !reader.read_byte_record(&mut record).map_err(fail)? {
        return Err(LogError::file(file, "the file is empty"));
    }
    let mut columns = header(file, &record, reader.position().line().saturating_sub(1))?;
    if map.is_none() {
        // Better said before the first number fails to parse.
        time_column(file, &columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>())?;
    }
    let mut lines = Vec::new();
    let mut seen = 0;
    while reader.read_byte_record(&mut record).map_err(fail)? {
        // The reader stands behind the line feed of this record.
        let line = reader.position().line().saturating_sub(1);
        if record.len() != columns.len() {
            let what = format!("{} cells, but the header has {} columns", record.len(), columns.len());
            return Err(LogError::line(file, line, what));
        }
        for (column, cell) in columns.iter_mut().zip(&record) {
            if column.text.is_some() {
                continue;
            }
            match number(cell) {
                Some(value) => column.values.push(value),
                None => {
                    let text = String::from_utf8_lossy(cell).into_owned();
                    let spare = map.is_some_and(|map| !map.uses(&column.name));
                    if !spare {
                        let what = format!("column {}: {} is not a number", quoted(&column.name), quoted(&text));
                        return Err(LogError::line(file, line, what));
                    }
                    column.text = Some((format!("{file}:{line}"), text));
                    column.values = Vec::new();
                }
            }
        }
        lines.push(u32::try_from(line).unwrap_or(u32::MAX));
        if lines.len() % STRIDE == 0 {
            let position = reader.position().byte();
            to.advance(position - seen);
            seen = position;
            to.check()?;
        }
    }
    if lines.is_empty() {
        return Err(LogError::line(file, 1, "there is a header but no sample"));
    }
    let sha256 = reader.into_inner().finish().map_err(|e| LogError::file(file, e.to_string()))?;
    let mut table = Table { file: file.to_owned(), sha256, columns: vec![], texts: vec![], place: Place::Lines(lines) };
    for column in columns {
        match column.text {
            None => table.columns.push((column.name, column.values)),
            Some((at, text)) => table.texts.push((column.name, at, text)),
        }
    }
    Ok(table)
}

struct Column {
    name: String,
    values: Vec<f64>,
    /// Place and content of the first text, if the column is left out for it.
    text: Option<(String, String)>,
}

fn header(file: &str, record: &ByteRecord, line: u64) -> Result<Vec<Column>, LogError> {
    if let Some(kind) = foreign(record.get(0).unwrap_or_default()) {
        return Err(LogError::file(file, format!("is no CSV file but {kind}")));
    }
    let mut columns: Vec<Column> = Vec::with_capacity(record.len());
    for (index, cell) in record.iter().enumerate() {
        // A byte order mark belongs to the file, not to the first name.
        let cell = if index == 0 { cell.strip_prefix(b"\xef\xbb\xbf").unwrap_or(cell) } else { cell };
        let Ok(name) = std::str::from_utf8(cell) else {
            return Err(LogError::line(file, line, format!("the name of column {} is not UTF-8 text", index + 1)));
        };
        let name = name.trim();
        let name = name.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')).unwrap_or(name);
        let name = if name.is_empty() { format!("column_{}", index + 1) } else { name.to_owned() };
        if let Some(twin) = columns.iter().position(|column| column.name == name) {
            let what = format!("columns {} and {} are both named {}", twin + 1, index + 1, quoted(&name));
            return Err(LogError::line(file, line, what));
        }
        columns.push(Column { name, values: Vec::new(), text: None });
    }
    Ok(columns)
}

/// What a file is that begins like this, if it is no text in UTF-8.
fn foreign(start: &[u8]) -> Option<&'static str> {
    match start {
        [0x1f, 0x8b, ..] => Some("compressed (gzip); unpack it first"),
        [b'P', b'K', 3, 4, ..] => Some("a zip archive or a spreadsheet; unpack it or save it as CSV first"),
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Some("text in UTF-16; save it in UTF-8 first"),
        _ if start.contains(&0) => Some("binary"),
        _ => None,
    }
}

/// A cell as a number: NaN if empty, `None` if it is text. Booleans as fmpy writes them are 0 and 1.
fn number(cell: &[u8]) -> Option<f64> {
    match cell {
        b"" => Some(f64::NAN),
        b"True" | b"true" => Some(1.0),
        b"False" | b"false" => Some(0.0),
        _ => std::str::from_utf8(cell).ok()?.parse().ok(),
    }
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

/// Passes lines on that all end in a single line feed, so that lines can be counted, and remembers
/// the SHA-256 of the original bytes.
struct Lines<R> {
    from: R,
    hash: Sha256,
    /// The last byte passed on was a line feed.
    ended: bool,
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let count = self.from.read(buffer)?;
            self.hash.update(&buffer[..count]);
            if count == 0 && !self.ended && !buffer.is_empty() {
                buffer[0] = b'\n';
                self.ended = true;
                return Ok(1);
            }
            let mut kept = 0;
            for index in 0..count {
                if buffer[index] != b'\r' {
                    buffer[kept] = buffer[index];
                    kept += 1;
                }
            }
            if kept > 0 {
                self.ended = buffer[kept - 1] == b'\n';
            }
            if kept > 0 || count == 0 {
                return Ok(kept);
            }
        }
    }
}

impl<R: Read> Lines<R> {
    fn finish(mut self) -> io::Result<String> {
        io::copy(&mut self, &mut io::sink())?;
        Ok(hexadecimal(&self.hash.finalize()))
    }
}

/// SHA-256 of a whole file, hexadecimal.
#[cfg(any(feature = "parquet", feature = "mf4"))]
pub(super) fn sha256(path: &Path) -> io::Result<String> {
    Lines { from: File::open(path)?, hash: Sha256::new(), ended: true }.finish()
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
