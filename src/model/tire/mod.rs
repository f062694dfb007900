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
//!
//! `B alpha` contains K and mu only as their ratio, so that their relative errors move the force by
//!
//! ```text
//! dFy/dln K0 = alpha dFy/dalpha,    dFy/dln mu0 = Fy - alpha dFy/dalpha
//! ```
//!
//! [`Tire`] is the definition; [`Tires`] computes four tyres side by side and is held to it by its tests.

mod wide;

pub use wide::Tires;
pub(super) use wide::{Angles, Curves};

variables! {
    /// Tyre of one axle in the Magic Formula.
    #[derive(Copy)]
    pub struct Tire {
        /// Cornering stiffness of one wheel at the nominal load (K0).
        stiffness: f64 = 1318.464, "N/rad", [1e-2, 1e8];
        /// Nominal load of one wheel (Fz0).
        nominal_load: f64 = 147.15, "N", [1e-2, 1e7];
        /// Load of the greatest stiffness over the nominal load (c2); 0 makes the stiffness proportional to the load.
        load_sensitivity: f64 = 2.0, "1", [0.0, 1000.0];
        /// Shape factor (C).
        shape: f64 = 1.4, "1", [1.0, 2.2];
        /// Friction at the nominal load (mu0).
        friction: f64 = 0.8, "1", [0.01, 10.0];
        /// Change of the friction per relative change of the load (mu1).
        friction_slope: f64 = -0.1, "1", [-2.0, 2.0];
        /// Curvature factor (E).
        curvature: f64 = -0.2, "1", [-50.0, 1.0];
        /// Error of the stiffness over the stiffness (one standard deviation), which counts in the estimates' deviations.
        stiffness_std: f64 = 0.3, "1", [0.0, 10.0], tunable;
        /// Error of the friction over the friction (one standard deviation), likewise.
        friction_std: f64 = 0.3, "1", [0.0, 10.0], tunable;
    }
}

variables! {
    /// Tyres.
    pub struct TireSet {
        /// Front tyres.
        front: Tire;
        /// Rear tyres.
        rear: Tire;
        /// Whether longitudinal force takes lateral grip away, by the friction ellipse.
        combined: bool = false, "1";
    }
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
        let f = load.max(1e-6 * self.nominal_load);
        let share = f / self.nominal_load;
        let mu = (self.friction + self.friction_slope * (share - 1.0)).max(0.05 * self.friction);
        let (c, d, e) = (self.shape, mu * f, self.curvature);
        let c2 = self.degressive_share();
        let bend = |x: f64| (2.0 * x.atan()).sin();
        let k = self.stiffness * if c2 > 0.0 { bend(share / c2) / bend(1.0 / c2) } else { share };
        Coefficients { b: k / (c * d), c, d, e }
    }

    /// `c2`, not so small that its inverse square overflows.
    fn degressive_share(&self) -> f64 {
        if self.load_sensitivity > 0.0 { self.load_sensitivity.max(1e-6) } else { 0.0 }
    }

    /// Lateral force at a slip angle (rad) under a vertical load (N), N.
    pub fn lateral_force(&self, slip_angle: f64, load: f64) -> f64 {
        if load <= 0.0 {
            return 0.0;
        }
        let Coefficients { b, c, d, e } = self.coefficients(load);
        let x = b * slip_angle;
        d * (c * (x - e * (x - x.atan())).atan()).sin()
    }

    /// Share of the lateral force that a longitudinal force (N) leaves, by the friction ellipse: `sqrt(1 - (Fx/D)²)`.
    pub fn lateral_share(&self, longitudinal: f64, load: f64) -> f64 {
        let used = longitudinal / self.coefficients(load).d;
        (1.0 - used * used).max(0.0).sqrt()
    }

    /// Cornering stiffness `dFy/dalpha` at a slip angle (rad) under a vertical load (N), N/rad.
    pub fn cornering_stiffness(&self, slip_angle: f64, load: f64) -> f64 {
        if load <= 0.0 {
            return 0.0;
        }
        let Coefficients { b, c, d, e } = self.coefficients(load);
        let x = b * slip_angle;
        let y = x - e * (x - x.atan());
        let y_x = 1.0 - e + e / (1.0 + x * x);
        d * (c * y.atan()).cos() * c / (1.0 + y * y) * y_x * b
    }
}
