//! The model with both axles side by side in SIMD lanes, its derivatives and its linearly implicit step: what the
//! filter's sigma points cost. The definition is [`WheelLoader::rates`]; the derivatives are chain rule over it.

use super::{Drive, GRAVITY, Motion, Unknowns, WheelLoader};
use crate::model::lanes::tanh;
use multiversion::multiversion;
use nalgebra::{SMatrix, Vector3};
use wide::f64x2;

/// One value per axle, front and rear.
pub(super) type Axles = f64x2;

/// A machine and what drives it: all that does not depend on its motion.
#[derive(Clone, Debug)]
pub struct Driven<'a> {
    model: &'a WheelLoader,
    torque: Axles,
    brake: Axles,
    braked: bool,
    /// `1 / I_i`
    per_inertia: Axles,
    per_mass: f64,
    per_length: f64,
    per_friction: f64,
    /// `W`
    weight: f64,
    /// `m g cos alpha`
    across: f64,
    /// `g sin alpha`
    along: f64,
    /// The part of `b_f` that does not depend on `lambda`.
    spading: f64,
    /// `F_x`
    force_x: f64,
}

/// The model at one point with its derivatives to the motion.
pub(super) struct At {
    pub slip: Axles,
    /// Friction demand and its derivatives to `v`, to the own wheel speed and to `K`.
    pub mu: Axles,
    mu_v: Axles,
    mu_w: Axles,
    mu_k: Axles,
    /// `mu_f - mu_r`
    difference: f64,
    pub load: Axles,
    /// `m h/l`; 0 if an axle has lost contact and no load can be transferred.
    lever: f64,
    /// `D` before its guard.
    pub transfer: f64,
    pub guarded: bool,
    pub lift: bool,
    /// `1 / (m D)`
    per: f64,
    pub specific_force: f64,
    /// Derivatives of the specific force to `v` and to the wheel speeds.
    a_v: f64,
    a_w: Axles,
    /// Derivative of the specific force to each axle's friction demand.
    effect: Axles,
    /// `-r_i / I_i`
    gear: Axles,
    /// Derivative of the brakes' share of `w_i'` to `w_i`, not positive.
    braking: Axles,
    pub rates: (f64, Axles),
}

/// A vector `[v, w_f, w_r]`, or a column of derivatives of such a vector.
pub(super) type Column = (f64, Axles);

/// How the specific force and the axle loads follow an unknown: derivatives of `a_s` and of the
/// front load, which is minus that of the rear load.
pub(super) struct ByUnknown {
    pub specific_force: f64,
    pub load: f64,
}

/// `[x, -x]`: what one axle gains the other one loses.
#[inline(always)]
fn opposite(x: f64) -> Axles {
    Axles::new([x, -x])
}

/// Smooth sign with its derivative.
#[inline(always)]
fn smooth_sign(x: f64, width: f64) -> (f64, f64) {
    let ratio = x / width;
    if ratio.abs() > 20.0 {
        return (ratio.signum(), 0.0); // tanh has reached 1 to the last bit
    }
    let t = ratio.tanh();
    (t, (1.0 - t * t) / width)
}

impl<'a> Driven<'a> {
    /// `model` under the drive `u`.
    pub fn new(model: &'a WheelLoader, u: &Drive) -> Self {
        let (loader, (sin, cos)) = (&model.loader, u.slope.sin_cos());
        let (m, per_length) = (loader.mass, 1.0 / loader.wheelbase);
        let across = m * GRAVITY * cos;
        Self {
            model,
            torque: Axles::new(u.torque),
            brake: Axles::new(u.brake),
            braked: u.brake != [0.0; 2],
            per_inertia: 1.0 / Axles::new(loader.axle_inertia()),
            per_mass: 1.0 / m,
            per_length,
            per_friction: model.tire.per_friction(),
            weight: across + u.force_z,
            across,
            along: GRAVITY * sin,
            spading: (u.force_z * (loader.wheelbase + loader.bucket_reach) - u.force_x * loader.bucket_height)
                * per_length,
            force_x: u.force_x,
        }
    }

    /// Friction demand `mu(x)` with its derivative.
    #[inline(always)]
    fn friction_demand(&self, x: Axles) -> (Axles, Axles) {
        if self.per_friction > 0.0 {
            let t = tanh(x * self.per_friction);
            (t * self.model.tire.friction, 1.0 - t * t)
        } else {
            (x, Axles::ONE)
        }
    }

    /// The model with wheels of radius `r`.
    #[inline(always)]
    pub(super) fn at(&self, (v, w): Column, r: Axles, p: &Unknowns) -> At {
        let (stiffness, h, lambda) = (p[0], p[1], p[2]);
        let WheelLoader { loader, rolling: resistance, tire } = self.model;

        // sigma = s / M with M = max(|r w|, |v|, v_g); where M is not constant, its derivative enters.
        let (rolling, speed) = (r * w, Axles::splat(v));
        let (wheel_size, speed_size, least) = (rolling.abs(), speed.abs(), Axles::splat(tire.slip_speed));
        let by_wheel = wheel_size.simd_ge(speed_size) & wheel_size.simd_gt(least);
        let by_speed = speed_size.simd_gt(wheel_size.fast_max(least));
        let per_m = 1.0 / wheel_size.fast_max(speed_size).fast_max(least);
        let slip = (rolling - speed) * per_m;
        let bend = slip * per_m * per_m;
        let slip_v = -per_m - (by_speed & (bend * speed));
        let slip_w = r * (per_m - (by_wheel & (bend * rolling)));

        let (mu, mu_x) = self.friction_demand(slip * stiffness);
        let steep = mu_x * stiffness;
        let (mu_v, mu_w, mu_k) = (steep * slip_v, steep * slip_w, mu_x * slip);
        let (sign, sign_v) = smooth_sign(v, resistance.smoothing_speed);

        let base_f = self.across * lambda + self.spading;
        let base = Axles::new([base_f, self.weight - base_f]);
        let [mu_f, mu_r] = mu.to_array();
        let difference = mu_f - mu_r;
        let transfer = 1.0 + h * self.per_length * difference;
        let guarded = transfer < loader.transfer_floor;
        let mut per = self.per_mass / if guarded { loader.transfer_floor } else { transfer };
        let mut drag = resistance.coefficient * self.weight;
        let mut a_s = ((mu * base).reduce_add() - drag * sign - self.force_x) * per;
        let mut lever = loader.mass * h * self.per_length;
        let mut load = base - opposite(lever * a_s);
        let [load_f, load_r] = load.to_array();
        let lift = load_f < 0.0 || load_r < 0.0;
        let mut effect = if guarded { base } else { load } * per;
        if lift {
            let all = self.weight.max(0.0);
            load = Axles::new(if load_f >= 0.0 { [all, 0.0] } else { [0.0, all] });
            (per, lever, drag) = (self.per_mass, 0.0, resistance.coefficient * all);
            a_s = ((mu * load).reduce_add() - drag * sign - self.force_x) * per;
            effect = load * per;
        }

        let gear = -r * self.per_inertia;
        let (brake, braking) = if self.braked { self.braking(r, w) } else { (Axles::ZERO, Axles::ZERO) };
        At {
            slip,
            mu,
            mu_v,
            mu_w,
            mu_k,
            difference,
            load,
            lever,
            transfer,
            guarded,
            lift,
            per,
            specific_force: a_s,
            a_v: (mu_v * effect).reduce_add() - drag * sign_v * per,
            a_w: mu_w * effect,
            effect,
            gear,
            braking,
            rates: (a_s - self.along, (self.torque - brake) * self.per_inertia + gear * mu * load),
        }
    }

    /// Brake torques against the wheels' rotation and how they change `w'` with `w`.
    #[inline(always)]
    fn braking(&self, r: Axles, w: Axles) -> (Axles, Axles) {
        let [front, rear] = (r * w).to_array().map(|rolling| smooth_sign(rolling, self.model.rolling.smoothing_speed));
        let by_speed = Axles::new([front.1, rear.1]);
        (self.brake * Axles::new([front.0, rear.0]), -self.brake * by_speed * r * self.per_inertia)
    }

    /// Derivatives to `[K, h, lambda]`.
    pub(super) fn by_unknowns(&self, at: &At) -> [ByUnknown; 3] {
        let stiffness = (at.mu_k * at.effect).reduce_add();
        let (mut height, mut ratio) = (0.0, 0.0);
        if !at.lift {
            ratio = self.across * at.difference * at.per;
            if !at.guarded {
                height = -at.specific_force * at.difference * self.per_length * self.model.loader.mass * at.per;
            }
        }
        let (by_height, by_ratio) = if at.lift {
            (0.0, 0.0)
        } else {
            (self.model.loader.mass * self.per_length * at.specific_force, self.across)
        };
        [
            ByUnknown { specific_force: stiffness, load: at.load_by(stiffness) },
            ByUnknown { specific_force: height, load: at.load_by(height) - by_height },
            ByUnknown { specific_force: ratio, load: at.load_by(ratio) + by_ratio },
        ]
    }

    /// Whether an axle has lost contact.
    pub fn lifts(&self, x: &Motion, p: &Unknowns) -> bool {
        self.at((x[0], Axles::new([x[1], x[2]])), Axles::new(self.model.loader.wheel_radius()), p).lift
    }

    /// [`WheelLoader::advance`] with wheels of radius `radius`.
    pub fn advance(&self, radius: [f64; 2], x: &Motion, p: &Unknowns, dt: f64, substeps: u32) -> Motion {
        advance(self, radius, x, p, dt, substeps)
    }

    /// [`WheelLoader::advance_linearised`] with wheels of radius `radius`: the derivatives to the first `N`
    /// of `[v, w_f, w_r, K, h, lambda, ln r_f, ln r_r]`.
    pub fn advance_linearised<const N: usize>(
        &self,
        radius: [f64; 2],
        x: &Motion,
        p: &Unknowns,
        dt: f64,
        substeps: u32,
    ) -> (Motion, SMatrix<f64, 3, N>) {
        let (hs, r) = (dt / f64::from(substeps), Axles::new(radius));
        let mut x = (x[0], Axles::new([x[1], x[2]]));
        let mut f: [Column; N] = std::array::from_fn(unit);
        for _ in 0..substeps {
            let at = self.at(x, r, p);
            let implicit = Implicit::new(&at, hs);
            let Some(moved) = moved(x, implicit.solve((at.rates.0 * hs, at.rates.1 * hs))) else { continue };
            let derivatives = self.by_unknowns_and_radii(&at, x.1);
            for (k, column) in f.iter_mut().enumerate() {
                if let Some(rate) = k.checked_sub(3).map(|k| derivatives[k]) {
                    *column = (column.0 + rate.0 * hs, column.1 + rate.1 * hs);
                }
                *column = implicit.solve(*column);
            }
            x = moved;
        }
        (vector(x), SMatrix::from_columns(&f.map(vector)))
    }

    /// Derivatives of the rates to the motion.
    pub(super) fn by_motion(&self, at: &At) -> [Column; 3] {
        let through_load = at.gear * at.mu * opposite(at.lever);
        let own = at.gear * at.load * at.mu_w + at.braking;
        let [a_f, a_r] = at.a_w.to_array();
        let [own_f, own_r] = own.to_array();
        [
            (at.a_v, at.gear * at.load * at.mu_v - through_load * at.a_v),
            (a_f, Axles::new([own_f, 0.0]) - through_load * a_f),
            (a_r, Axles::new([0.0, own_r]) - through_load * a_r),
        ]
    }

    /// Derivatives of the rates to `[K, h, lambda, ln r_f, ln r_r]` where the wheels turn at `w`.
    pub(super) fn by_unknowns_and_radii(&self, at: &At, w: Axles) -> [Column; 5] {
        let [k, h, lambda] = self.by_unknowns(at).map(|by| (by.specific_force, at.gear * at.mu * opposite(by.load)));
        // The wheel speeds enter as r w only; r also is the lever of the tyre's force.
        let ([_, f, r], [w_f, w_r]) = (self.by_motion(at), w.to_array());
        let [force_f, force_r] = (at.gear * at.mu * at.load).to_array();
        [
            (k.0, k.1 + at.gear * at.mu_k * at.load),
            h,
            lambda,
            (f.0 * w_f, f.1 * w_f + Axles::new([force_f, 0.0])),
            (r.0 * w_r, r.1 * w_r + Axles::new([0.0, force_r])),
        ]
    }
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn advance(driven: &Driven, radius: [f64; 2], x: &Motion, p: &Unknowns, dt: f64, substeps: u32) -> Motion {
    let (hs, r) = (dt / f64::from(substeps), Axles::new(radius));
    let mut x = (x[0], Axles::new([x[1], x[2]]));
    for _ in 0..substeps {
        let at = driven.at(x, r, p);
        let step = Implicit::new(&at, hs).solve((at.rates.0 * hs, at.rates.1 * hs));
        if let Some(moved) = moved(x, step) {
            x = moved;
        }
    }
    vector(x)
}

impl At {
    /// Derivative of the front load to something by which the specific force has the derivative `a_s`.
    pub(super) fn load_by(&self, a_s: f64) -> f64 {
        -self.lever * a_s
    }
}

/// `(I - hs J)^-1`. The wheels feel each other through the load transfer only, which follows the
/// specific force: with `hs a_s' x = x_0 - b_0` from the first row each wheel's row holds `x_0` and
/// its own speed alone, and what is left is one equation for `x_0`.
struct Implicit {
    /// Reciprocal of each wheel's own element.
    own: Axles,
    /// What the right-hand side's first element does to the wheels.
    transfer: Axles,
    /// What the speed does to the wheels.
    speed: Axles,
    /// What the wheels do to the speed.
    wheels: Axles,
    scale: f64,
}

impl Implicit {
    #[inline(always)]
    fn new(at: &At, hs: f64) -> Self {
        let grip = at.gear * at.load * hs;
        let own = 1.0 / (1.0 - (grip * at.mu_w + at.braking * hs));
        let transfer = at.gear * at.mu * opposite(at.lever);
        let speed = grip * at.mu_v - transfer;
        let wheels = at.a_w * own * hs;
        let scale = 1.0 / (1.0 - hs * at.a_v - (wheels * speed).reduce_add());
        Self { own, transfer, speed, wheels, scale }
    }

    /// `x` with `(I - hs J) x = b`.
    #[inline(always)]
    fn solve(&self, (b_v, b_w): Column) -> Column {
        let b_w = b_w + self.transfer * b_v;
        let v = (b_v + (self.wheels * b_w).reduce_add()) * self.scale;
        (v, (b_w + self.speed * v) * self.own)
    }
}

/// The motion after a step, or nothing if the step does not exist.
#[inline(always)]
fn moved((v, w): Column, (dv, dw): Column) -> Option<Column> {
    let x = (v + dv, w + dw);
    (x.0 + x.1.reduce_add()).is_finite().then_some(x)
}

/// Column `k` of the identity followed by zeros.
fn unit(k: usize) -> Column {
    let one = |i: usize| f64::from(u8::from(i == k));
    (one(0), Axles::new([one(1), one(2)]))
}

pub(super) fn vector((v, w): Column) -> Vector3<f64> {
    let [front, rear] = w.to_array();
    Vector3::new(v, front, rear)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::wheel_loader::{Point, Tire};

    /// To 1e-13 of the weight and of what it accelerates, driving, braking and reversing, until axles lift.
    #[test]
    fn both_axles_side_by_side_have_the_rates_of_the_definition() {
        let (mut lifted, mut guarded) = (0, 0);
        for friction in [0.75, 1e6] {
            let machine = WheelLoader { tire: Tire { friction, ..Tire::default() }, ..WheelLoader::default() };
            let weight = machine.loader.mass * GRAVITY;
            for k in 0..4000 {
                let wave = |rate: f64| (rate * f64::from(k)).sin();
                let u = Drive {
                    torque: [5000.0 * wave(0.37), 4000.0 * wave(0.41)],
                    brake: [900.0 * wave(0.2).max(0.0), 700.0 * wave(0.3).max(0.0)],
                    slope: 0.3 * wave(0.53),
                    force_x: 2e4 * wave(0.59).powi(5),
                    force_z: 2e4 * wave(0.61).powi(5),
                };
                let v = 4.0 * wave(0.11);
                let x = Motion::new(v, v / 0.55 * (1.0 + 0.3 * wave(0.7)), v / 0.55 * (1.0 + 0.3 * wave(0.8)));
                let p = Unknowns::new(20.0 + 15.0 * wave(0.13), 1.4 + wave(0.17), 0.5 + 0.35 * wave(0.19));
                let Point { rates, slip, load, specific_force, lift, guarded: guard, .. } = machine.rates(&x, &p, &u);
                let (wide, ..) = machine.linearise(&x, &p, &u);
                assert_eq!((lift, guard), (wide.lift, wide.guarded), "{k}");
                // The linear tyre's demand may be a multiple of the load.
                let size = weight * slip.iter().fold(1.0, |size: f64, slip| size.max(p[0] * slip.abs()));
                for i in 0..2 {
                    assert!((wide.slip[i] - slip[i]).abs() <= 1e-15, "{k}");
                    assert!((wide.load[i] - load[i]).abs() <= 1e-13 * size, "{k}: {} {}", wide.load[i], load[i]);
                }
                assert!((wide.specific_force - specific_force).abs() <= 1e-13 * size / machine.loader.mass, "{k}");
                let scale = [size / machine.loader.mass, size / 36.0, size / 36.0];
                for i in 0..3 {
                    assert!(
                        (wide.rates[i] - rates[i]).abs() <= 1e-13 * scale[i],
                        "{k}: {} {}",
                        wide.rates[i],
                        rates[i]
                    );
                }
                (lifted, guarded) = (lifted + usize::from(lift), guarded + usize::from(guard));
            }
        }
        assert!(lifted > 100 && guarded > 100, "{lifted} {guarded}");
    }
}
