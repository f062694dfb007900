//! Online estimators for wheeled machines that carry people and loads.
//!
//! # The way through the crate
//!
//! ```text
//!             model/  what moves: f, h and their Jacobians, in the sources' notation
//! estimator/ <                                                                        plant/  truth to test against
//!             filter/ how to estimate: Kalman, sigma points, least squares, observers
//! ```
//!
//! [`estimator`] joins one model with one filter per machine and is what users call. [`model`] knows
//! no filter, [`filter`] knows no vehicle, and [`plant`] shares equations with neither, so that an
//! error in a model cannot hide behind the same error in the plant.
//!
//! # Conventions
//!
//! SI units and radians everywhere, `f64` only. Frames are right-handed with x forward, y left and
//! z up (ISO 8855); each model's page states its angles and signs. A NaN sample is a missing sample.
//! After construction no step allocates, panics or returns a value that is not finite.

#[macro_use]
pub mod variable;
pub mod parameter_set;
pub mod status;
pub mod unit;

pub mod estimator;
pub mod filter;
pub mod model;
pub mod plant;

pub use estimator::Estimator;
pub use status::Status;
pub use variable::{ParameterError, Variable, Variables};
