//! Identification of physical parameters from logs, before the online estimators run.
//!
//! ```text
//! file -> wheelstate-log -> problem/ (one per vehicle: rows and constraints) -> solve/ (Clarabel) -> assess/ -> report/
//!         simulate/ (plants + noise -> logs)                          tune/ (noise by replay)
//! ```

pub mod assess;
pub mod cli;
pub mod estimate;
pub mod problem;
pub mod report;
pub mod result;
pub mod simulate;
pub mod solve;
pub mod tune;
pub mod vehicle;

pub use wheelstate_log::{self as log, output, progress};
