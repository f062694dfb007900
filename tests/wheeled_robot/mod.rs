//! The wheeled robot: wheel forces and motion.

mod consistency;
mod drive;
mod inputs;
mod multibody;
mod parameters;
mod slip;
mod steering;
mod untold;
mod vectors;
