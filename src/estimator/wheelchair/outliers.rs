//! Impacts that the accelerometer feels on a kerb or a ramp's edge, where the axle's path bends and the model does not.
//!
//! The noise of a row that is more than `c` deviations off becomes what makes it just `c` deviations off. The row's
//! influence on the state, which grows with the innovation `nu` up to `c`, then falls as `c^2/nu` (in deviations): a
//! redescending M-estimate, to which no row is lost for good. The source has nothing of the kind.

use crate::filter::ekf::Rows;
use crate::filter::gaussian::Gaussian;

/// Row of the forward accelerometer; those to the left and upward follow.
pub(super) const ACCEL_X: usize = 3;
/// A forward impact takes no more samples than this; what lasts longer is an unmodelled force, to be learned.
const LONGEST: u32 = 3;
/// What is further off than this, m/s^2, is no impact: the filter has diverged.
pub(super) const DIVERGED: f64 = 1e3;

/// Down-weights the accelerometer's rows that are more than `deviations` off. `forward_hits` counts the samples in a row
/// that were off forward. Returns by how much that lowers the normalised innovation squared, which is to show impacts
/// all the same.
pub(super) fn downweight<const N: usize>(
    deviations: f64,
    belief: &Gaussian<N>,
    rows: &mut Rows<N, 6>,
    forward_hits: &mut u32,
) -> f64 {
    let most = deviations * deviations;
    let (mut taken, mut forward_hit) = (0.0, false);
    for row in (ACCEL_X..6).filter(|&row| rows.used[row]) {
        let (square, noise) = (rows.innovation[row] * rows.innovation[row], rows.noise[(row, row)]);
        if !(square > most * noise && square < DIVERGED * DIVERGED) {
            continue;
        }
        let known = rows.expected_variance(row, belief);
        let times = square / (known + noise);
        if times <= most {
            continue;
        }
        forward_hit |= row == ACCEL_X;
        if row == ACCEL_X && *forward_hits >= LONGEST {
            continue;
        }
        rows.noise[(row, row)] = square / most - known;
        taken += times - most;
    }
    *forward_hits = if forward_hit { forward_hits.saturating_add(1) } else { 0 };
    taken
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, SVector};

    fn rows(forward: f64, left: f64) -> Rows<2, 6> {
        let mut innovation = SVector::zeros();
        (innovation[ACCEL_X], innovation[ACCEL_X + 1]) = (forward, left);
        let jacobian = SMatrix::from_fn(|row, column| if row >= ACCEL_X && column == 0 { 0.2 } else { 0.0 });
        Rows { innovation, jacobian, noise: SMatrix::identity() * 0.01, used: [true; 6] }
    }

    /// Noise of the forward and the leftward row after down-weighting samples that are so far off forward.
    fn noise(forward: f64, left: f64, hits: &mut u32) -> [f64; 2] {
        let mut rows = rows(forward, left);
        let belief = Gaussian::independent(SVector::zeros(), &SVector::repeat(1.0));
        downweight(4.0, &belief, &mut rows, hits);
        [rows.noise[(ACCEL_X, ACCEL_X)], rows.noise[(ACCEL_X + 1, ACCEL_X + 1)]]
    }

    #[test]
    fn a_forward_impact_is_down_weighted_for_three_samples_and_then_used() {
        let mut hits = 0;
        let weighed: Vec<bool> = (0..5).map(|_| noise(2.0, 0.0, &mut hits)[0] > 0.011).collect();
        assert_eq!(weighed, [true, true, true, false, false]);
        assert_eq!(noise(0.1, 0.0, &mut hits)[0], 0.01);
        assert!(noise(2.0, 0.0, &mut hits)[0] > 0.011, "a sample that agrees ends the impact");
    }

    #[test]
    fn a_sideward_impact_may_last() {
        let mut hits = 0;
        assert!((0..50).all(|_| noise(0.0, 2.0, &mut hits)[1] > 0.011));
    }

    /// Just as far off as the threshold says: the influence of a row falls from there on.
    #[test]
    fn a_row_is_made_as_uncertain_as_it_is_off() {
        let [forward, _] = noise(2.0, 0.0, &mut 0);
        // the state itself is known to within 0.2 of the reading
        assert!((2.0 / forward.sqrt().hypot(0.2) - 4.0).abs() < 1e-12);
        assert_eq!(noise(2e3, 0.0, &mut 0)[0], 0.01, "beyond all impacts the filter has diverged");
    }
}
