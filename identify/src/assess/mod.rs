//! How good an estimate is: verdicts and validation.

pub mod student;
pub mod validation;
pub mod verdict;

pub use student::student;
pub use verdict::{Evidence, Limits, Verdict, verdict};
