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

//!
//! [`WheeledRobot::forces`] and [`WheeledRobot::derivative`] are the definition; [`Driven`] computes many states side
//! by side and is held to it by its tests.

mod wide;

pub use wide::Driven;

use super::tire::{TireSet, Tires};

/// Gravity, m/s².
pub const GRAVITY: f64 = super::ROUNDED_GRAVITY;

/// One number per wheel, in the order front left, front right, rear left, rear right.
pub type Wheels = [f64; 4];

/// Longitudinal speed, lateral speed (m/s) and yaw rate (rad/s): `x = (vx, vy, r)`.
pub type Motion = [f64; 3];

variables! {
    /// Masses and lengths.
    pub struct Vehicle {
        /// Mass (m).
        mass: f64 = 60.0, "kg", [0.1, 1e6], essential;
        /// Yaw inertia about the centre of gravity (Iz).
        yaw_inertia: f64 = 7.5, "kg.m2", [1e-4, 1e8], essential;
        /// Error of the mass over the mass, as by a load (one standard deviation), which counts in the deviations of the wheel loads.
        mass_std: f64 = 0.05, "1", [0.0, 10.0], tunable;
        /// Error of the yaw inertia over the yaw inertia (one standard deviation), which counts in the estimates' deviations.
        yaw_inertia_std: f64 = 0.2, "1", [0.0, 10.0], tunable;
        /// Distance of the centre of gravity from the front axle (lf).
        cg_to_front: f64 = 0.38, "m", [0.001, 50.0], essential;
        /// Distance of the centre of gravity from the rear axle (lr).
        cg_to_rear: f64 = 0.42, "m", [0.001, 50.0], essential;
        /// Error of the place of the centre of gravity between the axles over the wheelbase (one standard deviation), which counts in the estimates' deviations.
        cg_std: f64 = 0.05, "1", [0.0, 1.0], tunable;
        /// Distance of the front wheels from each other (tf).
        track_front: f64 = 0.60, "m", [0.001, 20.0], essential;
        /// Distance of the rear wheels from each other (tr).
        track_rear: f64 = 0.62, "m", [0.001, 20.0], essential;
        /// Height of the centre of gravity above the ground (h).
        cg_height: f64 = 0.25, "m", [0.0, 20.0], essential;
    }
}

variables! {
    /// Wheels, all four alike.
    pub struct Wheel {
        /// Rolling radius (R).
        radius: f64 = 0.15, "m", [0.001, 10.0], essential;
        /// Error of the rolling radius over the radius (one standard deviation), which counts in speed_x_std where the speed comes from the wheels: tyres roll on 0.95 to 1 of the radius that they are sold with, and wear. 0.005 if it was calibrated over a known distance.
        radius_std: f64 = 0.04, "1", [0.0, 1.0], tunable;
        /// Moment of inertia of one wheel with all that turns with it, a motor's rotor reflected through its gear included (J).
        inertia: f64 = 0.06, "kg.m2", [1e-8, 1e5];
        /// Longitudinal force per slip and per load, which corrects the speed taken from slipping wheels; 0 if it is not known: the wheels are taken to roll without slip, and that of a slip stiffness of 15 counts as an error in speed_x_std. Typically 15 to 30.
        slip_stiffness: f64 = 0.0, "1", [0.0, 1000.0];
        /// Error of the slip stiffness over the slip stiffness (one standard deviation), which counts in speed_x_std likewise.
        slip_stiffness_std: f64 = 0.3, "1", [0.0, 10.0], tunable;
    }
}

variables! {
    /// Rolling resistance.
    pub struct Rolling {
        /// Rolling resistance over load, taken off the wheels' torque (f_r).
        coefficient: f64 = 0.0, "1", [0.0, 1.0];
        /// Error of the coefficient (one standard deviation), for wheel_force_x_*_std. Tyres have 0.01 to 0.02 on roads, castors and soft ground more.
        coefficient_std: f64 = 0.01, "1", [0.0, 1.0], tunable;
    }
}

impl Vehicle {
    /// Wheelbase `L = lf + lr`, m.
    pub fn wheelbase(&self) -> f64 {
        self.cg_to_front + self.cg_to_rear
    }

    /// By how much, rad, each front wheel's angle differs from this one, the mean of both, where they steer about one centre
    /// (Ackermann): `steering² tf/(2 L)`. The model has parallel front wheels.
    pub fn ackermann(&self, steering: f64) -> f64 {
        0.5 * steering * steering * self.track_front / self.wheelbase()
    }

    /// How the loads follow the accelerations while all wheels touch the ground, N per m/s²: what `ax` takes off
    /// each front wheel, and what `ay` takes off the front left and off the rear left wheel,
    /// `m h/(2 L)`, `m h lr/(L tf)`, `m h lf/(L tr)`.
    pub fn load_transfer(&self) -> [f64; 3] {
        let lever = self.mass * self.cg_height / self.wheelbase();
        [0.5 * lever, lever * self.cg_to_rear / self.track_front, lever * self.cg_to_front / self.track_rear]
    }
}

/// The equation of motion of a wheel, `J w' = T - R Fx` (CN117406607B, claim 1, step 2).
impl Wheel {
    /// `w'` under a torque (N m) and the ground's longitudinal force (N), rad/s².
    pub fn acceleration(&self, torque: f64, force: f64) -> f64 {
        (torque - self.radius * force) / self.inertia
    }

    /// The force of a torque on a wheel that turns steadily, `T/R`, N.
    pub fn steady_force(&self, torque: f64) -> f64 {
        torque / self.radius
    }

    /// The force that accelerates the wheel itself, `J/R`, N per rad/s².
    pub fn inertia_force(&self) -> f64 {
        self.inertia / self.radius
    }
}

/// A vehicle with its tyres.
#[derive(Clone, Debug, PartialEq)]
pub struct WheeledRobot {
    /// Masses and lengths.
    pub vehicle: Vehicle,
    /// Front and rear tyres.
    pub tire: TireSet,
    /// Speed below which slip angles are taken as if at this speed `v_min`, m/s.
    pub minimum_speed: f64,
    /// The tyres side by side, derived from `tire`.
    tires: Tires,
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

    /// Cosine of the steering angle.
    pub fn steering_cos(&self) -> f64 {
        self.steering_cos
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

impl WheeledRobot {
    /// A vehicle on tyres, whose slip angles below `minimum_speed` (m/s) are taken as if at this speed.
    pub fn new(vehicle: &Vehicle, tire: &TireSet, minimum_speed: f64) -> Self {
        let tires = Tires::new(&tire.front, &tire.rear);
        Self { vehicle: vehicle.clone(), tire: tire.clone(), minimum_speed, tires }
    }

    /// Vertical wheel loads under an acceleration at the centre of gravity, N. Their sum is the weight and none is
    /// negative: a wheel that would pull at the ground has lifted off.
    ///
    /// ```text
    /// front = clip(m g lr/L - m ax h/L, 0, m g),     rear = m g - front
    /// Fz = front/2 -+ clip(m ay h lr/(L tf), -front/2, front/2),   rear likewise with lf and tr
    /// ```
    pub fn loads(&self, accel_x: f64, accel_y: f64) -> Wheels {
        let v = &self.vehicle;
        let weight = v.mass * GRAVITY;
        let [pitch, roll_front, roll_rear] = v.load_transfer();
        let front = (0.5 * (weight * v.cg_to_rear / v.wheelbase()) - pitch * accel_x).max(0.0).min(0.5 * weight);
        let rear = 0.5 * weight - front;
        let front_shift = (roll_front * accel_y).max(-front).min(front);
        let rear_shift = (roll_rear * accel_y).max(-rear).min(rear);
        [front - front_shift, front + front_shift, rear - rear_shift, rear + rear_shift]
    }

    /// Velocity of the wheels' hubs along and across the wheels, m/s.
    pub fn hub_velocities(&self, &[vx, vy, r]: &Motion, drive: &Drive) -> (Wheels, Wheels) {
        let (v, s, c) = (&self.vehicle, drive.steering_sin, drive.steering_cos);
        let (front, rear) = (vy + v.cg_to_front * r, vy - v.cg_to_rear * r);
        let [fl, fr] = [-0.5, 0.5].map(|side| vx + side * v.track_front * r);
        let [rl, rr] = [-0.5, 0.5].map(|side| vx + side * v.track_rear * r);
        ([fl * c + front * s, fr * c + front * s, rl, rr], [front * c - fl * s, front * c - fr * s, rear, rear])
    }

    /// Slip angles, rad: `-atan(across / max(|along|, v_min))`, positive for a leftward force. The
    /// guard makes them defined at rest and in reverse.
    pub fn slip_angles(&self, x: &Motion, drive: &Drive) -> Wheels {
        let (along, across) = self.hub_velocities(x, drive);
        std::array::from_fn(|i| -(across[i] / along[i].abs().max(self.minimum_speed)).atan())
    }

    /// The specific forces `ax`, `ay` at the centre of gravity, m/s², and the yaw acceleration `Mz/Iz`, rad/s²,
    /// under lateral wheel forces, N.
    pub fn accelerations(&self, lateral: &Wheels, drive: &Drive) -> [f64; 3] {
        let (v, s, c) = (&self.vehicle, drive.steering_sin, drive.steering_cos);
        let ([f0, f1, f2, f3], [l0, l1, l2, l3]) = (drive.longitudinal, *lateral);
        let bx = [f0 * c - l0 * s, f1 * c - l1 * s, f2, f3];
        let by = [f0 * s + l0 * c, f1 * s + l1 * c, l2, l3];
        let moment = v.cg_to_front * (by[0] + by[1]) - v.cg_to_rear * (by[2] + by[3])
            + 0.5 * v.track_front * (bx[1] - bx[0])
            + 0.5 * v.track_rear * (bx[3] - bx[2]);
        [bx.iter().sum::<f64>() / v.mass, by.iter().sum::<f64>() / v.mass, moment / v.yaw_inertia]
    }

    /// Forces and accelerations in a state. Loads depend on accelerations, these on tyre forces, and these on
    /// loads: four rounds of a fixed point, begun with the acceleration by the longitudinal forces alone.
    pub fn forces(&self, x: &Motion, drive: &Drive) -> Forces {
        let slip_angle = self.slip_angles(x, drive);
        let [mut accel_x, _, mut yaw_acceleration] = self.accelerations(&[0.0; 4], drive);
        let (mut accel_y, mut load, mut lateral) = (0.0, [0.0; 4], [0.0; 4]);
        for _ in 0..ROUNDS {
            load = self.loads(accel_x, accel_y);
            lateral = std::array::from_fn(|i| {
                let tire = if i < 2 { &self.tire.front } else { &self.tire.rear };
                let share = if self.tire.combined { tire.lateral_share(drive.longitudinal[i], load[i]) } else { 1.0 };
                share * tire.lateral_force(slip_angle[i], load[i])
            });
            [accel_x, accel_y, yaw_acceleration] = self.accelerations(&lateral, drive);
        }
        Forces { slip_angle, load, lateral, accel_x, accel_y, yaw_acceleration }
    }

    /// Time derivative of the motion.
    pub fn derivative(&self, x: &Motion, drive: &Drive) -> Motion {
        let ([vx, vy, r], [ax, ay, turn]) = (*x, self.forces(x, drive).accelerations());
        [ax + r * vy, ay - r * vx, turn]
    }

    /// How the slip angles follow the motion `(vx, vy, r)`, rad per unit; in first order of slip and steering angles.
    pub fn slip_derivatives(&self, x: &Motion, drive: &Drive) -> [[f64; 3]; 4] {
        let (along, across) = self.hub_velocities(x, drive);
        let v = &self.vehicle;
        let arms = [v.cg_to_front, v.cg_to_front, -v.cg_to_rear, -v.cg_to_rear];
        std::array::from_fn(|i| {
            let speed = along[i].abs().max(self.minimum_speed);
            let turn = if along[i].abs() > self.minimum_speed { -across[i] / (speed * along[i]) } else { 0.0 };
            [turn, 1.0 / speed, arms[i] / speed].map(|derivative| -derivative)
        })
    }

    /// Derivatives of the lateral wheel forces by the slip angles at fixed loads, N/rad.
    pub fn cornering_stiffness(&self, slip_angle: Wheels, load: Wheels, drive: &Drive) -> Wheels {
        self.tires.cornering_stiffness(slip_angle, load, drive.longitudinal, self.tire.combined)
    }

    /// The fastest rate of the lateral dynamics straight ahead at a speed, 1/s: the larger of `sum(K)/(m v)` and
    /// `(lf² Kf + lr² Kr)/(Iz v)`, `Kf` and `Kr` being the cornering stiffness of both wheels of an axle.
    pub fn lateral_rate(&self, speed: f64) -> f64 {
        let (v, [front, _, rear, _]) = (&self.vehicle, self.loads(0.0, 0.0));
        let front = 2.0 * self.tire.front.cornering_stiffness(0.0, front);
        let rear = 2.0 * self.tire.rear.cornering_stiffness(0.0, rear);
        let sway = (front + rear) / (v.mass * speed);
        let yaw =
            (v.cg_to_front * v.cg_to_front * front + v.cg_to_rear * v.cg_to_rear * rear) / (v.yaw_inertia * speed);
        sway.max(yaw)
    }

    /// The vehicle under a drive, for many states at once.
    #[inline]
    pub fn driven(&self, drive: &Drive) -> Driven<'_> {
        Driven::new(self, drive)
    }
}

/// Rounds of the fixed point between loads and tyre forces.
const ROUNDS: usize = 4;

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
