//! A seated person whose joints are springs and dampers, on a seat that brakes.
//!
//! Forward dynamics: pelvis and seat move as given, every joint has the passive torque
//! `-stiffness (q - rest) - damping qd`, the feet stand on elastic supports that move with the
//! seat, and the hands hold handles that push and pull.

use super::person::{Noise, Person, plateau};
use crate::log::Log;
use crate::simulate::{Request, SimulateError};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::TAU;
use wheelstate::estimator::human_dynamics::Parameters;
use wheelstate::estimator::human_dynamics::variables::{CONTACTS, DOF, IMUS, JOINTS};
use wheelstate::model::STANDARD_GRAVITY as GRAVITY;
use wheelstate::model::multibody::anthropometry::seated12;
use wheelstate::plant::human_dynamics::{BaseMotion, Push, SegmentState};
use wheelstate::{Variables, variables};

variables! {
    /// What happens.
    struct Plant {
        /// Duration.
        duration: f64 = 8.0, "s", [0.1, 3600.0];
        /// Deceleration of the seat while it brakes.
        braking: f64 = 2.5, "m/s2", [0.0, 20.0];
        /// Amplitude of the seat's sideways acceleration.
        lateral: f64 = 0.8, "m/s2", [0.0, 20.0];
        /// Amplitude of the seat's pitch, roll and yaw.
        tilt: f64 = 0.05, "rad", [0.0, 0.5];
        /// Largest force of the handles on each hand.
        hand_force: f64 = 20.0, "N", [0.0, 500.0];
        /// Upward force under each foot at rest.
        foot_force: f64 = 60.0, "N", [0.0, 500.0];
        /// Stiffness of the foot supports.
        foot_stiffness: f64 = 1500.0, "N/m", [0.0, 1e6];
        /// All joint stiffnesses are multiplied by this.
        stiffness_scale: f64 = 1.0, "1", [0.01, 100.0];
        /// All joint dampings are multiplied by this.
        damping_scale: f64 = 1.0, "1", [0.01, 100.0];
    }
}

variables! {
    /// Standard deviations of white noise.
    struct Deviations {
        /// Of the joint positions.
        position: f64 = 1e-3, "rad", [0.0, 1.0];
        /// Of the joint velocities.
        velocity: f64 = 0.01, "rad/s", [0.0, 10.0];
        /// Of the joint accelerations.
        acceleration: f64 = 0.5, "rad/s2", [0.0, 1e3];
        /// Of the seat's gyroscope.
        gyro: f64 = 0.002, "rad/s", [0.0, 10.0];
        /// Of the seat's accelerometer.
        base_accel: f64 = 0.05, "m/s2", [0.0, 100.0];
        /// Of the seat's angular acceleration.
        base_angular_accel: f64 = 0.3, "rad/s2", [0.0, 1e3];
        /// Of the accelerometers on the body.
        imu: f64 = 0.03, "m/s2", [0.0, 100.0];
        /// Of the seat's force.
        seat_force: f64 = 2.0, "N", [0.0, 1e3];
        /// Of the seat's moment.
        seat_moment: f64 = 0.3, "N.m", [0.0, 1e3];
        /// Of the hands' forces.
        hand_force: f64 = 0.5, "N", [0.0, 1e3];
        /// Of the hands' moments.
        hand_moment: f64 = 0.05, "N.m", [0.0, 1e3];
        /// Of the feet's forces.
        foot_force: f64 = 2.0, "N", [0.0, 1e3];
        /// Of the feet's moments.
        foot_moment: f64 = 0.3, "N.m", [0.0, 1e3];
    }
}

variables! {
    struct Simulation {
        /// What happens.
        plant: Plant;
        /// Sensors.
        noise: Deviations;
    }
}

/// Passive joints: stiffness N.m/rad, damping N.m.s/rad, rest angle rad, in the order of the joints.
const PASSIVE: [[f64; 3]; DOF] = [
    [180.0, 14.0, 0.0],
    [220.0, 18.0, 0.05],
    [160.0, 12.0, 0.03],
    [60.0, 4.0, 0.0],
    [25.0, 1.5, 0.0],
    [30.0, 1.8, 0.04],
    [12.0, 0.5, 0.0],
    [22.0, 1.6, -0.06],
    [24.0, 1.8, -0.10],
    [6.0, 0.25, 0.0],
    [12.0, 0.8, -0.50],
    [22.0, 1.6, 0.06],
    [24.0, 1.8, -0.10],
    [6.0, 0.25, 0.0],
    [12.0, 0.8, -0.50],
    [90.0, 8.0, -0.10],
    [45.0, 4.0, 0.05],
    [90.0, 8.0, -0.10],
    [45.0, 4.0, 0.05],
];

const SAMPLE: f64 = 0.01;
const SUBSTEPS: usize = 10;

/// Everything that the person's motion depends on.
struct Scene {
    person: Person,
    plant: Plant,
    passive: [[f64; 3]; DOF],
    /// Plant joint of each outside joint.
    joint: [usize; DOF],
    hands: [(usize, Vector3<f64>); 2],
    feet: [(usize, Vector3<f64>); 2],
    /// Where the feet's supports are in pelvis axes.
    supports: [Vector3<f64>; 2],
}

fn read(request: &Request) -> Result<(Parameters, Simulation, [[f64; 3]; DOF]), SimulateError> {
    let (mut parameters, mut simulation, mut passive) = (Parameters::default(), Simulation::default(), PASSIVE);
    for (name, value) in &request.settings {
        let group = name.split('.').next().unwrap_or_default();
        let joint = name.split_once('.').and_then(|(_, joint)| JOINTS.iter().position(|j| j.0 == joint));
        let part = ["stiffness", "damping", "rest"].iter().position(|part| *part == group);
        match (part, joint) {
            (Some(part), Some(joint)) if value.is_finite() && (part == 2 || *value >= 0.0) => {
                passive[joint][part] = *value
            }
            _ if group == "plant" || group == "noise" => simulation.set(name, *value)?,
            _ => parameters.set(name, *value)?,
        }
    }
    parameters.validate()?;
    for joint in &mut passive {
        joint[0] *= simulation.plant.stiffness_scale;
        joint[1] *= simulation.plant.damping_scale;
    }
    Ok((parameters, simulation, passive))
}

impl Scene {
    /// The seat's motion in an inertial frame.
    fn base(&self, t: f64) -> BaseMotion {
        let p = &self.plant;
        // roll, pitch and yaw as sines; small, but rates and accelerations are exact by difference
        let angles = |t: f64| {
            let a = p.tilt;
            [a * (TAU * 0.7 * t).sin(), a * (TAU * 0.9 * t + 0.4).sin() - a * 0.389, 1.5 * a * (TAU * 0.5 * t).sin()]
        };
        let rotation = |t: f64| {
            let [r, p, y] = angles(t);
            Rotation3::from_euler_angles(r, p, y)
        };
        // d/dt R = w~ R; central differences of the given angles to rounding of about 1e-9
        let rate = |t: f64| {
            let h = 1e-4;
            let change = (rotation(t + h) * rotation(t - h).inverse()).scaled_axis();
            change / (2.0 * h)
        };
        let h = 1e-3;
        let brake = plateau(t, (1.0, 1.3), (3.2, 3.6)) - 0.5 * plateau(t, (4.5, 5.0), (6.0, 6.5));
        BaseMotion {
            rotation: *rotation(t).matrix(),
            rate: rate(t),
            angular_acceleration: (rate(t + h) - rate(t - h)) / (2.0 * h),
            acceleration: Vector3::new(
                -p.braking * brake,
                p.lateral * (TAU * 0.6 * t).sin(),
                0.3 * (TAU * 1.3 * t).sin(),
            ),
        }
    }

    /// Wrenches of handles and supports, from the kinematics.
    fn pushes(&self, t: f64, base: &BaseMotion, states: &[SegmentState]) -> Vec<Push> {
        let mut pushes = vec![];
        let pull = self.plant.hand_force;
        for (k, &(segment, at)) in self.hands.iter().enumerate() {
            let phase = 1.7 * k as f64;
            let wave = |f: f64, o: f64| (TAU * f * t + o + phase).sin() * (1.0 - (-3.0 * t).exp());
            let force = Vector3::new(pull * wave(0.8, 0.0), 0.5 * pull * wave(1.1, 0.5), 0.5 * pull * wave(0.65, 1.1));
            let moment = Vector3::new(0.0, 0.0, 0.03 * pull * wave(0.9, 0.2));
            pushes.push(Push { segment, at, force: base.rotation * force, moment: base.rotation * moment });
        }
        for (&(segment, at), support) in self.feet.iter().zip(&self.supports) {
            let state = &states[segment];
            let arm = state.rotation * at;
            let place = state.position + arm;
            // relative to the seat, in its axes
            let offset = support - base.rotation.transpose() * place;
            let velocity = state.velocity + state.rate.cross(&arm) - base.rate.cross(&place);
            let speed = base.rotation.transpose() * velocity;
            let k = Vector3::new(0.3, 0.3, 1.0) * self.plant.foot_stiffness;
            let force = k.component_mul(&offset) - k.component_mul(&speed) * 0.03
                + Vector3::new(0.0, 0.0, self.plant.foot_force);
            pushes.push(Push { segment, at, force: base.rotation * force, moment: Vector3::zeros() });
        }
        pushes
    }

    fn torque(&self, q: &[f64], qd: &[f64]) -> Vec<f64> {
        let mut torque = vec![0.0; q.len()];
        for (outside, &k) in self.joint.iter().enumerate() {
            let [stiffness, damping, rest] = self.passive[outside];
            torque[k] = -stiffness * (q[k] - rest) - damping * qd[k];
        }
        torque
    }

    fn acceleration(&self, t: f64, q: &[f64], qd: &[f64]) -> Vec<f64> {
        let base = self.base(t);
        let zero = vec![0.0; q.len()];
        let (_, states) = self.person.rooted.body.inverse(&base, q, qd, &zero, &[]);
        let pushes = self.pushes(t, &base, &states);
        let torque = self.torque(q, qd);
        // every joint of the seated body moves mass, so the inertia matrix has a Cholesky factor
        self.person.rooted.body.forward(&base, q, qd, &torque, &pushes).unwrap_or(zero)
    }

    /// One step of the classical Runge-Kutta method.
    fn advance(&self, t: f64, h: f64, q: &mut [f64], qd: &mut [f64]) {
        let moved = |a: &[f64], b: &[f64], h: f64| a.iter().zip(b).map(|(a, b)| a + h * b).collect::<Vec<f64>>();
        let a1 = self.acceleration(t, q, qd);
        let (q2, v2) = (moved(q, qd, 0.5 * h), moved(qd, &a1, 0.5 * h));
        let a2 = self.acceleration(t + 0.5 * h, &q2, &v2);
        let (q3, v3) = (moved(q, &v2, 0.5 * h), moved(qd, &a2, 0.5 * h));
        let a3 = self.acceleration(t + 0.5 * h, &q3, &v3);
        let (q4, v4) = (moved(q, &v3, h), moved(qd, &a3, h));
        let a4 = self.acceleration(t + h, &q4, &v4);
        for k in 0..q.len() {
            q[k] += h / 6.0 * (qd[k] + 2.0 * v2[k] + 2.0 * v3[k] + v4[k]);
            qd[k] += h / 6.0 * (a1[k] + 2.0 * a2[k] + 2.0 * a3[k] + a4[k]);
        }
    }
}

pub(super) fn simulate(request: &Request) -> Result<Log, SimulateError> {
    let (parameters, Simulation { plant, noise }, passive) = read(request)?;
    let description = seated12(&parameters.body);
    let person = Person::new(&description, "Pelvis", Vector3::new(0.0, 0.0, -GRAVITY));
    let m = &parameters.mount;
    let mount = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
    let contact = [
        mount(m.right_hand.x, m.right_hand.y, m.right_hand.z),
        mount(m.left_hand.x, m.left_hand.y, m.left_hand.z),
        mount(m.right_foot.x, m.right_foot.y, m.right_foot.z),
        mount(m.left_foot.x, m.left_foot.y, m.left_foot.z),
    ];
    let imu = [
        mount(m.imu_thorax.x, m.imu_thorax.y, m.imu_thorax.z),
        mount(m.imu_head.x, m.imu_head.y, m.imu_head.z),
        mount(m.imu_right_forearm.x, m.imu_right_forearm.y, m.imu_right_forearm.z),
        mount(m.imu_left_forearm.x, m.imu_left_forearm.y, m.imu_left_forearm.z),
    ];
    let seat = mount(m.seat.x, m.seat.y, m.seat.z);
    let contacts: [_; 4] = std::array::from_fn(|k| person.place(CONTACTS[k].1, &contact[k]));
    let imus: [_; 4] = std::array::from_fn(|k| person.place(IMUS[k].1, &imu[k]));
    let joint: [usize; DOF] = std::array::from_fn(|k| person.joint(JOINTS[k].1));

    // the person starts with the joints at their rest angles; there the supports fit
    let (mut q, mut qd) = (vec![0.0; DOF], vec![0.0; DOF]);
    for (outside, &k) in joint.iter().enumerate() {
        q[k] = passive[outside][2];
    }
    let zero = vec![0.0; DOF];
    let (_, at_rest) = person.rooted.body.inverse(&BaseMotion::rest(), &q, &zero, &zero, &[]);
    let supports = [2, 3].map(|k| at_rest[contacts[k].0].position + at_rest[contacts[k].0].rotation * contacts[k].1);
    let (hands, feet) = ([contacts[0], contacts[1]], [contacts[2], contacts[3]]);
    let scene = Scene { person, plant, passive, joint, hands, feet, supports };

    let count = (scene.plant.duration / SAMPLE).round() as usize + 1;
    let mut draw = Noise::new(request.seed);
    let mut table: Vec<Vec<f64>> = vec![];
    let mut names: Vec<String> = vec![];
    for k in 0..count {
        let t = k as f64 * SAMPLE;
        let row = sample(&scene, t, &q, &qd, (&imus, &contacts, &seat), &noise, &mut draw);
        if k == 0 {
            names = row.iter().map(|(name, _)| name.clone()).collect();
            table = vec![Vec::with_capacity(count); names.len()];
        }
        for (column, (_, value)) in table.iter_mut().zip(row) {
            column.push(value);
        }
        for sub in 0..SUBSTEPS {
            let h = SAMPLE / SUBSTEPS as f64;
            scene.advance(t + sub as f64 * h, h, &mut q, &mut qd);
        }
    }
    let time = (0..count).map(|k| k as f64 * SAMPLE).collect();
    let mut log = Log { source: request.scenario.clone(), time, ..Log::default() };
    for (name, values) in names.iter().zip(table) {
        log.push(name, values);
    }
    Ok(log)
}

/// Sensors on the body: accelerometers, contacts, the seat's force sensor.
type Sensors<'a> = (&'a [(usize, Vector3<f64>); 4], &'a [(usize, Vector3<f64>); 4], &'a Vector3<f64>);

/// One row of the log.
fn sample(
    scene: &Scene,
    t: f64,
    q: &[f64],
    qd: &[f64],
    (imus, contacts, seat): Sensors,
    noise: &Deviations,
    draw: &mut Noise,
) -> Vec<(String, f64)> {
    let base = scene.base(t);
    let body = &scene.person.rooted.body;
    let qdd = scene.acceleration(t, q, qd);
    let (_, kinematics) = body.inverse(&base, q, qd, &qdd, &[]);
    let pushes = scene.pushes(t, &base, &kinematics);
    let (torque, states) = body.inverse(&base, q, qd, &qdd, &pushes);
    let mut row = vec![];
    for (list, stem, std) in [(q, "q", noise.position), (qd, "qd", noise.velocity), (&qdd, "qdd", noise.acceleration)] {
        for ((name, ..), &k) in JOINTS.iter().zip(&scene.joint) {
            row.push((format!("{stem}_{name}"), list[k] + draw.of(std)));
        }
    }
    let axes = ["x", "y", "z"];
    let turn = base.rotation.transpose();
    let mut vector = |stem: &str, v: Vector3<f64>, std: f64, draw: &mut Noise| {
        for (axis, value) in axes.iter().zip(v.iter()) {
            row.push((format!("{stem}_{axis}"), value + draw.of(std)));
        }
    };
    vector("base_gyro", turn * base.rate, noise.gyro, draw);
    vector("base_accel", states[0].specific_force(&Vector3::zeros(), &body.gravity), noise.base_accel, draw);
    vector("base_angular_accel", turn * base.angular_acceleration, noise.base_angular_accel, draw);
    let mut wrench = |stem: &str, seen: [f64; 6], std: [f64; 2], draw: &mut Noise| {
        vector(&format!("{stem}_force"), Vector3::new(seen[0], seen[1], seen[2]), std[0], draw);
        vector(&format!("{stem}_moment"), Vector3::new(seen[3], seen[4], seen[5]), std[1], draw);
    };
    let root = &states[0];
    wrench("seat", root.seen_at(seat, &root.force, &root.moment), [noise.seat_force, noise.seat_moment], draw);
    for ((name, _), ((segment, at), push)) in CONTACTS.iter().zip(contacts.iter().zip(&pushes)) {
        let state = &states[*segment];
        let about = push.moment + (state.rotation * at).cross(&push.force);
        let std = if name.ends_with("hand") {
            [noise.hand_force, noise.hand_moment]
        } else {
            [noise.foot_force, noise.foot_moment]
        };
        wrench(name, state.seen_at(at, &push.force, &about), std, draw);
    }
    wrench("true_seat_wrench", root.seen_at(&Vector3::zeros(), &root.force, &root.moment), [0.0; 2], draw);
    for ((name, _), (segment, at)) in IMUS.iter().zip(imus) {
        vector(&format!("imu_{name}_accel"), states[*segment].specific_force(at, &body.gravity), noise.imu, draw);
    }
    for ((name, ..), &k) in JOINTS.iter().zip(&scene.joint) {
        row.push((format!("true_tau_{name}"), torque[k]));
    }
    row
}
