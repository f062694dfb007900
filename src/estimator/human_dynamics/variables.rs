//! Inputs and outputs of the seated body. The lists are long and regular, so their declarations
//! are written by loops over joints, sensors and axes.

use crate::Status;
use crate::variable::{Kind, Value, Variable, Variables};

/// Degrees of freedom of the seated body.
pub const DOF: usize = 19;

/// The joints: name outside, name in the model, what moves about which axis.
pub const JOINTS: [(&str, &str, &str); DOF] = [
    ("lumbar_x", "jLumbar_rotx", "lumbar spine against the pelvis about x (leaning to the right is positive)"),
    ("lumbar_y", "jLumbar_roty", "lumbar spine against the pelvis about y (leaning forward is positive)"),
    ("thorax_y", "jThorax_roty", "thorax against the lumbar spine about y (leaning forward is positive)"),
    ("thorax_z", "jThorax_rotz", "thorax against the lumbar spine about z (turning left is positive)"),
    ("neck_x", "jNeck_rotx", "head against the thorax about x (tilting to the right is positive)"),
    ("neck_y", "jNeck_roty", "head against the thorax about y (nodding forward is positive)"),
    ("neck_z", "jNeck_rotz", "head against the thorax about z (turning left is positive)"),
    (
        "right_shoulder_x",
        "jRightShoulder_rotx",
        "right upper arm against the thorax about x (the hand swings to the left)",
    ),
    (
        "right_shoulder_y",
        "jRightShoulder_roty",
        "right upper arm against the thorax about y (the hand swings backward)",
    ),
    ("right_shoulder_z", "jRightShoulder_rotz", "right upper arm against the thorax about z"),
    ("right_elbow_y", "jRightElbow_roty", "right forearm against the upper arm about y (bending is negative)"),
    (
        "left_shoulder_x",
        "jLeftShoulder_rotx",
        "left upper arm against the thorax about x (the hand swings to the left)",
    ),
    ("left_shoulder_y", "jLeftShoulder_roty", "left upper arm against the thorax about y (the hand swings backward)"),
    ("left_shoulder_z", "jLeftShoulder_rotz", "left upper arm against the thorax about z"),
    ("left_elbow_y", "jLeftElbow_roty", "left forearm against the upper arm about y (bending is negative)"),
    ("right_hip_y", "jRightHip_roty", "right thigh against the pelvis about y (raising the knee is negative)"),
    ("right_knee_y", "jRightKnee_roty", "right shank against the thigh about y (stretching is negative)"),
    ("left_hip_y", "jLeftHip_roty", "left thigh against the pelvis about y (raising the knee is negative)"),
    ("left_knee_y", "jLeftKnee_roty", "left shank against the thigh about y (stretching is negative)"),
];

/// The accelerometers on the body: name outside, link.
pub const IMUS: [(&str, &str); 4] =
    [("thorax", "Thorax"), ("head", "Head"), ("right_forearm", "RightForeArm"), ("left_forearm", "LeftForeArm")];

/// The contacts of the body with its surroundings: name outside, link.
pub const CONTACTS: [(&str, &str); 4] = [
    ("right_hand", "RightForeArm"),
    ("left_hand", "LeftForeArm"),
    ("right_foot", "RightShank"),
    ("left_foot", "LeftShank"),
];

/// The groups of sensors, as the `use.*` parameters name them.
pub const GROUPS: [&str; 6] =
    ["joint_acceleration", "base_acceleration", "seat_wrench", "imu", "hand_wrench", "foot_wrench"];

const AXES: [&str; 3] = ["x", "y", "z"];

/// What is measured; frames as in the [module](super)'s page.
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    /// Joint positions, rad.
    pub q: [f64; DOF],
    /// Joint velocities, rad/s.
    pub qd: [f64; DOF],
    /// Joint accelerations, rad/s2.
    pub qdd: [f64; DOF],
    /// Angular velocity of the pelvis, pelvis axes, rad/s.
    pub base_gyro: [f64; 3],
    /// Specific force at the pelvis origin, pelvis axes, m/s2.
    pub base_accel: [f64; 3],
    /// Angular acceleration of the pelvis, pelvis axes, rad/s2.
    pub base_angular_accel: [f64; 3],
    /// Force and moment of the seat on the person at `mount.seat`, N and N.m.
    pub seat: [f64; 6],
    /// Specific forces of the [`IMUS`], m/s2.
    pub imu: [[f64; 3]; 4],
    /// Forces and moments at the [`CONTACTS`], N and N.m.
    pub contact: [[f64; 6]; 4],
}

impl Default for Inputs {
    fn default() -> Self {
        Self {
            q: [0.0; DOF],
            qd: [0.0; DOF],
            qdd: [0.0; DOF],
            base_gyro: ZERO,
            base_accel: UP,
            base_angular_accel: ZERO,
            seat: [0.0; 6],
            imu: [UP; 4],
            contact: [[0.0; 6]; 4],
        }
    }
}

/// Collects declarations with one prefix.
struct List<'a> {
    prefix: &'a str,
    list: &'a mut Vec<Variable>,
    measured: bool,
}

impl List<'_> {
    fn push(&mut self, name: &str, about: &str, unit: &'static str, start: f64, range: (f64, f64)) {
        let name = format!("{}{name}", self.prefix);
        let measured = self.measured;
        self.list.push(Variable { start, measured, ..Variable::new(name, about, unit, Kind::Real, range) });
    }

    fn push_of_kind<V: Value>(&mut self, name: &str, about: &str, start: V) {
        self.push(name, about, "1", start.to_number(), V::RANGE);
        if let Some(last) = self.list.last_mut() {
            last.kind = V::KIND;
        }
    }

    /// Three axes of one vector.
    fn vector(&mut self, stem: &str, about: &str, unit: &'static str, start: [f64; 3], range: (f64, f64)) {
        for (axis, start) in AXES.iter().zip(start) {
            self.push(&format!("{stem}_{axis}"), &about.replace("{}", axis), unit, start, range);
        }
    }

    /// A measured force and moment.
    fn wrench(&mut self, stem: &str, about: &str) {
        let force = format!("Force {about} along the {{}} axis. NaN = no sample.");
        self.vector(&format!("{stem}_force"), &force, "N", ZERO, (-1e6, 1e6));
        let moment = format!("Moment {about} about the {{}} axis. NaN = no sample.");
        self.vector(&format!("{stem}_moment"), &moment, "N.m", ZERO, (-1e6, 1e6));
    }
}

const UP: [f64; 3] = [0.0, 0.0, 9.80665];
const ZERO: [f64; 3] = [0.0; 3];

impl Variables for Inputs {
    const COUNT: usize = 3 * DOF + 9 + 6 + 12 + 24;

    fn declare_into(prefix: &str, list: &mut Vec<Variable>) {
        let mut list = List { prefix, list, measured: true };
        let skip = "NaN = the whole sample is skipped.";
        let missing = "NaN = no sample.";
        for (name, _, about) in JOINTS {
            let about = format!("Position of the {about}. {skip}");
            list.push(&format!("q_{name}"), &about, "rad", 0.0, (-100.0, 100.0));
        }
        for (name, _, about) in JOINTS {
            let about = format!("Velocity of the {about}. Ignored with differentiate. {skip}");
            list.push(&format!("qd_{name}"), &about, "rad/s", 0.0, (-1e4, 1e4));
        }
        for (name, _, about) in JOINTS {
            let about = format!("Acceleration of the {about}. Ignored with differentiate. {missing}");
            list.push(&format!("qdd_{name}"), &about, "rad/s2", 0.0, (-1e6, 1e6));
        }
        let about = format!("Angular velocity of the pelvis about its {{}} axis. {skip}");
        list.vector("base_gyro", &about, "rad/s", ZERO, (-1e4, 1e4));
        let about =
            format!("Specific force at the pelvis origin along the pelvis's {{}} axis; +g along z at rest. {missing}");
        list.vector("base_accel", &about, "m/s2", UP, (-1e5, 1e5));
        let about = format!("Angular acceleration of the pelvis about its {{}} axis. {missing}");
        list.vector("base_angular_accel", &about, "rad/s2", ZERO, (-1e6, 1e6));
        list.wrench("seat", "of the seat on the person at mount.seat in pelvis axes,");
        for (name, link) in IMUS {
            let about = format!("Specific force at mount.imu_{name} along the {{}} axis of the {link}. {missing}");
            list.vector(&format!("imu_{name}_accel"), &about, "m/s2", UP, (-1e5, 1e5));
        }
        for (name, link) in CONTACTS {
            let about = format!("of the surroundings on the person at mount.{name} in {link} axes,");
            list.wrench(name, &about);
        }
    }

    fn write(&self, flat: &mut [f64]) {
        let groups: [&[f64]; 9] = [
            &self.q,
            &self.qd,
            &self.qdd,
            &self.base_gyro,
            &self.base_accel,
            &self.base_angular_accel,
            &self.seat,
            self.imu.as_flattened(),
            self.contact.as_flattened(),
        ];
        put(flat, &groups);
    }

    fn read(&mut self, flat: &[f64]) {
        let mut groups: [&mut [f64]; 9] = [
            &mut self.q,
            &mut self.qd,
            &mut self.qdd,
            &mut self.base_gyro,
            &mut self.base_accel,
            &mut self.base_angular_accel,
            &mut self.seat,
            self.imu.as_flattened_mut(),
            self.contact.as_flattened_mut(),
        ];
        take(flat, &mut groups);
    }

    fn map(&mut self, f: &mut impl FnMut(f64) -> f64) {
        let mut flat = [0.0; Self::COUNT];
        self.write(&mut flat);
        flat.iter_mut().for_each(|value| *value = f(*value));
        self.read(&flat);
    }
}

fn put(flat: &mut [f64], groups: &[&[f64]]) {
    for (slot, value) in flat.iter_mut().zip(groups.iter().flat_map(|group| group.iter())) {
        *slot = *value;
    }
}

fn take(flat: &[f64], groups: &mut [&mut [f64]]) {
    for (value, slot) in flat.iter().zip(groups.iter_mut().flat_map(|group| group.iter_mut())) {
        *slot = *value;
    }
}

/// What is estimated; frames as in the [module](super)'s page.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Outputs {
    /// Joint torques, N.m.
    pub tau: [f64; DOF],
    /// Their standard deviations.
    pub tau_std: [f64; DOF],
    /// Force and moment of the seat on the person at the pelvis origin, pelvis axes, N and N.m.
    pub seat_wrench: [f64; 6],
    /// Their standard deviations.
    pub seat_wrench_std: [f64; 6],
    /// Centre of mass in the pelvis frame, m.
    pub com: [f64; 3],
    /// Velocity of the centre of mass relative to the pelvis origin, m/s.
    pub com_velocity: [f64; 3],
    /// Mass of the person, kg.
    pub body_mass: f64,
    /// Sum of squared residuals over their variances, per group of sensors.
    pub chi2: [f64; 6],
    /// Normalised innovation squared per channel.
    pub nis: f64,
    /// Channels that `nis` is the mean of.
    pub nis_channels: i32,
    /// Logarithm of the joint likelihood of equations and readings.
    pub log_likelihood: f64,
    /// Conditions of the last sample.
    pub status: Status,
    /// Whether the torques and the seat wrench are usable.
    pub healthy: bool,
}

impl Variables for Outputs {
    const COUNT: usize = 2 * DOF + 12 + 6 + 1 + 6 + 3 + 2;

    fn declare_into(prefix: &str, list: &mut Vec<Variable>) {
        let mut list = List { prefix, list, measured: false };
        let any = (f64::NEG_INFINITY, f64::INFINITY);
        let positive = (0.0, f64::INFINITY);
        for (name, _, about) in JOINTS {
            let about = format!("Torque of the muscles on the {about}.");
            list.push(&format!("tau_{name}"), &about, "N.m", 0.0, any);
        }
        for (name, ..) in JOINTS {
            let about = format!("Standard deviation of tau_{name}.");
            list.push(&format!("tau_{name}_std"), &about, "N.m", 0.0, positive);
        }
        let about = "at the pelvis origin in pelvis axes; its opposite loads the vehicle.";
        let force = format!("Force of the seat on the person along the {{}} axis, {about}");
        list.vector("seat_wrench_force", &force, "N", ZERO, any);
        let moment = format!("Moment of the seat on the person about the {{}} axis, {about}");
        list.vector("seat_wrench_moment", &moment, "N.m", ZERO, any);
        for (part, unit) in [("force", "N"), ("moment", "N.m")] {
            for axis in AXES {
                let name = format!("seat_wrench_{part}_{axis}");
                list.push(&format!("{name}_std"), &format!("Standard deviation of {name}."), unit, 0.0, positive);
            }
        }
        let about =
            "Centre of mass of the person in the pelvis frame along the {} axis, from posture, height and mass.";
        list.vector("com", about, "m", ZERO, any);
        let about = "Velocity of the centre of mass relative to the pelvis origin along the pelvis's {} axis.";
        list.vector("com_velocity", about, "m/s", ZERO, any);
        list.push("body_mass", "Mass of the person, from the parameters.", "kg", 0.0, positive);
        for group in GROUPS {
            let about = format!(
                "Sum of squared residuals over their variances of the sensors of use.{group}; 0 if none has a sample."
            );
            list.push(&format!("chi2_{group}"), &about, "1", 0.0, positive);
        }
        let about = "Normalised innovation squared per channel over the channels that the others predict; near 1 if \
            model and noise fit, 0 if no channel is predicted by the others.";
        list.push("nis", about, "1", 0.0, positive);
        let about = "Number of channels in nis: those whose reading the other sensors predict.";
        list.push_of_kind("nis_channels", about, 0_i32);
        let about =
            "Logarithm of the joint likelihood of the equations and of the last readings under noise and prior.";
        list.push("log_likelihood", about, "1", 0.0, any);
        let about = "Conditions of the last sample as bits. Unobservable: the seat force is not known to within \
            the person's weight.";
        list.push_of_kind("status", about, Status::OK);
        list.push_of_kind("healthy", "Whether joint torques and seat wrench are usable now.", false);
    }

    fn write(&self, flat: &mut [f64]) {
        let groups: [&[f64]; 10] = [
            &self.tau,
            &self.tau_std,
            &self.seat_wrench,
            &self.seat_wrench_std,
            &self.com,
            &self.com_velocity,
            &[self.body_mass],
            &self.chi2,
            &[self.nis, self.nis_channels.to_number(), self.log_likelihood],
            &[self.status.to_number(), self.healthy.to_number()],
        ];
        put(flat, &groups);
    }

    fn read(&mut self, flat: &[f64]) {
        let mut innovations = [0.0; 3];
        let mut last = [0.0; 2];
        let mut mass = [0.0];
        let mut groups: [&mut [f64]; 10] = [
            &mut self.tau,
            &mut self.tau_std,
            &mut self.seat_wrench,
            &mut self.seat_wrench_std,
            &mut self.com,
            &mut self.com_velocity,
            &mut mass,
            &mut self.chi2,
            &mut innovations,
            &mut last,
        ];
        take(flat, &mut groups);
        self.body_mass = mass[0];
        self.nis = innovations[0];
        self.nis_channels = i32::from_number(innovations[1]);
        self.log_likelihood = innovations[2];
        self.status = Status::from_number(last[0]);
        self.healthy = bool::from_number(last[1]);
    }
    fn map(&mut self, f: &mut impl FnMut(f64) -> f64) {
        let mut flat = [0.0; Self::COUNT];
        self.write(&mut flat);
        flat.iter_mut().for_each(|value| *value = f(*value));
        self.read(&flat);
    }
}
