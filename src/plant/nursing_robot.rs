//! Nursing robot with a seated person in full: driving, turning, pitch and roll sway, motors with lag
//! and limited torque, an optional speed loop. Fourth-order Runge-Kutta at 1 kHz.
//!
//! Derived by Kane's method with vectors of the robot's frame, not from the Lagrangian of the
//! estimator's model: each body's acceleration is written as a partial velocity times the unknown
//! accelerations plus a bias, and the equations are the projections of all inertia and active forces.
//! Frame: at the midpoint of the driven axle, x forward, y left, z up. Pitch is positive leaning
//! forward, roll is positive leaning right.

use nalgebra::{Matrix3x4, Matrix4, SVector, Vector3, Vector4};

const GRAVITY: f64 = super::ROUNDED_GRAVITY;

/// The robot's hardware.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    /// Mass without the person, kg.
    pub mass: f64,
    /// Distance between the drive wheels, m.
    pub track: f64,
    /// Wheel radius, m.
    pub wheel_radius: f64,
    /// Moment of inertia of one drive wheel, kg m2.
    pub wheel_inertia: f64,
    /// Further equivalent mass of rotating parts, half of it on each side, kg.
    pub rotating_mass: f64,
    /// Yaw moment of inertia, kg m2.
    pub yaw_inertia: f64,
    /// Share of the motor torque that arrives at the floor.
    pub efficiency: f64,
    /// Coefficient of rolling resistance.
    pub rolling: f64,
    /// Speed over which rolling resistance changes its sign, m/s.
    pub smoothing_speed: f64,
    /// Largest wheel torque of a motor, N m.
    pub torque_limit: f64,
    /// Time constant of a motor's torque, s; 0 for none.
    pub motor_lag: f64,
}

/// The seated person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Person {
    /// Mass, kg.
    pub mass: f64,
    /// Share of the mass that sways.
    pub swaying: f64,
    /// Hip to the centre of mass of the swaying part, m.
    pub height: f64,
    /// Radius of gyration of the swaying part, a slender rod, m.
    pub gyration: f64,
    /// Hip stiffness about the roll and the pitch axis, N m/rad.
    pub stiffness: [f64; 2],
    /// Hip damping about the roll and the pitch axis, N m s/rad.
    pub damping: [f64; 2],
    /// Relaxed roll and pitch, rad.
    pub rest: [f64; 2],
}

/// Where everything is and how fast it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position of the axle's midpoint, m, and heading, rad.
    pub pose: [f64; 3],
    /// Roll and pitch of the upper body, rad.
    pub sway: [f64; 2],
    /// Forward speed, m/s, and yaw rate, rad/s.
    pub drive: [f64; 2],
    /// Roll and pitch rate, rad/s.
    pub sway_rate: [f64; 2],
}

type Flat = SVector<f64, 9>;

impl Motion {
    fn flat(&self) -> Flat {
        let [x, y, heading] = self.pose;
        Flat::from([
            x,
            y,
            heading,
            self.sway[0],
            self.sway[1],
            self.drive[0],
            self.drive[1],
            self.sway_rate[0],
            self.sway_rate[1],
        ])
    }

    fn of(x: &Flat) -> Self {
        Self { pose: [x[0], x[1], x[2]], sway: [x[3], x[4]], drive: [x[5], x[6]], sway_rate: [x[7], x[8]] }
    }
}

/// Speeds to be kept by the robot's own controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedLoop {
    /// Force per speed error, N s/m.
    pub force_gain: f64,
    /// Moment per yaw rate error, N m s/rad.
    pub moment_gain: f64,
    /// Time constant of the integral parts, s.
    pub integral_time: f64,
}

impl Default for SpeedLoop {
    fn default() -> Self {
        Self { force_gain: 1500.0, moment_gain: 150.0, integral_time: 1.0 }
    }
}

/// What is asked of the motors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Wheel torques left and right, N m.
    Torque([f64; 2]),
    /// Forward speed, m/s, and yaw rate, rad/s, kept by the speed loop, plus a force, N, on top.
    Speed {
        /// Speed to be kept, m/s.
        speed: f64,
        /// Yaw rate to be kept, rad/s.
        yaw_rate: f64,
        /// Force added to that of the loop, N.
        force: f64,
    },
}

/// The plant with everything that changes.
#[derive(Clone, Debug, PartialEq)]
pub struct NursingRobotPlant {
    /// The robot.
    pub chassis: Chassis,
    /// The person; may be exchanged while running.
    pub person: Person,
    /// The speed controller.
    pub speed_loop: SpeedLoop,
    /// Where everything is.
    pub motion: Motion,
    /// Torque of the motors at the wheels left and right, N m.
    pub torque: [f64; 2],
    integral: [f64; 2],
}

/// Step of the integration, s.
pub const STEP: f64 = 1e-3;

impl NursingRobotPlant {
    /// At rest in the relaxed posture.
    pub fn new(chassis: Chassis, person: Person) -> Self {
        let motion = Motion { sway: person.rest, ..Motion::default() };
        Self { chassis, person, speed_loop: SpeedLoop::default(), motion, torque: [0.0; 2], integral: [0.0; 2] }
    }

    /// Goes on by one step of 1 ms. `active` are the person's own torques about the roll and the pitch
    /// axis of the hip, N m, positive towards positive angles.
    pub fn advance(&mut self, command: &Command, active: [f64; 2]) {
        let wanted = match *command {
            Command::Torque(torque) => torque,
            Command::Speed { speed, yaw_rate, force } => self.control(speed, yaw_rate, force),
        };
        let limit = self.chassis.torque_limit;
        let stay = if self.chassis.motor_lag > 0.0 { (-STEP / self.chassis.motor_lag).exp() } else { 0.0 };
        let before = self.torque;
        for (torque, wanted) in self.torque.iter_mut().zip(wanted) {
            let target = wanted.clamp(-limit, limit);
            *torque = target + stay * (*torque - target);
        }
        let middle = [0, 1].map(|side| 0.5 * (before[side] + self.torque[side]));
        let x = self.motion.flat();
        let slope = |x: &Flat, torque| self.slope(&Motion::of(x), torque, active);
        let k1 = slope(&x, before);
        let k2 = slope(&(x + k1 * (0.5 * STEP)), middle);
        let k3 = slope(&(x + k2 * (0.5 * STEP)), middle);
        let k4 = slope(&(x + k3 * STEP), self.torque);
        self.motion = Motion::of(&(x + (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (STEP / 6.0)));
    }

    /// Proportional-integral control; the integral rests while a motor is at its limit.
    fn control(&mut self, speed: f64, yaw_rate: f64, extra: f64) -> [f64; 2] {
        let c = &self.speed_loop;
        let error = [speed - self.motion.drive[0], yaw_rate - self.motion.drive[1]];
        let force = c.force_gain * (error[0] + self.integral[0] / c.integral_time) + extra;
        let moment = c.moment_gain * (error[1] + self.integral[1] / c.integral_time);
        let r = self.chassis.wheel_radius;
        let turn = moment / self.chassis.track;
        let torque = [r * (0.5 * force - turn), r * (0.5 * force + turn)];
        if torque.iter().all(|t| t.abs() < self.chassis.torque_limit) {
            (0..2).for_each(|i| self.integral[i] += error[i] * STEP);
        }
        torque
    }

    /// Rate of change of all coordinates and speeds under wheel torques and active hip torques.
    pub fn rates(&self, motion: &Motion, wheel_torque: [f64; 2], active: [f64; 2]) -> Motion {
        Motion::of(&self.slope(motion, wheel_torque, active))
    }

    fn slope(&self, motion: &Motion, torque: [f64; 2], active: [f64; 2]) -> Flat {
        let (sin, cos) = motion.pose[2].sin_cos();
        let [v, omega] = motion.drive;
        let [roll_rate, pitch_rate] = motion.sway_rate;
        let acceleration = self.accelerations(motion, torque, active);
        Flat::from([
            v * cos,
            v * sin,
            omega,
            roll_rate,
            pitch_rate,
            acceleration[0],
            acceleration[1],
            acceleration[2],
            acceleration[3],
        ])
    }

    /// `[v', omega', roll'', pitch'']`.
    fn accelerations(&self, motion: &Motion, [left, right]: [f64; 2], active: [f64; 2]) -> Vector4<f64> {
        let (c, p) = (&self.chassis, &self.person);
        let upper = p.swaying * p.mass;
        let lower = c.mass + p.mass - upper;
        let wheel = c.wheel_inertia / c.wheel_radius.powi(2) + 0.5 * c.rotating_mass;
        let [v, omega] = motion.drive;
        let rod = Rod::of(motion);

        // Upper body: centre of mass at `height` along the rod, then the rod's own inertia.
        let forward = Vector3::x();
        let mut partial = rod.partial * p.height;
        partial.column_mut(0).copy_from(&forward);
        let bias = rod.bias * p.height + Vector3::y() * (omega * v);
        let spin = upper * p.gyration.powi(2);
        let mut inertia: Matrix4<f64> =
            partial.transpose() * partial * upper + rod.partial.transpose() * rod.partial * spin;
        let inertial: Vector4<f64> = partial.transpose() * bias * upper + rod.partial.transpose() * rod.bias * spin;
        // Everything that does not sway, and the wheels, which turn with v and omega.
        inertia[(0, 0)] += lower + 2.0 * wheel;
        inertia[(1, 1)] += c.yaw_inertia + 0.5 * wheel * c.track.powi(2);

        // Active forces: weight of the upper body, hip, wheels, floor.
        let weight = Vector3::new(0.0, 0.0, -upper * GRAVITY);
        let mut force: Vector4<f64> = partial.transpose() * weight;
        for axis in 0..2 {
            force[2 + axis] += active[axis]
                - p.stiffness[axis] * (motion.sway[axis] - p.rest[axis])
                - p.damping[axis] * motion.sway_rate[axis];
        }
        let per_radius = c.efficiency / c.wheel_radius;
        force[0] += per_radius * (left + right) - self.rolling_resistance(v);
        force[1] += per_radius * (right - left) * 0.5 * c.track;

        // Positive definite for all states; a broken parameter set stops the motion instead of panicking.
        inertia.cholesky().map_or_else(Vector4::zeros, |factor| factor.solve(&(force - inertial)))
    }

    /// Rolling resistance at forward speed `v`, N.
    pub fn rolling_resistance(&self, v: f64) -> f64 {
        let c = &self.chassis;
        c.rolling * (c.mass + self.person.mass) * GRAVITY * (v / c.smoothing_speed).tanh()
    }

    /// What the sensors could see now: accelerations and forces of the present motion.
    pub fn forces(&self, active: [f64; 2]) -> Forces {
        let p = &self.person;
        let rates = self.accelerations(&self.motion, self.torque, active);
        let rod = Rod::of(&self.motion);
        // Force that the upper body's relative motion puts on the seat, along x.
        let mut relative = rates;
        relative[0] = 0.0;
        let along = (rod.partial * relative + rod.bias).x;
        Forces {
            acceleration: rates[0],
            yaw_acceleration: rates[1],
            sway_force: p.swaying * p.mass * p.height * along,
            hip_torque: [0, 1].map(|axis| {
                p.stiffness[axis] * (self.motion.sway[axis] - p.rest[axis])
                    + p.damping[axis] * self.motion.sway_rate[axis]
            }),
        }
    }

    /// Kinetic and potential energy, J, from the speeds of the bodies.
    pub fn energy(&self) -> f64 {
        let (c, p) = (&self.chassis, &self.person);
        let [v, omega] = self.motion.drive;
        let rod = Rod::of(&self.motion);
        let speeds = Vector4::new(0.0, omega, self.motion.sway_rate[0], self.motion.sway_rate[1]);
        let rod_speed = rod.partial * speeds;
        let upper = p.swaying * p.mass;
        let centre = Vector3::new(v, 0.0, 0.0) + rod_speed * p.height;
        let wheel = c.wheel_inertia / c.wheel_radius.powi(2) + 0.5 * c.rotating_mass;
        let sides = [v - 0.5 * omega * c.track, v + 0.5 * omega * c.track];
        let doubled = (c.mass + p.mass - upper) * v * v
            + c.yaw_inertia * omega * omega
            + wheel * (sides[0].powi(2) + sides[1].powi(2))
            + upper * centre.norm_squared()
            + upper * p.gyration.powi(2) * rod_speed.norm_squared()
            + (0..2).map(|i| p.stiffness[i] * (self.motion.sway[i] - p.rest[i]).powi(2)).sum::<f64>();
        0.5 * doubled + upper * GRAVITY * p.height * rod.direction.z
    }
}

/// Forces and accelerations of the present motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forces {
    /// Forward acceleration of the axle's midpoint, m/s2.
    pub acceleration: f64,
    /// Yaw acceleration, rad/s2.
    pub yaw_acceleration: f64,
    /// Force of the upper body's relative motion along x, positive slowing the robot, N.
    pub sway_force: f64,
    /// Passive torque of spring and damper about the roll and the pitch axis, N m.
    pub hip_torque: [f64; 2],
}

/// The upper body as a direction in the robot's frame, and how that direction moves.
struct Rod {
    direction: Vector3<f64>,
    /// Velocity of the direction = `partial * [v, omega, roll', pitch']`; the first column is zero.
    partial: Matrix3x4<f64>,
    /// Acceleration of the direction = `partial * accelerations + bias`.
    bias: Vector3<f64>,
}

impl Rod {
    fn of(motion: &Motion) -> Self {
        let (sin_roll, cos_roll) = motion.sway[0].sin_cos();
        let (sin_pitch, cos_pitch) = motion.sway[1].sin_cos();
        let [roll_rate, pitch_rate] = motion.sway_rate;
        let turn = Vector3::z();
        let direction = Vector3::new(sin_pitch * cos_roll, -sin_roll, cos_pitch * cos_roll);
        let by_roll = Vector3::new(-sin_pitch * sin_roll, -cos_roll, -cos_pitch * sin_roll);
        let by_pitch = Vector3::new(cos_pitch * cos_roll, 0.0, -sin_pitch * cos_roll);
        let by_both = Vector3::new(-cos_pitch * sin_roll, 0.0, sin_pitch * sin_roll);
        let by_pitch_twice = Vector3::new(-direction.x, 0.0, -direction.z);
        let relative = by_roll * roll_rate + by_pitch * pitch_rate;
        let relative_bias = by_both * (2.0 * roll_rate * pitch_rate) + by_pitch_twice * pitch_rate.powi(2)
            - direction * roll_rate.powi(2);
        let omega = motion.drive[1];
        let sideways = turn.cross(&direction);
        let bias = relative_bias + turn.cross(&relative) * (2.0 * omega) + turn.cross(&sideways) * omega.powi(2);
        let partial = Matrix3x4::from_columns(&[Vector3::zeros(), sideways, by_roll, by_pitch]);
        Self { direction, partial, bias }
    }
}
