//! What moves: equations of motion `f`, measurements `h` and their Jacobians, in the notation and
//! with the equation numbers of the sources. Knows no filter.

pub(crate) mod four;
mod lanes;
pub mod multibody;
pub mod nursing_robot;
pub mod tire;
pub mod wheel_loader;
pub mod wheelchair;
pub mod wheeled_robot;

/// Standard gravity, m/s².
pub const STANDARD_GRAVITY: f64 = 9.80665;
/// Gravity as the sources of the nursing robot and of the wheeled robot round it, m/s².
pub const ROUNDED_GRAVITY: f64 = 9.81;
