//! Parquet: flat numeric columns; a null is a missing sample.

use super::error::quoted;
use super::table::{Place, Table};
use super::{Log, LogError};
use crate::guard::guarded;
use crate::progress::Progress;
use ::parquet::basic::{LogicalType, Repetition, TimeUnit, Type as Physical};
use ::parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use ::parquet::data_type::{DataType, DoubleType};
use ::parquet::errors::ParquetError;
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::file::writer::SerializedFileWriter;
use ::parquet::schema::types::{ColumnDescriptor, Type};
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Reads a file column by column.
pub(super) fn read(path: &Path, progress: &Progress) -> Result<Table, LogError> {
    let name = path.display().to_string();
    guarded(|| parse(path, progress)).unwrap_or_else(|| Err(LogError::file(&name, "the file is damaged")))
}

fn parse(path: &Path, progress: &Progress) -> Result<Table, LogError> {
    let name = path.display().to_string();
    let file = File::open(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    let sha256 = super::csv::sha256(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    let fail = |e: ParquetError| {
        LogError::file(&name, format!("not a readable Parquet file: {}", e.to_string().replace('\n', " ")))
    };
    let reader = SerializedFileReader::new(file).map_err(fail)?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
    let mut texts = Vec::new();
    progress.start(format!("reading {name}"), (schema.num_columns() * reader.num_row_groups()) as u64);
    for (index, column) in schema.columns().iter().enumerate() {
        let title = column.path().string();
        if columns.iter().any(|(other, _)| *other == title) {
            return Err(LogError::file(&name, format!("two columns are named {}", quoted(&title))));
        }
        let Some(factor) = to_number(column) else {
            let kind = column.converted_type().to_string();
            let kind = if kind == "NONE" { column.physical_type().to_string() } else { kind };
            texts.push((title, name.clone(), kind));
            continue;
        };
        let mut values = Vec::new();
        for group in 0..reader.num_row_groups() {
            progress.check()?;
            let group = reader.get_row_group(group).map_err(fail)?;
            let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            let reader = group.get_column_reader(index).map_err(fail)?;
            append(reader, rows, (factor, column.max_def_level()), &mut values).map_err(fail)?;
            progress.advance(1);
        }
        columns.push((title, values));
    }
    progress.finish();
    if let Some((title, values)) = columns.iter().find(|(_, values)| values.len() != columns[0].1.len()) {
        let what = format!("column {} has {} values instead of {}", quoted(title), values.len(), columns[0].1.len());
        return Err(LogError::file(&name, what));
    }
    Ok(Table { file: name, sha256, columns, texts, place: Place::Samples })
}

/// The factor that turns a column's numbers into a plain number or seconds; `None` if it is no number.
fn to_number(column: &ColumnDescriptor) -> Option<f64> {
    let scale = match column.logical_type_ref() {
        Some(LogicalType::Timestamp(time) | LogicalType::Time(time)) => match time.unit {
            TimeUnit::MILLIS => 1e-3,
            TimeUnit::MICROS => 1e-6,
            TimeUnit::NANOS => 1e-9,
        },
        Some(LogicalType::Decimal(decimal)) => 0.1_f64.powi(decimal.scale),
        _ => 1.0,
    };
    let numeric = matches!(
        column.physical_type(),
        Physical::BOOLEAN | Physical::INT32 | Physical::INT64 | Physical::FLOAT | Physical::DOUBLE
    );
    (numeric && column.max_rep_level() == 0).then_some(scale)
}

/// Appends a column chunk: `number * factor`, NaN below the definition level `top`.
fn append(reader: ColumnReader, rows: usize, (factor, top): (f64, i16), to: &mut Vec<f64>) -> Result<(), ParquetError> {
    match reader {
        ColumnReader::BoolColumnReader(reader) => typed(reader, (rows, top), |v| f64::from(u8::from(*v)), to),
        ColumnReader::Int32ColumnReader(reader) => typed(reader, (rows, top), |v| f64::from(*v) * factor, to),
        ColumnReader::Int64ColumnReader(reader) => typed(reader, (rows, top), |v| *v as f64 * factor, to),
        ColumnReader::FloatColumnReader(reader) => typed(reader, (rows, top), |v| f64::from(*v), to),
        ColumnReader::DoubleColumnReader(reader) => typed(reader, (rows, top), |v| *v, to),
        _ => Err(ParquetError::General("a column changed its type".to_owned())),
    }
}

/// Reads all values of a column chunk in pieces.
fn typed<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    (rows, top): (usize, i16),
    number: impl Fn(&T::T) -> f64,
    to: &mut Vec<f64>,
) -> Result<(), ParquetError> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    let mut left = rows;
    while left > 0 {
        levels.clear();
        values.clear();
        let (records, _, count) = reader.read_records(left.min(1 << 16), Some(&mut levels), None, &mut values)?;
        if records == 0 {
            return Err(ParquetError::General(format!("a column ends {left} values early")));
        }
        let mut present = values.iter().map(&number);
        if levels.is_empty() {
            to.extend(present);
        } else {
            let filled = levels[..count].iter().map(|level| if *level == top { present.next() } else { None });
            to.extend(filled.map(|value| value.unwrap_or(f64::NAN)));
        }
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
