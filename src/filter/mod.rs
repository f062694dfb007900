//! How to estimate: one file per filter. Knows no vehicle.

pub mod square_root;
