//! Tuning.
pub mod dung_beetle;
pub mod replay;
pub mod rng;
