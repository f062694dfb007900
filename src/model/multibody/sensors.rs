//! Sensors on a tree: what each measures of the vector `d`, where it sits and how noisy it is.
//!
//! Every sensor is a constant matrix on one 6-vector of `d` (or picks one scalar), so its rows are
//! those of `Y` in `Y d + b_Y = y`; Latella et al. (2019), section 3.

use super::error::ModelError;
use super::spatial::{Pose, angular, cross_wrench, join, linear};
use super::tree::Tree;
use nalgebra::{Matrix6, Vector3, Vector6};

/// What a sensor measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Specific force of a link at the sensor, sensor axes, m/s2: 3 rows on a link.
    Accelerometer,
    /// Angular acceleration of a link, sensor axes, rad/s2: 3 rows on a link.
    AngularAccelerometer,
    /// Angular velocity of a link, sensor axes, rad/s. Says nothing about `d`: no rows, only a check.
    Gyroscope,
    /// Wrench of the surroundings on a link at the sensor, sensor axes, N and N.m: 6 rows. On a
    /// fixed base: the whole reaction of the ground.
    NetExtWrench,
    /// Wrench that a joint passes from its parent to its child, sensor axes: 6 rows on a joint.
    JointWrench,
    /// Torque of a joint (force of a sliding one), N.m (N): 1 row on a joint.
    JointTorque,
    /// Acceleration of a joint's coordinate, rad/s2 (m/s2): 1 row on a joint.
    JointAcceleration,
    /// Wrench of the seat on a moving base, sensor axes: 6 rows.
    BaseWrench,
    /// Specific force and angular acceleration of a moving base: 6 rows.
    BaseAcceleration,
}

/// What a [`Quantity`] is attached to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attachment {
    /// A named link.
    Link,
    /// A named joint.
    Joint,
    /// The base; no name.
    Base,
}

impl Quantity {
    /// All quantities with their names outside.
    pub const ALL: [(Self, &'static str); 9] = [
        (Self::Accelerometer, "accelerometer"),
        (Self::AngularAccelerometer, "angular_accelerometer"),
        (Self::Gyroscope, "gyroscope"),
        (Self::NetExtWrench, "net_ext_wrench"),
        (Self::JointWrench, "joint_wrench"),
        (Self::JointTorque, "joint_torque"),
        (Self::JointAcceleration, "joint_acceleration"),
        (Self::BaseWrench, "base_wrench"),
        (Self::BaseAcceleration, "base_acceleration"),
    ];

    /// Number of measured values.
    pub fn rows(self) -> usize {
        match self {
            Self::Accelerometer | Self::AngularAccelerometer | Self::Gyroscope => 3,
            Self::NetExtWrench | Self::JointWrench | Self::BaseWrench | Self::BaseAcceleration => 6,
            Self::JointTorque | Self::JointAcceleration => 1,
        }
    }

    /// What it is attached to.
    pub fn attachment(self) -> Attachment {
        match self {
            Self::Accelerometer | Self::AngularAccelerometer | Self::Gyroscope | Self::NetExtWrench => Attachment::Link,
            Self::JointWrench | Self::JointTorque | Self::JointAcceleration => Attachment::Joint,
            Self::BaseWrench | Self::BaseAcceleration => Attachment::Base,
        }
    }
}

/// How noisy a sensor is.
#[derive(Clone, Debug, PartialEq)]
pub enum Noise {
    /// One variance for all rows.
    Scalar(f64),
    /// One variance per row.
    Diagonal(Vec<f64>),
    /// A full covariance, row by row. If one of its samples is missing, the sensor is left out whole.
    Full(Vec<f64>),
}

/// A sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Name for messages and reports.
    pub name: String,
    /// What it measures.
    pub quantity: Quantity,
    /// Name of the link or joint; empty for the base.
    pub target: String,
    /// Pose in link axes; for a joint in the axes of the link it carries.
    pub pose: Pose,
    /// Its noise.
    pub noise: Noise,
}

impl Sensor {
    /// A sensor at the origin of its link, in link axes.
    pub fn new(quantity: Quantity, target: &str, noise: Noise) -> Self {
        let word = Quantity::ALL.iter().find(|(q, _)| *q == quantity).map_or("", |(_, word)| word);
        let name = if target.is_empty() { word.to_owned() } else { format!("{word} {target}") };
        Self { name, quantity, target: target.to_owned(), pose: Pose::identity(), noise }
    }

    /// The same sensor at another pose.
    pub fn at(mut self, pose: Pose) -> Self {
        self.pose = pose;
        self
    }

    /// Rows that it adds to `Y`.
    pub fn equation_rows(&self) -> usize {
        if self.quantity == Quantity::Gyroscope { 0 } else { self.quantity.rows() }
    }
}

/// Which 6-vector or scalar of `d` a sensor sees.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Sees {
    /// Proper acceleration of a body.
    Acceleration(usize),
    /// External wrench of a body.
    External(usize),
    /// Wrench from the parent on a body, in the body's frame.
    Internal(usize),
    /// Wrench from a body on its parent, in the parent's frame (a joint walked backwards).
    Reaction(usize),
    /// Wrench of the ground on a fixed base.
    Ground,
    /// Torque: body and place among its joint's degrees of freedom.
    Torque(usize, usize),
    /// Acceleration of the coordinate: body and place among its joint's degrees of freedom.
    Coordinate(usize, usize),
    /// Nothing of `d`.
    Velocity(usize),
}

/// A sensor whose link or joint has been found.
#[derive(Clone, Debug)]
pub(super) struct Mounted {
    /// Which part of `d` it sees.
    pub sees: Sees,
    /// Sensor pose in the frame of the 6-vector it sees.
    pub pose: Pose,
    /// Number of its rows.
    pub rows: usize,
    /// What its rows are multiplied by on the 6-vector: the sensor's map, whitened if its covariance is full.
    pub map: Matrix6<f64>,
    /// Inverse Cholesky factor of a full covariance.
    pub whitening: Option<Matrix6<f64>>,
    /// Variance per row, after whitening.
    pub variance: [f64; 6],
    /// Carries an acceleration, whose sensor has the bias `w x v`.
    pub classical: bool,
}

/// Finds a sensor's place on a tree.
pub(super) fn mount(tree: &Tree, base_moves: bool, sensor: &Sensor) -> Result<Mounted, ModelError> {
    let on_link = || tree.place(&sensor.target).map(|place| (place.body, place.pose.compose(&sensor.pose)));
    let fixed = |body: usize| body == 0 && !base_moves;
    let (sees, pose) = match sensor.quantity {
        Quantity::Accelerometer | Quantity::AngularAccelerometer => {
            let (body, pose) = on_link()?;
            if fixed(body) {
                return Err(ModelError::SensorOnFixedBase(sensor.name.clone(), sensor.target.clone()));
            }
            (Sees::Acceleration(body), pose)
        }
        Quantity::Gyroscope => {
            let (body, pose) = on_link()?;
            (Sees::Velocity(body), pose)
        }
        Quantity::NetExtWrench => {
            let (body, pose) = on_link()?;
            (if fixed(body) { Sees::Ground } else { Sees::External(body) }, pose)
        }
        Quantity::JointWrench => {
            let (body, k) = tree.dof_places[tree.coordinate(&sensor.target)?];
            let carried = tree.carried(&sensor.target)?;
            let pose = carried.pose.compose(&sensor.pose);
            let forward = tree.bodies[body].steps[k].sign > 0.0;
            (if forward { Sees::Internal(body) } else { Sees::Reaction(body) }, pose)
        }
        Quantity::JointTorque | Quantity::JointAcceleration => {
            let (body, k) = tree.dof_places[tree.coordinate(&sensor.target)?];
            let torque = sensor.quantity == Quantity::JointTorque;
            (if torque { Sees::Torque(body, k) } else { Sees::Coordinate(body, k) }, Pose::identity())
        }
        Quantity::BaseWrench | Quantity::BaseAcceleration if !base_moves => {
            return Err(ModelError::BaseIsFixed(sensor.name.clone()));
        }
        Quantity::BaseWrench => (Sees::Internal(0), sensor.pose),
        Quantity::BaseAcceleration => (Sees::Acceleration(0), sensor.pose),
    };
    let rows = sensor.equation_rows();
    let back = pose.inverse();
    let mut map = match sees {
        Sees::Acceleration(_) => back.motion_matrix(),
        _ => back.wrench_matrix(),
    };
    if sensor.quantity == Quantity::AngularAccelerometer {
        let angular_rows = map.fixed_rows::<3>(3).into_owned();
        map.fixed_rows_mut::<3>(0).copy_from(&angular_rows);
    }
    let (variance, whitening) = noise(sensor)?;
    if let Some(w) = &whitening {
        map = w * map;
    }
    let classical = matches!(sensor.quantity, Quantity::Accelerometer | Quantity::BaseAcceleration);
    Ok(Mounted { sees, pose, rows, map, whitening, variance, classical })
}

fn noise(sensor: &Sensor) -> Result<([f64; 6], Option<Matrix6<f64>>), ModelError> {
    let m = sensor.quantity.rows();
    let mut variance = [1.0; 6];
    let bad = |v: f64| !(v > 0.0 && v.is_finite() && (1.0 / v).is_finite());
    let given: &[f64] = match &sensor.noise {
        Noise::Scalar(v) => std::slice::from_ref(v),
        Noise::Diagonal(v) if v.len() == m => v,
        Noise::Full(v) if v.len() == m * m => v,
        Noise::Diagonal(v) | Noise::Full(v) => {
            return Err(ModelError::VarianceCount(sensor.name.clone(), v.len(), m));
        }
    };
    if let Noise::Full(values) = &sensor.noise {
        let mut covariance = Matrix6::identity();
        for (i, &value) in values.iter().enumerate() {
            covariance[(i / m, i % m)] = value;
        }
        let not_spd = || ModelError::CovarianceNotSpd(sensor.name.clone());
        let asymmetry = (covariance - covariance.transpose()).amax();
        if !asymmetry.is_finite() || asymmetry > 1e-9 * covariance.amax() {
            return Err(not_spd());
        }
        let factor = covariance.cholesky().ok_or_else(not_spd)?.l();
        return Ok((variance, Some(factor.try_inverse().ok_or_else(not_spd)?)));
    }
    if let Some(&v) = given.iter().find(|v| bad(**v)) {
        return Err(ModelError::BadVariance(format!("sensor '{}'", sensor.name), v));
    }
    for (row, v) in variance.iter_mut().enumerate().take(m) {
        *v = if given.len() == 1 { given[0] } else { given[row] };
    }
    Ok((variance, None))
}

impl Mounted {
    /// The part of the reading that does not depend on `d`, whitened: the accelerometer's
    /// `w_s x v_s`; for the ground's reaction the base's own weight, `I_0 [-g; 0]`.
    pub fn bias(&self, velocity: &Vector6<f64>, base_inertial_wrench: &Vector6<f64>) -> Vector6<f64> {
        match self.sees {
            Sees::Acceleration(_) if self.classical => {
                let at_sensor = self.pose.motion_back(velocity);
                let bias = angular(&at_sensor).cross(&linear(&at_sensor));
                let bias = join(&bias, &Vector3::zeros());
                self.whitening.map_or(bias, |w| w * bias)
            }
            Sees::Ground => self.map * base_inertial_wrench,
            _ => Vector6::zeros(),
        }
    }
}

/// Inertial wrench of a body with this velocity and proper acceleration.
pub(super) fn inertial_wrench(
    inertia: &super::spatial::Inertia,
    velocity: &Vector6<f64>,
    proper: &Vector6<f64>,
) -> Vector6<f64> {
    inertia.times(proper) + cross_wrench(velocity, &inertia.times(velocity))
}
