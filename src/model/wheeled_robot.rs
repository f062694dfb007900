//! Planar motion of a four-wheeled vehicle: longitudinal, lateral, yaw.
//!
//! Frame ISO 8855: x forward, y left, z up; yaw rate and steering angle positive to the left. Wheels in
//! the order front left, front right, rear left, rear right. CN117406607B, claim 1, step 1; its
//! formulas are images that the published text lacks, so the equations are the standard ones its words
//! describe. With `c = cos(delta)`, `s = sin(delta)`:
//!
//! ```text
//! bx = Fx c - Fy s,  by = Fx s + Fy c   (front);   bx = Fx, by = Fy   (rear)
//! ax = sum(bx)/m,    ay = sum(by)/m                 specific force at the centre of gravity
//! Mz = lf (by_FL + by_FR) - lr (by_RL + by_RR) + tf/2 (bx_FR - bx_FL) + tr/2 (bx_RR - bx_RL)
//! vx' = ax + r vy,   vy' = ay - r vx,   r' = Mz/Iz
//! ```
//!
//! Erratum: the source calls the accelerations' noise "process noise"; it is measurement noise.

use super::lanes::arc_tangent;
use super::tire::{Angles, Curves, Tires};
use wide::f64x4;

/// One number per wheel, in the order front left, front right, rear left, rear right.
pub type Wheels = [f64; 4];

/// Gravity, m/s².
pub const GRAVITY: f64 = 9.81;

/// Longitudinal speed, lateral speed (m/s) and yaw rate (rad/s): `x = (vx, vy, r)`.
pub type Motion = [f64; 3];

/// Masses, lengths and tyres.
#[derive(Clone, Debug, PartialEq)]
pub struct WheeledRobot {
    /// Mass, kg.
    pub mass: f64,
    /// Yaw inertia about the centre of gravity, kg m².
    pub yaw_inertia: f64,
    /// Centre of gravity to the front axle, m.
    pub cg_to_front: f64,
    /// Centre of gravity to the rear axle, m.
    pub cg_to_rear: f64,
    /// Front track, m.
    pub track_front: f64,
    /// Rear track, m.
    pub track_rear: f64,
    /// Height of the centre of gravity, m.
    pub cg_height: f64,
    /// The tyres.
    pub tires: Tires,
    /// Speed below which slip angles are taken as if at this speed, m/s.
    pub minimum_speed: f64,
    /// Whether longitudinal forces take lateral grip away.
    pub combined: bool,
}

/// What acts on the vehicle: steering angle and longitudinal wheel forces, `u = (delta, Fx)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    steering_sin: f64,
    steering_cos: f64,
    longitudinal: Wheels,
}

impl Drive {
    /// From the steering angle of the front wheels (rad) and the longitudinal wheel forces (N).
    pub fn new(steering: f64, longitudinal: Wheels) -> Self {
        let (steering_sin, steering_cos) = steering.sin_cos();
        Self { steering_sin, steering_cos, longitudinal }
    }

    /// Longitudinal wheel forces, N.
    pub fn longitudinal(&self) -> Wheels {
        self.longitudinal
    }

    /// Sine of the steering angle.
    pub fn steering_sin(&self) -> f64 {
        self.steering_sin
    }
}

/// Forces and accelerations of one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forces {
    /// Slip angles, rad.
    pub slip_angle: Wheels,
    /// Vertical wheel loads, N.
    pub load: Wheels,
    /// Lateral wheel forces, N.
    pub lateral: Wheels,
    /// Longitudinal specific force at the centre of gravity, m/s².
    pub accel_x: f64,
    /// Lateral specific force at the centre of gravity, m/s².
    pub accel_y: f64,
    /// Yaw acceleration, rad/s².
    pub yaw_acceleration: f64,
}

impl Forces {
    /// Specific forces at the centre of gravity, m/s², and yaw acceleration, rad/s².
    pub fn accelerations(&self) -> [f64; 3] {
        [self.accel_x, self.accel_y, self.yaw_acceleration]
    }
}

/// How the equations of motion are made discrete, the inputs being held over a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    /// Explicit Euler, the source's choice.
    Euler,
    /// The classical Runge-Kutta method of fourth order.
    Rk4,
}

impl WheeledRobot {
    /// Vertical wheel loads under an acceleration, N. Their sum is the weight and none is negative:
    /// a wheel that would pull at the ground has lifted off.
    #[inline(always)]
    pub fn loads(&self, accel_x: f64, accel_y: f64) -> Wheels {
        self.transfer().loads(accel_x, accel_y).to_array()
    }

    /// What the load transfer is made of; worked out once, for divisions are slow.
    #[inline(always)]
    fn transfer(&self) -> Transfer {
        let (weight, base) = (self.mass * GRAVITY, self.cg_to_front + self.cg_to_rear);
        let lever = self.mass * self.cg_height / base;
        let (front, rear) = (lever * self.cg_to_rear / self.track_front, lever * self.cg_to_front / self.track_rear);
        Transfer {
            weight,
            front: weight * self.cg_to_rear / base,
            pitch: lever,
            roll: f64x4::new([-front, front, -rear, rear]),
        }
    }

    /// The vehicle under a drive.
    #[inline]
    pub fn driven(&self, drive: &Drive) -> Driven<'_> {
        Driven::new(self, drive)
    }

    /// Forces and accelerations in a state; see [`Driven::forces_of`].
    pub fn forces(&self, x: &Motion, drive: &Drive) -> Forces {
        let [forces] = self.driven(drive).forces_of(&[*x]);
        forces
    }

    /// Time derivative of the motion.
    pub fn derivative(&self, x: &Motion, drive: &Drive) -> Motion {
        let [rate] = self.driven(drive).derivatives(&[*x]);
        rate
    }

    /// The motion `dt` seconds later, in equal substeps.
    pub fn advance(&self, x: &Motion, drive: &Drive, dt: f64, integrator: Integrator, substeps: u32) -> Motion {
        let [x] = self.driven(drive).advance_of([*x], dt, integrator, substeps);
        x
    }

    /// Derivatives of the lateral forces by the slip angles at fixed loads, N/rad.
    pub fn cornering_stiffness(&self, slip_angle: Wheels, load: Wheels, drive: &Drive) -> Wheels {
        self.tires.cornering_stiffness(slip_angle, load, drive.longitudinal, self.combined)
    }
}

/// The vehicle under a drive: all that is the same in every state, worked out once, so that a filter can ask
/// about many states.
#[derive(Clone, Debug)]
pub struct Driven<'a> {
    model: &'a WheeledRobot,
    longitudinal: f64x4,
    /// Sines and cosines of the wheels' steering angles, and the hubs' places left and ahead.
    steering: (f64x4, f64x4),
    left: f64x4,
    ahead: f64x4,
    /// The specific forces and the yaw acceleration by the longitudinal forces alone.
    alone: [f64; 3],
    /// Acceleration per lateral force: both front wheels' ahead and to the left, both rear wheels' to the left.
    per_force: [f64; 3],
    /// Yaw acceleration per lateral force of each wheel.
    turning: Wheels,
    transfer: Transfer,
    /// Loads and curves of the first round.
    first: (f64x4, Curves),
}

impl<'a> Driven<'a> {
    #[inline]
    fn new(model: &'a WheeledRobot, drive: &Drive) -> Self {
        let (s, c, fx) = (drive.steering_sin, drive.steering_cos, &drive.longitudinal);
        let (per_mass, per_inertia) = (1.0 / model.mass, 1.0 / model.yaw_inertia);
        let (lf, lr) = (model.cg_to_front, model.cg_to_rear);
        let (half_front, half_rear) = (0.5 * model.track_front, 0.5 * model.track_rear);
        let front_fx = fx[0] + fx[1];
        let moment = lf * front_fx * s + half_front * c * (fx[1] - fx[0]) + half_rear * (fx[3] - fx[2]);
        let alone = [(front_fx * c + fx[2] + fx[3]) * per_mass, front_fx * s * per_mass, moment * per_inertia];
        let (transfer, longitudinal) = (model.transfer(), f64x4::new(*fx));
        let load = transfer.loads(alone[0], 0.0);
        Self {
            model,
            longitudinal,
            steering: (f64x4::new([s, s, 0.0, 0.0]), f64x4::new([c, c, 1.0, 1.0])),
            left: f64x4::new([half_front, -half_front, half_rear, -half_rear]),
            ahead: f64x4::new([lf, lf, -lr, -lr]),
            alone,
            per_force: [-s * per_mass, c * per_mass, per_mass],
            turning: [lf * c + half_front * s, lf * c - half_front * s, -lr, -lr].map(|arm| arm * per_inertia),
            transfer,
            first: (load, model.tires.curves(load, longitudinal, model.combined)),
        }
    }

    #[inline(always)]
    fn hubs(&self, x: &Motion) -> (f64x4, f64x4) {
        let [vx, vy, r] = x.map(f64x4::splat);
        let (ux, uy) = (vx - r * self.left, vy + r * self.ahead);
        let (s, c) = self.steering;
        (ux * c + uy * s, uy * c - ux * s)
    }

    #[inline(always)]
    fn slip(&self, x: &Motion) -> f64x4 {
        let (along, across) = self.hubs(x);
        let speed = along.abs().fast_max(f64x4::splat(self.model.minimum_speed));
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
        let slip = x.map(|x| self.slip(&x));
        let (load, lateral) = self.loads_and_forces(&slip);
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
        let (_, lateral) = self.loads_and_forces(&x.map(|x| self.slip(&x)));
        lateral.map(|lateral| self.accelerations(&lateral.to_array()))
    }

    #[inline(always)]
    fn loads_and_forces<const K: usize>(&self, slip: &[f64x4; K]) -> ([f64x4; K], [f64x4; K]) {
        let (tires, combined) = (&self.model.tires, self.model.combined);
        let mut load = [self.first.0; K];
        let mut curves = [self.first.1; K];
        let mut angles = [Angles::default(); K];
        let mut lateral = tires.on_curves(slip, &curves, &mut angles, false);
        for _ in 1..4 {
            for k in 0..K {
                let [accel_x, accel_y, _] = self.accelerations(&lateral[k].to_array());
                load[k] = self.transfer.loads(accel_x, accel_y);
                curves[k] = tires.curves(load[k], self.longitudinal, combined);
            }
            // from round to round the angles hardly change
            lateral = tires.on_curves(slip, &curves, &mut angles, true);
        }
        (load, lateral)
    }

    /// The specific forces at the centre of gravity, m/s², and the yaw acceleration, rad/s², under lateral forces.
    #[inline(always)]
    fn accelerations(&self, lateral: &Wheels) -> [f64; 3] {
        let [ahead, left, rear] = self.per_force;
        let (front_pair, rear_pair) = (lateral[0] + lateral[1], lateral[2] + lateral[3]);
        let [a, b, c, d] = std::array::from_fn(|i| self.turning[i] * lateral[i]);
        [
            self.alone[0] + front_pair * ahead,
            self.alone[1] + front_pair * left + rear_pair * rear,
            self.alone[2] + ((a + b) + (c + d)),
        ]
    }

    #[inline]
    fn derivatives<const K: usize>(&self, x: &[Motion; K]) -> [Motion; K] {
        let accelerations = self.accelerations_of(x);
        std::array::from_fn(|k| {
            let ([vx, vy, r], [ax, ay, turn]) = (x[k], accelerations[k]);
            [ax + r * vy, ay - r * vx, turn]
        })
    }

    /// The motions `dt` seconds later of several states side by side, in equal substeps.
    #[inline]
    pub fn advance_of<const K: usize>(
        &self,
        mut x: [Motion; K],
        dt: f64,
        integrator: Integrator,
        substeps: u32,
    ) -> [Motion; K] {
        let h = dt / f64::from(substeps.max(1));
        for _ in 0..substeps.max(1) {
            let k1 = self.derivatives(&x);
            x = match integrator {
                Integrator::Euler => ahead(&x, &k1, h),
                Integrator::Rk4 => {
                    let k2 = self.derivatives(&ahead(&x, &k1, 0.5 * h));
                    let k3 = self.derivatives(&ahead(&x, &k2, 0.5 * h));
                    let k4 = self.derivatives(&ahead(&x, &k3, h));
                    let mean = |k: usize, i: usize| k1[k][i] + 2.0 * k2[k][i] + 2.0 * k3[k][i] + k4[k][i];
                    std::array::from_fn(|k| std::array::from_fn(|i| x[k][i] + h / 6.0 * mean(k, i)))
                }
            };
        }
        x
    }
}

/// Load transfer, loads per acceleration.
#[derive(Clone, Debug)]
struct Transfer {
    weight: f64,
    front: f64,
    pitch: f64,
    /// Of each wheel, to the left positive.
    roll: f64x4,
}

impl Transfer {
    #[inline(always)]
    fn loads(&self, accel_x: f64, accel_y: f64) -> f64x4 {
        let front = 0.5 * (self.front - self.pitch * accel_x).max(0.0).min(self.weight);
        let rear = 0.5 * self.weight - front;
        let half = f64x4::new([front, front, rear, rear]);
        half + (self.roll * f64x4::splat(accel_y)).fast_max(-half).fast_min(half)
    }
}

fn ahead<const K: usize>(x: &[Motion; K], slope: &[Motion; K], h: f64) -> [Motion; K] {
    std::array::from_fn(|k| std::array::from_fn(|i| x[k][i] + h * slope[k][i]))
}

/// What an inertial sensor `(dx, dy)` metres from the centre of gravity reads there, m/s², from the specific
/// forces at the centre of gravity and the yaw acceleration: `ax - r² dx - r' dy` and `ay - r² dy + r' dx`.
#[inline]
pub fn specific_force_at([ax, ay, turn]: [f64; 3], yaw_rate: f64, dx: f64, dy: f64) -> (f64, f64) {
    let square = yaw_rate * yaw_rate;
    (ax - square * dx - turn * dy, ay - square * dy + turn * dx)
}

/// Torque on a wheel, N m: `T_drive - T_brake clip(w/w_stop, -1, 1) - f_r Fz R tanh(w/0.1)`. Brake and
/// rolling resistance work against the rotation, so that a brake held at rest makes no false force;
/// `stop_speed = 0` (rad/s) makes the brake's sign jump.
pub fn wheel_torque(drive: f64, brake: f64, speed: f64, stop_speed: f64, rolling_moment: f64) -> f64 {
    let direction = if stop_speed > 0.0 {
        (speed / stop_speed).clamp(-1.0, 1.0)
    } else if speed == 0.0 {
        0.0
    } else {
        speed.signum()
    };
    let rolling = if rolling_moment == 0.0 { 0.0 } else { rolling_moment * (speed / 0.1).tanh() };
    drive - brake * direction - rolling
}

/// The fastest rate of the lateral dynamics at a speed, 1/s: the larger of `sum(K)/(m v)` and
/// `(lf² Kf + lr² Kr)/(Iz v)`, `Kf` and `Kr` being the stiffness of both wheels of an axle (N/rad).
pub fn lateral_rate(model: &WheeledRobot, stiffness_front: f64, stiffness_rear: f64, speed: f64) -> f64 {
    let sway = (stiffness_front + stiffness_rear) / (model.mass * speed);
    let (lf, lr) = (model.cg_to_front, model.cg_to_rear);
    let yaw = (lf * lf * stiffness_front + lr * lr * stiffness_rear) / (model.yaw_inertia * speed);
    sway.max(yaw)
}
