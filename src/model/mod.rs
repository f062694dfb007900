//! What moves: equations of motion `f`, measurements `h` and their Jacobians, in the notation and
//! with the equation numbers of the sources. Knows no filter.

mod lanes;
pub mod multibody;
pub mod nursing_robot;
pub mod tire;
pub mod wheel_loader;
pub mod wheelchair;
pub mod wheeled_robot;
