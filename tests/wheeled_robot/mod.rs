//! The wheeled robot: wheel forces and motion.

mod allocation;
mod consistency;
mod drive;
mod inputs;
mod multibody;
mod vectors;
