//! The wheel loader: slip stiffness and centre of mass.

mod bend;
mod consistency;
mod filterpy;
mod inputs;
mod model;
mod plant;
mod runs;
mod speed_and_slope;
mod supervision;
mod vectors;
