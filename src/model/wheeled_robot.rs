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

use super::tire::Tires;
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

/// How the equations of motion are made discrete, the inputs being held over a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    /// Explicit Euler, the source's choice.
    Euler,
    /// The classical Runge-Kutta method of fourth order.
    Rk4,
}

impl WheeledRobot {
    /// Velocity of the wheels' hubs along and across the wheels, m/s.
    #[inline(always)]
    pub fn hub_velocities(&self, x: &Motion, drive: &Drive) -> (Wheels, Wheels) {
        let [vx, vy, r] = *x;
        let (front, rear) = (0.5 * self.track_front * r, 0.5 * self.track_rear * r);
        let (uy_front, uy_rear) = (vy + self.cg_to_front * r, vy - self.cg_to_rear * r);
        let (s, c) = (drive.steering_sin, drive.steering_cos);
        let (left, right) = (vx - front, vx + front);
        let along = [left * c + uy_front * s, right * c + uy_front * s, vx - rear, vx + rear];
        let across = [uy_front * c - left * s, uy_front * c - right * s, uy_rear, uy_rear];
        (along, across)
    }

    /// Slip angles, rad: `-atan(across / max(|along|, v_min))`, positive for a leftward force. The
    /// guard makes them defined at rest and in reverse.
    #[inline(always)]
    pub fn slip_angles(&self, x: &Motion, drive: &Drive) -> Wheels {
        let (along, across) = self.hub_velocities(x, drive);
        let speed = f64x4::new(along).abs().fast_max(f64x4::splat(self.minimum_speed));
        (-f64x4::new(across) / speed).atan().to_array()
    }

    /// Vertical wheel loads under an acceleration, N. Their sum is the weight and none is negative:
    /// a wheel that would pull at the ground has lifted off.
    #[inline(always)]
    pub fn loads(&self, accel_x: f64, accel_y: f64) -> Wheels {
        self.transfer().loads(accel_x, accel_y)
    }

    /// What the load transfer is made of; worked out once, for divisions are slow.
    #[inline(always)]
    fn transfer(&self) -> Transfer {
        let (weight, base) = (self.mass * GRAVITY, self.cg_to_front + self.cg_to_rear);
        let lever = self.mass * self.cg_height / base;
        Transfer {
            weight,
            front: weight * self.cg_to_rear / base,
            pitch: lever,
            roll_front: lever * self.cg_to_rear / self.track_front,
            roll_rear: lever * self.cg_to_front / self.track_rear,
        }
    }

    /// Forces and accelerations in a state. Loads depend on accelerations, these on tyre forces, and
    /// these on loads: four rounds of a fixed point, begun without lateral forces.
    #[inline]
    pub fn forces(&self, x: &Motion, drive: &Drive) -> Forces {
        let [forces] = self.forces_of(&[*x], drive);
        forces
    }

    /// The forces in several states. Each state is one long chain of dependent operations; side by
    /// side the chains keep the processor busy.
    #[inline]
    pub fn forces_of<const K: usize>(&self, x: &[Motion; K], drive: &Drive) -> [Forces; K] {
        let (s, c, fx) = (drive.steering_sin, drive.steering_cos, &drive.longitudinal);
        let (transfer, per_mass, longitudinal) = (self.transfer(), 1.0 / self.mass, f64x4::new(*fx));
        let front_fx = fx[0] + fx[1];
        let (forward, sideward) = (front_fx * c + fx[2] + fx[3], front_fx * s);
        let mut all: [Forces; K] = std::array::from_fn(|k| Forces {
            slip_angle: self.slip_angles(&x[k], drive),
            load: [0.0; 4],
            lateral: [0.0; 4],
            accel_x: forward * per_mass,
            accel_y: 0.0,
            yaw_acceleration: 0.0,
        });
        let slip = std::array::from_fn(|k| f64x4::new(all[k].slip_angle));
        for _ in 0..4 {
            for one in &mut all {
                one.load = transfer.loads(one.accel_x, one.accel_y);
            }
            let load = std::array::from_fn(|k| f64x4::new(all[k].load));
            let lateral = self.tires.lateral_forces::<K>(&slip, &load, longitudinal, self.combined);
            for (one, lateral) in all.iter_mut().zip(lateral) {
                one.lateral = lateral.to_array();
                let [left, right, rear_left, rear_right] = one.lateral;
                one.accel_x = (forward - (left + right) * s) * per_mass;
                one.accel_y = (sideward + (left + right) * c + rear_left + rear_right) * per_mass;
            }
        }
        for one in &mut all {
            let lateral = &one.lateral;
            let bx: Wheels = [fx[0] * c - lateral[0] * s, fx[1] * c - lateral[1] * s, fx[2], fx[3]];
            let by_front = front_fx * s + (lateral[0] + lateral[1]) * c;
            let moment = self.cg_to_front * by_front - self.cg_to_rear * (lateral[2] + lateral[3])
                + 0.5 * self.track_front * (bx[1] - bx[0])
                + 0.5 * self.track_rear * (bx[3] - bx[2]);
            one.yaw_acceleration = moment / self.yaw_inertia;
        }
        all
    }

    /// Slopes of the lateral forces over the slip angles at fixed loads, N/rad.
    pub fn cornering_slopes(&self, slip_angle: Wheels, load: Wheels, drive: &Drive) -> Wheels {
        const STEP: f64 = 1e-4;
        let (load, longitudinal) = (f64x4::new(load), f64x4::new(drive.longitudinal));
        let (slip, step) = (f64x4::new(slip_angle), f64x4::splat(STEP));
        let beside = [slip + step, slip - step];
        let [above, below] = self.tires.lateral_forces(&beside, &[load; 2], longitudinal, self.combined);
        ((above - below) / f64x4::splat(2.0 * STEP)).to_array()
    }

    /// Time derivative of the motion.
    #[inline]
    pub fn derivative(&self, x: &Motion, drive: &Drive) -> Motion {
        let [rate] = self.derivatives(&[*x], drive);
        rate
    }

    #[inline]
    fn derivatives<const K: usize>(&self, x: &[Motion; K], drive: &Drive) -> [Motion; K] {
        let forces = self.forces_of(x, drive);
        std::array::from_fn(|k| {
            let ([vx, vy, r], forces) = (x[k], &forces[k]);
            [forces.accel_x + r * vy, forces.accel_y - r * vx, forces.yaw_acceleration]
        })
    }

    /// The motion `dt` seconds later, in equal substeps.
    #[inline]
    pub fn advance(&self, x: &Motion, drive: &Drive, dt: f64, integrator: Integrator, substeps: u32) -> Motion {
        let [x] = self.advance_of([*x], drive, dt, integrator, substeps);
        x
    }

    /// As [`advance`](Self::advance) for several states side by side.
    #[inline]
    pub fn advance_of<const K: usize>(
        &self,
        mut x: [Motion; K],
        drive: &Drive,
        dt: f64,
        integrator: Integrator,
        substeps: u32,
    ) -> [Motion; K] {
        let h = dt / f64::from(substeps.max(1));
        for _ in 0..substeps.max(1) {
            let k1 = self.derivatives(&x, drive);
            x = match integrator {
                Integrator::Euler => ahead(&x, &k1, h),
                Integrator::Rk4 => {
                    let k2 = self.derivatives(&ahead(&x, &k1, 0.5 * h), drive);
                    let k3 = self.derivatives(&ahead(&x, &k2, 0.5 * h), drive);
                    let k4 = self.derivatives(&ahead(&x, &k3, h), drive);
                    let mean = |k: usize, i: usize| k1[k][i] + 2.0 * k2[k][i] + 2.0 * k3[k][i] + k4[k][i];
                    std::array::from_fn(|k| std::array::from_fn(|i| x[k][i] + h / 6.0 * mean(k, i)))
                }
            };
        }
        x
    }
}

/// Load transfer, loads per acceleration.
struct Transfer {
    weight: f64,
    front: f64,
    pitch: f64,
    roll_front: f64,
    roll_rear: f64,
}

impl Transfer {
    #[inline(always)]
    fn loads(&self, accel_x: f64, accel_y: f64) -> Wheels {
        let front = (self.front - self.pitch * accel_x).max(0.0).min(self.weight);
        let (half_front, half_rear) = (0.5 * front, 0.5 * (self.weight - front));
        let shift_front = (self.roll_front * accel_y).max(-half_front).min(half_front);
        let shift_rear = (self.roll_rear * accel_y).max(-half_rear).min(half_rear);
        [half_front - shift_front, half_front + shift_front, half_rear - shift_rear, half_rear + shift_rear]
    }
}

fn ahead<const K: usize>(x: &[Motion; K], slope: &[Motion; K], h: f64) -> [Motion; K] {
    std::array::from_fn(|k| std::array::from_fn(|i| x[k][i] + h * slope[k][i]))
}

/// What an inertial sensor `(dx, dy)` metres from the centre of gravity reads there, m/s²:
/// `ax - r² dx - r' dy` and `ay - r² dy + r' dx`.
#[inline]
pub fn specific_force_at(forces: &Forces, yaw_rate: f64, dx: f64, dy: f64) -> (f64, f64) {
    let (square, change) = (yaw_rate * yaw_rate, forces.yaw_acceleration);
    (forces.accel_x - square * dx - change * dy, forces.accel_y - square * dy + change * dx)
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
