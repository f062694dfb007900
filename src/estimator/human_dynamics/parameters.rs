//! Parameters of the seated body.

use super::variables::{AXES, CONTACTS, IMUS, JOINTS};
use crate::model::multibody::anthropometry::{BodyParameters, at};
use crate::model::multibody::equations::Kind;
use crate::model::multibody::prior::Variances;
use crate::model::multibody::scatter::ScatterParameters;
use crate::model::multibody::sensors::{Noise, Quantity, Sensor};
use crate::model::multibody::spatial::Pose;
use crate::model::multibody::tree::Tree;

crate::variables! {
    /// Which sensors are used.
    pub struct UseParameters {
        /// Use the joint accelerations qdd_* (or those made by differentiate).
        joint_acceleration: bool = true, "1", essential;
        /// Use the accelerometer and the angular acceleration of the pelvis.
        base_acceleration: bool = true, "1", essential;
        /// Use the seat's force and moment.
        seat_wrench: bool = false, "1", essential;
        /// Use the accelerometers on thorax, head and forearms.
        imu: bool = false, "1", essential;
        /// Use the forces and moments on the hands.
        hand_wrench: bool = false, "1", essential;
        /// Use the forces and moments on the feet.
        foot_wrench: bool = false, "1", essential;
    }
}

crate::variables! {
    /// Variances of the equations of motion.
    pub struct EquationVariances {
        /// Variance of the accelerations between neighbours, in (m/s2)^2 and (rad/s2)^2.
        acceleration: f64 = 1e-4, "1", [1e-12, 1e12], process_noise;
        /// Variance of Newton's and Euler's equations, in N^2 and (N.m)^2. Larger for a body that is known badly.
        net_wrench: f64 = 1e-4, "1", [1e-12, 1e12], process_noise;
        /// Variance of the sum of wrenches on a body, in N^2 and (N.m)^2.
        wrench_balance: f64 = 1e-4, "1", [1e-12, 1e12], process_noise;
        /// Variance with which the torques follow from the wrenches.
        torque: f64 = 1e-4, "N2.m2", [1e-12, 1e12], process_noise;
    }
}

crate::variables! {
    /// All variances, in the squares of the units of what they belong to.
    pub struct VarianceParameters {
        /// Equations of motion.
        equation: EquationVariances;
        /// Prior variance of all variables without one of their own, in the square of their unit; their prior mean is 0.
        prior: f64 = 1e4, "1", [1e-12, 1e14];
        /// Prior variance of the seat's force and moment, in N^2 and (N.m)^2.
        prior_seat: f64 = 1e6, "1", [1e-12, 1e14];
        /// Prior variance of the force on a hand.
        prior_hand_force: f64 = 900.0, "N2", [1e-12, 1e14];
        /// Prior variance of the moment on a hand.
        prior_hand_moment: f64 = 100.0, "N2.m2", [1e-12, 1e14];
        /// Prior variance of the force on a foot.
        prior_foot_force: f64 = 6400.0, "N2", [1e-12, 1e14];
        /// Prior variance of the moment on a foot.
        prior_foot_moment: f64 = 1600.0, "N2.m2", [1e-12, 1e14];
        /// Variance of the knowledge that nothing touches the other segments, in N^2 and (N.m)^2.
        no_contact: f64 = 1e-4, "1", [1e-12, 1e12];
        /// Variance of a joint acceleration.
        joint_acceleration: f64 = 0.25, "rad2/s4", [1e-12, 1e12], measurement_noise;
        /// Variance of the pelvis's accelerometer.
        base_acceleration: f64 = 0.0025, "m2/s4", [1e-12, 1e12], measurement_noise;
        /// Variance of the pelvis's angular acceleration.
        base_angular_acceleration: f64 = 0.09, "rad2/s4", [1e-12, 1e12], measurement_noise;
        /// Variance of the accelerometers on the body.
        imu_acceleration: f64 = 9e-4, "m2/s4", [1e-12, 1e12], measurement_noise;
        /// Variance of the seat's force.
        seat_force: f64 = 4.0, "N2", [1e-12, 1e12], measurement_noise;
        /// Variance of the seat's moment.
        seat_moment: f64 = 0.09, "N2.m2", [1e-12, 1e12], measurement_noise;
        /// Variance of a hand's force.
        hand_force: f64 = 0.25, "N2", [1e-12, 1e12], measurement_noise;
        /// Variance of a hand's moment.
        hand_moment: f64 = 0.0025, "N2.m2", [1e-12, 1e12], measurement_noise;
        /// Variance of a foot's force.
        foot_force: f64 = 4.0, "N2", [1e-12, 1e12], measurement_noise;
        /// Variance of a foot's moment.
        foot_moment: f64 = 0.09, "N2.m2", [1e-12, 1e12], measurement_noise;
    }
}

/// A sensor's place in the axes of its segment.
macro_rules! mount {
    ($name:ident, $about:literal, $z:literal) => {
        crate::variables! {
            #[doc = $about]
            pub struct $name {
                /// Place of the sensor from the segment's origin along the segment's x axis (forward).
                x: f64 = 0.0, "m", [-2.0, 2.0];
                /// Place of the sensor from the segment's origin along the segment's y axis (left).
                y: f64 = 0.0, "m", [-2.0, 2.0];
                /// Place of the sensor from the segment's origin along the segment's z axis (up).
                z: f64 = $z, "m", [-2.0, 2.0];
            }
        }

        impl $name {
            fn pose(&self) -> Pose {
                at(self.x, self.y, self.z)
            }
        }
    };
}

mount!(SeatMount, "Place of the seat's force sensor on the pelvis.", -0.1);
mount!(ImuMount, "Place of an accelerometer on its segment.", 0.1);
mount!(HandMount, "Place of a hand's force sensor on the forearm.", -0.2);
mount!(FootMount, "Place of a foot's force sensor on the shank.", -0.4);

crate::variables! {
    /// Where the sensors sit; their axes are those of their segments.
    pub struct MountParameters {
        /// Seat force sensor, on the pelvis.
        seat: SeatMount;
        /// Accelerometer on the thorax.
        imu_thorax: ImuMount;
        /// Accelerometer on the head.
        imu_head: ImuMount;
        /// Accelerometer on the right forearm.
        imu_right_forearm: ImuMount;
        /// Accelerometer on the left forearm.
        imu_left_forearm: ImuMount;
        /// Force sensor of the right hand, on the forearm.
        right_hand: HandMount;
        /// Force sensor of the left hand, on the forearm.
        left_hand: HandMount;
        /// Force sensor of the right foot, on the shank.
        right_foot: FootMount;
        /// Force sensor of the left foot, on the shank.
        left_foot: FootMount;
    }
}

crate::variables! {
    /// Derivatives from joint positions.
    pub struct DifferentiationParameters {
        /// Samples in the window whose cubic fit gives velocity and acceleration at its end; odd.
        window: i32 = 25, "1", [5, 501];
    }
}

crate::variables! {
    /// All parameters.
    pub struct Parameters {
        /// Time between two samples.
        sample_period: f64 = 0.01, "s", [1e-4, 1.0], essential;
        /// The person.
        body: BodyParameters;
        /// Make joint velocities and accelerations from the positions instead of taking qd_* and qdd_*. Until the window is full nothing is estimated.
        differentiate: bool = false, "1", essential;
        /// Derivatives from joint positions.
        differentiation: DifferentiationParameters;
        /// Which sensors are used.
        r#use: UseParameters;
        /// Standard deviation of the time by which the joints' motion and the other sensors come apart, which counts in the deviations of torques and seat wrench. 0: all are sampled together.
        delay_std: f64 = 0.015, "s", [0.0, 1.0];
        /// Variances.
        variance: VarianceParameters;
        /// How well the body is known.
        scatter: ScatterParameters;
        /// Places of the sensors.
        mount: MountParameters;
    }
}

impl Parameters {
    /// The inputs that no sensor which is switched on reads.
    pub(super) fn unused(&self) -> Vec<String> {
        let used = &self.r#use;
        let joints = |stem: &str| JOINTS.map(|(name, ..)| format!("{stem}_{name}"));
        let axes = |stem: &str| AXES.map(|axis| format!("{stem}_{axis}"));
        let wrench = |stem: &str| [axes(&format!("{stem}_force")), axes(&format!("{stem}_moment"))].concat();
        let mut unused = Vec::new();
        let mut without = |on: bool, inputs: Vec<String>| unused.extend(inputs.into_iter().filter(|_| !on));
        without(!self.differentiate, joints("qd").to_vec());
        without(used.joint_acceleration && !self.differentiate, joints("qdd").to_vec());
        without(used.base_acceleration, [axes("base_accel"), axes("base_angular_accel")].concat());
        without(used.seat_wrench, wrench("seat"));
        for (name, _) in IMUS {
            without(used.imu, axes(&format!("imu_{name}_accel")).to_vec());
        }
        for (k, (name, _)) in CONTACTS.into_iter().enumerate() {
            without(if k < 2 { used.hand_wrench } else { used.foot_wrench }, wrench(name));
        }
        unused
    }

    /// The sensors that are switched on, each with its group (see
    /// [`GROUPS`](super::variables::GROUPS)); the knowledge that nothing touches a segment has none.
    /// Joint accelerations come one by one.
    pub(super) fn sensors(&self, tree: &Tree) -> Vec<(Option<usize>, Sensor)> {
        let (v, used) = (&self.variance, &self.r#use);
        let wrench = |force: f64, moment: f64| Noise::Diagonal([[force; 3], [moment; 3]].as_flattened().to_vec());
        let mut sensors = vec![];
        for body in &tree.bodies {
            if !CONTACTS.iter().any(|(_, link)| *link == body.name) {
                sensors.push((None, Sensor::new(Quantity::NetExtWrench, &body.name, Noise::Scalar(v.no_contact))));
            }
        }
        if used.joint_acceleration {
            for joint in &tree.dof_names {
                let noise = Noise::Scalar(v.joint_acceleration);
                sensors.push((Some(0), Sensor::new(Quantity::JointAcceleration, joint, noise)));
            }
        }
        if used.base_acceleration {
            let noise = wrench(v.base_acceleration, v.base_angular_acceleration);
            sensors.push((Some(1), Sensor::new(Quantity::BaseAcceleration, "", noise)));
        }
        if used.seat_wrench {
            let noise = wrench(v.seat_force, v.seat_moment);
            sensors.push((Some(2), Sensor::new(Quantity::BaseWrench, "", noise).at(self.mount.seat.pose())));
        }
        let m = &self.mount;
        if used.imu {
            let poses = [m.imu_thorax.pose(), m.imu_head.pose(), m.imu_right_forearm.pose(), m.imu_left_forearm.pose()];
            for ((_, link), pose) in IMUS.iter().zip(poses) {
                let noise = Noise::Scalar(v.imu_acceleration);
                sensors.push((Some(3), Sensor::new(Quantity::Accelerometer, link, noise).at(pose)));
            }
        }
        let poses = [m.right_hand.pose(), m.left_hand.pose(), m.right_foot.pose(), m.left_foot.pose()];
        for (k, ((_, link), pose)) in CONTACTS.iter().zip(poses).enumerate() {
            let hand = k < 2;
            if if hand { used.hand_wrench } else { used.foot_wrench } {
                let noise =
                    if hand { wrench(v.hand_force, v.hand_moment) } else { wrench(v.foot_force, v.foot_moment) };
                let group = if hand { 4 } else { 5 };
                sensors.push((Some(group), Sensor::new(Quantity::NetExtWrench, link, noise).at(pose)));
            }
        }
        sensors
    }

    /// The variances of equations and priors.
    pub(super) fn variances(&self, tree: &Tree) -> Variances {
        let (v, e) = (&self.variance, &self.variance.equation);
        let hand = [v.prior_hand_force, v.prior_hand_moment];
        let foot = [v.prior_foot_force, v.prior_foot_moment];
        let mut prior_of = vec![(0, Kind::ParentWrench, [v.prior_seat; 2])];
        for (k, (_, link)) in CONTACTS.iter().enumerate() {
            if let Ok(place) = tree.place(link) {
                prior_of.push((place.body, Kind::ExternalWrench, if k < 2 { hand } else { foot }));
            }
        }
        Variances {
            equation: [e.acceleration, e.net_wrench, e.wrench_balance, e.torque],
            prior: [v.prior; 6],
            prior_of,
            ..Default::default()
        }
    }
}
