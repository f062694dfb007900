//! The nursing robot.

pub mod checks;
#[cfg(test)]
mod long;
pub mod problem;
pub mod simulate;

use crate::simulate::Simulation;
use crate::vehicle::{Seat, Vehicle};
use wheelstate::estimator::nursing_robot::NursingRobot;

/// The record.
pub static VEHICLE: Vehicle = Vehicle {
    name: "nursing-robot",
    about: "Nursing robot that carries a seated person (also road vehicles: mass and rolling resistance)",
    estimator: Seat::of::<NursingRobot>(),
    problem: problem::PROBLEM,
    checks: checks::CHECKS,
    simulation: Simulation {
        scenarios: simulate::SCENARIOS,
        run: simulate::simulate,
        companions: |_| Ok(Vec::new()),
        manoeuvres: simulate::MANOEUVRES,
    },
    needed: &[&["torque_left", "torque_right"], &["speed", "tilt", "tilt_rate"]],
    noise_floors: |_| Vec::new(),
    body_tree: false,
};
