//! The wheelchair.

pub mod checks;
pub mod problem;
pub mod simulate;

use crate::simulate::Simulation;
use crate::vehicle::{Seat, Vehicle};
use wheelstate::estimator::wheelchair::Wheelchair;

/// The record.
pub static VEHICLE: Vehicle = Vehicle {
    name: "wheelchair",
    about: "Wheelchair with power assistance",
    estimator: Seat::of::<Wheelchair>(),
    problem: problem::PROBLEM,
    checks: checks::CHECKS,
    simulation: Simulation {
        scenarios: simulate::SCENARIOS,
        run: simulate::simulate,
        companions: |_| Ok(Vec::new()),
        manoeuvres: simulate::MANOEUVRES,
    },
    needed: &[&["encoder_left", "encoder_right", "gyro_pitch"]],
    noise_floors: |_| Vec::new(),
    body_tree: false,
};
