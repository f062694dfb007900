//! The wheel loader: slip stiffness and centre of mass.

mod allocation;
mod consistency;
mod filterpy;
mod inputs;
mod model;
mod plant;
mod runs;
mod supervision;
mod vectors;
