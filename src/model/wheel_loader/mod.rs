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
//!   printed inertia); [`WheelLoader::advance`] is linearly implicit.
//! - Table 1: the mass "4.7 kg" is in tonnes and 50 N.m can only be a motor torque.

//!
//! [`WheelLoader::rates`] is the definition; [`Driven`] computes four points side by side, with the derivatives and the
//! implicit step, and is held to it by its tests.

mod axles;
mod steady;
mod steering;
mod wide;

pub use steady::SteadySlip;
pub use steering::{Paths, Steering};
pub use wide::Driven;

use axles::Axles;
use nalgebra::{Matrix3, Matrix3x2, Vector3};
use serde::{Deserialize, Serialize};
use wide::{first, motions, unknowns};

/// Gravity, m/s2.
pub const GRAVITY: f64 = super::STANDARD_GRAVITY;

variables! {
    /// The machine: a compact loader of 4.7 t; what the source does not print is an engineering assumption.
    #[derive(Copy)]
    pub struct Loader {
        /// Mass of the machine with its load (m).
        mass: f64 = 4700.0, "kg", [50.0, 1e6], essential;
        /// Wheelbase (l).
        wheelbase: f64 = 2.2, "m", [0.2, 20.0], essential;
        /// Rolling radius of the front wheels at zero torque (r_f). A front to rear mismatch of 0.3 % spoils the centre of gravity.
        wheel_radius_front: f64 = 0.55, "m", [0.05, 3.0], essential;
        /// Rolling radius of the rear wheels at zero torque (r_r).
        wheel_radius_rear: f64 = 0.55, "m", [0.05, 3.0], essential;
        /// Inertia of the front axle with its drive, seen at the wheels (I_f).
        axle_inertia_front: f64 = 36.0, "kg.m2", [1e-3, 1e5];
        /// Inertia of the rear axle with its drive, seen at the wheels (I_r).
        axle_inertia_rear: f64 = 36.0, "kg.m2", [1e-3, 1e5];
        /// Distance of the bucket's tip forward of the front axle (l_c).
        bucket_reach: f64 = 1.6, "m", [-5.0, 20.0];
        /// Height of the bucket's tip above ground, where the spading force acts (h_b).
        bucket_height: f64 = 0.0, "m", [-5.0, 20.0];
        /// How the machine is steered, which says what the measured steering angle does to the axles' paths; none = it is not measured, and bends are only detected.
        steering: Steering = Steering::None, "1";
        /// Articulated: distance of the joint behind the front axle; halfway, both axles roll equally far in a steady bend.
        joint_to_front_axle: f64 = 1.1, "m", [0.0, 20.0];
        /// Lower limit of the load transfer's denominator; a numerical guard (d_min).
        transfer_floor: f64 = 0.1, "1", [1e-3, 1.0];
    }
}

variables! {
    /// Rolling resistance.
    #[derive(Copy)]
    pub struct Rolling {
        /// Rolling resistance over axle load (f).
        coefficient: f64 = 0.03, "1", [0.0, 0.5], essential;
        /// Speed over which the resistance changes its sign smoothly (v_s).
        smoothing_speed: f64 = 0.05, "m/s", [1e-4, 1.0];
    }
}

variables! {
    /// The tyres.
    #[derive(Copy)]
    pub struct Tire {
        /// Largest friction coefficient (mu_max); 1000 and more makes the tyre linear, as the source's is.
        friction: f64 = 0.75, "1", [0.05, 1e6], essential;
        /// Speed below which slip is no longer relative to the speed (v_g).
        slip_speed: f64 = 0.3, "m/s", [1e-3, 5.0];
    }
}

impl Loader {
    /// Rolling radii at zero torque `[r_f, r_r]`, m.
    pub fn wheel_radius(&self) -> [f64; 2] {
        [self.wheel_radius_front, self.wheel_radius_rear]
    }

    /// Inertias of the axles `[I_f, I_r]`, kg.m2.
    pub fn axle_inertia(&self) -> [f64; 2] {
        [self.axle_inertia_front, self.axle_inertia_rear]
    }
}

impl Tire {
    /// `1 / mu_max`; 0 if the tyre is linear.
    fn per_friction(&self) -> f64 {
        if self.friction < 1000.0 { 1.0 / self.friction } else { 0.0 }
    }

    /// The slip times its stiffness that a friction demand takes, `x = mu^-1(demand)`; close to the largest friction it
    /// is bounded.
    pub fn demanding(&self, demand: f64) -> f64 {
        let per_friction = self.per_friction();
        if per_friction > 0.0 { self.friction * (demand * per_friction).clamp(-0.98, 0.98).atanh() } else { demand }
    }

    /// Friction demand `mu(x)` of a slip times its stiffness, `x = K sigma`.
    pub fn friction_demand(&self, x: f64) -> f64 {
        let per_friction = self.per_friction();
        if per_friction > 0.0 { self.friction * (x * per_friction).tanh() } else { x }
    }

    /// Slip `sigma` of a wheel of radius `r` (m) that turns at `w` (rad/s) over ground that passes at `v` (m/s). One
    /// form drives, brakes, reverses and stands still.
    pub fn slip(&self, v: f64, w: f64, radius: f64) -> f64 {
        let rolling = radius * w;
        (rolling - v) / rolling.abs().max(v.abs()).max(self.slip_speed)
    }
}

/// All that is known of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelLoader {
    /// Masses and lengths.
    pub loader: Loader,
    /// Rolling resistance.
    pub rolling: Rolling,
    /// The tyres.
    pub tire: Tire,
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

/// Derivatives of the front load to `(v, w_f, w_r, K, h, lambda)`, N per unit. The sum of both loads depends on none
/// of them.
pub type LoadDerivatives = [f64; 6];

impl WheelLoader {
    /// Load on both axles `W`, N.
    pub fn weight(&self, u: &Drive) -> f64 {
        self.loader.mass * GRAVITY * u.slope.cos() + u.force_z
    }

    /// Front axle's load of a machine that does not accelerate, `F_zf` with `a_s = g sin alpha`, N, with its
    /// derivatives to `[h, lambda]`.
    pub fn standing_front_load(&self, p: &Unknowns, u: &Drive) -> (f64, [f64; 2]) {
        let (Loader { mass: m, wheelbase: l, bucket_reach, bucket_height, .. }, [_, h, lambda]) =
            (self.loader, (*p).into());
        let (sin, cos) = u.slope.sin_cos();
        let load = m * GRAVITY * (lambda * cos - h / l * sin) + u.force_z * (l + bucket_reach) / l
            - u.force_x * bucket_height / l;
        (load, [-m * GRAVITY * sin / l, m * GRAVITY * cos])
    }

    /// The model. The guard of `D` matters with the linear tyre only, whose `D` reaches 0 at
    /// `sigma_f - sigma_r = -l/(h K)`.
    pub fn rates(&self, x: &Motion, p: &Unknowns, u: &Drive) -> Point {
        let ([v, w_f, w_r], [stiffness, h, lambda]) = ((*x).into(), (*p).into());
        let Loader { mass: m, wheelbase: l, bucket_reach: l_c, bucket_height: h_b, transfer_floor: d_min, .. } =
            self.loader;
        let (Rolling { coefficient: f, .. }, tire) = (self.rolling, &self.tire);
        let ([r_f, r_r], [i_f, i_r]) = (self.loader.wheel_radius(), self.loader.axle_inertia());
        let smooth_sign = |x: f64| (x / self.rolling.smoothing_speed).tanh();

        let slip = [tire.slip(v, w_f, r_f), tire.slip(v, w_r, r_r)];
        let [mu_f, mu_r] = slip.map(|sigma| tire.friction_demand(stiffness * sigma));

        let weight = self.weight(u);
        let b_f = m * GRAVITY * lambda * u.slope.cos() + u.force_z * (l + l_c) / l - u.force_x * h_b / l;
        let b_r = weight - b_f;
        let d = 1.0 + h / l * (mu_f - mu_r);
        let mut a_s = (mu_f * b_f + mu_r * b_r - f * smooth_sign(v) * weight - u.force_x) / (m * d.max(d_min));
        let mut load = [b_f - m * h / l * a_s, b_r + m * h / l * a_s];
        let lift = load[0] < 0.0 || load[1] < 0.0;
        if lift {
            let all = weight.max(0.0);
            load = if load[0] < 0.0 { [0.0, all] } else { [all, 0.0] };
            a_s = (mu_f * load[0] + mu_r * load[1] - f * smooth_sign(v) * all - u.force_x) / m;
        }
        let rates = Motion::new(
            a_s - GRAVITY * u.slope.sin(),
            (u.torque[0] - u.brake[0] * smooth_sign(r_f * w_f) - r_f * mu_f * load[0]) / i_f,
            (u.torque[1] - u.brake[1] * smooth_sign(r_r * w_r) - r_r * mu_r * load[1]) / i_r,
        );
        Point { rates, slip, load, specific_force: a_s, lift, transfer: d, guarded: d < d_min }
    }

    /// [`rates`](Self::rates) with their analytic derivatives and those of the front load.
    pub fn linearise(&self, x: &Motion, p: &Unknowns, u: &Drive) -> (Point, Jacobian, LoadDerivatives) {
        let driven = Driven::new(self, u);
        let x = motions([x; 4]);
        let at = driven.at(x, Axles::all(self.loader.wheel_radius()), unknowns([p; 4]));
        let by_motion = driven.by_motion(&at);
        let motion = by_motion.map(first);
        let [k, h, lambda, front, rear] = driven.by_unknowns_and_radii(&at, x.1).map(first);
        let jacobian = Jacobian {
            motion: Matrix3::from_columns(&motion),
            unknowns: Matrix3::from_columns(&[k, h, lambda]),
            radii: Matrix3x2::from_columns(&[front, rear]),
        };
        let [k, h, lambda] = driven.by_unknowns(&at).map(|by| by.load.first());
        let [v, w_f, w_r] = by_motion.map(|column| at.load_by(column.0).first());
        let point = Point {
            rates: first(at.rates),
            slip: at.slip.first(),
            load: at.load.first(),
            specific_force: at.specific_force.first(),
            lift: at.lift.first(),
            transfer: at.transfer.first(),
            guarded: at.guarded.first(),
        };
        (point, jacobian, [v, w_f, w_r, k, h, lambda])
    }

    /// The motion after `dt` seconds: `substeps` steps of linearly implicit Euler,
    /// `x + (I - hs J)^-1 hs f(x)`, `hs = dt / substeps`.
    ///
    /// Stable at any step although the wheels' poles lie near -1e4 1/s. Where a tyre is saturated, `J` is too small, and the
    /// step would pass rolling by far; there two steps of Newton's method for `y = x + hs f(y)` begin at rolling
    /// ([`Driven::overshooting`] leaves them out). A singular step, which no sensible machine has, leaves the motion where it
    /// is.
    pub fn advance(&self, x: &Motion, p: &Unknowns, u: &Drive, dt: f64, substeps: u32) -> Motion {
        Driven::new(self, u).advance(self.loader.wheel_radius(), x, p, dt, substeps)
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
        let (x, f) = Driven::new(self, u).advance_linearised::<8>(self.loader.wheel_radius(), x, p, dt, substeps);
        let jacobian = Jacobian {
            motion: f.fixed_columns::<3>(0).into(),
            unknowns: f.fixed_columns::<3>(3).into(),
            radii: f.fixed_columns::<2>(6).into(),
        };
        (x, jacobian)
    }
}
