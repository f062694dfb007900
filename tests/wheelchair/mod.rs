//! The wheelchair: speed, heading and slope.

mod accuracy;
mod chairs;
mod consistency;
mod ground;
mod inputs;
mod model;
mod random_machines;
mod rides;
mod runs;
mod ukf;
mod vectors;
