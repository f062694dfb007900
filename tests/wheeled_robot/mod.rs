//! The wheeled robot: wheel forces and motion.

mod allocation;
mod inputs;
mod multibody;
mod vectors;
