//! Heading, slope and pitch of a chair whose state is the direction of gravity, with their standard deviations.

use crate::model::wheelchair::gravity::{self, GX, WP};
use crate::variable::Estimate;
use nalgebra::{Matrix2, SMatrix};
use std::f64::consts::PI;

/// Heading, slope, slope rate and pitch, by the delta method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Heading relative to the contour line, rad, in (-pi, pi]. Its standard deviation is at most `pi / sqrt(3)`: that of a
    /// heading of which nothing is known.
    pub heading: Estimate,
    /// Slope, rad, not negative.
    pub slope: Estimate,
    /// Rate of the slope, rad/s.
    pub slope_rate: Estimate,
    /// Nose-up pitch, rad.
    pub pitch: Estimate,
}

/// Attitude from the mean and the covariance of the state.
///
/// Where the slope is smaller than its own uncertainty the delta method would divide by zero; there
/// the heading counts as unknown and every direction of the tilt counts for the slope. Not much above
/// it the tilt may point the other way, which the heading's standard deviation contains.
pub fn attitude(x: &gravity::State, covariance: &SMatrix<f64, 8, 8>) -> Attitude {
    let block = covariance.fixed_view::<2, 2>(GX, GX).into_owned();
    let rates = covariance.fixed_view::<2, 2>(WP, WP).into_owned();
    let (tilt, [ux, uy]) = gravity::tilt(x);
    let cosine = (1.0 - tilt * tilt).max(1e-6).sqrt();
    let spread = block.trace();
    let unknown = PI / 3.0_f64.sqrt();
    let quadratic =
        |m: &Matrix2<f64>, a: f64, b: f64| (a * a * m[(0, 0)] + 2.0 * a * b * m[(0, 1)] + b * b * m[(1, 1)]).max(0.0);
    let (along, across) = (quadratic(&block, ux, uy), quadratic(&block, uy, -ux));
    // A tilt that may as well point the other way makes the heading wrong by half a turn; Chernoff's bound of that.
    let turned = 0.5 * (-0.5 * tilt * tilt / along.max(1e-24)).exp();
    let heading_variance = (1.0 - turned) * across / (tilt * tilt).max(1e-24) + turned * PI * PI;
    let flat = tilt * tilt <= spread;
    let slope_rate_variance = quadratic(&rates, ux, uy) + if flat { rates.trace() } else { 0.0 };
    let pose = gravity::pose(x);
    let slope_std = if flat { spread.sqrt() } else { along.sqrt() / cosine };
    let pitch_std = (block[(0, 0)].max(0.0) / (1.0 - x[GX] * x[GX]).max(1e-6)).sqrt();
    Attitude {
        heading: Estimate::new(pose.heading, heading_variance.sqrt().min(unknown)),
        slope: Estimate::new(pose.slope, slope_std),
        slope_rate: Estimate::new(pose.slope_rate, slope_rate_variance.sqrt()),
        pitch: Estimate::new(pose.pitch, pitch_std),
    }
}
