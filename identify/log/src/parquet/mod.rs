//! Parquet: flat numeric columns; a null is a missing sample. Times, dates and durations become s.

mod arrow;
mod types;

use super::recording::{Clock, Column, Group, Growing, Place, Recording, Shelf, Values};
use super::{LONG, Log, LogError, Series};
use crate::guard::guarded;
use crate::progress::Progress;
use crate::wanted::Wanted;
use ::parquet::basic::{Repetition, Type as Physical};
use ::parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use ::parquet::data_type::{DataType, DoubleType};
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::file::writer::SerializedFileWriter;
use ::parquet::schema::types::Type;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use types::Meaning;

/// Reads a file column by column.
pub(super) fn read(path: &Path, wanted: &Wanted, progress: &Progress) -> Result<Recording, LogError> {
    let name = path.display().to_string();
    let file = File::open(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    // The hash takes as long as the columns.
    let (recording, sha256) = crate::hash::beside(path, || guarded(|| parse(&name, file, wanted, progress)));
    let damaged = || Err(LogError::file(&name, "the file is damaged"));
    let recording = recording.unwrap_or_else(damaged)?;
    Ok(Recording { sha256: sha256.map_err(|e| LogError::file(&name, e.to_string()))?, ..recording })
}

/// All but the hash.
fn parse(name: &str, file: File, wanted: &Wanted, progress: &Progress) -> Result<Recording, LogError> {
    let reason = |e: ParquetError| e.to_string().replace('\n', " ");
    let fail = |e: ParquetError| LogError::file(name, format!("not a readable Parquet file: {}", reason(e)));
    let reader = SerializedFileReader::new(file).map_err(fail)?;
    let meta = reader.metadata().file_metadata();
    let schema = meta.schema_descr();
    let metadata = |key: &str| find(meta.key_value_metadata(), key);
    let durations = metadata("ARROW:schema").map(arrow::durations).unwrap_or_default();
    let rows: usize =
        reader.metadata().row_groups().iter().map(|group| usize::try_from(group.num_rows()).unwrap_or(0)).sum();
    let mut columns: Vec<Column> = Vec::new();
    let mut notes = Vec::new();
    let mut shelf = Shelf::default();
    shelf.expected = rows >= LONG;
    progress.start(format!("reading {name}"), (schema.num_columns() * reader.num_row_groups()) as u64);
    for (index, column) in schema.columns().iter().enumerate() {
        let title = column.path().string();
        let meaning = match Meaning::of(column, durations.get(&title).copied()) {
            Ok(meaning) => meaning,
            Err(what) => {
                columns.push(Column::other(title, what));
                continue;
            }
        };
        if !wanted.has(&title, &title, index) {
            columns.push(Column { values: Values::Unread, ..Column::numbers(title, Vec::new()) });
            progress.advance(reader.num_row_groups() as u64);
            continue;
        }
        let mut values = Growing::default();
        if !shelf.expected {
            values.reserve(rows);
        }
        let mut damage = None;
        for group in 0..reader.num_row_groups() {
            progress.check()?;
            let read = || {
                let group = reader.get_row_group(group)?;
                let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
                append(
                    group.get_column_reader(index)?,
                    rows,
                    (meaning, column.max_def_level()),
                    &mut values,
                    &mut shelf,
                )
            };
            // A column that nobody needs shall not refuse the file.
            damage = damage.or(guarded(read)
                .unwrap_or_else(|| Err(ParquetError::General("the page is damaged".to_owned())))
                .err());
            progress.advance(1);
        }
        if let Some(damage) = damage {
            columns.push(Column::other(title, format!("data that cannot be read ({})", reason(damage))));
        } else if values.len() != rows {
            columns.push(Column::other(title, format!("{} values instead of {rows}", values.len())));
        } else {
            let values = values.finish().map_err(|error| LogError::file(name, error.to_string()))?;
            let unit = meaning.is_time().then(|| "s".to_owned());
            if meaning == Meaning::Days || meaning == Meaning::Julian {
                notes.push(format!("{title}: dates become s since 1970-01-01"));
            }
            columns.push(Column {
                name: title,
                title: None,
                unit,
                values: Values::Numbers(values),
                typed: meaning.is_time(),
            });
        }
    }
    columns.extend(metadata("pandas").and_then(|text| range_index(text, rows)));
    progress.finish();
    let groups = vec![Group { name: String::new(), clock: Clock::Undecided, columns }];
    Ok(Recording {
        file: name.to_owned(),
        sha256: String::new(),
        groups,
        own: 1,
        notes,
        place: Place::Samples,
        loader: None,
    })
}

/// A text in the file's metadata.
fn find<'a>(entries: Option<&'a Vec<KeyValue>>, key: &str) -> Option<&'a str> {
    entries?.iter().find(|entry| entry.key == key)?.value.as_deref()
}

/// The index of a pandas table that is not stored but counted: `{"kind": "range", "name": .., "start": .., "step": ..}`.
fn range_index(pandas: &str, rows: usize) -> Option<Column> {
    let pandas: serde_json::Value = serde_json::from_str(pandas).ok()?;
    let index = pandas
        .get("index_columns")?
        .as_array()?
        .iter()
        .find(|index| index.get("kind").is_some_and(|k| k == "range"))?;
    let (name, start, step) =
        (index.get("name")?.as_str()?, index.get("start")?.as_f64()?, index.get("step")?.as_f64()?);
    Some(Column::numbers(name, (0..rows).map(|row| start + row as f64 * step).collect::<Series>()))
}

/// Appends a column chunk, NaN below the definition level `top`.
fn append(
    reader: ColumnReader,
    rows: usize,
    (meaning, top): (Meaning, i16),
    to: &mut Growing,
    shelf: &mut Shelf,
) -> Result<(), ParquetError> {
    let rows = (rows, top);
    let to = (to, shelf);
    match reader {
        ColumnReader::BoolColumnReader(reader) => typed(reader, rows, |v| f64::from(u8::from(*v)), to),
        ColumnReader::Int32ColumnReader(reader) => typed(reader, rows, |v| meaning.of_i32(*v), to),
        ColumnReader::Int64ColumnReader(reader) => typed(reader, rows, |v| meaning.of_i64(*v), to),
        ColumnReader::Int96ColumnReader(reader) => typed(reader, rows, |v| meaning.of_int96(v), to),
        ColumnReader::FloatColumnReader(reader) => typed(reader, rows, |v| f64::from(*v), to),
        ColumnReader::DoubleColumnReader(reader) => doubles(reader, rows, to),
        ColumnReader::ByteArrayColumnReader(reader) => typed(reader, rows, |v| meaning.of_bytes(v.data()), to),
        ColumnReader::FixedLenByteArrayColumnReader(reader) => typed(reader, rows, |v| meaning.of_bytes(v.data()), to),
    }
}

/// Values that are read at once; with their levels they fit the second-level cache.
const PIECE: usize = 1 << 14;

/// Reads all values of a column chunk of doubles, which are what a log holds: straight to their place.
fn doubles(
    mut reader: ColumnReaderImpl<DoubleType>,
    (rows, top): (usize, i16),
    (all, shelf): (&mut Growing, &mut Shelf),
) -> Result<(), ParquetError> {
    let mut levels = Vec::new();
    let mut left = rows;
    all.reserve(rows.min(PIECE));
    while left > 0 {
        levels.clear();
        let to = &mut all.tail;
        let first = to.len();
        let (records, present, count) = reader.read_records(left.min(PIECE), Some(&mut levels), None, to)?;
        if records == 0 {
            return Err(ended(left));
        }
        // Missing values are not stored: what is stored moves behind them, the last one first.
        if present < count.min(levels.len()) {
            to.resize(first + count, f64::NAN);
            let mut from = first + present;
            for (k, level) in levels[..count].iter().enumerate().rev() {
                to[first + k] = if *level == top && from > first {
                    from -= 1;
                    to[from]
                } else {
                    f64::NAN
                };
            }
        }
        all.settle(shelf)?;
        left -= records;
    }
    Ok(())
}

fn ended(left: usize) -> ParquetError {
    ParquetError::General(format!("a column ends {left} values early"))
}

/// Reads all values of a column chunk in pieces.
fn typed<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    (rows, top): (usize, i16),
    number: impl Fn(&T::T) -> f64,
    (all, shelf): (&mut Growing, &mut Shelf),
) -> Result<(), ParquetError> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    let mut left = rows;
    while left > 0 {
        levels.clear();
        values.clear();
        let (records, _, count) = reader.read_records(left.min(PIECE), Some(&mut levels), None, &mut values)?;
        if records == 0 {
            return Err(ended(left));
        }
        let to = &mut all.tail;
        let mut present = values.iter().map(&number);
        if levels[..count.min(levels.len())].iter().all(|level| *level == top) {
            to.extend(present);
        } else {
            let filled = levels[..count].iter().map(|level| if *level == top { present.next() } else { None });
            to.extend(filled.map(|value| value.unwrap_or(f64::NAN)));
        }
        all.settle(shelf)?;
        left -= records;
    }
    Ok(())
}

/// Writes all channels as optional doubles; missing samples become nulls.
pub(super) fn write(log: &Log, to: impl Write + Send) -> Result<(), ParquetError> {
    let field = |name: &str, repetition| {
        Type::primitive_type_builder(name, Physical::DOUBLE).with_repetition(repetition).build().map(Arc::new)
    };
    let mut fields = vec![field("time", Repetition::REQUIRED)?];
    for channel in &log.channels {
        fields.push(field(&channel.name, Repetition::OPTIONAL)?);
    }
    let schema = Arc::new(Type::group_type_builder("log").with_fields(fields).build()?);
    let mut writer = SerializedFileWriter::new(to, schema, Arc::new(WriterProperties::builder().build()))?;
    let mut group = writer.next_row_group()?;
    let mut index = 0;
    while let Some(mut column) = group.next_column()? {
        let typed = column.typed::<DoubleType>();
        if index == 0 {
            typed.write_batch(&log.time, None, None)?;
        } else {
            let values = &log.channels[index - 1].values;
            let levels: Vec<i16> = values.iter().map(|value| i16::from(!value.is_nan())).collect();
            let present: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
            typed.write_batch(&present, Some(&levels), None)?;
        }
        column.close()?;
        index += 1;
    }
    group.close()?;
    writer.close()?;
    Ok(())
}
