//! The Magic Formula of a vehicle's four tyres side by side, in SIMD lanes: what the filter's sigma points cost.
//! The definition is [`Tire`]; here it is rearranged so that no sine and no division is wasted.

use super::Tire;
use crate::model::four::Four;
use crate::model::lanes::{Angle, arc_tangent, sine};

/// One number per wheel, in the order front left, front right, rear left, rear right.
type Wheels = [f64; 4];

/// The four tyres of a vehicle, lane by lane: front left, front right, rear left, rear right.
#[derive(Clone, Debug, PartialEq)]
pub struct Tires {
    least_load: Four,
    friction: Four,
    friction_per_load: Four,
    least_friction: Four,
    stiffness_per_load: Four,
    degression: Four,
    shape: Four,
    curvature: Four,
}

impl Tires {
    /// Two equal tyres in front, two at the rear.
    pub fn new(front: &Tire, rear: &Tire) -> Self {
        let lanes = |value: &dyn Fn(&Tire) -> f64| Four::new([front, front, rear, rear].map(value));
        // sin(2 atan x) = 2x / (1 + x²), so that K = K0 f/Fz0 (1 + y²)/(1 + (f y/Fz0)²) with y = 1/c2, or y = 0
        let y = |t: &Tire| if t.load_sensitivity > 0.0 { 1.0 / t.degressive_share() } else { 0.0 };
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
    fn peak_and_stiffness(&self, load: Four) -> (Four, Four) {
        let f = load.max(self.least_load);
        let mu = (self.friction + self.friction_per_load * f).max(self.least_friction);
        let bend = f * self.degression;
        let b = self.stiffness_per_load / ((Four::ONE + bend * bend) * self.shape * mu);
        (mu * f, b)
    }

    /// Lateral forces at slip angles (rad) under loads (N), N.
    ///
    /// `combined` takes the share of friction that the longitudinal forces (N) use away:
    /// [`Tire::lateral_share`].
    pub fn lateral_forces(&self, slip_angle: Wheels, load: Wheels, longitudinal: Wheels, combined: bool) -> Wheels {
        let curves = self.curves(Four::new(load), Four::new(longitudinal), combined);
        let [force] = self.on_curves(&[Four::new(slip_angle)], &[curves], &mut [Angles::default()], false);
        force.to_array()
    }

    /// The tyres' curves under loads, N.
    #[inline(always)]
    pub(in crate::model) fn curves(&self, load: Four, longitudinal: Four, combined: bool) -> Curves {
        let (peak, stiffness) = self.peak_and_stiffness(load);
        let mut height = load.greater(Four::ZERO).select(peak);
        if combined {
            let used = longitudinal / peak;
            height *= (Four::ONE - used * used).max(Four::ZERO).sqrt();
        }
        Curves { height, stiffness }
    }

    /// Lateral forces at slip angles (rad), N; keeps the angles inside the formula.
    ///
    /// The states go side by side from stage to stage: each is one long chain of dependent operations, and
    /// several keep the processor busy. `nearby` says that the angles of a similar load are in `angles`.
    #[inline(always)]
    pub(in crate::model) fn on_curves<const K: usize>(
        &self,
        slip_angle: &[Four; K],
        curves: &[Curves; K],
        angles: &mut [Angles; K],
        nearby: bool,
    ) -> [Four; K] {
        // The curve is odd, and with E <= 1 nothing in it is negative for positive slip angles.
        for k in 0..K {
            angles[k].inner.turn(curves[k].stiffness * slip_angle[k].abs(), nearby);
        }
        for Angles { inner, outer } in angles.iter_mut() {
            outer.turn(inner.tangent - self.curvature * (inner.tangent - inner.angle), nearby);
        }
        let mut force = [Four::ZERO; K];
        for k in 0..K {
            force[k] = (curves[k].height * sine(self.shape * angles[k].outer.angle)).flip_signs(slip_angle[k]);
        }
        force
    }

    /// [`Tire::cornering_stiffness`] at slip angles (rad) under loads (N), the forces reduced as in
    /// [`lateral_forces`](Self::lateral_forces), N/rad.
    pub fn cornering_stiffness(
        &self,
        slip_angle: Wheels,
        load: Wheels,
        longitudinal: Wheels,
        combined: bool,
    ) -> Wheels {
        let Curves { height, stiffness } = self.curves(Four::new(load), Four::new(longitudinal), combined);
        let straight = stiffness * Four::new(slip_angle).abs();
        let bent = straight - self.curvature * (straight - arc_tangent(straight));
        let bending = Four::ONE - self.curvature + self.curvature / (Four::ONE + straight * straight);
        let turn = self.shape * arc_tangent(bent);
        let cosine = sine(Four::FRAC_PI_2 - turn);
        (height * cosine * self.shape / (Four::ONE + bent * bent) * bending * stiffness).to_array()
    }
}

/// Four tyres' curves of force over slip angle at given loads.
#[derive(Clone, Copy, Debug)]
pub(in crate::model) struct Curves {
    /// Greatest forces, N.
    height: Four,
    /// Stiffness factors `B`, 1/rad.
    stiffness: Four,
}

/// The angles inside the Magic Formula.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::model) struct Angles {
    inner: Angle,
    outer: Angle,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// To 3e-14 of the peak force and of the greatest stiffness, over the whole range of shapes.
    #[test]
    fn four_tyres_side_by_side_are_the_magic_formula() {
        let mut tyres = 0;
        for (shape, curvature) in [(1.0, 1.0), (1.3, -4.0), (1.4, -0.2), (2.2, 0.9), (1.9, -50.0)] {
            for (load_sensitivity, friction_slope) in [(0.0, 0.0), (2.0, -0.1), (0.8, 0.4), (5.0, -2.0)] {
                let (stiffness, nominal_load, friction) = (1318.464, 147.15, 0.8);
                let front = Tire {
                    stiffness,
                    nominal_load,
                    load_sensitivity,
                    shape,
                    friction,
                    friction_slope,
                    curvature,
                    ..Tire::default()
                };
                let rear = Tire { stiffness: 2000.0, nominal_load: 200.0, ..front };
                let tires = Tires::new(&front, &rear);
                for k in 0..400 {
                    let slip: [f64; 4] = std::array::from_fn(|i| 1.5 * (0.37 * f64::from(k) + i as f64).sin());
                    let load = std::array::from_fn(|i| 400.0 * (0.73 * f64::from(k) + 2.0 * i as f64).sin().powi(3));
                    let longitudinal = std::array::from_fn(|i| 90.0 * (0.51 * f64::from(k) + i as f64).sin());
                    for combined in [false, true] {
                        let force = tires.lateral_forces(slip, load, longitudinal, combined);
                        let stiffness = tires.cornering_stiffness(slip, load, longitudinal, combined);
                        for i in 0..4 {
                            let tire = if i < 2 { &front } else { &rear };
                            let share = if combined { tire.lateral_share(longitudinal[i], load[i]) } else { 1.0 };
                            let peak = tire.coefficients(load[i]).d;
                            let expected = share * tire.lateral_force(slip[i], load[i]);
                            let slope = share * tire.cornering_stiffness(slip[i], load[i]);
                            let steepest = tire.cornering_stiffness(0.0, load[i]);
                            assert!((force[i] - expected).abs() <= 3e-14 * peak, "{expected} N, {} N", force[i]);
                            assert!(
                                (stiffness[i] - slope).abs() <= 3e-14 * steepest,
                                "{slope} N/rad, {}",
                                stiffness[i]
                            );
                        }
                    }
                    tyres += 4;
                }
            }
        }
        assert_eq!(tyres, 32_000);
    }
}
