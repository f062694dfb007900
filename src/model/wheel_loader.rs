//! Longitudinal dynamics of a wheel loader whose axles are driven independently, with exact load
//! transfer (Yang, Wang and Han, 2021).
//!
//! # Frame and signs
//!
//! `x` forward along the road, `z` normal to the road and up. The slope `alpha` is positive uphill.
//! The spading force `F_x` at the bucket's tip is positive when it pushes the machine backwards and
//! `F_z` when it pulls the tip down. Torques act at the wheels, after the reduction; brake torques
//! are magnitudes.
//!
//! # Equations
//!
//! Slip `sigma_i = (r_i w_i - v) / max(|r_i w_i|, |v|, v_g)`, friction demand `mu_i = mu(K sigma_i)`,
//! with `mu(x) = x` or `mu_max tanh(x / mu_max)`, smooth sign `s(x) = tanh(x / v_s)`;
//!
//! ```text
//! W   = m g cos alpha + F_z                                           load on both axles
//! b_f = m g lambda cos alpha + F_z (l + l_c)/l - F_x h_b/l,  b_r = W - b_f
//! D   = 1 + (h/l)(mu_f - mu_r)
//! a_s = [mu_f b_f + mu_r b_r - f s(v) W - F_x] / (m max(D, d_min))    specific force
//! F_zf = b_f - (m h/l) a_s,   F_zr = b_r + (m h/l) a_s                axle loads
//! v'  = a_s - g sin alpha
//! w_i' = (T_i - B_i s(r_i w_i) - r_i mu_i F_zi) / I_i
//! ```
//!
//! An axle whose load would be negative carries none and the other one carries everything.
//! The rolling radius is the one at zero torque: then it does not matter whether the rolling moment
//! acts on the body, as here, or on the wheels.
//!
//! # Errata of the source
//!
//! - Eqs. 6, 7, 10, 11: the load transfer from `v'` is printed with the wrong sign; acceleration
//!   unloads the front axle. The printed sign shifts the estimated `lambda` by `-2 v' h/(g l cos alpha)`.
//! - Eq. 10: `m g lambda cos alpha` belongs outside the fraction.
//! - Eq. 12: a bracket is missing and the denominator is `1 + (h K/l)(sigma_f - sigma_r)`.
//! - Eqs. 13, 14: the transfer is `-(h m/l)(v' + g sin alpha)` in front and `+` at the rear.
//! - Eqs. 6, 7 give `F_x` at the tip no moment; `h_b = 0` reproduces that.
//! - Eq. 18: explicit Euler at 10 ms is unstable here (the wheel's pole is near -2e4 1/s with the
//!   printed inertia); [`Loader::advance`] is linearly implicit.
//! - Table 1: the mass "4.7 kg" is in tonnes and 50 N.m can only be a motor torque.

use nalgebra::{Matrix3, Matrix3x2, Vector3};
use serde::{Deserialize, Serialize};

/// Standard gravity, m/s2.
pub const GRAVITY: f64 = 9.80665;

/// What is known of the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loader {
    /// Mass `m`, kg.
    pub mass: f64,
    /// Wheelbase `l`, m.
    pub wheelbase: f64,
    /// Rolling radii at zero torque `[r_f, r_r]`, m.
    pub wheel_radius: [f64; 2],
    /// Inertia of each axle with its drive, seen at the wheels, `[I_f, I_r]`, kg.m2.
    pub axle_inertia: [f64; 2],
    /// Distance of the bucket's tip ahead of the front axle `l_c`, m.
    pub bucket_reach: f64,
    /// Height of the bucket's tip `h_b`, m.
    pub bucket_height: f64,
    /// Rolling resistance coefficient `f`.
    pub rolling: f64,
    /// Largest friction coefficient `mu_max`; infinite for the source's linear tyre.
    pub friction: f64,
    /// Speed below which slip is no longer relative `v_g`, m/s.
    pub slip_speed: f64,
    /// Speed over which resistance changes sign `v_s`, m/s.
    pub sign_speed: f64,
    /// Lower limit of the load-transfer denominator `d_min`.
    pub transfer_floor: f64,
}

impl Default for Loader {
    /// A compact loader of 4.7 t; what the source does not print is an engineering assumption.
    fn default() -> Self {
        Self {
            mass: 4700.0,
            wheelbase: 2.2,
            wheel_radius: [0.55; 2],
            axle_inertia: [36.0; 2],
            bucket_reach: 1.6,
            bucket_height: 0.0,
            rolling: 0.03,
            friction: 0.75,
            slip_speed: 0.3,
            sign_speed: 0.05,
            transfer_floor: 0.1,
        }
    }
}

/// What drives the model: `u = [T_f, T_r, B_f, B_r, alpha, F_x, F_z]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Drive {
    /// Net drive torque of each axle at the wheels, N.m.
    pub torque: [f64; 2],
    /// Brake torque magnitude of each axle, N.m.
    pub brake: [f64; 2],
    /// Slope, rad, positive uphill.
    pub slope: f64,
    /// Spading force, N, positive backwards.
    pub force_x: f64,
    /// Spading force, N, positive down.
    pub force_z: f64,
}

/// Speed and wheel speeds `[v, w_f, w_r]`, m/s and rad/s.
pub type Motion = Vector3<f64>;

/// The parameters to estimate `[K, h, lambda]`: slip stiffness, CG height in m and the CG's distance
/// to the rear axle over the wheelbase, which is the front axle's share of the static load.
pub type Unknowns = Vector3<f64>;

/// The model at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Time derivatives of the motion.
    pub rates: Motion,
    /// Slip of each axle.
    pub slip: [f64; 2],
    /// Axle loads, N.
    pub load: [f64; 2],
    /// Specific force along the road, m/s2: what an accelerometer shows.
    pub specific_force: f64,
    /// An axle has lost contact.
    pub lift: bool,
    /// Load-transfer denominator before its guard.
    pub transfer: f64,
    /// The guard of the denominator acts.
    pub guarded: bool,
    /// Derivatives of the front load to `(v, w_f, w_r, K, h, lambda)`, N per unit; those to the last
    /// three only from [`Loader::linearise`]. The sum of both loads depends on none of them.
    pub load_slope: [f64; 6],
}

/// Slip with its derivatives to `v` and `w`. One form drives, brakes, reverses and stands still.
pub fn slip(v: f64, w: f64, radius: f64, slip_speed: f64) -> (f64, f64, f64) {
    let rolling = radius * w;
    let s = rolling - v;
    let (m_wheel, m_speed) = (rolling.abs(), v.abs());
    if m_wheel >= m_speed && m_wheel > slip_speed {
        let m = m_wheel;
        (s / m, -1.0 / m, radius / m - s * radius * rolling.signum() / (m * m))
    } else if m_speed > slip_speed {
        let m = m_speed;
        (s / m, -1.0 / m - s * v.signum() / (m * m), radius / m)
    } else {
        let m = slip_speed;
        (s / m, -1.0 / m, radius / m)
    }
}

/// Hyperbolic tangent; near zero, where the tyres work, by its continued fraction, which is exact to
/// the last bits there and several times faster than the library's function.
fn tanh(x: f64) -> f64 {
    if x.abs() > 0.6 {
        return x.tanh();
    }
    let s = x * x;
    x * (135_135.0 + s * (17_325.0 + s * (378.0 + s))) / (135_135.0 + s * (62_370.0 + s * (3_150.0 + 28.0 * s)))
}

/// Friction demand `mu(x)` with its derivative.
fn friction_demand(x: f64, limit: f64) -> (f64, f64) {
    if limit.is_finite() {
        let t = tanh(x / limit);
        (limit * t, 1.0 - t * t)
    } else {
        (x, 1.0)
    }
}

/// Smooth sign with its derivative.
fn smooth_sign(x: f64, width: f64) -> (f64, f64) {
    let ratio = x / width;
    if ratio.abs() > 20.0 {
        return (ratio.signum(), 0.0); // tanh has reached 1 to the last bit
    }
    let t = tanh(ratio);
    (t, (1.0 - t * t) / width)
}

/// Derivatives of the rates, or of the motion after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jacobian {
    /// To the motion `[v, w_f, w_r]`.
    pub motion: Matrix3<f64>,
    /// To the unknowns `[K, h, lambda]`.
    pub unknowns: Matrix3<f64>,
    /// To relative changes of the rolling radii `[ln r_f, ln r_r]`.
    pub radii: Matrix3x2<f64>,
}

impl Loader {
    /// The model. The guard of `D` matters with the linear tyre only, whose `D` reaches 0 at
    /// `sigma_f - sigma_r = -l/(h K)`.
    pub fn rates(&self, x: &Motion, p: &Unknowns, u: &Drive) -> Point {
        self.evaluate(x, p, u, u.slope.sin_cos(), false).0
    }

    /// The model with its analytic Jacobian.
    pub fn linearise(&self, x: &Motion, p: &Unknowns, u: &Drive) -> (Point, Jacobian) {
        self.evaluate(x, p, u, u.slope.sin_cos(), true)
    }

    #[inline(always)]
    fn evaluate(
        &self,
        x: &Motion,
        p: &Unknowns,
        u: &Drive,
        slope: (f64, f64),
        unknowns_too: bool,
    ) -> (Point, Jacobian) {
        let (v, w) = (x[0], [x[1], x[2]]);
        let (stiffness, h, lambda) = (p[0], p[1], p[2]);
        let (m, l, r) = (self.mass, self.wheelbase, self.wheel_radius);
        let (sin, cos) = slope;

        let (sigma_f, sigma_f_v, sigma_f_w) = slip(v, w[0], r[0], self.slip_speed);
        let (sigma_r, sigma_r_v, sigma_r_w) = slip(v, w[1], r[1], self.slip_speed);
        let (mu_f, slope_f) = friction_demand(stiffness * sigma_f, self.friction);
        let (mu_r, slope_r) = friction_demand(stiffness * sigma_r, self.friction);
        let (s_v, s_v_v) = smooth_sign(v, self.sign_speed);
        // Derivatives of mu to v, w_f, w_r, K; h and lambda do not enter.
        let d_mu_f = [stiffness * slope_f * sigma_f_v, stiffness * slope_f * sigma_f_w, 0.0, slope_f * sigma_f];
        let d_mu_r = [stiffness * slope_r * sigma_r_v, 0.0, stiffness * slope_r * sigma_r_w, slope_r * sigma_r];

        let weight = m * GRAVITY * cos + u.force_z;
        let base_f =
            m * GRAVITY * lambda * cos + u.force_z * (l + self.bucket_reach) / l - u.force_x * self.bucket_height / l;
        let base_r = weight - base_f;
        let base_lambda = m * GRAVITY * cos;
        let transfer = 1.0 + h / l * (mu_f - mu_r);
        let guarded = transfer < self.transfer_floor;
        let d = if guarded { self.transfer_floor } else { transfer };
        let c = m * h / l;
        let mut a_s = (mu_f * base_f + mu_r * base_r - self.rolling * s_v * weight - u.force_x) / (m * d);
        let (mut load_f, mut load_r) = (base_f - c * a_s, base_r + c * a_s);

        // Derivatives to (v, w_f, w_r, K, h, lambda).
        let mut d_a = [0.0; 6];
        let (mut d_load_f, mut d_load_r) = ([0.0; 6], [0.0; 6]);
        let lift = load_f < 0.0 || load_r < 0.0;
        let count = if unknowns_too { 6 } else { 3 };
        if lift {
            let front = load_f >= 0.0;
            let all = weight.max(0.0);
            (load_f, load_r) = if front { (all, 0.0) } else { (0.0, all) };
            let (mu, d_mu) = if front { (mu_f, &d_mu_f) } else { (mu_r, &d_mu_r) };
            a_s = (mu * all - self.rolling * s_v * all - u.force_x) / m;
            for k in 0..4 {
                d_a[k] = d_mu[k] * all / m;
            }
            d_a[0] -= self.rolling * s_v_v * all / m;
        } else {
            let d_transfer = if guarded { 0.0 } else { h / l };
            for k in 0..4 {
                let d_force = d_mu_f[k] * base_f + d_mu_r[k] * base_r;
                d_a[k] = (d_force / m - a_s * d_transfer * (d_mu_f[k] - d_mu_r[k])) / d;
            }
            d_a[0] -= self.rolling * s_v_v * weight / (m * d);
            if !guarded {
                d_a[4] = -a_s * (mu_f - mu_r) / (l * d);
            }
            d_a[5] = base_lambda * (mu_f - mu_r) / (m * d);
            for k in 0..count {
                d_load_f[k] = -c * d_a[k];
            }
            d_load_f[4] -= m / l * a_s;
            for k in 0..count {
                d_load_r[k] = -d_load_f[k];
            }
            d_load_f[5] += base_lambda;
            d_load_r[5] -= base_lambda;
        }

        let (brake_f, brake_f_w) = self.brake(u.brake[0], r[0], w[0]);
        let (brake_r, brake_r_w) = self.brake(u.brake[1], r[1], w[1]);
        let rates = Motion::new(
            a_s - GRAVITY * sin,
            (u.torque[0] - brake_f - r[0] * mu_f * load_f) / self.axle_inertia[0],
            (u.torque[1] - brake_r - r[1] * mu_r * load_r) / self.axle_inertia[1],
        );

        let mut jacobian = Jacobian { motion: Matrix3::zeros(), unknowns: Matrix3::zeros(), radii: Matrix3x2::zeros() };
        let (g_f, g_r) = (-r[0] / self.axle_inertia[0], -r[1] / self.axle_inertia[1]);
        for k in 0..3 {
            jacobian.motion[(0, k)] = d_a[k];
            jacobian.motion[(1, k)] = g_f * (d_mu_f[k] * load_f + mu_f * d_load_f[k]);
            jacobian.motion[(2, k)] = g_r * (d_mu_r[k] * load_r + mu_r * d_load_r[k]);
        }
        jacobian.motion[(1, 1)] -= brake_f_w / self.axle_inertia[0];
        jacobian.motion[(2, 2)] -= brake_r_w / self.axle_inertia[1];
        if unknowns_too {
            for k in 0..3 {
                jacobian.unknowns[(0, k)] = d_a[3 + k];
                jacobian.unknowns[(1, k)] = g_f * mu_f * d_load_f[3 + k];
                jacobian.unknowns[(2, k)] = g_r * mu_r * d_load_r[3 + k];
            }
            jacobian.unknowns[(1, 0)] += g_f * d_mu_f[3] * load_f;
            jacobian.unknowns[(2, 0)] += g_r * d_mu_r[3] * load_r;
            // The wheel speeds enter as r w only; r also is the lever of the tyre's force.
            jacobian.radii.set_column(0, &(jacobian.motion.column(1) * w[0]));
            jacobian.radii.set_column(1, &(jacobian.motion.column(2) * w[1]));
            jacobian.radii[(1, 0)] += g_f * mu_f * load_f;
            jacobian.radii[(2, 1)] += g_r * mu_r * load_r;
        }

        let point = Point {
            rates,
            slip: [sigma_f, sigma_r],
            load: [load_f, load_r],
            specific_force: a_s,
            lift,
            transfer,
            guarded,
            load_slope: d_load_f,
        };
        (point, jacobian)
    }

    /// Brake torque against the wheel's rotation with its derivative to `w`.
    fn brake(&self, torque: f64, radius: f64, w: f64) -> (f64, f64) {
        if torque == 0.0 {
            return (0.0, 0.0);
        }
        let (sign, slope) = smooth_sign(radius * w, self.sign_speed);
        (torque * sign, torque * slope * radius)
    }

    /// The motion after `dt` seconds: `substeps` steps of linearly implicit Euler,
    /// `x + (I - hs J)^-1 hs f(x)`, `hs = dt / substeps`.
    ///
    /// Stable at any step although the wheels' poles lie near -1e4 1/s. A singular step, which no
    /// sensible machine has, leaves the motion where it is.
    pub fn advance(&self, x: &Motion, p: &Unknowns, u: &Drive, dt: f64, substeps: u32) -> Motion {
        let hs = dt / f64::from(substeps);
        let slope = u.slope.sin_cos();
        let mut x = *x;
        for _ in 0..substeps {
            let (point, jacobian) = self.evaluate(&x, p, u, slope, false);
            if let Some(inverse) = implicit(&jacobian.motion, hs) {
                x += inverse * (point.rates * hs);
            }
        }
        x
    }

    /// [`advance`](Self::advance) with its derivatives: `A` and `A hs J_p` per step with
    /// `A = (I - hs J)^-1`; second derivatives of the model are neglected.
    pub fn advance_linearised(
        &self,
        x: &Motion,
        p: &Unknowns,
        u: &Drive,
        dt: f64,
        substeps: u32,
    ) -> (Motion, Jacobian) {
        let hs = dt / f64::from(substeps);
        let slope = u.slope.sin_cos();
        let mut x = *x;
        let mut f = Jacobian { motion: Matrix3::identity(), unknowns: Matrix3::zeros(), radii: Matrix3x2::zeros() };
        for _ in 0..substeps {
            let (point, j) = self.evaluate(&x, p, u, slope, true);
            if let Some(inverse) = implicit(&j.motion, hs) {
                x += inverse * (point.rates * hs);
                f.motion = inverse * f.motion;
                f.unknowns = inverse * (f.unknowns + j.unknowns * hs);
                f.radii = inverse * (f.radii + j.radii * hs);
            }
        }
        (x, f)
    }
}

/// `(I - hs J)^-1`, or nothing if it does not exist.
fn implicit(jacobian: &Matrix3<f64>, hs: f64) -> Option<Matrix3<f64>> {
    let a = Matrix3::identity() - jacobian * hs;
    let c00 = a[(1, 1)] * a[(2, 2)] - a[(1, 2)] * a[(2, 1)];
    let c01 = a[(1, 2)] * a[(2, 0)] - a[(1, 0)] * a[(2, 2)];
    let c02 = a[(1, 0)] * a[(2, 1)] - a[(1, 1)] * a[(2, 0)];
    let determinant = a[(0, 0)] * c00 + a[(0, 1)] * c01 + a[(0, 2)] * c02;
    let scale = 1.0 / determinant;
    if !scale.is_finite() {
        return None;
    }
    let inverse = Matrix3::new(
        c00,
        a[(0, 2)] * a[(2, 1)] - a[(0, 1)] * a[(2, 2)],
        a[(0, 1)] * a[(1, 2)] - a[(0, 2)] * a[(1, 1)],
        c01,
        a[(0, 0)] * a[(2, 2)] - a[(0, 2)] * a[(2, 0)],
        a[(0, 2)] * a[(1, 0)] - a[(0, 0)] * a[(1, 2)],
        c02,
        a[(0, 1)] * a[(2, 0)] - a[(0, 0)] * a[(2, 1)],
        a[(0, 0)] * a[(1, 1)] - a[(0, 1)] * a[(1, 0)],
    ) * scale;
    Some(inverse)
}
