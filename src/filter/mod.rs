//! How to estimate: one file per filter. Knows no vehicle.

pub mod adaptation;
mod array;
pub mod critically_damped;
pub mod discretise;
pub mod ekf;
pub mod rls;
pub mod sigma_points;
pub mod sliding_mode;
pub mod square_root;
pub mod srckf;
pub mod srukf;
pub mod ukf;
pub mod map;
pub mod savitzky_golay;
pub mod sparse_ldl;
pub mod tree_qr;
