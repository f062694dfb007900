//! Centre of gravity of a wheel loader that accelerates, brakes and coasts, from the slip of its axles.
//!
//! ```sh
//! identify simulate wheel-loader --scenario accelerate-brake --seed 1 --out wheel_loader.csv
//! cargo run --release --example wheel_loader wheel_loader.csv
//! ```

mod support;

use support::{Log, print};
use wheelstate::Estimator;
use wheelstate::estimator::wheel_loader::{Inputs, Outputs, Parameters, WheelLoader};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let log = Log::from_command_line()?;

    let mut parameters = Parameters::default();
    parameters.loader.mass = 4700.0;
    parameters.initial.cg_ratio = 0.5; // what is known of it before: 0.5 +- 0.1
    let mut estimator = WheelLoader::new(&parameters)?;
    let dt = estimator.sample_period();

    let (mut inputs, mut estimates) = (Inputs::default(), Outputs::default());
    for row in 0..log.len() {
        if row > 0 && row % 500 == 0 {
            // the estimate from the samples before, carried forward to this instant, as an FMU reports it
            estimator.outputs(&inputs, dt, &mut estimates);
            let time = log.value("time", row);
            print(time, "cg_ratio", estimates.cg_ratio, log.value("true_cg_ratio", row));
            print(time, "cg_height", estimates.cg_height, log.value("true_cg_height", row));
        }
        inputs = log.inputs(row);
        estimator.step(&inputs, dt);
    }
    Ok(())
}
