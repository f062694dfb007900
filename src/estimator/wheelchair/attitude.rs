//! Heading, slope and pitch of a chair whose state is the direction of gravity, with their standard deviations.

use crate::model::wheelchair::gravity::{self, GX, WP};
use crate::variable::Estimate;
use nalgebra::SMatrix;
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

/// Attitude from the mean and the covariance of the state, or of a longer one that begins with this.
///
/// Where the slope is smaller than its own uncertainty the delta method would divide by zero; there
/// the heading counts as unknown and every direction of the tilt counts for the slope. Not much above
/// it the tilt may point the other way, which the heading's standard deviation contains.
pub fn attitude<const N: usize>(x: &gravity::State, covariance: &SMatrix<f64, N, N>) -> Attitude {
    let (tilt, direction) = gravity::tilt(x);
    let [ux, uy] = direction;
    let unknown = PI / 3.0_f64.sqrt();
    let [along_tilt, across_tilt] = [direction, [uy, -ux]].map(|direction| along(covariance, GX, direction));
    // A tilt that may as well point the other way makes the heading wrong by half a turn; Chernoff's bound of that.
    let turned = 0.5 * (-0.5 * tilt * tilt / along_tilt.max(1e-24)).exp();
    let heading_variance = (1.0 - turned) * across_tilt / (tilt * tilt).max(1e-24) + turned * PI * PI;
    let any = if is_flat(tilt, covariance) { spread(covariance, WP) } else { 0.0 };
    let slope_rate_variance = along(covariance, WP, direction) + any;
    let pose = gravity::pose(x);
    let pitch_std = (covariance[(GX, GX)].max(0.0) / (1.0 - x[GX] * x[GX]).max(1e-6)).sqrt();
    Attitude {
        heading: Estimate::new(pose.heading, heading_variance.sqrt().min(unknown)),
        slope: Estimate::new(pose.slope, slope_std(x, covariance)),
        slope_rate: Estimate::new(pose.slope_rate, slope_rate_variance.sqrt()),
        pitch: Estimate::new(pose.pitch, pitch_std),
    }
}

/// Standard deviation of the slope, rad.
pub fn slope_std<const N: usize>(x: &gravity::State, covariance: &SMatrix<f64, N, N>) -> f64 {
    let (tilt, direction) = gravity::tilt(x);
    let cosine = (1.0 - tilt * tilt).max(1e-6).sqrt();
    if is_flat(tilt, covariance) {
        spread(covariance, GX).sqrt()
    } else {
        along(covariance, GX, direction).sqrt() / cosine
    }
}

fn is_flat<const N: usize>(tilt: f64, covariance: &SMatrix<f64, N, N>) -> bool {
    tilt * tilt <= spread(covariance, GX)
}

/// Variance of two states that follow each other, in all directions.
fn spread<const N: usize>(covariance: &SMatrix<f64, N, N>, first: usize) -> f64 {
    covariance[(first, first)] + covariance[(first + 1, first + 1)]
}

/// Variance of two states that follow each other, in one direction.
fn along<const N: usize>(covariance: &SMatrix<f64, N, N>, first: usize, [a, b]: [f64; 2]) -> f64 {
    let [aa, ab, bb] = [(first, first), (first, first + 1), (first + 1, first + 1)].map(|index| covariance[index]);
    (a * a * aa + 2.0 * a * b * ab + b * b * bb).max(0.0)
}
