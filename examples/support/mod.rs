//! What all examples need: a log as `identify simulate` writes it, and a line of output.

use std::collections::HashMap;
use std::error::Error;
use wheelstate::Variables;
use wheelstate::variable::Estimate;

/// A log by columns; `true_*` are the truth of the plant, which no estimator sees.
pub struct Log {
    columns: HashMap<String, Vec<f64>>,
}

impl Log {
    /// Reads the CSV file that the command line names. An empty cell is a missing sample.
    pub fn from_command_line() -> Result<Self, Box<dyn Error>> {
        let path = std::env::args().nth(1).ok_or("which log? See the first lines of this example")?;
        let mut reader = csv::Reader::from_path(&path).map_err(|error| format!("{path}: {error}"))?;
        let names: Vec<String> = reader.headers()?.iter().map(str::to_owned).collect();
        let mut columns: HashMap<_, _> = names.iter().map(|name| (name.clone(), Vec::new())).collect();
        for row in reader.records() {
            for (name, cell) in names.iter().zip(&row?) {
                let value = if cell.is_empty() { f64::NAN } else { cell.parse()? };
                columns.get_mut(name).ok_or("a row is too long")?.push(value);
            }
        }
        Ok(Self { columns })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.columns["time"].len()
    }

    /// One value, NaN if there is no such column.
    pub fn value(&self, name: &str, row: usize) -> f64 {
        self.columns.get(name).map_or(f64::NAN, |column| column[row])
    }

    /// All inputs of one sample; those without a column are missing.
    pub fn inputs<I: Variables + Default>(&self, row: usize) -> I {
        let mut inputs = I::default();
        let values: Vec<f64> = I::declare().iter().map(|variable| self.value(&variable.name, row)).collect();
        inputs.read(&values);
        inputs
    }
}

/// Prints one estimate with its standard deviation beside the truth.
pub fn print(time: f64, name: &str, estimate: Estimate, truth: f64) {
    println!("{time:8.2} s  {name:<20} {:10.4} +- {:8.4}   true {truth:10.4}", estimate.value, estimate.std);
}
