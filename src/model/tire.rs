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
    /// friction ellipse, `Fy sqrt(1 - (Fx/D)²)`. The states go side by side from stage to stage: each is one
    /// long chain of dependent operations, and several keep the processor busy.
    #[inline(always)]
    pub fn lateral_forces<const K: usize>(
        &self,
        slip_angle: &[f64x4; K],
        load: &[f64x4; K],
        longitudinal: f64x4,
        combined: bool,
    ) -> [f64x4; K] {
        let curve = load.map(|load| self.peak_and_stiffness(load));
        let straight: [f64x4; K] = std::array::from_fn(|k| curve[k].1 * slip_angle[k]);
        let inner = straight.map(|x| x.atan());
        let bent: [f64x4; K] = std::array::from_fn(|k| straight[k] - self.curvature * (straight[k] - inner[k]));
        let outer = bent.map(|x| x.atan());
        let shape = outer.map(|x| sine(self.shape * x));
        let mut force: [f64x4; K] =
            std::array::from_fn(|k| load[k].simd_gt(f64x4::ZERO).select(curve[k].0 * shape[k], f64x4::ZERO));
        if combined {
            for (force, (peak, _)) in force.iter_mut().zip(&curve) {
                let used = longitudinal / *peak;
                *force *= (f64x4::ONE - used * used).fast_max(f64x4::ZERO).sqrt();
            }
        }
        force
    }
}

/// The sine for `|x| <= 3 pi / 2`, which the shape's range `C <= 2.2` never leaves. A Chebyshev
/// interpolant in `x²` (relative error 4e-19 before rounding), without the range reduction of the library's.
#[inline(always)]
fn sine(x: f64x4) -> f64x4 {
    const C: [f64; 9] = [
        1.0,
        -0.16666666666666666,
        0.008333333333333186,
        -0.0001984126984120831,
        2.7557319211166023e-06,
        -2.5052106884617687e-08,
        1.6058940571674158e-10,
        -7.643018364326954e-13,
        2.721486441670626e-15,
    ];
    let c = C.map(f64x4::splat);
    let a = x.abs();
    let t = a.fast_min(f64x4::splat(PI) - a);
    let z = t * t;
    // Estrin's scheme: short chains of dependent operations, which is what the time goes into
    let z2 = z * z;
    let z4 = z2 * z2;
    let low = (c[0] + c[1] * z) + (c[2] + c[3] * z) * z2;
    let high = (c[4] + c[5] * z) + (c[6] + c[7] * z) * z2;
    (t * (low + (high + c[8] * z4) * z4)).flip_signs(x)
}

#[cfg(test)]
mod tests {
    use super::*;

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
