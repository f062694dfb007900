//! Shared by the integration tests of all packages: reference vectors, tolerances, statistics.
#![allow(dead_code, missing_docs)]

use flate2::read::GzDecoder;
use std::{fs::File, io::Read, path::PathBuf};

/// A table with named columns, row by row as in its file.
pub struct Table {
    pub columns: Vec<String>,
    pub rows: Vec<Vec<f64>>,
}

impl Table {
    /// Column number of `name`.
    pub fn column(&self, name: &str) -> usize {
        self.columns.iter().position(|c| c == name).unwrap_or_else(|| panic!("no column {name} in {:?}", self.columns))
    }

    /// All values of column `name`.
    pub fn values(&self, name: &str) -> Vec<f64> {
        let column = self.column(name);
        self.rows.iter().map(|row| row[column]).collect()
    }

    /// One value.
    pub fn at(&self, row: usize, name: &str) -> f64 {
        self.rows[row][self.column(name)]
    }
}

/// The text of a reference file below `tests/vectors`, named without its `.gz`.
pub fn vector_text(name: &str) -> String {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let root = if root.join("tests/vectors").is_dir() { root } else { root.join("..") };
    let path = root.join("tests/vectors").join(format!("{name}.gz"));
    let file = File::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut text = String::new();
    GzDecoder::new(file).read_to_string(&mut text).unwrap();
    text
}

/// A reference table; empty cells and `nan` are NaN.
pub fn vector_table(name: &str) -> Table {
    let text = vector_text(name);
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let columns = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let number = |cell: &str| if cell.is_empty() { f64::NAN } else { cell.trim().parse().unwrap_or(f64::NAN) };
    let rows = reader.records().map(|record| record.unwrap().iter().map(number).collect()).collect();
    Table { columns, rows }
}

/// Asserts |a - b| <= relative * max(|a|, |b|) + absolute; NaN equals NaN.
#[track_caller]
pub fn assert_close(what: &str, actual: f64, expected: f64, relative: f64, absolute: f64) {
    let bound = relative * actual.abs().max(expected.abs()) + absolute;
    let equal = (actual.is_nan() && expected.is_nan()) || actual == expected || (actual - expected).abs() <= bound;
    assert!(equal, "{what}: {actual:e} instead of {expected:e}, off by {:e} > {bound:e}", (actual - expected).abs());
}

/// The `p`-quantile (0..=1) of the sample, linearly interpolated.
pub fn quantile(sample: &[f64], p: f64) -> f64 {
    let mut sorted = sample.to_vec();
    sorted.sort_by(f64::total_cmp);
    let position = p * (sorted.len() - 1) as f64;
    let (low, share) = (position.floor() as usize, position.fract());
    sorted[low] + share * (sorted[(low + 1).min(sorted.len() - 1)] - sorted[low])
}

/// The median.
pub fn median(sample: &[f64]) -> f64 {
    quantile(sample, 0.5)
}
