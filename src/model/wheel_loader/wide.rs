//! The model at four points side by side in SIMD lanes, its derivatives and its linearly implicit step: what the filter's sigma
//! points cost. The definition is [`WheelLoader::rates`]; the derivatives are chain rule over it.

use super::axles::Axles;
use super::{Drive, GRAVITY, Motion, Unknowns, WheelLoader};
use crate::model::four::{Four, Mask};
use crate::model::lanes::tanh;
use multiversion::multiversion;
use nalgebra::{SMatrix, Vector3};
use std::array::from_fn;

/// A step overshoots where it ends beyond rolling by more slip than this part of `mu_max / K`.
const OVERSHOOT: f64 = 0.3;

/// A machine and what drives it: all that does not depend on its motion.
#[derive(Clone, Debug)]
pub struct Driven<'a> {
    model: &'a WheelLoader,
    torque: [f64; 2],
    brake: [f64; 2],
    braked: bool,
    /// `1 / I_i`
    per_inertia: [f64; 2],
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
    /// `1 / (OVERSHOOT mu_max)`; 0 if steps may overshoot.
    per_overshoot: f64,
}

/// The model at four points with its derivatives to the motion.
pub(super) struct At {
    pub slip: Axles,
    /// Friction demand and its derivatives to `v`, to the own wheel speed and to `K`.
    pub mu: Axles,
    mu_v: Axles,
    mu_w: Axles,
    mu_k: Axles,
    /// `mu_f - mu_r`
    difference: Four,
    pub load: Axles,
    /// `m h/l`; 0 if an axle has lost contact and no load can be transferred.
    lever: Four,
    /// `D` before its guard.
    pub transfer: Four,
    pub guarded: Mask,
    pub lift: Mask,
    /// `1 / (m D)`
    per: Four,
    pub specific_force: Four,
    /// Derivatives of the specific force to `v` and to the wheel speeds.
    a_v: Four,
    a_w: Axles,
    /// Derivative of the specific force to each axle's friction demand.
    effect: Axles,
    /// `-r_i / I_i`
    gear: Axles,
    /// Derivative of the brakes' share of `w_i'` to `w_i`, not positive.
    braking: Axles,
    pub rates: Column,
}

/// A vector `[v, w_f, w_r]` of each point, or a column of derivatives of such a vector.
pub(super) type Column = (Four, Axles);

/// How the specific force and the axle loads follow an unknown: derivatives of `a_s` and of the
/// front load, which is minus that of the rear load.
pub(super) struct ByUnknown {
    pub specific_force: Four,
    pub load: Four,
}

/// The same value at all points.
#[inline(always)]
fn all(x: f64) -> Four {
    Four::splat(x)
}

impl<'a> Driven<'a> {
    /// `model` under the drive `u`.
    pub fn new(model: &'a WheelLoader, u: &Drive) -> Self {
        let (loader, (sin, cos)) = (&model.loader, u.slope.sin_cos());
        let (m, per_length) = (loader.mass, 1.0 / loader.wheelbase);
        let across = m * GRAVITY * cos;
        Self {
            model,
            torque: u.torque,
            brake: u.brake,
            braked: u.brake != [0.0; 2],
            per_inertia: loader.axle_inertia().map(|inertia| 1.0 / inertia),
            per_mass: 1.0 / m,
            per_length,
            per_friction: model.tire.per_friction(),
            weight: across + u.force_z,
            across,
            along: GRAVITY * sin,
            spading: (u.force_z * (loader.wheelbase + loader.bucket_reach) - u.force_x * loader.bucket_height)
                * per_length,
            force_x: u.force_x,
            per_overshoot: model.tire.per_friction() / OVERSHOOT,
        }
    }

    /// With the study's steps, each linearised where it begins.
    pub fn overshooting(self) -> Self {
        Self { per_overshoot: 0.0, ..self }
    }

    /// Friction demand `mu(x)` with its derivative.
    #[inline(always)]
    fn friction_demand(&self, x: Axles) -> (Axles, Axles) {
        if self.per_friction > 0.0 {
            let x = x * all(self.per_friction);
            let t = Axles { front: tanh(x.front), rear: tanh(x.rear) };
            (t * all(self.model.tire.friction), Axles::both(Four::ONE) - t * t)
        } else {
            (x, Axles::both(Four::ONE))
        }
    }

    /// Smooth sign with its derivative.
    #[inline(always)]
    fn smooth_sign(&self, x: Four) -> (Four, Four) {
        let per_width = all(1.0 / self.model.rolling.smoothing_speed);
        let t = tanh(x * per_width);
        (t, (Four::ONE - t * t) * per_width)
    }

    /// Slip with its derivatives to `v` and to the wheel's speed.
    #[inline(always)]
    fn slip(&self, v: Four, w: Four, r: Four) -> [Four; 3] {
        // sigma = s / M with M = max(|r w|, |v|, v_g); where M is not constant, its derivative enters.
        let rolling = r * w;
        let (wheel_size, speed_size, least) = (rolling.abs(), v.abs(), all(self.model.tire.slip_speed));
        let by_speed = speed_size.greater(wheel_size.max(least));
        let per_m = Four::ONE / wheel_size.max(speed_size).max(least);
        let slip = (rolling - v) * per_m;
        let bend = slip * per_m * per_m;
        let slip_v = -per_m - by_speed.select(bend * v);
        let by_wheel = speed_size.greater(wheel_size).choose(Four::ZERO, bend * rolling);
        let slip_w = r * (per_m - wheel_size.greater(least).select(by_wheel));
        [slip, slip_v, slip_w]
    }

    /// The model with wheels of radius `r`.
    #[inline(always)]
    pub(super) fn at(&self, (v, w): Column, r: Axles, [stiffness, h, lambda]: [Four; 3]) -> At {
        let WheelLoader { loader, rolling: resistance, .. } = self.model;
        let [front, rear] = [self.slip(v, w.front, r.front), self.slip(v, w.rear, r.rear)];
        let [slip, slip_v, slip_w] = from_fn(|i| Axles { front: front[i], rear: rear[i] });
        let (mu, mu_x) = self.friction_demand(slip * stiffness);
        let steep = mu_x * stiffness;
        let (mu_v, mu_w, mu_k) = (steep * slip_v, steep * slip_w, mu_x * slip);
        let (sign, sign_v) = self.smooth_sign(v);

        let base_f = all(self.across) * lambda + all(self.spading);
        let base = Axles { front: base_f, rear: all(self.weight) - base_f };
        let difference = mu.front - mu.rear;
        let transfer = Four::ONE + h * all(self.per_length) * difference;
        let floor = all(loader.transfer_floor);
        let guarded = floor.greater(transfer);
        let mut per = all(self.per_mass) / transfer.max(floor);
        let mut drag = all(resistance.coefficient * self.weight);
        let force_x = all(self.force_x);
        let mut a_s = ((mu * base).sum() - drag * sign - force_x) * per;
        let mut lever = all(loader.mass * self.per_length) * h;
        let mut load = base - Axles::opposite(lever * a_s);
        let mut effect = base.where_or(guarded, load) * per;
        let rises = Four::ZERO.greater(load.front);
        let lift = rises | Four::ZERO.greater(load.rear);
        if lift.any() {
            let whole = all(self.weight.max(0.0));
            // the rear axle carries if neither keeps contact
            let carried = Axles { front: rises.choose(Four::ZERO, whole), rear: rises.select(whole) };
            load = carried.where_or(lift, load);
            per = lift.choose(all(self.per_mass), per);
            lever = lift.choose(Four::ZERO, lever);
            drag = lift.choose(all(resistance.coefficient) * whole, drag);
            a_s = lift.choose(((mu * load).sum() - drag * sign - force_x) * per, a_s);
            effect = (load * per).where_or(lift, effect);
        }

        let per_inertia = Axles::all(self.per_inertia);
        let gear = -r * per_inertia;
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
            a_v: (mu_v * effect).sum() - drag * sign_v * per,
            a_w: mu_w * effect,
            effect,
            gear,
            braking,
            rates: (a_s - all(self.along), (Axles::all(self.torque) - brake) * per_inertia + gear * mu * load),
        }
    }

    /// Brake torques against the wheels' rotation and how they change `w'` with `w`.
    #[inline(always)]
    fn braking(&self, r: Axles, w: Axles) -> (Axles, Axles) {
        let rolling = r * w;
        let [front, rear] = [rolling.front, rolling.rear].map(|rolling| self.smooth_sign(rolling));
        let (brake, by_speed) = (Axles::all(self.brake), Axles { front: front.1, rear: rear.1 });
        (brake * Axles { front: front.0, rear: rear.0 }, -brake * by_speed * r * Axles::all(self.per_inertia))
    }

    /// Derivatives to `[K, h, lambda]`.
    #[inline(always)]
    pub(super) fn by_unknowns(&self, at: &At) -> [ByUnknown; 3] {
        let (across, mass) = (all(self.across), all(self.model.loader.mass));
        let grounded = |value: Four| at.lift.choose(Four::ZERO, value);
        let stiffness = (at.mu_k * at.effect).sum();
        let moment = mass * all(self.per_length) * at.specific_force;
        let ratio = grounded(across * at.difference * at.per);
        let height = grounded(at.guarded.choose(Four::ZERO, -moment * at.difference * at.per));
        [
            ByUnknown { specific_force: stiffness, load: at.load_by(stiffness) },
            ByUnknown { specific_force: height, load: at.load_by(height) - grounded(moment) },
            ByUnknown { specific_force: ratio, load: at.load_by(ratio) + grounded(across) },
        ]
    }

    /// Whether an axle has lost contact.
    pub fn lifts(&self, x: &Motion, p: &Unknowns) -> bool {
        self.at(motions([x; 4]), Axles::all(self.model.loader.wheel_radius()), unknowns([p; 4])).lift.any()
    }

    /// [`WheelLoader::advance`] with wheels of radius `radius`.
    pub fn advance(&self, radius: [f64; 2], x: &Motion, p: &Unknowns, dt: f64, substeps: u32) -> Motion {
        let [moved, ..] = self.advance_four([radius; 4], [x; 4], [p; 4], dt, substeps);
        moved
    }

    /// The same of four points.
    pub fn advance_four(
        &self,
        radius: [[f64; 2]; 4],
        x: [&Motion; 4],
        p: [&Unknowns; 4],
        dt: f64,
        substeps: u32,
    ) -> [Motion; 4] {
        let r = Axles { front: Four::new(radius.map(|r| r[0])), rear: Four::new(radius.map(|r| r[1])) };
        let (v, w) = advance(self, &r, &motions(x), &unknowns(p), dt / f64::from(substeps), substeps);
        let [v, front, rear] = [v, w.front, w.rear].map(Four::to_array);
        from_fn(|i| Vector3::new(v[i], front[i], rear[i]))
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
        let (x, r, p) = (motions([x; 4]), Axles::all(radius), unknowns([p; 4]));
        let (x, f) = advance_linearised::<N>(self, &r, &x, &p, dt / f64::from(substeps), substeps);
        (first(x), SMatrix::from_columns(&f.map(first)))
    }

    /// How far, m/s, each axle passes rolling in a step to this motion, from the side on which it had this slip.
    #[inline(always)]
    fn passed(&self, slip: Axles, (v, w): Column, r: Axles) -> Axles {
        let beyond = Axles::both(v) - r * w;
        Axles { front: beyond.front.flip_signs(slip.front), rear: beyond.rear.flip_signs(slip.rear) }
    }

    /// Positive where that is further than the tyre is linear for.
    #[inline(always)]
    fn overshoot(&self, passed: Four, v: Four, stiffness: Four) -> Four {
        passed * stiffness * all(self.per_overshoot) - v.abs().max(all(self.model.tire.slip_speed))
    }

    /// Derivatives of the rates to the motion.
    #[inline(always)]
    pub(super) fn by_motion(&self, at: &At) -> [Column; 3] {
        let through_load = at.gear * at.mu * Axles::opposite(at.lever);
        let own = at.gear * at.load * at.mu_w + at.braking;
        let [a_f, a_r] = [at.a_w.front, at.a_w.rear];
        [
            (at.a_v, at.gear * at.load * at.mu_v - through_load * at.a_v),
            (a_f, Axles { rear: Four::ZERO, ..own } - through_load * a_f),
            (a_r, Axles { front: Four::ZERO, ..own } - through_load * a_r),
        ]
    }

    /// Derivatives of the rates to `[K, h, lambda, ln r_f, ln r_r]` where the wheels turn at `w`.
    #[inline(always)]
    pub(super) fn by_unknowns_and_radii(&self, at: &At, w: Axles) -> [Column; 5] {
        let [k, h, lambda] =
            self.by_unknowns(at).map(|by| (by.specific_force, at.gear * at.mu * Axles::opposite(by.load)));
        // The wheel speeds enter as r w only; r also is the lever of the tyre's force.
        let [_, f, r] = self.by_motion(at);
        let force = at.gear * at.mu * at.load;
        [
            (k.0, k.1 + at.gear * at.mu_k * at.load),
            h,
            lambda,
            (f.0 * w.front, f.1 * w.front + Axles { rear: Four::ZERO, ..force }),
            (r.0 * w.rear, r.1 * w.rear + Axles { front: Four::ZERO, ..force }),
        ]
    }
}

/// Steps linearised where they begin, unless one of them overshoots. That is asked at the end: with a branch in the loop the
/// points do not stay in their lanes.
#[multiversion(targets("x86_64+avx+avx2"))]
fn advance(driven: &Driven, r: &Axles, x: &Column, p: &[Four; 3], hs: f64, substeps: u32) -> Column {
    let (mut to, hs, mut overshoot) = (*x, all(hs), Four::ZERO);
    for _ in 0..substeps {
        let step = Step::new(driven, r, p, hs, to);
        let passed = driven.passed(step.at.slip, step.to, *r).largest();
        overshoot = driven.overshoot(passed, step.to.0, p[0]).max(overshoot);
        to = step.to;
    }
    if overshoot.greater(Four::ZERO).any() { again(driven, r, x, p, hs, substeps) } else { to }
}

/// The same by steps that do not overshoot.
#[cold]
#[inline(never)]
fn again(driven: &Driven, r: &Axles, x: &Column, p: &[Four; 3], hs: Four, substeps: u32) -> Column {
    (0..substeps).fold(*x, |x, _| Step::within_rolling(driven, r, p, hs, x).to)
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn advance_linearised<const N: usize>(
    driven: &Driven,
    r: &Axles,
    x: &Column,
    p: &[Four; 3],
    hs: f64,
    substeps: u32,
) -> (Column, [Column; N]) {
    let (mut x, hs) = (*x, all(hs));
    let mut f: [Column; N] = from_fn(unit);
    for _ in 0..substeps {
        let step = Step::within_rolling(driven, r, p, hs, x);
        if !step.exists.any() {
            continue;
        }
        let derivatives = driven.by_unknowns_and_radii(&step.at, step.about.1);
        for (k, column) in f.iter_mut().enumerate() {
            if let Some(rate) = k.checked_sub(3).map(|k| derivatives[k]) {
                *column = (column.0 + rate.0 * hs, column.1 + rate.1 * hs);
            }
            *column = step.implicit.solve(*column);
        }
        x = step.to;
    }
    (x, f)
}

/// An implicit step `y = x + hs f(y)` by Newton's method, `(I - hs J) (y - about) = x - about + hs f(about)`.
struct Step {
    /// Where the model is linearised.
    about: Column,
    at: At,
    implicit: Implicit,
    /// `y`; where it does not exist, `about`.
    to: Column,
    exists: Mask,
}

impl Step {
    /// Linearised where it begins.
    #[inline(always)]
    fn new(driven: &Driven, r: &Axles, p: &[Four; 3], hs: Four, x: Column) -> Self {
        let at = driven.at(x, *r, *p);
        let implicit = Implicit::new(&at, hs);
        let (to, exists) = moved(x, implicit.solve((at.rates.0 * hs, at.rates.1 * hs)));
        Self { about: x, at, implicit, to, exists }
    }

    /// The same; if a point overshoots, it ends where two steps of Newton's method lead from rolling, about which it is
    /// linearised then. There a tyre is stiffest, so that they come nearer from that side and do not pass. Both axles begin
    /// at rolling: the load that one transfers in a false step upsets the other.
    fn within_rolling(driven: &Driven, r: &Axles, p: &[Four; 3], hs: Four, x: Column) -> Self {
        let plain = Self::new(driven, r, p, hs, x);
        let passed = driven.passed(plain.at.slip, plain.to, *r);
        let overshot = driven.overshoot(passed.largest(), plain.to.0, p[0]).greater(Four::ZERO);
        if !overshot.any() {
            return plain;
        }
        let newton = |about: Column| {
            let at = driven.at(about, *r, *p);
            let implicit = Implicit::new(&at, hs);
            let rest = (x.0 - about.0 + at.rates.0 * hs, x.1 - about.1 + at.rates.1 * hs);
            let (to, exists) = moved(about, implicit.solve(rest));
            Self { about, at, implicit, to, exists }
        };
        let rolling = Axles { front: x.0 / r.front, rear: x.0 / r.rear };
        let mut step = newton(newton((x.0, rolling)).to);
        step.to = (overshot.choose(step.to.0, plain.to.0), step.to.1.where_or(overshot, plain.to.1));
        step
    }
}

impl At {
    /// Derivative of the front load to something by which the specific force has the derivative `a_s`.
    #[inline(always)]
    pub(super) fn load_by(&self, a_s: Four) -> Four {
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
    scale: Four,
}

impl Implicit {
    #[inline(always)]
    fn new(at: &At, hs: Four) -> Self {
        let grip = at.gear * at.load * hs;
        let element = Axles::both(Four::ONE) - (grip * at.mu_w + at.braking * hs);
        let own = Axles { front: Four::ONE / element.front, rear: Four::ONE / element.rear };
        let transfer = at.gear * at.mu * Axles::opposite(at.lever);
        let speed = grip * at.mu_v - transfer;
        let wheels = at.a_w * own * hs;
        let scale = Four::ONE / (Four::ONE - hs * at.a_v - (wheels * speed).sum());
        Self { own, transfer, speed, wheels, scale }
    }

    /// `x` with `(I - hs J) x = b`.
    #[inline(always)]
    fn solve(&self, (b_v, b_w): Column) -> Column {
        let b_w = b_w + self.transfer * b_v;
        let v = (b_v + (self.wheels * b_w).sum()) * self.scale;
        (v, (b_w + self.speed * v) * self.own)
    }
}

/// The motion after a step, as it was where the step does not exist; and where it does.
#[inline(always)]
fn moved((v, w): Column, (dv, dw): Column) -> (Column, Mask) {
    let (to_v, to_w) = (v + dv, w + dw);
    let exists = (to_v + to_w.sum()).is_finite();
    ((exists.choose(to_v, v), to_w.where_or(exists, w)), exists)
}

/// Column `k` of the identity followed by zeros.
fn unit(k: usize) -> Column {
    let one = |i: usize| f64::from(u8::from(i == k));
    (all(one(0)), Axles::all([one(1), one(2)]))
}

#[inline(always)]
pub(super) fn motions(x: [&Motion; 4]) -> Column {
    let [v, front, rear] = from_fn(|i| Four::new(x.map(|x| x[i])));
    (v, Axles { front, rear })
}

#[inline(always)]
pub(super) fn unknowns(p: [&Unknowns; 4]) -> [Four; 3] {
    from_fn(|i| Four::new(p.map(|p| p[i])))
}

/// That of the first point.
pub(super) fn first((v, w): Column) -> Vector3<f64> {
    let [front, rear] = w.first();
    Vector3::new(v.first(), front, rear)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::wheel_loader::{Point, Tire};

    /// To 1e-13 of the weight and of what it accelerates, driving, braking and reversing, until axles lift.
    #[test]
    fn points_side_by_side_have_the_rates_of_the_definition() {
        let (mut lifted, mut guarded) = (0, 0);
        for friction in [0.75, 1e6] {
            let machine = WheelLoader { tire: Tire { friction, ..Tire::default() }, ..WheelLoader::default() };
            let weight = machine.loader.mass * GRAVITY;
            for k in 0..1000 {
                let wave = |rate: f64| (rate * f64::from(k)).sin();
                let u = Drive {
                    torque: [5000.0 * wave(0.37), 4000.0 * wave(0.41)],
                    brake: [900.0 * wave(0.2).max(0.0), 700.0 * wave(0.3).max(0.0)],
                    slope: 0.3 * wave(0.53),
                    force_x: 2e4 * wave(0.59).powi(5),
                    force_z: 2e4 * wave(0.61).powi(5),
                };
                let points: [(Motion, Unknowns); 4] = from_fn(|point| {
                    let wave = |rate: f64| (rate * f64::from(4 * k + point as i32)).sin();
                    let v = 4.0 * wave(0.11);
                    let x = Motion::new(v, v / 0.55 * (1.0 + 0.3 * wave(0.7)), v / 0.55 * (1.0 + 0.3 * wave(0.8)));
                    (x, Unknowns::new(20.0 + 15.0 * wave(0.13), 1.4 + wave(0.17), 0.5 + 0.35 * wave(0.19)))
                });
                let at = Driven::new(&machine, &u).at(
                    motions(points.each_ref().map(|(x, _)| x)),
                    Axles::all(machine.loader.wheel_radius()),
                    unknowns(points.each_ref().map(|(_, p)| p)),
                );
                for (i, (x, p)) in points.iter().enumerate() {
                    let Point { rates, slip, load, specific_force, lift, guarded: guard, .. } = machine.rates(x, p, &u);
                    let lane = |value: Four| value.to_array()[i];
                    let flag = |mask: Mask| lane(mask.select(Four::ONE)) > 0.0;
                    assert_eq!((lift, guard), (flag(at.lift), flag(at.guarded)), "{k}");
                    // The linear tyre's demand may be a multiple of the load.
                    let size = weight * slip.iter().fold(1.0, |size: f64, slip| size.max(p[0] * slip.abs()));
                    let near = |value: Four, exact: f64, scale: f64| {
                        let value = lane(value);
                        assert!((value - exact).abs() <= scale, "{k}: {value} {exact}");
                    };
                    for (value, exact) in [at.slip.front, at.slip.rear].into_iter().zip(slip) {
                        near(value, exact, 1e-15);
                    }
                    for (value, exact) in [at.load.front, at.load.rear].into_iter().zip(load) {
                        near(value, exact, 1e-13 * size);
                    }
                    near(at.specific_force, specific_force, 1e-13 * size / machine.loader.mass);
                    near(at.rates.0, rates[0], 1e-13 * size / machine.loader.mass);
                    near(at.rates.1.front, rates[1], 1e-13 * size / 36.0);
                    near(at.rates.1.rear, rates[2], 1e-13 * size / 36.0);
                    (lifted, guarded) = (lifted + usize::from(lift), guarded + usize::from(guard));
                }
            }
        }
        assert!(lifted > 100 && guarded > 100, "{lifted} {guarded}");
    }
}
