//! The human body.

pub mod checks;
pub mod problem;
pub mod simulate;

use crate::simulate::{Manoeuvres, Simulation};
use crate::vehicle::{Seat, Vehicle};
use wheelstate::estimator::human_dynamics::HumanDynamics;

/// The record.
pub static VEHICLE: Vehicle = Vehicle {
    name: "human-dynamics",
    about: "Human body",
    estimator: Seat::of::<HumanDynamics>(),
    problem: problem::PROBLEM,
    checks: checks::CHECKS,
    simulation: Simulation {
        scenarios: simulate::SCENARIOS,
        run: simulate::simulate,
        companions: simulate::companions,
        manoeuvres: Manoeuvres::NONE,
    },
    needed: &[&["q_*"]],
    noise_floors: |_| Vec::new(),
    body_tree: true,
};
