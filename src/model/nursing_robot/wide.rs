//! The planar motion in four states side by side, one per lane: what the filter's sigma points cost. The definition is
//! [`Planar`]; every lane has its operations, but for small arguments of the hyperbolic tangent.

use super::{GRAVITY, Lean, Planar};
use crate::model::four::Four;
use crate::model::lanes::tanh;

/// Four pitch angles with their sines and cosines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leans {
    phi: Four,
    sin: Four,
    cos: Four,
}

impl Lean {
    /// At four angles nearby: [`moved_to`](Self::moved_to).
    #[inline(always)]
    pub(crate) fn moved_to_each(&self, phi: Four) -> Leans {
        let d = phi - Four::splat(self.phi);
        if d.abs().greater(Four::splat(Self::NEAR)).any() {
            let leans = phi.to_array().map(|phi| self.moved_to(phi));
            return Leans { phi, sin: Four::new(leans.map(|l| l.sin)), cos: Four::new(leans.map(|l| l.cos)) };
        }
        let (s, c) = Self::small_angle(d, Four::splat);
        let (sin, cos) = (Four::splat(self.sin), Four::splat(self.cos));
        Leans { phi, sin: sin * c + cos * s, cos: cos * c - sin * s }
    }
}

impl Planar {
    /// [`rolling_resistance`](Self::rolling_resistance)
    #[inline(always)]
    pub(crate) fn rolling_resistances(&self, v: Four) -> Four {
        Four::splat(self.rolling) * tanh(v * Four::splat(self.inverse_smoothing))
    }

    #[inline(always)]
    fn pitch_torques(&self, &Leans { phi, sin, cos }: &Leans, phi_dot: Four, omega: f64, active: Four) -> Four {
        let s = Four::splat;
        s(self.b * GRAVITY) * sin - s(self.k) * (phi - s(self.rest)) - s(self.c) * phi_dot
            + s(self.j * omega * omega) * sin * cos
            + active
    }

    /// [`acceleration`](Self::acceleration)
    #[inline(always)]
    pub(crate) fn accelerations(
        &self,
        force: Four,
        leans: &Leans,
        phi_dot: Four,
        omega: f64,
        active: Four,
    ) -> (Four, Four) {
        let (s, mass) = (Four::splat, Four::splat(self.inertial_mass));
        let r1 = force + s(self.b) * (s(omega * omega) + phi_dot * phi_dot) * leans.sin;
        let r2 = self.pitch_torques(leans, phi_dot, omega, active);
        let coupling = s(self.b) * leans.cos;
        let inverse = Four::ONE / (s(self.inertial_mass * self.j) - coupling * coupling);
        ((s(self.j) * r1 - coupling * r2) * inverse, (mass * r2 - coupling * r1) * inverse)
    }

    /// [`held_acceleration`](Self::held_acceleration)
    #[inline(always)]
    pub(crate) fn held_accelerations(&self, leans: &Leans, phi_dot: Four, omega: f64, active: Four) -> Four {
        self.pitch_torques(leans, phi_dot, omega, active) / Four::splat(self.j)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::nursing_robot::{Human, Robot, Rolling};

    /// To 1e-14 of the largest term, leaning near and far, rolling slowly and fast.
    #[test]
    fn four_states_side_by_side_have_the_accelerations_of_the_definition() {
        let planar = Planar::new(&Robot::default(), &Rolling::default(), &Human::default(), 80.0);
        for k in 0..2000 {
            let wave = |rate: f64, lane: usize| (rate * f64::from(k) + 1.7 * lane as f64).sin();
            let lanes = |size: f64, rate: f64| -> [f64; 4] { std::array::from_fn(|lane| size * wave(rate, lane)) };
            let lean = Lean::new(0.3 * wave(0.7, 0));
            let reach = if k % 2 == 0 { 0.1 } else { 0.5 };
            let phi = lanes(reach, 0.37).map(|d| lean.phi + d);
            let (v, phi_dot, active) = (lanes(0.4, 0.53).map(|v| v * v * v), lanes(2.0, 0.41), lanes(20.0, 0.29));
            let omega = wave(0.3, 1);
            let leans = lean.moved_to_each(Four::new(phi));
            let force = Four::splat(30.0) - planar.rolling_resistances(Four::new(v));
            let (v_dot, phi_ddot) = planar.accelerations(force, &leans, Four::new(phi_dot), omega, Four::new(active));
            let held = planar.held_accelerations(&leans, Four::new(phi_dot), omega, Four::new(active));
            for lane in 0..4 {
                let lean = Lean::new(phi[lane]);
                let force = 30.0 - planar.rolling_resistance(v[lane]);
                let expected = planar.acceleration(force, &lean, phi_dot[lane], omega, active[lane]);
                let expected_held = planar.held_acceleration(&lean, phi_dot[lane], omega, active[lane]);
                let size = 100.0;
                assert!((v_dot.to_array()[lane] - expected.0).abs() < 1e-14 * size, "{k}");
                assert!((phi_ddot.to_array()[lane] - expected.1).abs() < 1e-14 * size, "{k}");
                assert!((held.to_array()[lane] - expected_held).abs() < 1e-14 * size, "{k}");
            }
        }
    }
}
