//! Lateral speed and yaw rate of a robot that changes lanes.
//!
//! ```sh
//! identify simulate wheeled-robot --scenario lane-change --seed 1 --out wheeled_robot.csv
//! cargo run --release --example wheeled_robot wheeled_robot.csv
//! ```

mod support;

use support::{Log, print};
use wheelstate::Estimator;
use wheelstate::estimator::wheeled_robot::{Inputs, Outputs, Parameters, WheeledRobot};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let log = Log::from_command_line()?;

    let mut parameters = Parameters::default();
    parameters.vehicle.mass = 60.0;
    parameters.tire.front.friction = 0.8;
    let mut estimator = WheeledRobot::new(&parameters)?;
    let dt = estimator.sample_period();

    let (mut inputs, mut estimates) = (Inputs::default(), Outputs::default());
    for row in 0..log.len() {
        if row > 0 && row % 100 == 0 {
            // the estimate from the samples before, carried forward to this instant, as an FMU reports it
            estimator.outputs(&inputs, dt, &mut estimates);
            let time = log.value("time", row);
            print(time, "speed_y", estimates.speed_y, log.value("true_speed_y", row));
            print(time, "yaw_rate", estimates.yaw_rate, log.value("true_yaw_rate", row));
        }
        inputs = log.inputs(row);
        estimator.step(&inputs, dt);
    }
    Ok(())
}
