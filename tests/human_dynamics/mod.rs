//! The human body: multi-body equations, whole-body estimates, the seated person.

mod accuracy;
mod allocation;
mod cases;
mod consistency;
mod coupling;
mod inputs;
mod model;
mod scatter;
mod truth;
mod vectors;
