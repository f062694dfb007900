//! Torque at the lumbar spine and force of the seat on a person who reaches forward while the seat brakes.
//!
//! ```sh
//! identify simulate human-dynamics --scenario seated-braking --seed 1 --out human_dynamics.csv
//! cargo run --release --example human_dynamics human_dynamics.csv
//! ```

mod support;

use support::{Log, print};
use wheelstate::Estimator;
use wheelstate::estimator::human_dynamics::variables::JOINTS;
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let log = Log::from_command_line()?;

    let mut parameters = Parameters::default();
    parameters.body.height = 1.7;
    parameters.body.mass = 65.0;
    parameters.r#use.seat_wrench = true;
    parameters.r#use.hand_wrench = true;
    parameters.r#use.foot_wrench = true;
    let mut estimator = HumanDynamics::new(&parameters)?;
    let dt = estimator.sample_period();
    let lumbar = JOINTS.iter().position(|(name, ..)| *name == "lumbar_y").ok_or("there is no such joint")?;

    let (mut inputs, mut estimates) = (Inputs::default(), Outputs::default());
    for row in 0..log.len() {
        if row > 0 && row % 100 == 0 {
            // the estimate from the samples before, carried forward to this instant, as an FMU reports it
            estimator.outputs(&inputs, dt, &mut estimates);
            let time = log.value("time", row);
            print(time, "tau_lumbar_y", estimates.tau[lumbar], log.value("true_tau_lumbar_y", row));
            print(time, "seat_wrench_force_x", estimates.seat_wrench[0], log.value("true_seat_wrench_force_x", row));
        }
        inputs = log.inputs(row);
        estimator.step(&inputs, dt);
    }
    Ok(())
}
