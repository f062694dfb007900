//! The wheel loader.

mod accuracy;
mod fit;
mod random_machines;
