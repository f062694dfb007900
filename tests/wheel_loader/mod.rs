//! The wheel loader: slip stiffness and centre of mass.

mod allocation;
mod filterpy;
mod model;
mod plant;
mod supervision;
mod vectors;
