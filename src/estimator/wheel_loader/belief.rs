//! What the filter knows: motion, unknowns and radii.

use super::coordinates::{Map, initial_unknowns};
use super::parameters::{Parameters, Radii};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::square_root::tria;
use nalgebra::{SVector, Vector3};

/// States of the belief as it is stored; where the radii are taken as given the last two are 0.
pub const STATES: usize = 8;

/// `[v, w_f, w_r, theta_K, theta_h, theta_lambda, d_f, d_r]`: motion in m/s and rad/s, unknowns in the filter's
/// coordinates, relative errors of the rolling radii.
pub type Belief = FactoredGaussian<STATES>;

/// The belief before the first sample.
pub fn initial(p: &Parameters, map: &Map) -> Belief {
    let (initial, unknowns) = (&p.initial, initial_unknowns(&p.initial));
    let (theta, derivative) = (map.coordinates(&unknowns), map.derivative(&unknowns));
    let radius_std = if p.filter.radii == Radii::Estimated { initial.wheel_radius_std } else { 0.0 };
    let mut mean = SVector::<f64, STATES>::zeros();
    mean.fixed_rows_mut::<3>(3).copy_from(&theta);
    let std = [
        initial.speed_std,
        initial.wheel_speed_std,
        initial.wheel_speed_std,
        initial.slip_stiffness_std / derivative[0],
        initial.cg_height_std / derivative[1],
        initial.cg_ratio_std / derivative[2],
        radius_std,
        radius_std,
    ];
    FactoredGaussian::independent(mean, &SVector::from(std))
}

/// Restarts the motion from a sample `y` of speed and wheel speeds, NaN where there is none. What is missing follows
/// from the others by rolling; if all are, the motion is as it was, and unknown.
///
/// Nothing ties the unknowns to a motion that restarts; their own covariance stays.
pub fn begin_motion(
    belief: &mut Belief,
    y: &Vector3<f64>,
    radius: [f64; 2],
    measured_std: [f64; 3],
    unknown_std: [f64; 3],
) {
    let rolling = (0..2).map(|i| radius[i] * y[i + 1]).find(|speed| speed.is_finite());
    let v = if y[0].is_finite() { y[0] } else { rolling.unwrap_or(belief.mean[0]) };
    let motion = [v, v / radius[0], v / radius[1]];
    let others = tria(belief.factor.fixed_rows::<5>(3).into_owned());
    belief.factor.fill(0.0);
    belief.factor.fixed_view_mut::<5, 5>(3, 3).copy_from(&others);
    for i in 0..3 {
        let measured = y[i].is_finite();
        belief.mean[i] = if measured { y[i] } else { motion[i] };
        belief.factor[(i, i)] = if measured { measured_std[i] } else { unknown_std[i] };
    }
}

/// Puts unknowns and radii back to an earlier belief, such as that before the first sample. Nothing ties them to the
/// present motion then.
pub fn restore_unknowns(belief: &mut Belief, earlier: &Belief) {
    let others = tria(earlier.factor.fixed_rows::<5>(3).into_owned());
    for row in 3..STATES {
        belief.mean[row] = earlier.mean[row];
        belief.factor.row_mut(row).fill(0.0);
    }
    belief.factor.fixed_view_mut::<5, 5>(3, 3).copy_from(&others);
}
