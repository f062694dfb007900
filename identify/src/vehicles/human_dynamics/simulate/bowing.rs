//! A standing person bows; feet on two plates, accelerometers on the segments, force sensors in the hands.
//!
//! The motion is given and the plant says which torques make it. The joint coordinates are sampled
//! with noise at 240 Hz and differentiated by a cubic Savitzky-Golay filter, as in the recordings of
//! Latella et al. (2019).

use super::person::{Noise, Person};
use crate::estimate::urdf;
use crate::log::Log;
use crate::simulate::{Companion, Request, SimulateError};
use nalgebra::Vector3;
use std::f64::consts::TAU;
use wheelstate::filter::savitzky_golay::smooth;
use wheelstate::model::STANDARD_GRAVITY as GRAVITY;
use wheelstate::model::multibody::anthropometry::{BodyParameters, human48};
use wheelstate::model::multibody::tree::Description;
use wheelstate::plant::human_dynamics::{BaseMotion, Push};
use wheelstate::{Variables, variables};

variables! {
    /// The person and what happens.
    struct Plant {
        /// Height of the person.
        height: f64 = 1.67, "m", [0.5, 2.6];
        /// Mass of the person.
        mass: f64 = 61.1, "kg", [5.0, 400.0];
        /// Bows.
        repetitions: i32 = 5, "1", [1, 1000];
        /// Time of one bow.
        period: f64 = 4.0, "s", [1.0, 60.0];
        /// Depth of the bow: 1 bends hips and trunk by about 70 degrees together.
        depth: f64 = 1.0, "1", [0.0, 1.5];
        /// Weight carried at T8 that the written body does not have.
        extra_mass: f64 = 0.0, "kg", [0.0, 50.0];
        /// Downward force on each hand at the deepest point.
        hand_force: f64 = 15.0, "N", [0.0, 500.0];
        /// Samples in the differentiation window; odd.
        window: i32 = 57, "1", [5, 501];
    }
}

variables! {
    /// Standard deviations of white noise.
    struct Deviations {
        /// Of the joint coordinates.
        position: f64 = 1e-3, "rad", [0.0, 1.0];
        /// Of the accelerometers.
        accel: f64 = 0.033, "m/s2", [0.0, 100.0];
        /// Of the plates' forces.
        plate_force: f64 = 1.0, "N", [0.0, 1e3];
        /// Of the plates' moments.
        plate_moment: f64 = 0.3, "N.m", [0.0, 1e3];
        /// Of the hands' forces.
        hand_force: f64 = 0.5, "N", [0.0, 1e3];
        /// Of the hands' moments.
        hand_moment: f64 = 0.05, "N.m", [0.0, 1e3];
    }
}

variables! {
    struct Settings {
        /// The person and what happens.
        plant: Plant;
        /// Sensors.
        noise: Deviations;
    }
}

const RATE: f64 = 240.0;
/// Bend of each joint at the deepest point, rad.
const BOW: [(&str, f64); 14] = [
    ("jRightHip_roty", -0.62),
    ("jLeftHip_roty", -0.62),
    ("jRightAnkle_roty", 0.09),
    ("jLeftAnkle_roty", 0.09),
    ("jRightKnee_roty", -0.02),
    ("jLeftKnee_roty", -0.02),
    ("jL5S1_roty", 0.22),
    ("jL4L3_roty", 0.14),
    ("jL1T12_roty", 0.12),
    ("jT9T8_roty", 0.10),
    ("jT1C7_roty", 0.08),
    ("jC1Head_roty", 0.05),
    ("jRightShoulder_roty", -0.9),
    ("jLeftShoulder_roty", -0.9),
];
/// Links with an accelerometer: all that have a mass and are not the fixed foot.
const IMU_AT: [f64; 3] = [0.03, 0.02, -0.05];
const HAND_AT: [f64; 3] = [0.0, 0.0, -0.08];
const HANDS: [(&str, &str); 2] = [("right_hand", "RightHand"), ("left_hand", "LeftHand")];
const PARTS: [&str; 6] = ["force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"];

fn read(request: &Request) -> Result<Settings, SimulateError> {
    let mut all = Settings::default();
    for (name, value) in &request.settings {
        all.set(name, *value)?;
    }
    if all.plant.window % 2 == 0 {
        let reason = "is even; the window needs an odd number of samples".to_owned();
        let (name, value) = ("plant.window".to_owned(), f64::from(all.plant.window));
        return Err(wheelstate::ParameterError { name, value, unit: "1", reason }.into());
    }
    Ok(all)
}

fn imu_links(body: &Description) -> Vec<String> {
    let massive = body.links.iter().filter(|l| l.mass > 0.0 && l.name != "LeftFoot");
    massive.map(|l| l.name.clone()).filter(|n| !n.contains("Toe") && !n.contains("Hand")).collect()
}

/// Bend of a joint with rate and acceleration: a raised cosine, softly modulated so that no two bows
/// are alike.
fn bend(plant: &Plant, depth: f64, t: f64) -> [f64; 3] {
    let (w, slow) = (TAU / plant.period, 0.37);
    let (s, c) = (w * t).sin_cos();
    let base = [0.5 * (1.0 - c), 0.5 * w * s, 0.5 * w * w * c];
    let (ms, mc) = (slow * t).sin_cos();
    let slower = [1.0 + 0.1 * ms, 0.1 * slow * mc, -0.1 * slow * slow * ms];
    let scale = depth * plant.depth;
    [
        scale * base[0] * slower[0],
        scale * (base[1] * slower[0] + base[0] * slower[1]),
        scale * (base[2] * slower[0] + 2.0 * base[1] * slower[1] + base[0] * slower[2]),
    ]
}

pub(super) fn simulate(request: &Request) -> Result<Log, SimulateError> {
    let Settings { plant, noise } = read(request)?;
    let body = human48(&BodyParameters { height: plant.height, mass: plant.mass });
    let mut heavier = body.clone();
    for link in heavier.links.iter_mut().filter(|l| l.name == "T8") {
        // the weight sits in the segment's centre of mass
        link.mass += plant.extra_mass;
    }
    let person = Person::new(&heavier, "LeftFoot", Vector3::new(0.0, 0.0, -GRAVITY));
    let count = (f64::from(plant.repetitions) * plant.period * RATE) as usize + 1;
    let time: Vec<f64> = (0..count).map(|k| k as f64 / RATE).collect();
    let mut draw = Noise::new(request.seed);

    let mut record = Record::new(count);
    let n = person.joints.len();
    let imus: Vec<_> = imu_links(&body).iter().map(|l| person.place(l, &Vector3::from(IMU_AT))).collect();
    let hands = HANDS.map(|(_, link)| person.place(link, &Vector3::from(HAND_AT)));
    let (right, right_sole) = person.place("RightFoot", &Vector3::zeros());
    let gravity = person.rooted.body.gravity;
    for &t in &time {
        let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for (name, depth) in BOW {
            let k = person.joint(name);
            [q[k], qd[k], qdd[k]] = bend(&plant, depth, t);
        }
        let bow = bend(&plant, 1.0, t)[0];
        let load = Vector3::new(2.0 * bow, 0.0, -plant.hand_force * bow);
        let mut pushes: Vec<Push> = (hands.iter())
            .map(|&(segment, at)| Push { segment, at, force: load, moment: Vector3::new(0.0, 0.5 * bow, 0.0) })
            .collect();
        // both feet carry the same: half of the force, and what moment is left after its arm
        let rest = BaseMotion::rest();
        let (_, alone) = person.rooted.body.inverse(&rest, &q, &qd, &qdd, &pushes);
        let arm = alone[right].position + alone[right].rotation * right_sole;
        let force = alone[0].force * 0.5;
        let moment = (alone[0].moment - arm.cross(&force)) * 0.5;
        pushes.push(Push { segment: right, at: right_sole, force, moment });
        let (torque, states) = person.rooted.body.inverse(&rest, &q, &qd, &qdd, &pushes);

        record.rows("q", q.iter().map(|q| q + draw.of(noise.position)));
        record.rows("tau", torque.iter().copied());
        let imu = imus.iter().flat_map(|(segment, at)| {
            let a = states[*segment].specific_force(at, &gravity);
            [a.x, a.y, a.z]
        });
        record.rows("imu", imu.map(|a| a + draw.of(noise.accel)));
        let mut wrench =
            |segment: usize, at: &Vector3<f64>, force: &Vector3<f64>, about: &Vector3<f64>, std: [f64; 2]| {
                let mut seen = states[segment].seen_at(at, force, about);
                seen.iter_mut().enumerate().for_each(|(k, v)| *v += draw.of(std[k / 3]));
                seen
            };
        let plates = [noise.plate_force, noise.plate_moment];
        let about = |at: &Vector3<f64>, segment: usize, f: &Vector3<f64>, m: &Vector3<f64>| {
            m + (states[segment].rotation * at).cross(f)
        };
        let ground = [
            wrench(0, &Vector3::zeros(), &states[0].force, &states[0].moment, plates),
            wrench(right, &right_sole, &force, &about(&right_sole, right, &force, &moment), plates),
        ];
        record.rows("plates", ground.concat().into_iter());
        for (push, &(segment, at)) in pushes.iter().zip(&hands) {
            let moment = about(&at, segment, &push.force, &push.moment);
            let seen = wrench(segment, &at, &push.force, &moment, [noise.hand_force, noise.hand_moment]);
            record.rows("hands", seen.into_iter());
        }
    }
    Ok(record.into_log(request, time, &person, &body, &plant))
}

/// Samples by kind, row by row.
struct Record {
    rows: usize,
    kinds: Vec<(&'static str, Vec<f64>)>,
}

impl Record {
    fn new(rows: usize) -> Self {
        Self { rows, kinds: vec![] }
    }

    fn rows(&mut self, kind: &'static str, values: impl Iterator<Item = f64>) {
        let known = self.kinds.iter().position(|(name, _)| *name == kind);
        let place = known.unwrap_or_else(|| {
            self.kinds.push((kind, vec![]));
            self.kinds.len() - 1
        });
        self.kinds[place].1.extend(values);
    }

    fn column(&self, kind: &str, k: usize) -> Vec<f64> {
        let Some((_, values)) = self.kinds.iter().find(|(name, _)| *name == kind) else { return vec![] };
        let width = values.len() / self.rows;
        (0..self.rows).map(|row| values[row * width + k]).collect()
    }

    fn into_log(self, request: &Request, time: Vec<f64>, person: &Person, body: &Description, plant: &Plant) -> Log {
        let mut log = Log { source: request.scenario.clone(), time: time.into(), ..Log::default() };
        let window = plant.window as usize;
        for (k, joint) in person.joints.iter().enumerate() {
            let q = self.column("q", k);
            log.push(&format!("qd_{joint}"), smooth(&q, window, 1, 1.0 / RATE));
            log.push(&format!("qdd_{joint}"), smooth(&q, window, 2, 1.0 / RATE));
            log.push(&format!("q_{joint}"), q);
        }
        for (k, link) in imu_links(body).iter().enumerate() {
            for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                log.push(&format!("imu_{link}_accel_{name}"), self.column("imu", 3 * k + axis));
            }
        }
        for (k, plate) in ["left_plate", "right_plate"].iter().enumerate() {
            for (part, name) in PARTS.iter().enumerate() {
                log.push(&format!("{plate}_{name}"), self.column("plates", 6 * k + part));
            }
        }
        for (k, (hand, _)) in HANDS.iter().enumerate() {
            for (part, name) in PARTS.iter().enumerate() {
                log.push(&format!("{hand}_{name}"), self.column("hands", 6 * k + part));
            }
        }
        for (k, joint) in person.joints.iter().enumerate() {
            log.push(&format!("true_tau_{joint}"), self.column("tau", k));
        }
        log
    }
}

/// The body without the extra weight, and its sensors with the simulated noise.
pub(super) fn companions(request: &Request) -> Result<Vec<Companion>, SimulateError> {
    let Settings { plant, noise } = read(request)?;
    let body = human48(&BodyParameters { height: plant.height, mass: plant.mass });
    let weights =
        wheelstate::filter::savitzky_golay::weights(plant.window as usize, plant.window as usize / 2, 2, 1.0 / RATE);
    let floor = |variance: f64| variance.max(1e-10);
    let qdd = floor(noise.position.powi(2) * weights.iter().map(|w| w * w).sum::<f64>());
    let two = |force: f64, moment: f64| {
        let (f, m) = (floor(force * force), floor(moment * moment));
        format!("[{f:?}, {f:?}, {f:?}, {m:?}, {m:?}, {m:?}]")
    };
    let list = |stem: &str, parts: &[&str]| {
        let names: Vec<String> = parts.iter().map(|part| format!("\"{stem}_{part}\"")).collect();
        format!("[{}]", names.join(", "))
    };
    let mut toml = format!(
        "# Sensors of the bowing scenario: left foot fixed on a plate, right foot on another one.\n\
         base = \"LeftFoot\"\nvariant = \"fixed\"\ngravity = [0, 0, {:?}]\n\n[variance]\nacceleration = 1e-4\n\
         net_wrench = 1e-4\nwrench_balance = 1e-4\ntorque = 1e-4\nprior = 1e4\n",
        -GRAVITY
    );
    for joint in &body.joints {
        let name = &joint.name;
        toml += &format!(
            "\n[[sensor]]\ntype = \"joint_acceleration\"\njoint = \"{name}\"\nvariance = {qdd:?}\ncolumns = [\"qdd_{name}\"]\n"
        );
    }
    let touched = ["LeftFoot", "RightFoot", "RightHand", "LeftHand"];
    for link in body.links.iter().filter(|l| !touched.contains(&l.name.as_str())) {
        toml += &format!(
            "\n[[sensor]]\ntype = \"net_ext_wrench\"\nlink = \"{}\"\nvariance = 1e-6\nvalue = 0.0\n",
            link.name
        );
    }
    for (_, link) in HANDS {
        toml += &format!("\n[[prior]] # of the wrench on a hand\nlink = \"{link}\"\nforce = 3600.0\nmoment = 25.0\n");
    }
    let plates = two(noise.plate_force, noise.plate_moment);
    for (plate, link) in [("left_plate", "LeftFoot"), ("right_plate", "RightFoot")] {
        toml += &format!(
            "\n[[sensor]]\ntype = \"net_ext_wrench\"\nname = \"{plate}\"\nlink = \"{link}\"\nvariance = {plates}\ncolumns = {}\n",
            list(plate, &PARTS)
        );
    }
    for link in imu_links(&body) {
        toml += &format!(
            "\n[[sensor]]\ntype = \"accelerometer\"\nlink = \"{link}\"\nxyz = {IMU_AT:?}\nvariance = {:?}\ncolumns = {}\n",
            floor(noise.accel.powi(2)),
            list(&format!("imu_{link}_accel"), &["x", "y", "z"])
        );
    }
    let hands = two(noise.hand_force, noise.hand_moment);
    for (hand, link) in HANDS {
        toml += &format!(
            "\n[[sensor]]\ntype = \"net_ext_wrench\"\nname = \"{hand}\"\nlink = \"{link}\"\nxyz = {HAND_AT:?}\nvariance = {hands}\ncolumns = {}\n",
            list(hand, &PARTS)
        );
    }
    Ok(vec![("urdf", urdf::write(&body)), ("sensors.toml", toml)])
}
