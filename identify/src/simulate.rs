//! Built-in plants with sensors and noise: logs whose truth is known (`true_*` channels).

use crate::log::Log;

/// How the logs of a machine are simulated.
#[derive(Clone, Copy)]
pub struct Simulation {
    /// The scenarios.
    pub scenarios: &'static [Scenario],
    /// Runs one of them.
    pub run: fn(&Request) -> Result<Log, SimulateError>,
    /// Files that a scenario writes beside its log.
    pub companions: fn(&Request) -> Result<Vec<Companion>, SimulateError>,
}

/// A scenario that can be simulated.
#[derive(Clone, Copy, Debug)]
pub struct Scenario {
    /// Name on the command line.
    pub name: &'static str,
    /// What happens in it, in one line.
    pub about: &'static str,
}

/// A file beside a log: its ending and its text.
pub type Companion = (&'static str, String);

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

impl SimulateError {
    /// None of the scenarios has this name.
    pub fn unknown(asked: &str, scenarios: &[Scenario]) -> Self {
        let known = scenarios.iter().map(|scenario| scenario.name).collect::<Vec<_>>().join(", ");
        Self::UnknownScenario { asked: asked.to_owned(), known }
    }
}
