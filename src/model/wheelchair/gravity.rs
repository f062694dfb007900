//! The chair with the direction of gravity as state: no singular pose, no known contour line.
//!
//! `x = [s, psi, v, r, gx, gy, wp, wr]` with `gx = sin(alpha) sin(xi)` and `gy = cos(alpha) sin(xi)`,
//! the uphill share of "up" along the body's x and y axes, `psi` the yaw angle since the encoders'
//! zero, `wp` the nose-up rate and `wr` the roll rate that the ground gives the chair. Heading and
//! slope follow as `alpha = atan2(gx, gy)` and `xi = asin |(gx, gy)| >= 0`, so that a chair whose
//! direction to the contour line is unknown needs no initial heading. On flat ground `alpha` has no
//! meaning and its standard deviation says so.
//!
//! What the rates `wp`, `wr` do to the accelerometer in second order (`wr^2` times a lever, less than its
//! noise at the rates that ground gives a chair) is left out: nothing else measures the roll rate, and a
//! filter that sees its square takes a wrong sign for a solution.

use super::motion::motion;
use super::{Chair, Command, Output};
use nalgebra::{SMatrix, SVector, Vector3};

/// State `[s, psi, v, r, gx, gy, wp, wr]`.
pub type State = SVector<f64, 8>;

/// Index of the distance, m.
pub const S: usize = 0;
/// Index of the yaw angle, rad.
pub const PSI: usize = 1;
/// Index of the speed, m/s.
pub const V: usize = 2;
/// Index of the yaw rate, rad/s.
pub const R: usize = 3;
/// Index of the share of "up" along x, 1.
pub const GX: usize = 4;
/// Index of the share of "up" along y, 1.
pub const GY: usize = 5;
/// Index of the nose-up rate, rad/s.
pub const WP: usize = 6;
/// Index of the roll rate, rad/s.
pub const WR: usize = 7;

/// Smallest share of "up" along the normal, a tilt of 80 degrees.
const STEEPEST: f64 = 0.17;

/// Share of "up" along the normal, with its gradient over `gx`, `gy`. A state beyond the steepest tilt,
/// or even beyond the unit circle, keeps that share, so that no gradient grows without bound.
fn normal_share(x: &State) -> (f64, [f64; 2]) {
    let square = 1.0 - x[GX] * x[GX] - x[GY] * x[GY];
    if square <= STEEPEST * STEEPEST {
        return (STEEPEST, [0.0; 2]);
    }
    let gz = square.sqrt();
    (gz, [-x[GX] / gz, -x[GY] / gz])
}

/// `v'` and `r'`, their gradients over `[v, r, gx, gy]`, and the share of "up" along the normal.
struct Accelerations {
    v_dot: f64,
    r_dot: f64,
    v_gradient: [f64; 4],
    r_gradient: [f64; 4],
    gz: f64,
    gz_x: f64,
    gz_y: f64,
}

#[inline(always)]
fn accelerations(chair: &Chair, x: &State, u: &Command, still: bool) -> Accelerations {
    let (gz, [gz_x, gz_y]) = normal_share(x);
    let (mut v_dot, mut r_dot, mut v_gradient, mut r_gradient) = (0.0, 0.0, [0.0; 4], [0.0; 4]);
    if !still {
        let motion = motion(chair, x[V], x[R], [x[GX], x[GY], gz], u);
        let chain = |[v, r, gx, gy, along_z]: [f64; 5]| [v, r, gx + along_z * gz_x, gy + along_z * gz_y];
        (v_dot, r_dot) = (motion.v_dot, motion.r_dot);
        (v_gradient, r_gradient) = (chain(motion.v_partials), chain(motion.r_partials));
    }
    Accelerations { v_dot, r_dot, v_gradient, r_gradient, gz, gz_x, gz_y }
}

/// `x' = f(x, u)`: `s' = v + renc wp`, `psi' = r`, `gx' = r gy + gz wp`, `gy' = gz wr - r gx`, the
/// rates `wp`, `wr` constant, `v'` and `r'` as in [`super::derivative`].
#[inline]
pub fn derivative(chair: &Chair, x: &State, u: &Command, still: bool) -> State {
    rates(chair, x, &accelerations(chair, x, u, still))
}

fn rates(chair: &Chair, x: &State, a: &Accelerations) -> State {
    let gx_dot = x[R] * x[GY] + a.gz * x[WP];
    let gy_dot = a.gz * x[WR] - x[R] * x[GX];
    State::from([x[V] + chair.pitch_travel * x[WP], x[R], a.v_dot, a.r_dot, gx_dot, gy_dot, 0.0, 0.0])
}

/// [`derivative`] and the Jacobian of its first six rows at the price of one; the others are zero.
#[inline]
pub fn linearise(chair: &Chair, x: &State, u: &Command, still: bool) -> (State, SMatrix<f64, 6, 8>) {
    let a = accelerations(chair, x, u, still);
    let mut jacobian = SMatrix::<f64, 6, 8>::zeros();
    jacobian[(S, V)] = 1.0;
    jacobian[(S, WP)] = chair.pitch_travel;
    jacobian[(PSI, R)] = 1.0;
    for (row, gradient) in [(V, a.v_gradient), (R, a.r_gradient)] {
        for (column, value) in [V, R, GX, GY].into_iter().zip(gradient) {
            jacobian[(row, column)] = value;
        }
    }
    jacobian[(GX, R)] = x[GY];
    jacobian[(GX, GX)] = a.gz_x * x[WP];
    jacobian[(GX, GY)] = x[R] + a.gz_y * x[WP];
    jacobian[(GX, WP)] = a.gz;
    jacobian[(GY, R)] = -x[GX];
    jacobian[(GY, GX)] = -x[R] + a.gz_x * x[WR];
    jacobian[(GY, GY)] = a.gz_y * x[WR];
    jacobian[(GY, WR)] = a.gz;
    (rates(chair, x, &a), jacobian)
}

/// `y = h(x, u)`: as [`super::output`] for a strapped-down gyro and a rigid body, with the body rates
/// `p = wr`, `q = -wp` in first order and the second row `alpha_enc = psi`.
#[inline]
pub fn output(chair: &Chair, x: &State, u: &Command, still: bool) -> Output {
    reading(chair, x, &accelerations(chair, x, u, still))
}

fn reading(chair: &Chair, x: &State, a: &Accelerations) -> Output {
    let (v, r, p, q, g) = (x[V], x[R], x[WR], -x[WP], chair.gravity);
    let [dx, dy, _] = chair.lever();
    Output::new(
        x[S] - chair.reference_offset() * (x[PSI] - chair.heading_reference),
        x[PSI],
        x[WP],
        a.v_dot + g * x[GX] - dy * a.r_dot - dx * r * r,
        v * r + g * x[GY] + dx * a.r_dot - dy * r * r,
        g * a.gz - v * q + 2.0 * r * (p * dx + q * dy),
    )
}

/// [`output`] and its Jacobian at the price of one.
#[inline]
pub fn observe(chair: &Chair, x: &State, u: &Command, still: bool) -> (Output, SMatrix<f64, 6, 8>) {
    let a = accelerations(chair, x, u, still);
    let (v, r, p, q, g) = (x[V], x[R], x[WR], -x[WP], chair.gravity);
    let [dx, dy, _] = chair.lever();
    let mut jacobian = SMatrix::<f64, 6, 8>::zeros();
    jacobian[(0, S)] = 1.0;
    jacobian[(0, PSI)] = -chair.reference_offset();
    jacobian[(1, PSI)] = 1.0;
    jacobian[(2, WP)] = 1.0;
    for (k, column) in [V, R, GX, GY].into_iter().enumerate() {
        jacobian[(3, column)] = a.v_gradient[k] - dy * a.r_gradient[k];
        jacobian[(4, column)] = dx * a.r_gradient[k];
    }
    jacobian[(3, R)] -= 2.0 * dx * r;
    jacobian[(3, GX)] += g;
    jacobian[(4, V)] += r;
    jacobian[(4, R)] += v - 2.0 * dy * r;
    jacobian[(4, GY)] += g;
    jacobian[(5, V)] = -q;
    jacobian[(5, R)] = 2.0 * (p * dx + q * dy);
    jacobian[(5, GX)] = g * a.gz_x;
    jacobian[(5, GY)] = g * a.gz_y;
    jacobian[(5, WP)] = v - 2.0 * r * dy;
    jacobian[(5, WR)] = 2.0 * r * dx;
    (reading(chair, x, &a), jacobian)
}

/// What `wp'` and `wr'` add to the accelerometer per rad/s^2, m; the model leaves both to the noise.
#[inline]
pub fn tilt_levers(chair: &Chair) -> [Vector3<f64>; 2] {
    let [dx, dy, dz] = chair.lever();
    [Vector3::new(-dz, 0.0, dx), Vector3::new(0.0, -dz, dy)]
}

/// Size of the tilt `sin(xi) = |(gx, gy)|`, at most 1, and the unit vector along it in body axes; on flat ground any.
#[inline]
pub fn tilt(x: &State) -> (f64, [f64; 2]) {
    let tilt = (x[GX] * x[GX] + x[GY] * x[GY]).sqrt().min(1.0);
    (tilt, if tilt > LEVEL { [x[GX] / tilt, x[GY] / tilt] } else { [1.0, 0.0] })
}

/// A tilt of which no direction can be seen.
const LEVEL: f64 = 1e-12;

/// Heading and slope of a chair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Heading relative to the contour line, rad, in (-pi, pi]; 0 on flat ground.
    pub heading: f64,
    /// Slope, rad, not negative.
    pub slope: f64,
    /// Rate of the slope, rad/s.
    pub slope_rate: f64,
    /// Nose-up pitch, rad.
    pub pitch: f64,
}

/// `alpha = atan2(gx, gy)`, `xi = asin |(gx, gy)|`, `w` and `phi = asin gx`.
#[inline]
pub fn pose(x: &State) -> Pose {
    let (tilt, [ux, uy]) = tilt(x);
    Pose {
        heading: if tilt > LEVEL { x[GX].atan2(x[GY]) } else { 0.0 },
        slope: tilt.asin(),
        slope_rate: ux * x[WP] + uy * x[WR],
        pitch: x[GX].clamp(-1.0, 1.0).asin(),
    }
}
