//! Lateral tyre force by the Magic Formula with load-dependent stiffness and friction.
//!
//! With slip angle `alpha` and vertical load `Fz`, lifted to `f = max(Fz, 1e-6 Fz0)`:
//!
//! ```text
//! mu = max(mu0 + mu1 (f/Fz0 - 1), 0.05 mu0)              friction
//! D  = mu f                                              peak force
//! K  = K0 sin(2 atan(f/(c2 Fz0))) / sin(2 atan(1/c2))    cornering stiffness; K0 f/Fz0 if c2 = 0
//! B  = K / (C D)
//! Fy = D sin(C atan(B alpha - E (B alpha - atan(B alpha)))),  0 if Fz <= 0
//! ```
//!
//! Positive slip angle gives positive (leftward) force. CN117406607B names B, C, D, E; its formula is
//! an image that the published text lacks. The load laws are those of Pacejka's tyre book.

use std::f64::consts::PI;
use wide::f64x4;

/// One tyre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tire {
    /// Cornering stiffness `K0` at the nominal load, N/rad.
    pub stiffness: f64,
    /// Nominal load `Fz0`, N.
    pub nominal_load: f64,
    /// Load at the greatest stiffness over the nominal load, `c2`; 0 makes stiffness proportional to load.
    pub load_sensitivity: f64,
    /// Shape `C`, 1 to 2.2.
    pub shape: f64,
    /// Friction `mu0` at the nominal load.
    pub friction: f64,
    /// Change of friction per relative change of load, `mu1`.
    pub friction_slope: f64,
    /// Curvature `E`, at most 1.
    pub curvature: f64,
}

/// The coefficients of the Magic Formula at one load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// Stiffness factor, 1/rad.
    pub b: f64,
    /// Shape.
    pub c: f64,
    /// Peak force, N.
    pub d: f64,
    /// Curvature.
    pub e: f64,
}

impl Tire {
    /// The coefficients under a vertical load, N.
    pub fn coefficients(&self, load: f64) -> Coefficients {
        let tires = Tires::new(self, self);
        let (peak, b) = tires.peak_and_stiffness(f64x4::splat(load));
        Coefficients { b: b.to_array()[0], c: self.shape, d: peak.to_array()[0], e: self.curvature }
    }

    /// Lateral force at a slip angle (rad) under a vertical load (N), N.
    pub fn lateral_force(&self, slip_angle: f64, load: f64) -> f64 {
        let (slip_angle, load) = (f64x4::splat(slip_angle), f64x4::splat(load));
        Tires::new(self, self).lateral_forces(&[slip_angle], &[load], f64x4::ZERO, false)[0].to_array()[0]
    }
}

/// The four tyres of a vehicle, lane by lane: front left, front right, rear left, rear right.
#[derive(Clone, Debug, PartialEq)]
pub struct Tires {
    least_load: f64x4,
    friction: f64x4,
    friction_per_load: f64x4,
    least_friction: f64x4,
    stiffness_per_load: f64x4,
    degression: f64x4,
    shape: f64x4,
    curvature: f64x4,
}

impl Tires {
    /// Two equal tyres in front, two at the rear.
    pub fn new(front: &Tire, rear: &Tire) -> Self {
        let lanes = |value: &dyn Fn(&Tire) -> f64| f64x4::new([front, front, rear, rear].map(value));
        // sin(2 atan x) = 2x / (1 + x²), so that K = K0 f/Fz0 (1 + y²)/(1 + (f y/Fz0)²) with y = 1/c2, or y = 0
        let y = |t: &Tire| if t.load_sensitivity > 0.0 { 1.0 / t.load_sensitivity } else { 0.0 };
        Self {
            least_load: lanes(&|t| 1e-6 * t.nominal_load),
            friction: lanes(&|t| t.friction - t.friction_slope),
            friction_per_load: lanes(&|t| t.friction_slope / t.nominal_load),
            least_friction: lanes(&|t| 0.05 * t.friction),
            stiffness_per_load: lanes(&|t| t.stiffness / t.nominal_load * (1.0 + y(t) * y(t))),
            degression: lanes(&|t| y(t) / t.nominal_load),
            shape: lanes(&|t| t.shape),
            curvature: lanes(&|t| t.curvature),
        }
    }

    /// Peak forces `D`, N, and stiffness factors `B`, 1/rad.
    #[inline(always)]
    fn peak_and_stiffness(&self, load: f64x4) -> (f64x4, f64x4) {
        let f = load.fast_max(self.least_load);
        let mu = (self.friction + self.friction_per_load * f).fast_max(self.least_friction);
        let bend = f * self.degression;
        let b = self.stiffness_per_load / ((f64x4::ONE + bend * bend) * self.shape * mu);
        (mu * f, b)
    }

    /// As [`lateral_forces`](Self::lateral_forces), with plain arrays.
    pub fn lateral(&self, slip_angle: [f64; 4], load: [f64; 4], longitudinal: [f64; 4], combined: bool) -> [f64; 4] {
        let [slip_angle, load, longitudinal] = [slip_angle, load, longitudinal].map(f64x4::new);
        self.lateral_forces(&[slip_angle], &[load], longitudinal, combined)[0].to_array()
    }

    /// Lateral forces at slip angles (rad) under loads (N), N, in one or several states of a vehicle.
    ///
    /// `combined` takes the share of friction that the longitudinal forces (N) use away by the
    /// friction ellipse, `Fy sqrt(1 - (Fx/D)²)`.
    #[inline(always)]
    pub fn lateral_forces<const K: usize>(
        &self,
        slip_angle: &[f64x4; K],
        load: &[f64x4; K],
        longitudinal: f64x4,
        combined: bool,
    ) -> [f64x4; K] {
        let curves = load.map(|load| self.curves(load, longitudinal, combined));
        self.on_curves(slip_angle, &curves, &mut [Angles::default(); K], false)
    }

    /// The tyres' curves under loads, N.
    #[inline(always)]
    pub(super) fn curves(&self, load: f64x4, longitudinal: f64x4, combined: bool) -> Curves {
        let (peak, stiffness) = self.peak_and_stiffness(load);
        let mut height = load.simd_gt(f64x4::ZERO) & peak;
        if combined {
            let used = longitudinal / peak;
            height *= (f64x4::ONE - used * used).fast_max(f64x4::ZERO).sqrt();
        }
        Curves { height, stiffness }
    }

    /// Lateral forces at slip angles (rad), N; keeps the angles inside the formula.
    ///
    /// The states go side by side from stage to stage: each is one long chain of dependent operations, and
    /// several keep the processor busy. `nearby` says that the angles of a similar load are in `angles`.
    #[inline(always)]
    pub(super) fn on_curves<const K: usize>(
        &self,
        slip_angle: &[f64x4; K],
        curves: &[Curves; K],
        angles: &mut [Angles; K],
        nearby: bool,
    ) -> [f64x4; K] {
        // The curve is odd, and with E <= 1 nothing in it is negative for positive slip angles.
        for k in 0..K {
            angles[k].inner.turn(curves[k].stiffness * slip_angle[k].abs(), nearby);
        }
        for Angles { inner, outer } in angles.iter_mut() {
            outer.turn(inner.tangent - self.curvature * (inner.tangent - inner.angle), nearby);
        }
        let force = |k: usize| curves[k].height * sine(self.shape * angles[k].outer.angle);
        std::array::from_fn(|k| force(k).flip_signs(slip_angle[k]))
    }

    /// Slopes of the lateral forces over the slip angle at slip angles (rad) under loads (N), N/rad.
    pub fn slopes(&self, slip_angle: [f64; 4], load: [f64; 4], longitudinal: [f64; 4], combined: bool) -> [f64; 4] {
        let Curves { height, stiffness } = self.curves(f64x4::new(load), f64x4::new(longitudinal), combined);
        let straight = stiffness * f64x4::new(slip_angle).abs();
        let bent = straight - self.curvature * (straight - arc_tangent(straight));
        let bending = f64x4::ONE - self.curvature + self.curvature / (f64x4::ONE + straight * straight);
        let turn = self.shape * arc_tangent(bent);
        let cosine = sine(f64x4::FRAC_PI_2 - turn);
        (height * cosine * self.shape / (f64x4::ONE + bent * bent) * bending * stiffness).to_array()
    }
}

/// Four tyres' curves of force over slip angle at given loads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Curves {
    /// Greatest forces, N.
    height: f64x4,
    /// Stiffness factors `B`, 1/rad.
    stiffness: f64x4,
}

/// An angle and its tangent, both not negative.
#[derive(Clone, Copy, Debug, Default)]
struct Angle {
    tangent: f64x4,
    angle: f64x4,
}

impl Angle {
    /// Goes to another tangent. If it is `nearby`, `atan x = atan x0 + atan((x - x0)/(1 + x x0))`, where the
    /// last angle is small and has a short series.
    #[inline(always)]
    fn turn(&mut self, tangent: f64x4, nearby: bool) {
        let t = (tangent - self.tangent) / (f64x4::ONE + tangent * self.tangent);
        self.tangent = tangent;
        if !nearby || t.abs().simd_gt(f64x4::splat(0.125)).any() {
            self.angle = arc_tangent(tangent);
            return;
        }
        let series = polynomial(
            t * t,
            [-0.33333333333333287, -0.14285714129116034, -0.09085599506798686],
            [0.19999999999790477, 0.1111106826170422, 0.07387718384425714],
        );
        self.angle += t + t * (t * t * series);
    }
}

/// The angles inside the Magic Formula.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Angles {
    inner: Angle,
    outer: Angle,
}

/// A polynomial from its even and its odd coefficients by Horner's scheme in `z²`: two chains of dependent
/// operations, half as long as one.
#[inline(always)]
fn polynomial<const E: usize, const O: usize>(z: f64x4, even: [f64; E], odd: [f64; O]) -> f64x4 {
    let square = z * z;
    let horner = |coefficients: &[f64]| {
        coefficients.iter().rev().map(|c| f64x4::splat(*c)).reduce(|sum, c| sum * square + c).unwrap_or(f64x4::ZERO)
    };
    horner(&even) + z * horner(&odd)
}

/// The arc tangent for `x >= 0`. Above tan(30°) the angle is counted from 60°, `atan x = 60° +
/// atan((x - tan 60°)/(1 + x tan 60°))`, which leaves arguments up to tan(30°); there a Chebyshev
/// interpolant in their square has a relative error of 4e-17 before rounding.
#[inline(always)]
pub(super) fn arc_tangent(x: f64x4) -> f64x4 {
    const TAN_30: f64 = 0.577_350_269_189_625_7;
    const TAN_60: f64 = 1.732_050_807_568_877_2;
    let far = x.simd_gt(f64x4::splat(TAN_30));
    let turned = far & f64x4::splat(TAN_60);
    let t = (x - turned) / (f64x4::ONE + x * turned);
    let z = t * t;
    let series = polynomial(
        z,
        [
            -0.3333333333333332,
            -0.14285714283920362,
            -0.09090904942979589,
            -0.06665508502217014,
            -0.05196651814660573,
            -0.03424200375100575,
            -0.006070764829439552,
        ],
        [
            0.1999999999998937,
            0.11111110991697927,
            0.07692221484970703,
            0.058718231326435506,
            0.044665387521620394,
            0.019776845738205054,
        ],
    );
    (far & f64x4::FRAC_PI_3) + (t + t * (z * series))
}

/// The sine for `|x| <= 3 pi / 2`, which the shape's range `C <= 2.2` never leaves. A Chebyshev
/// interpolant in `x²` (relative error 4e-19 before rounding), without the range reduction of the library's.
#[inline(always)]
fn sine(x: f64x4) -> f64x4 {
    let a = x.abs();
    let t = a.fast_min(f64x4::splat(PI) - a);
    let series = polynomial(
        t * t,
        [1.0, 0.008333333333333186, 2.7557319211166023e-06, 1.6058940571674158e-10, 2.721486441670626e-15],
        [-0.16666666666666666, -0.0001984126984120831, -2.5052106884617687e-08, -7.643018364326954e-13],
    );
    (t * series).flip_signs(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_tangent_agrees_with_the_library() {
        for k in 0..=100_000 {
            let x = 1e-6 * 1.000_3_f64.powi(k) - 1e-6;
            let exact = x.atan();
            let [whole, ..] = arc_tangent(f64x4::splat(x)).to_array();
            assert!((whole - exact).abs() <= 8e-16 * exact, "{x}");
            for near in [0.9 * x, x + 0.1, 3.0 * x] {
                let mut angle = Angle { tangent: f64x4::splat(near), angle: arc_tangent(f64x4::splat(near)) };
                angle.turn(f64x4::splat(x), true);
                let [turned, ..] = angle.angle.to_array();
                assert!((turned - exact).abs() <= 8e-16 * exact.max(near.atan()), "{x} from {near}");
            }
        }
    }

    #[test]
    fn sine_agrees_with_the_library() {
        for k in -47_000..=47_000 {
            let x = f64::from(k) * 1e-4;
            let [near, far, ..] = sine(f64x4::new([x / 3.0, x, 0.0, 0.0])).to_array();
            assert!((near - (x / 3.0).sin()).abs() <= 4e-16 * (x / 3.0).abs(), "{x}");
            assert!((far - x.sin()).abs() <= 1e-15, "{x}");
        }
    }
}
