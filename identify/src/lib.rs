//! Identification of physical parameters from logs, before the online estimators run.
//!
//! ```text
//! log file -> wheelstate-log -> problem/ (rows, constraints) -> solve/ (Clarabel) -> assess/ -> result -> report/
//!                               tune/    (noise by replay)                                   -> result -> report/
//!                               run/     (estimates by replay)                               -> report/
//! simulate (plants + noise) -> log file
//!                               design/  (fits of simulated logs)
//! ```
//!
//! [`problem`], [`mod@simulate`] and [`tune`] hold what is common to all machines. What is a machine's own stands in its
//! folder of [`vehicles`], with one record, a [`Vehicle`](vehicle::Vehicle), that says it all: its name, its estimator,
//! its [`Problem`](problem::Problem), its scenarios. A machine is added by its folder and one line in the list
//! [`vehicles::ALL`]; the commands walk the list.
//!
//! # Who may import whom
//!
//! `solve` and `result` stand at the bottom and know no log file, no machine and no command line; `assess` and `report`
//! use `result`; `problem` uses `solve`, `assess` and `result`; `tune` and `run` use `result` and share `replay`; `vehicle` joins
//! problem, simulation, tuning and runs; a machine of `vehicles` uses all of these but never another machine; `checked`,
//! `design`, `fleet` and `values` are what the command line and the Python package share; `cli` uses everything.
//! `tests/walls/arrows.rs` of the repository is the whole list, and a test enforces it.

pub mod assess;
pub mod check;
pub mod checked;
pub mod cli;
pub mod design;
pub mod estimate;
pub mod finding;
pub mod fleet;
pub mod problem;
pub mod replay;
pub mod report;
pub mod result;
pub mod run;
pub mod simulate;
pub mod solve;
pub mod tune;
pub mod values;
pub mod vehicle;
pub mod vehicles;

pub use wheelstate_log::{self as log, output, progress};
