//! Impacts that the accelerometer feels on a kerb or a ramp's edge, where the axle's path bends and the model does not.
//!
//! The noise of a row that is more than `c` deviations off becomes what makes it just `c` deviations off. The row's
//! influence on the state, which grows with the innovation `nu` up to `c`, then falls as `c^2/nu` (in deviations): a
//! redescending M-estimate, to which no row is lost for good. The source has nothing of the kind.

use crate::filter::belief::Belief;
use crate::filter::ekf::Rows;

/// Row of the accelerometer ahead; those to the left and upward follow.
pub(super) const AHEAD: usize = 3;
/// An impact ahead takes no more samples than this; what lasts longer is a force that nobody reported, to be learned.
const LONGEST: u32 = 3;
/// What is further off than this, m/s^2, is no impact but a filter gone astray.
const ASTRAY: f64 = 1e3;

/// Weighs down the accelerometer's rows that are more than `deviations` off. `hits_ahead` counts the samples in a row
/// that were off ahead. Returns what that takes from the normalised innovation squared, which is to tell of impacts
/// all the same.
pub(super) fn weigh_down<const N: usize>(
    deviations: f64,
    belief: &Belief<N>,
    rows: &mut Rows<N, 6>,
    hits_ahead: &mut u32,
) -> f64 {
    let most = deviations * deviations;
    let (mut taken, mut hit_ahead) = (0.0, false);
    for row in (AHEAD..6).filter(|&row| rows.used[row]) {
        let (square, noise) = (rows.innovation[row] * rows.innovation[row], rows.noise[(row, row)]);
        if !(square > most * noise && square < ASTRAY * ASTRAY) {
            continue;
        }
        let h = rows.jacobian.row(row);
        let known = (h * belief.covariance).dot(&h);
        let times = square / (known + noise);
        if times <= most {
            continue;
        }
        hit_ahead |= row == AHEAD;
        if row == AHEAD && *hits_ahead >= LONGEST {
            continue;
        }
        rows.noise[(row, row)] = square / most - known;
        taken += times - most;
    }
    *hits_ahead = if hit_ahead { hits_ahead.saturating_add(1) } else { 0 };
    taken
}
