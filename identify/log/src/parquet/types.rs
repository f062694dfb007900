//! What a Parquet column's numbers mean.

use half::f16;
use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type as Physical};
use parquet::data_type::Int96;
use parquet::schema::types::ColumnDescriptor;

/// The Julian day number of 1970-01-01.
const JULIAN_1970: i64 = 2_440_588;
const DAY: f64 = 86_400.0;

/// How stored values become numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meaning {
    /// The stored number.
    Plain,
    Unsigned,
    /// A time or duration: units per second.
    Time(i64),
    /// Days since 1970.
    Days,
    /// A whole number, and how many of its digits stand behind the point.
    Decimal(i32),
    /// Two bytes that are a float.
    Half,
    /// A Julian day and nanoseconds of it, as Spark and Impala wrote times.
    Julian,
}

impl Meaning {
    /// Whether the column holds times, which become s.
    pub fn is_time(self) -> bool {
        matches!(self, Self::Time(_) | Self::Days | Self::Julian)
    }

    /// What a column's numbers mean; the error says in words what it holds instead of numbers.
    pub fn of(column: &ColumnDescriptor, duration: Option<i64>) -> Result<Self, String> {
        if column.max_rep_level() > 0 {
            return Err("lists".to_owned());
        }
        let per_second = |unit: &TimeUnit| match unit {
            TimeUnit::MILLIS => 1_000,
            TimeUnit::MICROS => 1_000_000,
            TimeUnit::NANOS => 1_000_000_000,
        };
        let meaning = match column.logical_type_ref() {
            Some(LogicalType::Timestamp(time) | LogicalType::Time(time)) => Self::Time(per_second(&time.unit)),
            Some(LogicalType::Date) => Self::Days,
            Some(LogicalType::Decimal(decimal)) => Self::Decimal(decimal.scale),
            Some(LogicalType::Float16) => Self::Half,
            Some(LogicalType::Integer(integer)) if !integer.is_signed => Self::Unsigned,
            Some(LogicalType::Integer(_)) => Self::Plain,
            Some(LogicalType::Unknown) => return Err("nothing but missing values of no type".to_owned()),
            Some(_) => return Err(format!("{:?}", column.converted_type()).to_lowercase()),
            None => match column.converted_type() {
                ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS => Self::Time(1_000),
                ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS => Self::Time(1_000_000),
                ConvertedType::DATE => Self::Days,
                ConvertedType::DECIMAL => Self::Decimal(column.type_scale()),
                ConvertedType::UINT_8 | ConvertedType::UINT_16 | ConvertedType::UINT_32 | ConvertedType::UINT_64 => {
                    Self::Unsigned
                }
                ConvertedType::NONE
                | ConvertedType::INT_8
                | ConvertedType::INT_16
                | ConvertedType::INT_32
                | ConvertedType::INT_64 => Self::Plain,
                other => return Err(format!("{other:?}").to_lowercase()),
            },
        };
        let meaning = duration.filter(|_| meaning == Self::Plain).map_or(meaning, Self::Time);
        match (column.physical_type(), meaning) {
            (Physical::INT96, Self::Plain) => Ok(Self::Julian),
            (Physical::BOOLEAN | Physical::FLOAT | Physical::DOUBLE, Self::Plain)
            | (
                Physical::INT32 | Physical::INT64,
                Self::Plain | Self::Unsigned | Self::Time(_) | Self::Days | Self::Decimal(_),
            )
            | (Physical::BYTE_ARRAY, Self::Decimal(_)) => Ok(meaning),
            (Physical::FIXED_LEN_BYTE_ARRAY, Self::Half) if column.type_length() == 2 => Ok(meaning),
            (Physical::FIXED_LEN_BYTE_ARRAY, Self::Decimal(_)) if column.type_length() <= 16 => Ok(meaning),
            (Physical::FIXED_LEN_BYTE_ARRAY, Self::Decimal(_)) => Err("decimals of more than 38 digits".to_owned()),
            _ => Err("bytes".to_owned()),
        }
    }

    pub fn of_i32(self, value: i32) -> f64 {
        match self {
            Self::Unsigned => f64::from(value as u32),
            Self::Days => f64::from(value) * DAY,
            _ => self.of_i64(i64::from(value)),
        }
    }

    pub fn of_i64(self, value: i64) -> f64 {
        match self {
            Self::Unsigned => value as u64 as f64,
            Self::Time(per_second) => seconds(value, per_second),
            Self::Days => value as f64 * DAY,
            Self::Decimal(scale) => decimal(value.into(), scale),
            _ => value as f64,
        }
    }

    /// Nanoseconds of the day in the lower two words, the Julian day in the third.
    pub fn of_int96(self, value: &Int96) -> f64 {
        let [low, high, day] = *value.data() else { return f64::NAN };
        let nanoseconds = i64::from(high) << 32 | i64::from(low);
        (i64::from(day) - JULIAN_1970) as f64 * DAY + seconds(nanoseconds, 1_000_000_000)
    }

    /// Bytes, the highest first; NaN if they are more than a number has.
    pub fn of_bytes(self, bytes: &[u8]) -> f64 {
        match (self, bytes) {
            (Self::Half, [low, high]) => f16::from_le_bytes([*low, *high]).to_f64(),
            (Self::Decimal(scale), [first, ..]) if bytes.len() <= 16 => {
                let sign = if first & 0x80 != 0 { -1 } else { 0 };
                decimal(bytes.iter().fold(sign, |word: i128, byte| word << 8 | i128::from(*byte)), scale)
            }
            _ => f64::NAN,
        }
    }
}

/// A number of units as s: rounded once, or, beyond what a float holds exactly, as whole seconds and the rest.
fn seconds(value: i64, per_second: i64) -> f64 {
    if value.unsigned_abs() < 1 << 53 {
        return value as f64 / per_second as f64;
    }
    (value / per_second) as f64 + (value % per_second) as f64 / per_second as f64
}

/// `value / 10^scale`, rounded once.
fn decimal(value: i128, scale: i32) -> f64 {
    // Both are exact up to here, and a quotient of exact numbers is rounded once.
    if value.unsigned_abs() < 1 << 53 && (0..=22).contains(&scale) {
        return value as f64 / 10_f64.powi(scale);
    }
    format!("{value}e{}", -scale).parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_decimals_are_rounded_once() {
        let nearest = |text: &str| text.parse::<f64>().unwrap();
        assert_eq!(seconds(1_700_000_000_123_456_789, 1_000_000_000), nearest("1700000000.123456789"));
        assert_eq!(seconds(-1, 1_000), -0.001);
        assert_eq!(decimal(-12_345, 3), -12.345);
        assert_eq!(decimal(123_456_789_012_345_678_901_234_567_890, 10), nearest("12345678901234567890.123456789"));
        assert_eq!(Meaning::Decimal(2).of_bytes(&[0xff, 0x9c]), -1.0);
        assert_eq!(Meaning::Unsigned.of_i32(-1), 4_294_967_295.0);
        assert_eq!(Meaning::Half.of_bytes(&[0x00, 0x3c]), 1.0);
    }
}
