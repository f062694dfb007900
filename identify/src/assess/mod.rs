//! How good an estimate is: verdicts and validation.

pub mod validation;
pub mod verdict;

pub use verdict::{Evidence, Limits, Verdict, verdict};
