//! How to estimate: one file per filter. Knows no vehicle.

pub mod adaptation;
pub(crate) mod array;
pub mod critically_damped;
pub mod discretise;
pub mod ekf;
pub mod gaussian;
pub mod innovation;
pub mod map;
pub mod nis_monitor;
pub mod rls;
pub mod savitzky_golay;
pub mod sigma_points;
pub mod signal_noise;
pub mod sliding_mode;
pub mod sparse_ldl;
pub mod sparse_rows;
pub mod square_root;
pub mod srckf;
pub mod srukf;
pub mod tree_qr;
pub mod two_stage;
pub mod ukf;

/// Whether a number of a stored state is finite and so far from the largest one that sums and squares
/// of such numbers are finite too.
pub fn bounded(x: f64) -> bool {
    x.abs() < 1e30
}
