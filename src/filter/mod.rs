//! How to estimate: one file per filter. Knows no vehicle.

pub mod discretise;
pub mod ekf;
pub mod square_root;
