//! Human body: a standing person who bows, and a seated person whose seat brakes.

mod bowing;
mod person;
mod seated;

use crate::log::Log;
use crate::simulate::{Companion, Request, Scenario, SimulateError};

/// The scenarios.
pub const SCENARIOS: &[Scenario] = &[
    Scenario {
        name: "bowing",
        about: "standing person bows five times on two force plates; writes the body (.urdf) and its sensors \
                (.sensors.toml) beside the log, for `identify estimate`",
    },
    Scenario {
        name: "seated-braking",
        about: "seated person, held upright by passive joints, reaches forward while the seat brakes",
    },
];

/// Runs a scenario.
pub fn simulate(request: &Request) -> Result<Log, SimulateError> {
    match request.scenario.as_str() {
        "bowing" => bowing::simulate(request),
        "seated-braking" => seated::simulate(request),
        _ => Err(SimulateError::unknown(&request.scenario, SCENARIOS)),
    }
}

/// Files that belong to a scenario's log: ending and text.
pub fn companions(request: &Request) -> Result<Vec<Companion>, SimulateError> {
    if request.scenario == "bowing" { bowing::companions(request) } else { Ok(vec![]) }
}
