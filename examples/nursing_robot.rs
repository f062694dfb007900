//! Mass of the person on a nursing robot that stops and goes; another person sits down at 16 s. From the wheels alone.
//!
//! ```sh
//! identify simulate nursing-robot --scenario new-patient --seed 6 --out nursing_robot.csv
//! cargo run --release --example nursing_robot nursing_robot.csv
//! ```

mod support;

use support::{Log, print};
use wheelstate::Estimator;
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let log = Log::from_command_line()?;

    let mut parameters = Parameters::default();
    parameters.robot.mass = 160.0;
    parameters.rolling.coefficient = 0.015;
    let mut estimator = NursingRobot::new(&parameters)?;
    let dt = estimator.sample_period();

    let (mut inputs, mut estimates) = (Inputs::default(), Outputs::default());
    for row in 0..log.len() {
        if row > 0 && row % 400 == 0 {
            // the estimate from the samples before, carried forward to this instant, as an FMU reports it
            estimator.outputs(&inputs, dt, &mut estimates);
            let time = log.value("time", row);
            print(time, "load_mass", estimates.load_mass, log.value("true_load_mass", row));
            print(time, "body_pitch", estimates.body_pitch, log.value("true_body_pitch", row));
        }
        inputs = log.inputs(row);
        estimator.step(&inputs, dt);
    }
    Ok(())
}
