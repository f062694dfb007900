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
        let (weight, base) = (self.mass * GRAVITY, self.cg_to_front + self.cg_to_rear);
        let front = ((weight * self.cg_to_rear - self.mass * accel_x * self.cg_height) / base).max(0.0).min(weight);
        let rear = weight - front;
        let lever = self.mass * accel_y * self.cg_height / base;
        let shift_front = (lever * self.cg_to_rear / self.track_front).max(-0.5 * front).min(0.5 * front);
        let shift_rear = (lever * self.cg_to_front / self.track_rear).max(-0.5 * rear).min(0.5 * rear);
        [0.5 * front - shift_front, 0.5 * front + shift_front, 0.5 * rear - shift_rear, 0.5 * rear + shift_rear]
    }

    /// Forces and accelerations in a state. Loads depend on accelerations, these on tyre forces, and
    /// these on loads: four rounds of a fixed point, begun without lateral forces.
    #[inline]
    pub fn forces(&self, x: &Motion, drive: &Drive) -> Forces {
        let slip_angle = self.slip_angles(x, drive);
        let (s, c, fx) = (drive.steering_sin, drive.steering_cos, &drive.longitudinal);
        let (slip, longitudinal) = (f64x4::new(slip_angle), f64x4::new(*fx));
        let front_fx = fx[0] + fx[1];
        let mut accel_x = (front_fx * c + fx[2] + fx[3]) / self.mass;
        let mut accel_y = 0.0;
        let (mut load, mut lateral) = ([0.0; 4], [0.0; 4]);
        for _ in 0..4 {
            load = self.loads(accel_x, accel_y);
            lateral = self.tires.lateral_forces(slip, f64x4::new(load), longitudinal, self.combined).to_array();
            let front_fy = lateral[0] + lateral[1];
            accel_x = (front_fx * c - front_fy * s + fx[2] + fx[3]) / self.mass;
            accel_y = (front_fx * s + front_fy * c + lateral[2] + lateral[3]) / self.mass;
        }
        let bx: Wheels = [fx[0] * c - lateral[0] * s, fx[1] * c - lateral[1] * s, fx[2], fx[3]];
        let by_front = front_fx * s + (lateral[0] + lateral[1]) * c;
        let moment = self.cg_to_front * by_front - self.cg_to_rear * (lateral[2] + lateral[3])
            + 0.5 * self.track_front * (bx[1] - bx[0])
            + 0.5 * self.track_rear * (bx[3] - bx[2]);
        Forces { slip_angle, load, lateral, accel_x, accel_y, yaw_acceleration: moment / self.yaw_inertia }
    }

    /// Slopes of the lateral forces over the slip angles at fixed loads, N/rad.
    pub fn cornering_slopes(&self, slip_angle: Wheels, load: Wheels, drive: &Drive) -> Wheels {
        const STEP: f64 = 1e-4;
        let (load, longitudinal) = (f64x4::new(load), f64x4::new(drive.longitudinal));
        let at = |slip: f64x4| self.tires.lateral_forces(slip, load, longitudinal, self.combined);
        let (slip, step) = (f64x4::new(slip_angle), f64x4::splat(STEP));
        ((at(slip + step) - at(slip - step)) / f64x4::splat(2.0 * STEP)).to_array()
    }

    /// Time derivative of the motion.
    #[inline]
    pub fn derivative(&self, x: &Motion, drive: &Drive) -> Motion {
        let forces = self.forces(x, drive);
        let [vx, vy, r] = *x;
        [forces.accel_x + r * vy, forces.accel_y - r * vx, forces.yaw_acceleration]
    }

    /// The motion `dt` seconds later, in equal substeps.
    #[inline]
    pub fn advance(&self, x: &Motion, drive: &Drive, dt: f64, integrator: Integrator, substeps: u32) -> Motion {
        let h = dt / f64::from(substeps.max(1));
        let mut x = *x;
        for _ in 0..substeps.max(1) {
            let k1 = self.derivative(&x, drive);
            x = match integrator {
                Integrator::Euler => ahead(&x, &k1, h),
                Integrator::Rk4 => {
                    let k2 = self.derivative(&ahead(&x, &k1, 0.5 * h), drive);
                    let k3 = self.derivative(&ahead(&x, &k2, 0.5 * h), drive);
                    let k4 = self.derivative(&ahead(&x, &k3, h), drive);
                    std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
                }
            };
        }
        x
    }
}

fn ahead(x: &Motion, slope: &Motion, h: f64) -> Motion {
    std::array::from_fn(|i| x[i] + h * slope[i])
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
