//! The machines the commands know.

use wheelstate::{Estimator, Variable, Variables, estimator};

/// A machine named on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Vehicle {
    /// Nursing robot that carries a seated person (also road vehicles: mass and rolling resistance).
    NursingRobot,
    /// Four-wheeled robot or car.
    WheeledRobot,
    /// Articulated or rigid wheel loader.
    WheelLoader,
    /// Human body.
    HumanDynamics,
    /// Wheelchair with power assistance.
    Wheelchair,
}

impl Vehicle {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::NursingRobot, Self::WheeledRobot, Self::WheelLoader, Self::HumanDynamics, Self::Wheelchair];

    /// Name on the command line and in `fit.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::NursingRobot => "nursing-robot",
            Self::WheeledRobot => "wheeled-robot",
            Self::WheelLoader => "wheel-loader",
            Self::HumanDynamics => "human-dynamics",
            Self::Wheelchair => "wheelchair",
        }
    }

    /// Name of its estimator and of its FMU.
    pub fn model(self) -> &'static str {
        match self {
            Self::NursingRobot => "NursingRobot",
            Self::WheeledRobot => "WheeledRobot",
            Self::WheelLoader => "WheelLoader",
            Self::HumanDynamics => "HumanDynamics",
            Self::Wheelchair => "Wheelchair",
        }
    }

    /// The parameters of its estimator; none if this build has no estimator for it.
    pub fn parameters(self) -> Vec<Variable> {
        self.declarations().0
    }

    /// The inputs of its estimator, which are the channels of its logs.
    pub fn inputs(self) -> Vec<Variable> {
        self.declarations().1
    }

    fn declarations(self) -> (Vec<Variable>, Vec<Variable>) {
        let mut found = Declarations { model: self.model(), parameters: Vec::new(), inputs: Vec::new() };
        estimator::visit_all(&mut found);
        (found.parameters, found.inputs)
    }
}

impl std::fmt::Display for Vehicle {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// Collects the declarations of the estimator with this name.
struct Declarations {
    model: &'static str,
    parameters: Vec<Variable>,
    inputs: Vec<Variable>,
}

impl estimator::Visitor for Declarations {
    fn visit<E: Estimator + 'static>(&mut self) {
        if E::NAME == self.model {
            self.parameters = E::Parameters::declare();
            self.inputs = E::Inputs::declare();
        }
    }
}
