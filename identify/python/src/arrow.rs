//! Tables of Arrow's C stream interface, which pandas, polars, pyarrow and others speak.

use crate::error::{error, log_error};
use arrow_array::cast::AsArray;
use arrow_array::ffi_stream::{FFI_ArrowArrayStream, RecordBatchStreamReader};
use arrow_array::types::*;
use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, Float64Array, RecordBatch, RecordBatchIterator, RecordBatchReader,
};
use arrow_buffer::{Buffer, ScalarBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema, TimeUnit};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use std::ffi::CStr;
use std::sync::Arc;
use wheelstate_identify::log::{Log, Samples, TableColumn};

/// Name of the capsules, by the interface.
const STREAM: &CStr = c"arrow_array_stream";
const DAY: f64 = 86_400.0;

/// The samples of one channel, or the times, of a log that stays as long as somebody looks at them.
struct Owned {
    log: Arc<Log>,
    /// The channel; the times if none.
    channel: Option<usize>,
}

impl AsRef<[u8]> for Owned {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(match self.channel {
            Some(channel) => &self.log.channels[channel].values,
            None => &self.log.time,
        })
    }
}

/// A log as a stream of one batch whose columns are the log's own memory: `time` and the channels, as doubles; NaN is a
/// missing sample.
pub fn export<'py>(py: Python<'py>, log: &Arc<Log>) -> PyResult<Bound<'py, PyCapsule>> {
    let column = |channel: Option<usize>| -> ArrayRef {
        let bytes = bytes::Bytes::from_owner(Owned { log: log.clone(), channel });
        let values = ScalarBuffer::new(Buffer::from(bytes), 0, log.len());
        Arc::new(Float64Array::new(values, None))
    };
    let names = std::iter::once("time").chain(log.channels.iter().map(|channel| channel.name.as_str()));
    let fields: Vec<Field> = names.map(|name| Field::new(name, DataType::Float64, false)).collect();
    let columns = std::iter::once(None).chain((0..log.channels.len()).map(Some)).map(column).collect();
    let schema = Arc::new(Schema::new(fields));
    let batch = RecordBatch::try_new(schema.clone(), columns).map_err(error)?;
    let reader = RecordBatchIterator::new([Ok::<_, ArrowError>(batch)], schema);
    PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(Box::new(reader)), STREAM)
}

/// The columns of anything that gives an Arrow stream.
pub fn import(table: &Bound<PyAny>) -> PyResult<Vec<TableColumn>> {
    let capsule = table.call_method0("__arrow_c_stream__")?;
    let capsule = capsule.cast::<PyCapsule>().map_err(|_| PyTypeError::new_err("an Arrow stream is expected"))?;
    let stream = capsule.pointer_checked(Some(STREAM))?.cast::<FFI_ArrowArrayStream>();
    // SAFETY: a capsule of this name holds such a stream, and the reader takes it over: what is left is released.
    #[allow(unsafe_code)]
    let reader = unsafe { RecordBatchStreamReader::from_raw(stream.as_ptr()) }.map_err(log_error)?;
    let mut columns: Vec<TableColumn> = reader
        .schema()
        .fields()
        .iter()
        .map(|field| TableColumn { name: field.name().clone(), samples: empty(field.data_type()) })
        .collect();
    for batch in reader {
        let batch = batch.map_err(log_error)?;
        for (column, array) in columns.iter_mut().zip(batch.columns()) {
            if let Samples::Numbers(values) | Samples::Times(values) = &mut column.samples {
                append(array.as_ref(), values);
            }
        }
    }
    Ok(columns)
}

/// What a column of this type will hold.
fn empty(of: &DataType) -> Samples {
    match of {
        DataType::Timestamp(..)
        | DataType::Date32
        | DataType::Date64
        | DataType::Time32(_)
        | DataType::Time64(_)
        | DataType::Duration(_) => Samples::Times(Vec::new()),
        DataType::Boolean | DataType::Decimal128(..) => Samples::Numbers(Vec::new()),
        of if of.is_numeric()
            && !matches!(of, DataType::Decimal32(..) | DataType::Decimal64(..) | DataType::Decimal256(..)) =>
        {
            Samples::Numbers(Vec::new())
        }
        DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View => Samples::Other("text".to_owned()),
        other => Samples::Other(other.to_string()),
    }
}

/// Appends what an array holds; a null is NaN.
fn append(array: &dyn Array, to: &mut Vec<f64>) {
    match array.data_type() {
        DataType::Float64 => numbers::<Float64Type>(array, |v| v, to),
        DataType::Float32 => numbers::<Float32Type>(array, f64::from, to),
        DataType::Float16 => numbers::<Float16Type>(array, half::f16::to_f64, to),
        DataType::Int8 => numbers::<Int8Type>(array, f64::from, to),
        DataType::Int16 => numbers::<Int16Type>(array, f64::from, to),
        DataType::Int32 => numbers::<Int32Type>(array, f64::from, to),
        DataType::Int64 => numbers::<Int64Type>(array, |v| v as f64, to),
        DataType::UInt8 => numbers::<UInt8Type>(array, f64::from, to),
        DataType::UInt16 => numbers::<UInt16Type>(array, f64::from, to),
        DataType::UInt32 => numbers::<UInt32Type>(array, f64::from, to),
        DataType::UInt64 => numbers::<UInt64Type>(array, |v| v as f64, to),
        DataType::Boolean => {
            to.extend(array.as_boolean().iter().map(|v| v.map_or(f64::NAN, |v| f64::from(u8::from(v)))));
        }
        DataType::Decimal128(_, scale) => {
            let scale = -i32::from(*scale);
            numbers::<Decimal128Type>(array, |v| format!("{v}e{scale}").parse().unwrap_or(f64::NAN), to);
        }
        DataType::Date32 => numbers::<Date32Type>(array, |v| f64::from(v) * DAY, to),
        DataType::Date64 => numbers::<Date64Type>(array, |v| seconds(v, &TimeUnit::Millisecond), to),
        DataType::Time32(TimeUnit::Second) => numbers::<Time32SecondType>(array, f64::from, to),
        DataType::Time32(_) => numbers::<Time32MillisecondType>(array, |v| f64::from(v) / 1e3, to),
        DataType::Time64(TimeUnit::Nanosecond) => {
            numbers::<Time64NanosecondType>(array, |v| seconds(v, &TimeUnit::Nanosecond), to)
        }
        DataType::Time64(_) => numbers::<Time64MicrosecondType>(array, |v| seconds(v, &TimeUnit::Microsecond), to),
        DataType::Timestamp(unit @ TimeUnit::Second, _) => {
            numbers::<TimestampSecondType>(array, |v| seconds(v, unit), to)
        }
        DataType::Timestamp(unit @ TimeUnit::Millisecond, _) => {
            numbers::<TimestampMillisecondType>(array, |v| seconds(v, unit), to);
        }
        DataType::Timestamp(unit @ TimeUnit::Microsecond, _) => {
            numbers::<TimestampMicrosecondType>(array, |v| seconds(v, unit), to);
        }
        DataType::Timestamp(unit @ TimeUnit::Nanosecond, _) => {
            numbers::<TimestampNanosecondType>(array, |v| seconds(v, unit), to);
        }
        DataType::Duration(unit @ TimeUnit::Second) => numbers::<DurationSecondType>(array, |v| seconds(v, unit), to),
        DataType::Duration(unit @ TimeUnit::Millisecond) => {
            numbers::<DurationMillisecondType>(array, |v| seconds(v, unit), to);
        }
        DataType::Duration(unit @ TimeUnit::Microsecond) => {
            numbers::<DurationMicrosecondType>(array, |v| seconds(v, unit), to);
        }
        DataType::Duration(unit @ TimeUnit::Nanosecond) => {
            numbers::<DurationNanosecondType>(array, |v| seconds(v, unit), to);
        }
        // what `empty` calls no numbers is not asked for
        _ => to.extend(std::iter::repeat_n(f64::NAN, array.len())),
    }
}

/// The values of a primitive array as numbers.
fn numbers<T: ArrowPrimitiveType>(array: &dyn Array, number: impl Fn(T::Native) -> f64, to: &mut Vec<f64>) {
    let array = array.as_primitive::<T>();
    if array.null_count() == 0 {
        to.extend(array.values().iter().map(|value| number(*value)));
    } else {
        to.extend(array.iter().map(|value| value.map_or(f64::NAN, &number)));
    }
}

/// A number of units in s: whole seconds and the rest, so that nanoseconds since 1970 lose as little as a double can.
fn seconds(value: i64, unit: &TimeUnit) -> f64 {
    let per_second = match unit {
        TimeUnit::Second => 1,
        TimeUnit::Millisecond => 1_000,
        TimeUnit::Microsecond => 1_000_000,
        TimeUnit::Nanosecond => 1_000_000_000,
    };
    if value.unsigned_abs() < 1 << 53 {
        return value as f64 / per_second as f64;
    }
    (value / per_second) as f64 + (value % per_second) as f64 / per_second as f64
}
