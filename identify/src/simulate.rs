//! Built-in plants with sensors and noise: logs whose truth is known (`true_*` channels).

use crate::log::Log;
use wheelstate::variable::Variable;

/// How the logs of a machine are simulated.
#[derive(Clone, Copy)]
pub struct Simulation {
    /// The scenarios.
    pub scenarios: &'static [Scenario],
    /// Runs one of them.
    pub run: fn(&Request) -> Result<Log, SimulateError>,
    /// Files that a scenario writes beside its log.
    pub companions: fn(&Request) -> Result<Vec<Companion>, SimulateError>,
    /// Which of them can be driven on purpose, and what can be chosen about that.
    pub manoeuvres: Manoeuvres,
}

/// Values by name.
pub type Values = Vec<(String, f64)>;

/// Scenarios that a driver can repeat with the machine, for the design of experiments.
#[derive(Clone, Copy)]
pub struct Manoeuvres {
    /// Their names.
    pub scenarios: &'static [&'static str],
    /// What can be chosen about them.
    pub knobs: &'static [Knob],
    /// Inputs that the driver or the controller commands.
    pub commands: &'static [&'static str],
    /// The settings of the simulation, `plant.*` and `noise.*`.
    pub settings: fn() -> Vec<Variable>,
    /// Settings that make the plant one with these values of the estimator's parameters, by FMU name.
    pub plant: fn(&[(String, f64)]) -> Values,
    /// Ranges that are supposed of parameters of which nothing is known, not even a size: their declared value is zero.
    pub supposed: &'static [(&'static str, f64, f64)],
    /// Parameters whose standard errors simulated drives do not foresee: nothing is promised of them.
    pub unforeseen: &'static [&'static str],
}

impl Manoeuvres {
    /// None: nothing of what the scenarios do can be commanded.
    pub const NONE: Self = Self {
        scenarios: &[],
        knobs: &[],
        commands: &[],
        settings: Vec::new,
        plant: |values| values.to_vec(),
        supposed: &[],
        unforeseen: &[],
    };
}

/// A setting of manoeuvres.
#[derive(Clone, Copy, Debug)]
pub struct Knob {
    /// Its name among the settings of the simulation, where its unit and its range stand.
    pub name: &'static str,
    /// The scenarios that it changes; empty for all.
    pub scenarios: &'static [&'static str],
}

impl Knob {
    /// Whether it changes a scenario.
    pub fn acts_in(&self, scenario: &str) -> bool {
        self.scenarios.is_empty() || self.scenarios.contains(&scenario)
    }
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
