//! The wheel loader.

pub mod checks;
pub mod problem;
pub mod simulate;

use crate::simulate::Simulation;
use crate::vehicle::{Seat, Vehicle};
use wheelstate::estimator::wheel_loader::WheelLoader;

/// The record.
pub static VEHICLE: Vehicle = Vehicle {
    name: "wheel-loader",
    about: "Articulated or rigid wheel loader",
    estimator: Seat::of::<WheelLoader>(),
    problem: problem::PROBLEM,
    checks: checks::CHECKS,
    simulation: Simulation {
        scenarios: simulate::SCENARIOS,
        run: simulate::simulate,
        companions: |_| Ok(Vec::new()),
        manoeuvres: simulate::MANOEUVRES,
    },
    needed: &[
        &["torque_front", "torque_rear", "brake_front", "brake_rear"],
        &["speed", "wheel_speed_front", "wheel_speed_rear"],
    ],
    noise_floors: |_| Vec::new(),
    body_tree: false,
};
