//! Trees of rigid bodies: spatial algebra, kinematic trees, the equations of motion as sparse rows,
//! sensors, and a human body from height and mass.
//!
//! The rows are those of Latella et al., *Towards real-time whole-body human dynamics estimation
//! through probabilistic sensor fusion algorithms*, Autonomous Robots 43 (2019): constraints
//! `D d + b_D = 0` and measurements `Y d + b_Y = y` in one vector `d` of accelerations, wrenches
//! and torques. How they are solved is not known here.

pub mod anthropometry;
pub mod equations;
pub mod error;
pub mod prior;
pub mod rows;
pub mod scatter;
pub mod sensors;
pub mod spatial;
pub mod tree;
