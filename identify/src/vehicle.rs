//! The machines the commands know.

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
