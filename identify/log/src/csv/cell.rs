//! One cell of a CSV file.

use chrono::{DateTime, NaiveDate, NaiveDateTime, NaiveTime};

/// Texts that mean a missing sample, as Excel, R, pandas, MATLAB and Julia write them.
const MISSING: [&str; 22] = [
    "nan", "NaN", "NAN", "-nan", "NA", "N/A", "n/a", "#N/A", "#NA", "<NA>", "<N/A>", "NaT", "null", "NULL", "Null",
    "None", "none", "missing", "--", "-", "?", "1.#QNAN",
];

/// What the cells of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Nothing but missing samples so far.
    Unknown,
    Number,
    /// A date and a time of day, as s since 1970-01-01 00:00 UTC.
    Stamp,
    /// A time of day, as s since midnight.
    OfDay,
}

/// How cells are written.
#[derive(Clone, Debug)]
pub struct Cells {
    pub decimal: u8,
    /// Further texts that mean a missing sample.
    pub missing: Vec<String>,
}

impl Cells {
    /// A cell as a number, NaN if it is missing; `None` if it does not fit the column.
    #[inline]
    pub fn value(&self, cell: &[u8], kind: &mut Kind) -> Option<f64> {
        if cell.is_empty() {
            return Some(f64::NAN);
        }
        if matches!(kind, Kind::Number | Kind::Unknown)
            && let Some(number) = self.number(cell)
        {
            *kind = Kind::Number;
            return Some(if self.missing.is_empty() || !self.is_marker(cell) { number } else { f64::NAN });
        }
        self.unusual(cell, kind)
    }

    /// Whether numbers are written as most programs do.
    pub fn are_plain(&self) -> bool {
        self.decimal == b'.' && self.missing.is_empty()
    }

    fn is_marker(&self, cell: &[u8]) -> bool {
        self.missing.iter().any(|text| text.as_bytes() == cell)
    }

    /// Everything but a plain number.
    #[cold]
    fn unusual(&self, cell: &[u8], kind: &mut Kind) -> Option<f64> {
        let text = std::str::from_utf8(cell).ok()?;
        if MISSING.contains(&text) || self.is_marker(cell) {
            return Some(f64::NAN);
        }
        let (found, value) = match text {
            "True" | "true" | "TRUE" => (Kind::Number, 1.0),
            "False" | "false" | "FALSE" => (Kind::Number, 0.0),
            _ => match stamp(text) {
                Some(value) => (Kind::Stamp, value),
                None => (Kind::OfDay, of_day(text)?),
            },
        };
        if *kind == Kind::Unknown {
            *kind = found;
        }
        (*kind == found).then_some(value)
    }

    #[inline]
    fn number(&self, cell: &[u8]) -> Option<f64> {
        if self.decimal == b'.' {
            return fast_float2::parse(cell).ok();
        }
        let mut digits = [0; 64];
        let digits = digits.get_mut(..cell.len())?;
        digits.copy_from_slice(cell);
        for digit in digits.iter_mut() {
            match digit {
                b'.' => return None,
                b',' => *digit = b'.',
                _ => {}
            }
        }
        fast_float2::parse(digits).ok()
    }

    /// Whether a cell is a number, a truth value, a time or a missing sample.
    pub fn is_value(&self, cell: &[u8]) -> bool {
        self.value(cell, &mut Kind::Unknown).is_some()
    }
}

/// A date and time of ISO 8601 or RFC 3339, s since 1970 in UTC; without a zone it is taken as UTC.
fn stamp(text: &str) -> Option<f64> {
    if !text.as_bytes().first()?.is_ascii_digit() || text.len() < 8 {
        return None;
    }
    if let Ok(time) = DateTime::parse_from_rfc3339(text) {
        return Some(seconds(time.timestamp(), time.timestamp_subsec_nanos()));
    }
    for form in ["%Y-%m-%dT%H:%M:%S%.f%#z", "%Y-%m-%d %H:%M:%S%.f%#z", "%Y%m%dT%H%M%S%.f%#z"] {
        if let Ok(time) = DateTime::parse_from_str(text, form) {
            return Some(seconds(time.timestamp(), time.timestamp_subsec_nanos()));
        }
    }
    let dotted = text.replace(',', ".");
    let plain = dotted.trim_end_matches('Z');
    for form in [
        "%Y-%m-%dT%H:%M:%S%.f",
        "%Y-%m-%d %H:%M:%S%.f",
        "%Y/%m/%d %H:%M:%S%.f",
        "%Y%m%dT%H%M%S%.f",
        "%Y-%m-%dT%H:%M",
        "%Y-%m-%d %H:%M",
    ] {
        if let Ok(time) = NaiveDateTime::parse_from_str(plain, form) {
            let time = time.and_utc();
            return Some(seconds(time.timestamp(), time.timestamp_subsec_nanos()));
        }
    }
    let date = NaiveDate::parse_from_str(plain, "%Y-%m-%d").ok()?;
    Some(seconds(date.and_time(NaiveTime::MIN).and_utc().timestamp(), 0))
}

/// A time of day, s since midnight.
fn of_day(text: &str) -> Option<f64> {
    use chrono::Timelike;
    let dotted = text.replace(',', ".");
    let time = NaiveTime::parse_from_str(&dotted, "%H:%M:%S%.f").ok()?;
    Some(seconds(time.num_seconds_from_midnight().into(), time.nanosecond()))
}

/// Whole seconds and nanoseconds as one number, rounded once.
fn seconds(whole: i64, nanoseconds: u32) -> f64 {
    whole as f64 + f64::from(nanoseconds) / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Option<f64>, Kind) {
        let mut kind = Kind::Unknown;
        let value = Cells { decimal: b'.', missing: vec![] }.value(text.as_bytes(), &mut kind);
        (value, kind)
    }

    #[test]
    fn iso_8601_times_are_seconds_since_1970() {
        // date -u -d '2024-05-06T12:00:00Z' +%s
        let noon = 1_714_996_800.0;
        for (text, expected) in [
            ("2024-05-06T12:00:00.010Z", noon + 0.01),
            ("2024-05-06 12:00:00", noon),
            ("2024-05-06T14:00:00+02:00", noon),
            ("2024-05-06T14:00:00.5+0200", noon + 0.5),
            ("2024-05-06T12:00:00,25", noon + 0.25),
            ("20240506T120000Z", noon),
            ("2024/05/06 12:00:00.000001", noon + 1e-6),
            ("2024-05-06T12:00Z", noon),
            ("2024-05-06", noon - 43_200.0),
        ] {
            assert_eq!(read(text), (Some(expected), Kind::Stamp), "{text}");
        }
        assert_eq!(read("12:00:00.010"), (Some(43_200.01), Kind::OfDay));
    }

    #[test]
    fn what_can_be_read_in_two_ways_is_text() {
        for text in ["05/06/2024 12:00:00", "06.05.2024 12:00", "1,5", "1.234,5", "idle", "12:00", "0x1f", "1_000"] {
            assert_eq!(read(text).0, None, "{text}");
        }
    }

    #[test]
    fn a_decimal_comma_is_a_point_and_a_point_is_no_number_beside_it() {
        let cells = Cells { decimal: b',', missing: vec!["-999".to_owned()] };
        let value = |text: &str| cells.value(text.as_bytes(), &mut Kind::Unknown);
        assert_eq!(value("-1,5e3"), Some(-1500.0));
        assert_eq!(value("1.234,5"), None);
        assert!(value("-999").unwrap().is_nan() && value("#N/A").unwrap().is_nan());
    }
}
