//! Inputs and outputs of the seated body. The lists are long and regular, so their declarations
//! are written by loops over joints, sensors and axes.

use crate::estimator::Diagnostics;
use crate::variable::{Estimate, Field, Kind, Variable, Variables};
use serde::{Deserialize, Serialize};

/// Degrees of freedom of the seated body.
pub const DOF: usize = 19;
/// Torques and components of the seat wrench.
pub const WRENCHES: usize = DOF + 6;

/// The joints: name outside, name in the model, what moves about which axis.
pub const JOINTS: [(&str, &str, &str); DOF] = [
    ("lumbar_x", "jLumbar_rotx", "lumbar spine relative to the pelvis about x (leaning to the right is positive)"),
    ("lumbar_y", "jLumbar_roty", "lumbar spine relative to the pelvis about y (leaning forward is positive)"),
    ("thorax_y", "jThorax_roty", "thorax relative to the lumbar spine about y (leaning forward is positive)"),
    ("thorax_z", "jThorax_rotz", "thorax relative to the lumbar spine about z (turning left is positive)"),
    ("neck_x", "jNeck_rotx", "head relative to the thorax about x (tilting to the right is positive)"),
    ("neck_y", "jNeck_roty", "head relative to the thorax about y (nodding forward is positive)"),
    ("neck_z", "jNeck_rotz", "head relative to the thorax about z (turning left is positive)"),
    (
        "right_shoulder_x",
        "jRightShoulder_rotx",
        "right upper arm relative to the thorax about x (the hand swings to the left)",
    ),
    (
        "right_shoulder_y",
        "jRightShoulder_roty",
        "right upper arm relative to the thorax about y (the hand swings backward)",
    ),
    ("right_shoulder_z", "jRightShoulder_rotz", "right upper arm relative to the thorax about z"),
    ("right_elbow_y", "jRightElbow_roty", "right forearm relative to the upper arm about y (bending is negative)"),
    (
        "left_shoulder_x",
        "jLeftShoulder_rotx",
        "left upper arm relative to the thorax about x (the hand swings to the left)",
    ),
    (
        "left_shoulder_y",
        "jLeftShoulder_roty",
        "left upper arm relative to the thorax about y (the hand swings backward)",
    ),
    ("left_shoulder_z", "jLeftShoulder_rotz", "left upper arm relative to the thorax about z"),
    ("left_elbow_y", "jLeftElbow_roty", "left forearm relative to the upper arm about y (bending is negative)"),
    ("right_hip_y", "jRightHip_roty", "right thigh relative to the pelvis about y (raising the knee is negative)"),
    ("right_knee_y", "jRightKnee_roty", "right shank relative to the thigh about y (stretching is negative)"),
    ("left_hip_y", "jLeftHip_roty", "left thigh relative to the pelvis about y (raising the knee is negative)"),
    ("left_knee_y", "jLeftKnee_roty", "left shank relative to the thigh about y (stretching is negative)"),
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

/// The axes of a vector.
pub const AXES: [&str; 3] = ["x", "y", "z"];

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
        const NEVER_SET: f64 = f64::NAN;
        Self {
            q: [NEVER_SET; DOF],
            qd: [NEVER_SET; DOF],
            qdd: [NEVER_SET; DOF],
            base_gyro: [NEVER_SET; 3],
            base_accel: [NEVER_SET; 3],
            base_angular_accel: [NEVER_SET; 3],
            seat: [NEVER_SET; 6],
            imu: [[NEVER_SET; 3]; 4],
            contact: [[NEVER_SET; 6]; 4],
        }
    }
}

/// Collects declarations with one prefix.
struct List<'a> {
    prefix: &'a str,
    list: &'a mut Vec<Variable>,
}

impl List<'_> {
    /// A measured input.
    fn measured(&mut self, name: &str, about: &str, unit: &'static str, limit: f64) {
        let name = format!("{}{name}", self.prefix);
        let variable = Variable::new(name, about.to_owned(), unit, Kind::Real, (-limit, limit));
        self.list.push(Variable { start: f64::NAN, measured: true, ..variable });
    }

    /// An estimate with its standard deviation, or a number without one.
    fn output(&mut self, name: &str, about: &str, unit: &'static str, start: impl Field) {
        let variable = Variable::new(format!("{}{name}", self.prefix), about.to_owned(), unit, Kind::Real, ANY);
        start.declare_into(variable, self.list);
    }

    /// Three measured axes of one vector.
    fn vector(&mut self, stem: &str, about: &str, unit: &'static str, limit: f64) {
        for axis in AXES {
            self.measured(&format!("{stem}_{axis}"), &about.replace("{}", axis), unit, limit);
        }
    }

    /// A measured force and moment.
    fn wrench(&mut self, stem: &str, about: &str) {
        let force = format!("Force {about} along the {{}} axis. NaN = no sample.");
        self.vector(&format!("{stem}_force"), &force, "N", 1e6);
        let moment = format!("Moment {about} about the {{}} axis. NaN = no sample.");
        self.vector(&format!("{stem}_moment"), &moment, "N.m", 1e6);
    }
}

const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

impl Variables for Inputs {
    const COUNT: usize = 3 * DOF + 9 + 6 + 12 + 24;

    fn declare_into(prefix: &str, list: &mut Vec<Variable>) {
        let mut list = List { prefix, list };
        let skip = "NaN = the whole sample is skipped.";
        let missing = "NaN = no sample.";
        for (name, _, about) in JOINTS {
            let about = format!("Position of the {about}. {skip}");
            list.measured(&format!("q_{name}"), &about, "rad", 100.0);
        }
        for (name, _, about) in JOINTS {
            let about = format!("Velocity of the {about}. Ignored with differentiate. {skip}");
            list.measured(&format!("qd_{name}"), &about, "rad/s", 1e4);
        }
        for (name, _, about) in JOINTS {
            let about = format!("Acceleration of the {about}. Ignored with differentiate. {missing}");
            list.measured(&format!("qdd_{name}"), &about, "rad/s2", 1e6);
        }
        let about = format!("Angular velocity of the pelvis about its {{}} axis. {skip}");
        list.vector("base_gyro", &about, "rad/s", 1e4);
        let about =
            format!("Specific force at the pelvis origin along the pelvis's {{}} axis; +g along z at rest. {missing}");
        list.vector("base_accel", &about, "m/s2", 1e5);
        let about = format!("Angular acceleration of the pelvis about its {{}} axis. {missing}");
        list.vector("base_angular_accel", &about, "rad/s2", 1e6);
        list.wrench("seat", "of the seat on the person at mount.seat in pelvis axes,");
        for (name, link) in IMUS {
            let about = format!("Specific force at mount.imu_{name} along the {{}} axis of the {link}. {missing}");
            list.vector(&format!("imu_{name}_accel"), &about, "m/s2", 1e5);
        }
        for (name, link) in CONTACTS {
            let about = format!("of the surroundings on the person at mount.{name} in {link} axes,");
            list.wrench(name, &about);
        }
    }

    fn write(&self, flat: &mut [f64]) {
        let mut rest = flat;
        for group in self.groups() {
            let (head, tail) = rest.split_at_mut(group.len());
            head.copy_from_slice(group);
            rest = tail;
        }
    }

    fn read(&mut self, flat: &[f64]) {
        let mut rest = flat;
        for group in self.groups_mut() {
            let (head, tail) = rest.split_at(group.len());
            group.copy_from_slice(head);
            rest = tail;
        }
    }

    fn map(&mut self, f: &mut impl FnMut(f64) -> f64) {
        self.groups_mut().into_iter().flatten().for_each(|value| *value = f(*value));
    }

    fn same(&self, other: &Self) -> bool {
        // A whole group at once, which the processor does several numbers at a time.
        let differs = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0, |all, (a, b)| all | (a.to_bits() ^ b.to_bits()));
        self.groups().into_iter().zip(other.groups()).all(|(mine, other)| differs(mine, other) == 0)
    }
}

impl Inputs {
    /// The values in the order of their declarations.
    fn groups(&self) -> [&[f64]; 9] {
        [
            &self.q,
            &self.qd,
            &self.qdd,
            &self.base_gyro,
            &self.base_accel,
            &self.base_angular_accel,
            &self.seat,
            self.imu.as_flattened(),
            self.contact.as_flattened(),
        ]
    }

    fn groups_mut(&mut self) -> [&mut [f64]; 9] {
        [
            &mut self.q,
            &mut self.qd,
            &mut self.qdd,
            &mut self.base_gyro,
            &mut self.base_accel,
            &mut self.base_angular_accel,
            &mut self.seat,
            self.imu.as_flattened_mut(),
            self.contact.as_flattened_mut(),
        ]
    }
}

/// What is estimated; frames as in the [module](super)'s page.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outputs {
    /// Joint torques, N.m.
    pub tau: [Estimate; DOF],
    /// Force and moment of the seat on the person at the pelvis origin, pelvis axes, N and N.m.
    pub seat_wrench: [Estimate; 6],
    /// Centre of mass in the pelvis frame, m.
    pub com: [f64; 3],
    /// Velocity of the centre of mass relative to the pelvis origin, m/s.
    pub com_velocity: [f64; 3],
    /// Mass of the person, kg.
    pub body_mass: f64,
    /// Sum of squared residuals over their variances, per group of sensors.
    pub chi2: [f64; 6],
    /// What every estimator says.
    pub diagnostics: Diagnostics,
}

impl AsMut<Diagnostics> for Outputs {
    fn as_mut(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}

/// Numbers in [`Outputs`] before the diagnostics.
const ESTIMATES: usize = 2 * WRENCHES + 6 + 1 + 6;

impl Outputs {
    /// Torques, then the seat wrench.
    pub(super) fn wrenches_mut(&mut self) -> impl Iterator<Item = &mut Estimate> {
        self.tau.iter_mut().chain(&mut self.seat_wrench)
    }
}

impl Variables for Outputs {
    const COUNT: usize = ESTIMATES + Diagnostics::COUNT;

    fn declare_into(prefix: &str, list: &mut Vec<Variable>) {
        let mut outputs = List { prefix, list };
        for (name, _, about) in JOINTS {
            let about = format!("Torque of the muscles on the {about}.");
            outputs.output(&format!("tau_{name}"), &about, "N.m", Estimate::NONE);
        }
        let at = "at the pelvis origin in pelvis axes; its opposite loads the vehicle.";
        for (part, what, unit) in [
            ("force", "Force of the seat on the person along", "N"),
            ("moment", "Moment of the seat on the person about", "N.m"),
        ] {
            for axis in AXES {
                let about = format!("{what} the {axis} axis, {at}");
                outputs.output(&format!("seat_wrench_{part}_{axis}"), &about, unit, Estimate::NONE);
            }
        }
        for axis in AXES {
            let about = format!(
                "Centre of mass of the person in the pelvis frame along the {axis} axis, from posture, height and mass."
            );
            outputs.output(&format!("com_{axis}"), &about, "m", 0.0);
        }
        for axis in AXES {
            let about =
                format!("Velocity of the centre of mass relative to the pelvis origin along the pelvis's {axis} axis.");
            outputs.output(&format!("com_velocity_{axis}"), &about, "m/s", 0.0);
        }
        outputs.output("body_mass", "Mass of the person, from the parameters.", "kg", 0.0);
        for group in GROUPS {
            let about = format!(
                "Sum of squared residuals over their variances of the sensors of use.{group}; 0 if none has a sample."
            );
            outputs.output(&format!("chi2_{group}"), &about, "1", 0.0);
        }
        Diagnostics::declare_into(prefix, list);
    }

    fn write(&self, flat: &mut [f64]) {
        let estimates = self.tau.iter().chain(&self.seat_wrench).flat_map(|e| [e.value, e.std]);
        let plain = self.com.iter().chain(&self.com_velocity).chain([&self.body_mass]).chain(&self.chi2).copied();
        for (slot, value) in flat.iter_mut().zip(estimates.chain(plain)) {
            *slot = value;
        }
        self.diagnostics.write(&mut flat[ESTIMATES..]);
    }

    fn read(&mut self, flat: &[f64]) {
        let mut values = flat.iter().copied();
        let mut next = || values.next().unwrap_or_default();
        for estimate in self.wrenches_mut() {
            *estimate = Estimate::new(next(), next());
        }
        let plain = self.com.iter_mut().chain(&mut self.com_velocity).chain([&mut self.body_mass]);
        for value in plain.chain(&mut self.chi2) {
            *value = next();
        }
        self.diagnostics.read(&flat[ESTIMATES..]);
    }

    fn map(&mut self, f: &mut impl FnMut(f64) -> f64) {
        let mut flat = [0.0; Self::COUNT];
        self.write(&mut flat);
        flat.iter_mut().for_each(|value| *value = f(*value));
        self.read(&flat);
    }

    fn same(&self, other: &Self) -> bool {
        let flat = |values: &Self| {
            let mut flat = [0.0; Self::COUNT];
            values.write(&mut flat);
            flat.map(f64::to_bits)
        };
        flat(self) == flat(other)
    }
}
