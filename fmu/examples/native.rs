//! Runs an estimator natively over a CSV log and writes its outputs: the reference that the tests
//! in `tests/fmpy` hold the FMUs against.
//!
//! `native MODEL LOG.csv OUT.csv [name=value]...` takes one sample per row, `sample_period` apart,
//! and writes the outputs one period later, as an FMU gives them at the end of a step.

use std::process::ExitCode;
use wheelstate::estimator::{Visitor, visit_all};
use wheelstate::{Estimator, Variables};

type Failure = Box<dyn std::error::Error>;

struct Run {
    arguments: Vec<String>,
    result: Result<(), Failure>,
}

impl Visitor for Run {
    fn visit<E: Estimator + 'static>(&mut self) {
        if E::NAME == self.arguments[0] {
            self.result = run::<E>(&self.arguments[1], &self.arguments[2], &self.arguments[3..]);
        }
    }
}

fn run<E: Estimator>(log: &str, out: &str, settings: &[String]) -> Result<(), Failure> {
    let mut parameters = E::Parameters::default();
    for setting in settings {
        let (name, value) = setting.split_once('=').ok_or("name=value is expected")?;
        parameters.set(name, value.parse()?)?;
    }
    let mut estimator = E::new(&parameters)?;
    let period = estimator.sample_period();
    let (mut inputs, mut outputs) = (E::Inputs::default(), E::Outputs::default());
    let declared = E::Inputs::declare();
    let mut flat = inputs.to_vec();

    let mut reader = csv::Reader::from_path(log)?;
    let headers = reader.headers()?.clone();
    let columns: Vec<_> = headers.iter().map(|name| declared.iter().position(|v| v.name == name)).collect();
    let mut writer = csv::Writer::from_path(out)?;
    writer.write_record(std::iter::once("time".to_owned()).chain(E::Outputs::declare().into_iter().map(|v| v.name)))?;
    for row in reader.records() {
        let row = row?;
        for (cell, column) in row.iter().zip(&columns) {
            if let Some(index) = column {
                flat[*index] = if cell.is_empty() { f64::NAN } else { cell.parse()? };
            }
        }
        inputs.read(&flat);
        estimator.step(&inputs, period);
        estimator.outputs(&inputs, period, &mut outputs);
        let time: f64 = row.get(0).ok_or("empty row")?.parse()?;
        let values = std::iter::once(time + period).chain(outputs.to_vec());
        writer.write_record(values.map(|value| format!("{value:?}")))?;
    }
    Ok(writer.flush()?)
}

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    if arguments.len() < 3 {
        eprintln!("usage: native MODEL LOG.csv OUT.csv [name=value]...");
        return ExitCode::from(2);
    }
    let mut run = Run { arguments, result: Err("there is no such model".into()) };
    visit_all(&mut run);
    match run.result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("native: {error}");
            ExitCode::from(2)
        }
    }
}
