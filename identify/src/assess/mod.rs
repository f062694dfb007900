//! How good an estimate is: covariance, conditioning, verdicts, excitation, validation.

pub mod covariance;
pub mod validation;
pub mod verdict;

pub use covariance::{condition_number, inverse, is_singular, of_regression};
pub use verdict::{Evidence, Limits, Verdict, verdict};
