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

mod axles;

pub use axles::Driven;

use axles::{Axles, vector};
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
    /// Derivatives of the front load to `(v, w_f, w_r, K, h, lambda)`, N per unit. The sum of both
    /// loads depends on none of them.
    pub load_slope: [f64; 6],
}

/// Slip of a wheel. One form drives, brakes, reverses and stands still.
pub fn slip(v: f64, w: f64, radius: f64, slip_speed: f64) -> f64 {
    let rolling = radius * w;
    (rolling - v) / rolling.abs().max(v.abs()).max(slip_speed)
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
        self.linearise(x, p, u).0
    }

    /// The model with its analytic Jacobian.
    pub fn linearise(&self, x: &Motion, p: &Unknowns, u: &Drive) -> (Point, Jacobian) {
        let driven = Driven::new(self, u);
        let wheels = Axles::new([x[1], x[2]]);
        let at = driven.at((x[0], wheels), Axles::new(self.wheel_radius), p);
        let motion = driven.motion_slopes(&at).map(vector);
        let [k, h, lambda, front, rear] = driven.slopes(&at, wheels).map(vector);
        let jacobian = Jacobian {
            motion: Matrix3::from_columns(&motion),
            unknowns: Matrix3::from_columns(&[k, h, lambda]),
            radii: Matrix3x2::from_columns(&[front, rear]),
        };
        let [k, h, lambda] = driven.by_unknowns(&at).map(|by| by.load);
        let [v, w_f, w_r] = motion.map(|column| at.load_slope(column[0]));
        let point = Point {
            rates: vector(at.rates),
            slip: at.slip.to_array(),
            load: at.load.to_array(),
            specific_force: at.specific_force,
            lift: at.lift,
            transfer: at.transfer,
            guarded: at.guarded,
            load_slope: [v, w_f, w_r, k, h, lambda],
        };
        (point, jacobian)
    }

    /// The motion after `dt` seconds: `substeps` steps of linearly implicit Euler,
    /// `x + (I - hs J)^-1 hs f(x)`, `hs = dt / substeps`.
    ///
    /// Stable at any step although the wheels' poles lie near -1e4 1/s. A singular step, which no
    /// sensible machine has, leaves the motion where it is.
    pub fn advance(&self, x: &Motion, p: &Unknowns, u: &Drive, dt: f64, substeps: u32) -> Motion {
        Driven::new(self, u).advance(self.wheel_radius, x, p, dt, substeps)
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
        let (x, f) = Driven::new(self, u).advance_linearised::<8>(self.wheel_radius, x, p, dt, substeps);
        let jacobian = Jacobian {
            motion: f.fixed_columns::<3>(0).into(),
            unknowns: f.fixed_columns::<3>(3).into(),
            radii: f.fixed_columns::<2>(6).into(),
        };
        (x, jacobian)
    }
}
