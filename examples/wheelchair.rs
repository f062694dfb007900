//! Slope and speed of a wheelchair that climbs a ramp and rolls down again.
//!
//! ```sh
//! identify simulate wheelchair --scenario climb --seed 1 --out wheelchair.csv
//! cargo run --release --example wheelchair wheelchair.csv
//! ```

mod support;

use support::{Log, print};
use wheelstate::Estimator;
use wheelstate::estimator::wheelchair::{Inputs, Outputs, Parameters, Wheelchair};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let log = Log::from_command_line()?;

    let mut parameters = Parameters::default();
    parameters.initial.heading = std::f64::consts::FRAC_PI_2; // straight up
    let mut estimator = Wheelchair::new(&parameters)?;
    let dt = estimator.sample_period();

    let (mut inputs, mut estimates) = (Inputs::default(), Outputs::default());
    for row in 0..log.len() {
        if row > 0 && row % 100 == 0 {
            // the estimate from the samples before, carried forward to this instant, as an FMU reports it
            estimator.outputs(&inputs, dt, &mut estimates);
            let time = log.value("time", row);
            print(time, "slope", estimates.slope, log.value("true_slope", row));
            print(time, "speed", estimates.speed, log.value("true_speed", row));
        }
        inputs = log.inputs(row);
        estimator.step(&inputs, dt);
    }
    Ok(())
}
