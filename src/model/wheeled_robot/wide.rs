//! The vehicle's forces in many states side by side, in SIMD lanes, one per wheel: what the filter's sigma points
//! cost. The definition is [`WheeledRobot::forces`]; here what all states share is worked out once per drive.

use super::{Drive, Forces, GRAVITY, Motion, ROUNDS, Vehicle, WheeledRobot, Wheels};
use crate::model::four::Four;
use crate::model::lanes::arc_tangent;
use crate::model::tire::{Angles, Curves};
use multiversion::multiversion;

/// The vehicle under a drive: all that is the same in every state, worked out once, so that a filter can ask
/// about many states.
#[derive(Clone, Debug)]
pub struct Driven<'a> {
    model: &'a WheeledRobot,
    longitudinal: Four,
    /// Sines and cosines of the wheels' steering angles, and the hubs' places to the left and forward.
    steering: (Four, Four),
    left: Four,
    forward: Four,
    /// The specific forces and the yaw acceleration by the longitudinal forces alone.
    alone: [f64; 3],
    /// Acceleration per lateral force: both front wheels' forward and to the left, both rear wheels' to the left.
    per_force: [f64; 3],
    /// Yaw acceleration per lateral force of each wheel.
    turning: Wheels,
    transfer: Transfer,
    /// Loads and curves of the first round.
    first: (Four, Curves),
}

impl<'a> Driven<'a> {
    #[inline]
    pub(super) fn new(model: &'a WheeledRobot, drive: &Drive) -> Self {
        let (s, c, fx) = (drive.steering_sin, drive.steering_cos, &drive.longitudinal);
        let v = &model.vehicle;
        let (per_mass, per_inertia) = (1.0 / v.mass, 1.0 / v.yaw_inertia);
        let (lf, lr) = (v.cg_to_front, v.cg_to_rear);
        let (half_front, half_rear) = (0.5 * v.track_front, 0.5 * v.track_rear);
        let front_fx = fx[0] + fx[1];
        let moment = lf * front_fx * s + half_front * c * (fx[1] - fx[0]) + half_rear * (fx[3] - fx[2]);
        let alone = [(front_fx * c + fx[2] + fx[3]) * per_mass, front_fx * s * per_mass, moment * per_inertia];
        let (transfer, longitudinal) = (Transfer::new(v), Four::new(*fx));
        let load = transfer.loads(alone[0], 0.0);
        Self {
            model,
            longitudinal,
            steering: (Four::new([s, s, 0.0, 0.0]), Four::new([c, c, 1.0, 1.0])),
            left: Four::new([half_front, -half_front, half_rear, -half_rear]),
            forward: Four::new([lf, lf, -lr, -lr]),
            alone,
            per_force: [-s * per_mass, c * per_mass, per_mass],
            turning: [lf * c + half_front * s, lf * c - half_front * s, -lr, -lr].map(|arm| arm * per_inertia),
            transfer,
            first: (load, model.tires.curves(load, longitudinal, model.tire.combined)),
        }
    }

    #[inline(always)]
    fn hubs(&self, x: &Motion) -> (Four, Four) {
        let [vx, vy, r] = x.map(Four::splat);
        let (ux, uy) = (vx - r * self.left, vy + r * self.forward);
        let (s, c) = self.steering;
        (ux * c + uy * s, uy * c - ux * s)
    }

    #[inline(always)]
    fn slip(&self, x: &Motion) -> Four {
        let (along, across) = self.hubs(x);
        let speed = along.abs().max(Four::splat(self.model.minimum_speed));
        arc_tangent(across.abs() / speed).flip_signs(-across)
    }

    /// Slip angles, rad: `-atan(across / max(|along|, v_min))`, positive for a leftward force. The
    /// guard makes them defined at rest and in reverse.
    pub fn slip_angles(&self, x: &Motion) -> Wheels {
        self.slip(x).to_array()
    }

    /// Velocity of the wheels' hubs along and across the wheels, m/s.
    pub fn hub_velocities(&self, x: &Motion) -> (Wheels, Wheels) {
        let (along, across) = self.hubs(x);
        (along.to_array(), across.to_array())
    }

    /// The forces in several states. Loads depend on accelerations, these on tyre forces, and
    /// these on loads: four rounds of a fixed point, begun without lateral forces.
    #[inline]
    pub fn forces_of<const K: usize>(&self, x: &[Motion; K]) -> [Forces; K] {
        let (slip, load, lateral) = loads_and_forces(self, x);
        std::array::from_fn(|k| {
            let lateral = lateral[k].to_array();
            let [accel_x, accel_y, yaw_acceleration] = self.accelerations(&lateral);
            let (slip_angle, load) = (slip[k].to_array(), load[k].to_array());
            Forces { slip_angle, load, lateral, accel_x, accel_y, yaw_acceleration }
        })
    }

    /// The specific forces at the centre of gravity, m/s², and the yaw acceleration, rad/s², in several states.
    #[inline]
    pub fn accelerations_of<const K: usize>(&self, x: &[Motion; K]) -> [[f64; 3]; K] {
        let (.., lateral) = loads_and_forces(self, x);
        lateral.map(|lateral| self.accelerations(&lateral.to_array()))
    }

    /// The specific forces at the centre of gravity, m/s², and the yaw acceleration, rad/s², under lateral forces.
    #[inline(always)]
    fn accelerations(&self, lateral: &Wheels) -> [f64; 3] {
        let [forward, left, rear] = self.per_force;
        let (front_pair, rear_pair) = (lateral[0] + lateral[1], lateral[2] + lateral[3]);
        let [a, b, c, d] = std::array::from_fn(|i| self.turning[i] * lateral[i]);
        [
            self.alone[0] + front_pair * forward,
            self.alone[1] + front_pair * left + rear_pair * rear,
            self.alone[2] + ((a + b) + (c + d)),
        ]
    }

    /// [`WheeledRobot::derivative`] in several states.
    #[inline]
    pub fn derivatives_of<const K: usize>(&self, x: &[Motion; K]) -> [Motion; K] {
        let accelerations = self.accelerations_of(x);
        std::array::from_fn(|k| {
            let ([vx, vy, r], [ax, ay, turn]) = (x[k], accelerations[k]);
            [ax + r * vy, ay - r * vx, turn]
        })
    }
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn loads_and_forces<const K: usize>(driven: &Driven, x: &[Motion; K]) -> ([Four; K], [Four; K], [Four; K]) {
    let (tires, combined) = (&driven.model.tires, driven.model.tire.combined);
    let mut slip = [Four::ZERO; K];
    for k in 0..K {
        slip[k] = driven.slip(&x[k]);
    }
    let mut load = [driven.first.0; K];
    let mut curves = [driven.first.1; K];
    let mut angles = [Angles::default(); K];
    let mut lateral = tires.on_curves(&slip, &curves, &mut angles, false);
    for _ in 1..ROUNDS {
        for k in 0..K {
            let [accel_x, accel_y, _] = driven.accelerations(&lateral[k].to_array());
            load[k] = driven.transfer.loads(accel_x, accel_y);
            curves[k] = tires.curves(load[k], driven.longitudinal, combined);
        }
        // from round to round the angles hardly change
        lateral = tires.on_curves(&slip, &curves, &mut angles, true);
    }
    (slip, load, lateral)
}

/// Load transfer, loads per acceleration.
#[derive(Clone, Debug)]
struct Transfer {
    weight: f64,
    front: f64,
    pitch: f64,
    /// Of each wheel, to the left positive.
    roll: Four,
}

impl Transfer {
    #[inline(always)]
    fn new(v: &Vehicle) -> Self {
        let (weight, base) = (v.mass * GRAVITY, v.wheelbase());
        let lever = v.mass * v.cg_height / base;
        let (front, rear) = (lever * v.cg_to_rear / v.track_front, lever * v.cg_to_front / v.track_rear);
        Self {
            weight,
            front: weight * v.cg_to_rear / base,
            pitch: lever,
            roll: Four::new([-front, front, -rear, rear]),
        }
    }

    #[inline(always)]
    fn loads(&self, accel_x: f64, accel_y: f64) -> Four {
        let front = 0.5 * (self.front - self.pitch * accel_x).max(0.0).min(self.weight);
        let rear = 0.5 * self.weight - front;
        let half = Four::new([front, front, rear, rear]);
        half + (self.roll * Four::splat(accel_y)).max(-half).min(half)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tire::TireSet;

    /// To 1e-13 of the weight and of what the weight accelerates, at speeds through zero, in bends until wheels lift.
    #[test]
    fn states_side_by_side_have_the_forces_of_the_definition() {
        let mut lifted = 0;
        for combined in [false, true] {
            let vehicle = Vehicle { cg_height: 0.4, ..Vehicle::default() };
            let robot = WheeledRobot::new(&vehicle, &TireSet { combined, ..TireSet::default() }, 0.5);
            let (weight, arm) = (vehicle.mass * GRAVITY, vehicle.mass * vehicle.wheelbase() / vehicle.yaw_inertia);
            for k in 0..4000 {
                let wave = |rate: f64| (rate * f64::from(k)).sin();
                let drive = Drive::new(0.5 * wave(0.37), [0.71, 0.83, 0.97, 1.13].map(|rate| 60.0 * wave(rate)));
                let x = [8.0 * wave(0.11), 2.0 * wave(0.23), 3.0 * wave(0.31)];
                let (expected, driven) = (robot.forces(&x, &drive), robot.driven(&drive));
                let [forces] = driven.forces_of(&[x]);
                for i in 0..4 {
                    assert!((forces.slip_angle[i] - expected.slip_angle[i]).abs() <= 1e-15, "{k}");
                    assert!((forces.load[i] - expected.load[i]).abs() <= 1e-13 * weight, "{k}");
                    assert!((forces.lateral[i] - expected.lateral[i]).abs() <= 1e-13 * weight, "{k}");
                }
                let (a, b) = (forces.accelerations(), expected.accelerations());
                for (i, scale) in [GRAVITY, GRAVITY, arm * GRAVITY].into_iter().enumerate() {
                    assert!((a[i] - b[i]).abs() <= 1e-13 * scale, "{k}");
                }
                let [rates] = driven.derivatives_of(&[x]);
                for (i, rate) in robot.derivative(&x, &drive).into_iter().enumerate() {
                    assert!((rates[i] - rate).abs() <= 1e-13 * [GRAVITY, GRAVITY, arm * GRAVITY][i], "{k}");
                }
                lifted += usize::from(expected.load.contains(&0.0));
            }
        }
        assert!(lifted > 100, "wheels lift: {lifted}");
    }
}
