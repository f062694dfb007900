//! Takes the first samples of a log with one estimator: `instructions ESTIMATOR LOG.csv SAMPLES`, one step and one call of
//! `outputs` each. `instructions.sh` counts the processor's instructions of two lengths; their difference is the step's.

use std::hint::black_box;
use wheelstate::estimator::{Visitor, visit_all};
use wheelstate::{Estimator, Variables};

struct Run {
    estimator: String,
    log: String,
    samples: usize,
}

impl Visitor for Run {
    fn visit<E: Estimator + 'static>(&mut self) {
        if E::NAME != self.estimator {
            return;
        }
        let mut estimator = E::new(&E::Parameters::default()).expect("the defaults are valid");
        let period = estimator.sample_period();
        let mut log = csv::Reader::from_path(&self.log).expect("a log");
        let declared = E::Inputs::declare();
        let header = log.headers().expect("a header").clone();
        let columns: Vec<_> = header.iter().map(|name| declared.iter().position(|input| input.name == name)).collect();
        let (mut inputs, mut outputs) = (E::Inputs::default(), E::Outputs::default());
        let mut values = inputs.to_vec();
        // all of it, so that both lengths read the same
        let rows: Vec<Vec<f64>> = log
            .records()
            .map(|record| {
                for (cell, column) in record.expect("a row").iter().zip(&columns) {
                    if let Some(column) = column {
                        values[*column] = cell.parse().unwrap_or(f64::NAN);
                    }
                }
                values.clone()
            })
            .collect();
        for row in &rows[..self.samples] {
            inputs.read(row);
            black_box(estimator.step(&inputs, period));
            estimator.outputs(&inputs, 0.0, &mut outputs);
            black_box(&outputs);
        }
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    let (Some(estimator), Some(log), Some(samples)) = (arguments.next(), arguments.next(), arguments.next()) else {
        println!("tests/bench/instructions.sh counts instructions with this");
        return;
    };
    visit_all(&mut Run { estimator, log, samples: samples.parse().expect("a number of samples") });
}
