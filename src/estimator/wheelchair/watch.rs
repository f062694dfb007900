//! Whether the innovations agree with what a filter takes as given: the contour line, and that no unreported moment steers.
//!
//! The kinds with heading and slope know the tilt of the ground across one line only, that of `initial.heading`. Ground
//! that tilts along that line as well, by `chi`, moves "up" in the body by `(cos(alpha) chi, -sin(alpha) chi)`: the
//! leftward accelerometer is off by `-g sin(alpha) chi`, the gyro by `cos(alpha) chi'`, and neither is noise. Both are
//! followed here by filters of one state each, which wait the longer the noisier the sensor is. The source has
//! nothing of the kind.

use super::brake::Brake;
use super::held::Held;
use super::outliers::ACCEL_X;
use super::push::Push;
use super::turn::Turn;
use super::vibration::Vibration;
use crate::filter::ekf::Rows;
use crate::filter::gaussian::Gaussian;
use serde::{Deserialize, Serialize};

/// Rows of the leftward and the upward accelerometer.
pub(super) const LEFT: usize = ACCEL_X + 1;
pub(super) const UPWARD: usize = ACCEL_X + 2;
/// Rows of distance, heading and gyro.
pub(super) const TRAVEL: usize = 0;
pub(super) const HEADING: usize = 1;
pub(super) const GYRO: usize = 2;
/// Density of the tilt along the contour line, rad^2/s.
const ACROSS: f64 = 1e-4;
/// Densities of the mean of innovations over their standard deviations, 1/s: the gyro sees a tilt while it grows, the
/// heading a moment for as long as it acts.
const GYRO_MEAN: f64 = 2.0;
const HEADING_MEAN: f64 = 0.005;
/// A mean so many standard deviations from zero is none of noise: of white noise the filter of [`Mean`] shows
/// three quarters of what it expects.
const SIGNIFICANT: f64 = 3.5;
/// A bias is compared with what it was this long ago, s, and drifts if it has moved by more than this, m/s^2,
/// and by more than its own uncertainty explains.
const BIAS_TIME: f64 = 2.0;
const BIAS_MOVED: f64 = 0.04;
/// One sample counts at most as this many standard deviations off.
const LARGEST: f64 = 4.0;
/// A smaller tilt along the contour line is left to the standard deviation, rad: no heading is given up for it, and below
/// the second the leftward accelerometer remains in use.
const LEAST_TILT: f64 = 0.012;
const LEAST_DISTURBING_TILT: f64 = 0.004;
/// What the ground may tilt along the contour line while a sensor contradicts that line, rad.
const SEEN_TILT: f64 = 0.1;
/// What the first sample shows is a bias if nothing has contradicted the contour line for so long, s.
const START_TIME: f64 = 3.0;
/// The gyro sees a tilt only while it grows, and a bias that nobody expects stays: they count so many times.
const CONCLUSIVE: f64 = 3.0;
/// So long after the first sample, s, the encoders show whether the speed at the start is that of the parameters.
const SPEED_TIME: f64 = 0.3;
/// With less of it across the heading the leftward accelerometer says nothing about the contour line.
const LEAST_SHARE: f64 = 0.2;

/// The mean of something that is zero if all is well, by a filter of one state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    value: f64,
    variance: f64,
}

impl Mean {
    /// Takes a sample of variance `noise`; since the last one the mean has moved by `drift` in variance.
    fn update(&mut self, sample: f64, noise: f64, drift: f64) {
        if !sample.is_finite() {
            return;
        }
        self.variance += drift;
        let (off, total) = (sample - self.value, self.variance + noise);
        let most = LARGEST * total.sqrt();
        let gain = self.variance / total;
        self.value += gain * off.clamp(-most, most);
        self.variance -= gain * self.variance;
    }

    fn is_significant(&self) -> bool {
        self.value * self.value > SIGNIFICANT * SIGNIFICANT * self.variance
    }

    /// Mean square of what may be behind it.
    fn square(&self) -> f64 {
        self.value * self.value + self.variance
    }
}

/// What is estimated from innovations beside the state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Watch {
    /// Vibration of the accelerometer, as on cobbles.
    pub vibration: Vibration,
    /// A force that moves and is not reported.
    pub push: Push,
    /// A yaw acceleration that is not reported.
    pub turn: Turn,
    /// Moment with which the chair is held without a report.
    pub held: Held,
    /// A brake that may have held the chair at the start.
    pub brake: Brake,
    /// Tilt of the ground along the contour line, rad.
    across: Mean,
    /// Mean square of it as the first sample shows it, rad^2: it fades.
    start: f64,
    /// Innovations of gyro and heading over their standard deviations.
    gyro: Mean,
    heading: Mean,
    /// The leftward accelerometer's bias some time ago, m/s^2, its variance, and how long ago, s.
    bias: [f64; 2],
    bias_age: f64,
    /// For how long the contour line has been in doubt, s.
    doubt: f64,
    /// Time since the first sample, s.
    time: f64,
}

impl Watch {
    /// Mean square tilt along the contour line that the innovations indicate, rad^2.
    pub fn tilt_along_contour(&self) -> f64 {
        let seen = if self.contradicts_contour() { SEEN_TILT * SEEN_TILT } else { 0.0 };
        self.across.square() + seen + self.start
    }

    /// Takes the mean square tilt along the contour line that the first sample shows beyond biases and noise, rad^2.
    pub fn begin(&mut self, along_contour: f64) {
        self.start = along_contour.min(SEEN_TILT * SEEN_TILT);
    }

    /// Whether the ride has just begun, `dt` seconds after the last sample.
    pub fn begins(&mut self, dt: f64) -> bool {
        self.time += dt;
        self.time < SPEED_TIME
    }

    /// Whether there was a sample before.
    pub fn has_begun(&self) -> bool {
        self.time > 0.0
    }

    /// Whether a sensor contradicts the contour line.
    pub fn contradicts_contour(&self) -> bool {
        self.contour_is_contradicted() || self.gyro.is_significant()
    }

    /// Follows what hands hold over a step of `dt` seconds by what a correction added to the yaw rate, if it shows anything,
    /// and the variance of that; see [`Held`]. Where the contour line is contradicted gravity's moment is not the one that
    /// it gives.
    pub(super) fn follow_held(&mut self, added: Option<(f64, f64)>, gravity: f64, dt: f64) {
        if self.contradicts_contour() {
            (self.held, self.turn) = (Held::default(), Turn::default());
            return;
        }
        self.held.wait(dt);
        if let Some((added, variance)) = added {
            self.held.update(added, gravity, variance, dt);
        }
    }

    /// Whether the gyro is what contradicts the contour line.
    pub fn gyro_contradicts(&self) -> bool {
        self.gyro.is_significant()
    }

    /// Whether the contour line has been in doubt for at least `time`; `improbable` is doubt from elsewhere.
    pub fn doubts(&mut self, improbable: bool, time: f64, dt: f64) -> bool {
        let mut weight = -1.0;
        if self.contour_is_contradicted() || self.heading.is_significant() {
            weight = 1.0;
        }
        if improbable || self.gyro.is_significant() {
            weight = CONCLUSIVE;
        }
        self.doubt = (self.doubt + weight * dt).clamp(0.0, 2.0 * time);
        self.doubt > time
    }

    /// Whether the leftward accelerometer's bias moves as no sensor's does: while a bias is being estimated it moves within its own
    /// uncertainty, one that reconciles the accelerometer with an unreported moment keeps growing.
    pub fn bias_drifts(&mut self, bias: f64, variance: f64, dt: f64) -> bool {
        self.bias_age += dt;
        if self.bias_age >= BIAS_TIME || self.bias[1] == 0.0 {
            (self.bias, self.bias_age) = ([bias, variance], 0.0);
        }
        let moved = (bias - self.bias[0]).powi(2);
        let explained = (self.bias[1] - variance).max(0.0);
        moved > BIAS_MOVED * BIAS_MOVED && moved > SIGNIFICANT * SIGNIFICANT * explained
    }

    /// Clears all doubt.
    pub fn reset(&mut self) {
        *self =
            Self { vibration: self.vibration, push: self.push, turn: self.turn, time: self.time, ..Self::default() };
    }

    /// Compares a sample that came `dt` seconds after the last one with a contour line at the heading `alpha` to it. What the first
    /// sample shows remains in doubt until the chair moves.
    /// Returns whether the leftward accelerometer contradicts it: it must not correct the direction of travel then.
    pub(super) fn compare_with_contour<const N: usize>(
        &mut self,
        (alpha, moves): (f64, bool),
        gravity: f64,
        belief: &Gaussian<N>,
        rows: &Rows<N, 6>,
        dt: f64,
    ) -> bool {
        if moves {
            self.start *= (-dt / START_TIME).exp();
        }
        let share = -alpha.sin();
        if rows.used[LEFT] && share.abs() > LEAST_SHARE {
            let scale = gravity * share;
            let noise = rows.noise[(LEFT, LEFT)] / (scale * scale);
            self.across.update(rows.innovation[LEFT] / scale, noise, ACROSS * share * share * dt);
        }
        self.gyro.update_with_row(belief, rows, GYRO, GYRO_MEAN * dt);
        self.heading.update_with_row(belief, rows, HEADING, HEADING_MEAN * dt);
        self.across.is_significant() && self.across.value.abs() > LEAST_DISTURBING_TILT
    }

    fn contour_is_contradicted(&self) -> bool {
        self.across.is_significant() && self.across.value.abs() > LEAST_TILT
    }
}

impl Mean {
    /// Takes the innovation of a row over its standard deviation.
    fn update_with_row<const N: usize>(&mut self, belief: &Gaussian<N>, rows: &Rows<N, 6>, row: usize, drift: f64) {
        if rows.used[row] {
            let variance = rows.expected_variance(row, belief) + rows.noise[(row, row)];
            self.update(rows.innovation[row] / variance.sqrt(), 1.0, drift);
        }
    }
}
