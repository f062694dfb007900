//! A wheelchair on a plane that tilts: rigid body, two driven wheels that roll without slip, sensors.
//!
//! Everything is worked out in a world frame with vectors: the plane's axes, the body's axes, the
//! angular velocity, and the momentum of body and wheels with the contact forces as unknowns. The
//! accelerometer is a point of the rigid body with every term, also those of the tilt's second
//! derivative; the wheels turn relative to a frame that pitches.
//!
//! Command and reality differ as given by [`Actuation`]; biases, saturation and encoder steps by
//! [`Sensors`]. Noise comes from outside.

mod course;

pub use course::{Course, Ramp};

use nalgebra::{SMatrix, SVector, Vector3};
use std::f64::consts::TAU;

/// The chair with its user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Mass, kg.
    pub mass: f64,
    /// Yaw inertia about the centre of mass, kg m^2.
    pub yaw_inertia: f64,
    /// Centre of mass forward of the axle, m.
    pub com_ahead: f64,
    /// Viscous drag, N s/m.
    pub drag: f64,
    /// Viscous yaw drag, N m s/rad.
    pub yaw_drag: f64,
    /// Dry yaw friction, N m.
    pub yaw_friction: f64,
    /// Rolling resistance coefficient.
    pub rolling_coefficient: f64,
    /// Speed over which rolling resistance builds up, m/s.
    pub smoothing_speed: f64,
    /// Yaw rate over which dry yaw friction builds up, rad/s.
    pub smoothing_yaw_rate: f64,
    /// Wheel radius, m.
    pub wheel_radius: f64,
    /// Spin inertia of one wheel, kg m^2.
    pub wheel_inertia: f64,
    /// Distance between the wheels, m.
    pub track: f64,
    /// Accelerometer in the body frame from the axle's midpoint, m.
    pub imu: [f64; 3],
    /// Gravity, m/s^2.
    pub gravity: f64,
}

impl Default for Body {
    fn default() -> Self {
        Self {
            mass: 100.0,
            yaw_inertia: 7.0,
            com_ahead: 0.12,
            drag: 12.0,
            yaw_drag: 3.0,
            yaw_friction: 0.0,
            rolling_coefficient: 0.0,
            smoothing_speed: 0.05,
            smoothing_yaw_rate: 0.03,
            wheel_radius: 0.305,
            wheel_inertia: 0.0,
            track: 0.54,
            imu: [0.10, 0.01, 0.10],
            gravity: super::STANDARD_GRAVITY,
        }
    }
}

/// How force and moment that act follow from those that are reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuation {
    /// Gain of the force.
    pub force_gain: f64,
    /// Gain of the moment.
    pub moment_gain: f64,
    /// Unmodelled force, N.
    pub force_bias: f64,
    /// Unmodelled moment, N m.
    pub moment_bias: f64,
}

impl Default for Actuation {
    fn default() -> Self {
        Self { force_gain: 1.0, moment_gain: 1.0, force_bias: 0.0, moment_bias: 0.0 }
    }
}

/// Errors of the sensors that are not noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors {
    /// Bias of the gyro, rad/s.
    pub gyro_bias: f64,
    /// Bias of the accelerometer, m/s^2.
    pub accel_bias: [f64; 3],
    /// Steps per turn of an encoder; 0 = continuous.
    pub encoder_counts: f64,
    /// Whether the encoders turn relative to the frame (true) or to the ground.
    pub encoder_on_frame: bool,
}

impl Default for Sensors {
    fn default() -> Self {
        Self { gyro_bias: 0.0, accel_bias: [0.0; 3], encoder_counts: 0.0, encoder_on_frame: true }
    }
}

/// One reading of all sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Left wheel's angle, rad.
    pub encoder_left: f64,
    /// Right wheel's angle, rad.
    pub encoder_right: f64,
    /// Nose-up rate, rad/s.
    pub gyro_pitch: f64,
    /// Forward, leftward and upward specific force, m/s^2.
    pub accel: [f64; 3],
}

/// What noise adds to a reading, in the reading's units.
pub type Noise = Reading;

/// What is true.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Path of the axle's midpoint, m.
    pub distance: f64,
    /// Heading relative to the contour line, rad; across a second tilt within half a turn, and 0 on the flat.
    pub heading: f64,
    /// Forward speed, m/s.
    pub speed: f64,
    /// Yaw rate about the plane's normal, rad/s.
    pub yaw_rate: f64,
    /// Tilt of the plane, rad; not negative where it has a second tilt.
    pub slope: f64,
    /// Its rate, rad/s.
    pub slope_rate: f64,
    /// Nose-up pitch, rad.
    pub pitch: f64,
}

/// `[distance, heading, speed, yaw rate, right wheel, left wheel]`
type Motion = SVector<f64, 6>;

/// The plant.
#[derive(Clone, Debug)]
pub struct Plant {
    body: Body,
    ramp: Ramp,
    cross: Option<Ramp>,
    actuation: Actuation,
    sensors: Sensors,
    time: f64,
    motion: Motion,
    /// Brakes hold the chair where it is.
    pub braked: bool,
}

/// The world's view of the plane and the chair on it.
struct Pose {
    /// Body axes in the world.
    axes: [Vector3<f64>; 3],
    /// Angular velocity, and what of the angular acceleration does not come from the yaw acceleration.
    spin: Vector3<f64>,
    spin_change: Vector3<f64>,
    normal: Vector3<f64>,
}

impl Plant {
    /// A chair at rest at the start of a ramp.
    pub fn new(body: Body, ramp: Ramp, actuation: Actuation, sensors: Sensors, heading: f64) -> Self {
        let motion = Motion::from([0.0, heading, 0.0, 0.0, 0.0, 0.0]);
        Self { body, ramp, cross: None, actuation, sensors, time: 0.0, motion, braked: false }
    }

    /// The same on ground that tilts sideways as well: about the line that is uphill on the ramp, down on the right
    /// side of who climbs it if positive. The plane's slope and contour line then follow from both tilts.
    pub fn across(self, cross: Ramp) -> Self {
        Self { cross: Some(cross), ..self }
    }

    /// Sets speed and yaw rate.
    pub fn push(&mut self, speed: f64, yaw_rate: f64) {
        (self.motion[2], self.motion[3]) = (speed, yaw_rate);
    }

    /// Time since the start, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    fn pose(&self, time: f64, heading: f64, yaw_rate: f64) -> Pose {
        let [tilt, rate, change] = self.ramp.at(time);
        let [roll, roll_rate, roll_change] = self.cross.map_or([0.0; 3], |cross| cross.at(time));
        let contour = Vector3::x();
        let uphill = Vector3::new(0.0, tilt.cos(), tilt.sin());
        // Turned about `uphill` by `roll`, which lowers what lies along the contour.
        let sideways = contour * roll.cos() - contour.cross(&uphill) * roll.sin();
        let normal = sideways.cross(&uphill);
        let ahead = sideways * heading.cos() + uphill * heading.sin();
        let left = normal.cross(&ahead);
        let plane_spin = contour * rate + uphill * roll_rate;
        let spin = plane_spin + normal * yaw_rate;
        // The line of the second turn turns with the first, and the normal with both.
        let spin_change = contour * change
            + uphill * roll_change
            + (contour * rate).cross(&uphill) * roll_rate
            + plane_spin.cross(&normal) * yaw_rate;
        Pose { axes: [ahead, left, normal], spin, spin_change, normal }
    }

    /// Speed and yaw accelerations: momentum along the heading, across it and about the normal, and the
    /// spin of both wheels, with the wheels' drive forces and the axle's side force as unknowns.
    fn accelerations(&self, time: f64, motion: &Motion, command: [f64; 2]) -> (f64, f64) {
        if self.braked {
            return (0.0, 0.0);
        }
        let b = &self.body;
        let (v, r) = (motion[2], motion[3]);
        let pose = self.pose(time, motion[1], r);
        let weight = Vector3::new(0.0, 0.0, -b.mass * b.gravity);
        let force = self.actuation.force_gain * command[0] + self.actuation.force_bias;
        let moment = self.actuation.moment_gain * command[1] + self.actuation.moment_bias;
        let half = 0.5 * b.track;
        let torque = |side: f64| b.wheel_radius * (0.5 * force + side * 0.5 * moment / half);
        let load = -weight.dot(&pose.axes[2]);
        let rolling = b.rolling_coefficient * load * (v / b.smoothing_speed).tanh();
        let friction = b.yaw_friction * (r / b.smoothing_yaw_rate).tanh();

        // Unknowns: v', r', side force on the axle, drive force right, drive force left.
        let mut balance = SMatrix::<f64, 5, 5>::zeros();
        let mut right = SVector::<f64, 5>::zeros();
        // Forward: M (v' - l r^2)
        balance[(0, 0)] = b.mass;
        (balance[(0, 3)], balance[(0, 4)]) = (-1.0, -1.0);
        right[0] = b.mass * b.com_ahead * r * r - b.drag * v - rolling + weight.dot(&pose.axes[0]);
        // Across: M (v r + l r')
        balance[(1, 1)] = b.mass * b.com_ahead;
        balance[(1, 2)] = -1.0;
        right[1] = weight.dot(&pose.axes[1]) - b.mass * v * r;
        // About the normal through the centre of mass.
        balance[(2, 1)] = b.yaw_inertia;
        balance[(2, 2)] = b.com_ahead;
        (balance[(2, 3)], balance[(2, 4)]) = (-half, half);
        right[2] = -b.yaw_drag * r - friction;
        // Wheels: J theta'' = torque - R F
        for (row, side) in [(3, 1.0), (4, -1.0)] {
            balance[(row, 0)] = b.wheel_inertia / b.wheel_radius;
            balance[(row, 1)] = b.wheel_inertia / b.wheel_radius * side * half;
            balance[(row, row)] = b.wheel_radius;
            right[row] = torque(side);
        }
        balance.lu().solve(&right).map_or((0.0, 0.0), |solution| (solution[0], solution[1]))
    }

    fn rate(&self, time: f64, motion: &Motion, command: [f64; 2]) -> Motion {
        let (v, r) = if self.braked { (0.0, 0.0) } else { (motion[2], motion[3]) };
        let (v_dot, r_dot) = self.accelerations(time, motion, command);
        let pose = self.pose(time, motion[1], r);
        let frame = if self.sensors.encoder_on_frame { -pose.spin.dot(&pose.axes[1]) } else { 0.0 };
        let wheel = |side: f64| (v + side * 0.5 * self.body.track * r) / self.body.wheel_radius + frame;
        Motion::from([v, r, v_dot, r_dot, wheel(1.0), wheel(-1.0)])
    }

    /// Moves on by `dt` with the command held, in steps of at most a millisecond.
    pub fn advance(&mut self, command: [f64; 2], dt: f64) {
        if self.braked {
            self.push(0.0, 0.0);
        }
        let steps = (dt / 1e-3).ceil().max(1.0) as usize;
        let h = dt / steps as f64;
        for _ in 0..steps {
            let (t, x) = (self.time, self.motion);
            let k1 = self.rate(t, &x, command);
            let k2 = self.rate(t + 0.5 * h, &(x + 0.5 * h * k1), command);
            let k3 = self.rate(t + 0.5 * h, &(x + 0.5 * h * k2), command);
            let k4 = self.rate(t + h, &(x + h * k3), command);
            self.motion += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
            self.time += h;
        }
    }

    /// What is true now.
    pub fn truth(&self) -> Truth {
        let [tilt, rate, _] = self.ramp.at(self.time);
        let pose = self.pose(self.time, self.motion[1], self.motion[3]);
        let [ahead, _, normal] = pose.axes;
        let (mut heading, mut slope, mut slope_rate) = (self.motion[1], tilt, rate);
        if self.cross.is_some() {
            let (sine, cosine) = (normal.x.hypot(normal.y), normal.z);
            slope = sine.atan2(cosine);
            let normal_rate = pose.spin.cross(&normal);
            slope_rate = if sine > 0.0 { -normal_rate.z / sine } else { 0.0 };
            // Uphill is against the horizontal part of the normal; the contour line lies to its right.
            let uphill = Vector3::z() - normal * cosine;
            heading = if sine > 0.0 { ahead.dot(&uphill).atan2(ahead.dot(&uphill.cross(&normal))) } else { 0.0 };
        }
        Truth {
            distance: self.motion[0],
            heading,
            speed: self.motion[2],
            yaw_rate: self.motion[3],
            slope,
            slope_rate,
            pitch: ahead.z.asin(),
        }
    }

    /// What the sensors read now, while the command acts.
    pub fn measure(&self, command: [f64; 2], noise: &Noise) -> Reading {
        let (v, r) = (self.motion[2], self.motion[3]);
        let (v_dot, r_dot) = self.accelerations(self.time, &self.motion, command);
        let pose = self.pose(self.time, self.motion[1], r);
        let [ahead, left, up] = pose.axes;
        let spin_rate = pose.spin_change + pose.normal * r_dot;
        let [x, y, z] = self.body.imu;
        let lever = ahead * x + left * y + up * z;
        let midpoint = ahead * v_dot + pose.spin.cross(&ahead) * v;
        let gravity = Vector3::new(0.0, 0.0, -self.body.gravity);
        let felt = midpoint + spin_rate.cross(&lever) + pose.spin.cross(&pose.spin.cross(&lever)) - gravity;
        let accel =
            std::array::from_fn(|axis| felt.dot(&pose.axes[axis]) + self.sensors.accel_bias[axis] + noise.accel[axis]);
        Reading {
            encoder_left: self.counted(self.motion[5] + noise.encoder_left),
            encoder_right: self.counted(self.motion[4] + noise.encoder_right),
            gyro_pitch: -pose.spin.dot(&left) + self.sensors.gyro_bias + noise.gyro_pitch,
            accel,
        }
    }

    fn counted(&self, angle: f64) -> f64 {
        let counts = self.sensors.encoder_counts;
        if counts > 0.0 { (angle * counts / TAU).round() * TAU / counts } else { angle }
    }
}
