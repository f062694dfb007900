//! The machines, each in its own folder: its record, its problem and its simulations.

pub mod human_dynamics;
pub mod nursing_robot;
pub mod wheel_loader;
pub mod wheelchair;
pub mod wheeled_robot;

use crate::vehicle::Vehicle;

/// The one list: a machine added here is on the command line with all its commands.
pub static ALL: [&Vehicle; 5] = [
    &nursing_robot::VEHICLE,
    &wheeled_robot::VEHICLE,
    &wheel_loader::VEHICLE,
    &human_dynamics::VEHICLE,
    &wheelchair::VEHICLE,
];
