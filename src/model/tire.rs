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

use super::lanes::{self, Lanes};

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
        let (peak, b) = tires.peak_and_stiffness([load; 4]);
        Coefficients { b: b[0], c: self.shape, d: peak[0], e: self.curvature }
    }

    /// Lateral force at a slip angle (rad) under a vertical load (N), N.
    pub fn lateral_force(&self, slip_angle: f64, load: f64) -> f64 {
        Tires::new(self, self).lateral_forces([slip_angle; 4], [load; 4], [0.0; 4], false)[0]
    }
}

/// The four tyres of a vehicle, lane by lane.
#[derive(Clone, Debug, PartialEq)]
pub struct Tires {
    least_load: Lanes,
    friction: Lanes,
    friction_per_load: Lanes,
    least_friction: Lanes,
    stiffness_per_load: Lanes,
    degression: Lanes,
    shape: Lanes,
    curvature: Lanes,
}

impl Tires {
    /// Two equal tyres in front, two at the rear.
    pub fn new(front: &Tire, rear: &Tire) -> Self {
        let tires = [front, front, rear, rear];
        // sin(2 atan x) = 2x / (1 + x²), so that K = K0 f/Fz0 (1 + y²)/(1 + (f y/Fz0)²) with y = 1/c2, or y = 0
        let y = tires.map(|t| if t.load_sensitivity > 0.0 { 1.0 / t.load_sensitivity } else { 0.0 });
        Self {
            least_load: tires.map(|t| 1e-6 * t.nominal_load),
            friction: tires.map(|t| t.friction - t.friction_slope),
            friction_per_load: tires.map(|t| t.friction_slope / t.nominal_load),
            least_friction: tires.map(|t| 0.05 * t.friction),
            stiffness_per_load: std::array::from_fn(|i| {
                tires[i].stiffness / tires[i].nominal_load * (1.0 + y[i] * y[i])
            }),
            degression: std::array::from_fn(|i| y[i] / tires[i].nominal_load),
            shape: tires.map(|t| t.shape),
            curvature: tires.map(|t| t.curvature),
        }
    }

    /// Peak forces `D`, N, and stiffness factors `B`, 1/rad.
    #[inline(always)]
    fn peak_and_stiffness(&self, load: Lanes) -> (Lanes, Lanes) {
        let (mut peak, mut b) = ([0.0; 4], [0.0; 4]);
        for i in 0..4 {
            let f = if load[i] > self.least_load[i] { load[i] } else { self.least_load[i] };
            let mu = self.friction[i] + self.friction_per_load[i] * f;
            let mu = if mu > self.least_friction[i] { mu } else { self.least_friction[i] };
            let bend = f * self.degression[i];
            peak[i] = mu * f;
            b[i] = self.stiffness_per_load[i] / ((1.0 + bend * bend) * self.shape[i] * mu);
        }
        (peak, b)
    }

    /// Lateral forces at slip angles (rad) under loads (N), N.
    ///
    /// `combined` takes the share of friction that the longitudinal forces (N) use away by the
    /// friction ellipse, `Fy sqrt(1 - (Fx/D)²)`.
    #[inline(always)]
    pub fn lateral_forces(&self, slip_angle: Lanes, load: Lanes, longitudinal: Lanes, combined: bool) -> Lanes {
        let (peak, b) = self.peak_and_stiffness(load);
        let (mut inner, mut angle) = ([0.0; 4], [0.0; 4]);
        for i in 0..4 {
            inner[i] = b[i] * slip_angle[i];
        }
        let bent = lanes::atan(inner);
        for i in 0..4 {
            inner[i] -= self.curvature[i] * (inner[i] - bent[i]);
        }
        let outer = lanes::atan(inner);
        for i in 0..4 {
            angle[i] = self.shape[i] * outer[i];
        }
        let sine = lanes::sin(angle);
        let mut force = [0.0; 4];
        for i in 0..4 {
            force[i] = if load[i] > 0.0 { peak[i] * sine[i] } else { 0.0 };
        }
        if combined {
            for i in 0..4 {
                let used = longitudinal[i] / peak[i];
                force[i] *= (1.0 - used * used).clamp(0.0, 1.0).sqrt();
            }
        }
        force
    }
}
