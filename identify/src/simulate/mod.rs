//! Built-in plants with sensors and noise: logs whose truth is known (`true_*` channels).
//!
//! One file per vehicle, each with its list of scenarios and one function that runs one of them.

pub mod human_dynamics;
pub mod nursing_robot;
mod wheel_loader;
mod wheelchair;
mod wheeled_robot;

use crate::log::Log;
use crate::vehicle::Vehicle;

/// A scenario that can be simulated.
#[derive(Clone, Copy, Debug)]
pub struct Scenario {
    /// Name on the command line.
    pub name: &'static str,
    /// What happens in it, in one line.
    pub about: &'static str,
}

/// What `simulate` is asked for.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of every random draw.
    pub seed: u64,
    /// Settings `name = value`: parameters of the machine, or `plant.*` and `noise.*` of the simulation.
    pub settings: Vec<(String, f64)>,
}

/// A request that cannot be simulated.
#[derive(Clone, Debug, thiserror::Error)]
pub enum SimulateError {
    /// There is no such scenario.
    #[error("there is no scenario '{asked}' for this vehicle; there are: {known}")]
    UnknownScenario {
        /// What was asked for.
        asked: String,
        /// What there is.
        known: String,
    },
    /// A setting was refused.
    #[error("{0}")]
    Setting(#[from] wheelstate::ParameterError),
}

/// The scenarios of a vehicle.
pub fn scenarios(vehicle: Vehicle) -> &'static [Scenario] {
    match vehicle {
        Vehicle::NursingRobot => nursing_robot::SCENARIOS,
        Vehicle::WheeledRobot => wheeled_robot::SCENARIOS,
        Vehicle::WheelLoader => wheel_loader::SCENARIOS,
        Vehicle::Wheelchair => wheelchair::SCENARIOS,
        Vehicle::HumanDynamics => human_dynamics::SCENARIOS,
    }
}

/// Runs a scenario.
pub fn simulate(vehicle: Vehicle, request: &Request) -> Result<Log, SimulateError> {
    match vehicle {
        Vehicle::NursingRobot => nursing_robot::simulate(request),
        Vehicle::WheeledRobot => wheeled_robot::simulate(request),
        Vehicle::WheelLoader => wheel_loader::run(request),
        Vehicle::Wheelchair => wheelchair::simulate(request),
        Vehicle::HumanDynamics => human_dynamics::simulate(request),
    }
}

/// Files that a scenario writes beside its log: ending and text.
pub fn companions(vehicle: Vehicle, request: &Request) -> Result<Vec<(&'static str, String)>, SimulateError> {
    match vehicle {
        Vehicle::HumanDynamics => human_dynamics::companions(request),
        _ => Ok(vec![]),
    }
}
