//! Truth to test against: plants that are richer than the estimators' models and share no equation
//! with them. Knows neither `model` nor `filter`, draws no random numbers: noise comes from outside.

pub mod human_dynamics;
pub mod nursing_robot;
pub mod road;
pub mod wheel_loader;
pub mod wheelchair;
pub mod wheeled_robot;

/// Standard gravity, m/s².
const STANDARD_GRAVITY: f64 = 9.80665;
/// Gravity as the reference values of the nursing robot and of the wheeled robot have it, m/s².
const ROUNDED_GRAVITY: f64 = 9.81;
