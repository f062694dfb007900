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

use super::lanes::{Angle, arc_tangent, sine};
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

/// The angles inside the Magic Formula.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Angles {
    inner: Angle,
    outer: Angle,
}
