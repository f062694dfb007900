//! Identification of physical parameters from logs, before the online estimators run.
//!
//! ```text
//! file -> log/ -> problem/ (one per vehicle: rows and constraints) -> solve/ (Clarabel) -> assess/ -> report/
//!         simulate/ (plants + noise -> logs)                          tune/ (noise by replay)
//! ```

pub mod assess;
pub mod cli;
pub mod estimate;
mod guard;
pub mod log;
pub mod output;
pub mod problem;
pub mod progress;
pub mod report;
pub mod request;
pub mod simulate;
pub mod solve;
pub mod tune;
pub mod vehicle;
