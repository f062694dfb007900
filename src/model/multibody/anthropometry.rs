//! A human body from height and mass: 23 segments with 48 degrees of freedom, or a seated body of
//! 12 with 19.
//!
//! Mass fractions, centres of mass, radii of gyration and lengths of the limbs and the mass of the
//! trunk's groups are the facts tabulated by Winter, *Biomechanics and Motor Control of Human
//! Movement* (4th ed. 2009), table 4.1 and figure 4.1. Choices of this project: how trunk and foot
//! split into segments, the heights of the trunk's joints, the boxes that give the trunk, the head
//! and the feet their inertias, the limbs' radii, and the half widths of hips and shoulders. They
//! are written below as fractions of the height.
//!
//! Axes: x forward, y left, z up. Zero posture: upright with the arms hanging; seated with the
//! thighs forward and the shanks hanging.

use super::spatial::{Inertia, Pose};
use super::tree::{Description, Joint, JointKind, Link};
use nalgebra::{Matrix3, Vector3};

variables! {
    /// The person.
    #[derive(Copy)]
    pub struct BodyParameters {
        /// Height of the person.
        height: f64 = 1.70, "m", [0.5, 2.6], essential;
        /// Mass of the person.
        mass: f64 = 65.0, "kg", [5.0, 400.0], essential;
    }
}

const HIP_HEIGHT: f64 = 0.530;
const SHOULDER_HEIGHT: f64 = 0.818;
const HIP_HALF_WIDTH: f64 = 0.04775;
const SHOULDER_HALF_WIDTH: f64 = 0.129;
const COLLAR_HALF_WIDTH: f64 = 0.020;
const KNEE_TO_ANKLE: f64 = 0.246;
const ANKLE_HEIGHT: f64 = 0.039;
const FOOT: f64 = 0.152;
const FOOT_WIDTH: f64 = 0.055;
/// Heights of the trunk's joints.
const L5: f64 = 0.585;
const L3: f64 = 0.622;
const T12: f64 = 0.668;
const T8: f64 = 0.727;
const NECK: f64 = 0.845;
const HEAD: f64 = 0.895;

/// A limb: fraction of the mass, length, centre of mass from the joint above per length, radius of
/// gyration per length, radius.
struct Limb {
    mass: f64,
    length: f64,
    com: f64,
    gyration: f64,
    radius: f64,
}

const UPPER_ARM: Limb = Limb { mass: 0.028, length: 0.186, com: 0.436, gyration: 0.322, radius: 0.026 };
const FOREARM: Limb = Limb { mass: 0.016, length: 0.146, com: 0.430, gyration: 0.303, radius: 0.020 };
const HAND: Limb = Limb { mass: 0.006, length: 0.108, com: 0.506, gyration: 0.297, radius: 0.016 };
const THIGH: Limb = Limb { mass: 0.100, length: 0.245, com: 0.433, gyration: 0.323, radius: 0.042 };
const SHANK: Limb = Limb { mass: 0.0465, length: KNEE_TO_ANKLE, com: 0.433, gyration: 0.302, radius: 0.028 };

/// One body piece in its segment's frame: mass, centre of mass, inertia about it.
#[derive(Clone, Copy)]
struct Piece {
    mass: f64,
    com: Vector3<f64>,
    about: Matrix3<f64>,
}

impl Piece {
    fn seen_at(self, x: f64, z: f64) -> Self {
        Self { com: self.com + Vector3::new(x, 0.0, z), ..self }
    }

    fn with(self, other: Self) -> Self {
        let at = |p: &Self, c: &Vector3<f64>| Inertia::from_centre(p.mass, &(p.com - c), &p.about).rotational;
        let mass = self.mass + other.mass;
        let com = (self.com * self.mass + other.com * other.mass) / mass;
        Self { mass, com, about: at(&self, &com) + at(&other, &com) }
    }
}

/// Scale of a person, and the description being written.
struct Body {
    height: f64,
    mass: f64,
    description: Description,
}

impl Body {
    fn new(name: &str, height: f64, mass: f64) -> Self {
        let name = format!("{name}_{height:.2}m_{mass:.1}kg");
        Self { height, mass, description: Description { name, links: vec![], joints: vec![] } }
    }

    /// A limb along `axis` (0 for x, 1 for y, 2 for z), pointing along `sign`.
    fn limb(&self, limb: &Limb, axis: usize, sign: f64) -> Piece {
        let (mass, length) = (limb.mass * self.mass, limb.length * self.height);
        let across = mass * (limb.gyration * length).powi(2);
        let along = 0.5 * mass * (limb.radius * self.height).powi(2);
        let mut com = Vector3::zeros();
        com[axis] = sign * limb.com * length;
        let mut moments = Vector3::repeat(across);
        moments[axis] = along;
        Piece { mass, com, about: Matrix3::from_diagonal(&moments) }
    }

    /// A box with its centre at `com`; all as fractions.
    fn cuboid(&self, mass: f64, size: [f64; 3], com: [f64; 3]) -> Piece {
        let mass = mass * self.mass;
        let square = size.map(|s| (s * self.height).powi(2));
        let sum = square[0] + square[1] + square[2];
        let moments = Vector3::from(square.map(|own| mass / 12.0 * (sum - own)));
        Piece { mass, com: Vector3::from(com) * self.height, about: Matrix3::from_diagonal(&moments) }
    }

    /// A piece of trunk between two joint heights.
    fn trunk(&self, mass: f64, depth: f64, width: f64, low: f64, high: f64) -> Piece {
        self.cuboid(mass, [depth, width, high - low], [0.0, 0.0, 0.5 * (high - low)])
    }

    fn link(&mut self, name: &str, piece: &Piece) {
        let i = &piece.about;
        let inertia = [i[(0, 0)], i[(0, 1)], i[(0, 2)], i[(1, 1)], i[(1, 2)], i[(2, 2)]];
        let com = [piece.com.x, piece.com.y, piece.com.z];
        self.description.links.push(Link { name: name.to_owned(), mass: piece.mass, com, inertia });
    }

    /// A segment behind a joint with the axes named in `axes`; massless links stand between them.
    fn segment(&mut self, parent: &str, joint: &str, axes: &str, name: &str, at: [f64; 3], piece: &Piece) {
        let mut parent = parent.to_owned();
        let last = axes.len() - 1;
        for (k, axis) in axes.chars().enumerate() {
            let child = if k == last { name.to_owned() } else { format!("{name}_f{}", k + 1) };
            if k == last {
                self.link(&child, piece);
            } else {
                self.link(&child, &Piece { mass: 0.0, com: Vector3::zeros(), about: Matrix3::zeros() });
            }
            let unit = |of: char| f64::from(u8::from(axis == of));
            self.description.joints.push(Joint {
                name: format!("{joint}_rot{axis}"),
                kind: JointKind::Revolute,
                parent,
                child: child.clone(),
                xyz: if k == 0 { at.map(|x| x * self.height) } else { [0.0; 3] },
                rpy: [0.0; 3],
                axis: [unit('x'), unit('y'), unit('z')],
            });
            parent = child;
        }
    }
}

/// Both sides of the body: name and sign of y.
const SIDES: [(&str, f64); 2] = [("Right", -1.0), ("Left", 1.0)];

/// The standing body: 23 segments, 48 degrees of freedom; root `Pelvis`.
pub fn human48(person: &BodyParameters) -> Description {
    let mut body = Body::new("human48", person.height, person.mass);
    let pelvis = body.trunk(0.142, 0.100, 0.174, HIP_HEIGHT, L5);
    body.link("Pelvis", &pelvis);
    let up = |from: f64, to: f64| [0.0, 0.0, to - from];
    let trunk = [
        ("Pelvis", "jL5S1", "xy", "L5", up(HIP_HEIGHT, L5), body.trunk(0.0695, 0.095, 0.160, L5, L3)),
        ("L5", "jL4L3", "xy", "L3", up(L5, L3), body.trunk(0.0695, 0.095, 0.160, L3, T12)),
        ("L3", "jL1T12", "xy", "T12", up(L3, T12), body.trunk(0.072, 0.105, 0.165, T12, T8)),
        ("T12", "jT9T8", "xyz", "T8", up(T12, T8), body.trunk(0.088, 0.105, 0.170, T8, NECK)),
        ("T8", "jT1C7", "xyz", "Neck", up(T8, NECK), body.trunk(0.017, 0.065, 0.065, NECK, HEAD)),
        ("Neck", "jC1Head", "xy", "Head", up(NECK, HEAD), body.trunk(0.064, 0.105, 0.085, HEAD, 1.0)),
    ];
    for (parent, joint, axes, name, at, piece) in &trunk {
        body.segment(parent, joint, axes, name, *at, piece);
    }
    for (side, y) in SIDES {
        let own = |name: &str| format!("{side}{name}");
        let joint = |name: &str| format!("j{side}{name}");
        let reach = SHOULDER_HALF_WIDTH - COLLAR_HALF_WIDTH;
        let shoulder = body.cuboid(0.028, [0.06, reach, 0.06], [0.0, 0.5 * y * reach, 0.0]);
        let collar = [0.0, y * COLLAR_HALF_WIDTH, SHOULDER_HEIGHT - T8];
        body.segment("T8", &joint("C7Shoulder"), "x", &own("Shoulder"), collar, &shoulder);
        let arm = [UPPER_ARM, FOREARM, HAND].map(|limb| body.limb(&limb, 2, -1.0));
        body.segment(&own("Shoulder"), &joint("Shoulder"), "xyz", &own("UpperArm"), [0.0, y * reach, 0.0], &arm[0]);
        body.segment(&own("UpperArm"), &joint("Elbow"), "yz", &own("ForeArm"), [0.0, 0.0, -UPPER_ARM.length], &arm[1]);
        body.segment(&own("ForeArm"), &joint("Wrist"), "xz", &own("Hand"), [0.0, 0.0, -FOREARM.length], &arm[2]);
    }
    for (side, y) in SIDES {
        let own = |name: &str| format!("{side}{name}");
        let joint = |name: &str| format!("j{side}{name}");
        let leg = [THIGH, SHANK].map(|limb| body.limb(&limb, 2, -1.0));
        // the ankle stands over the rear quarter of the foot, the toes are its front quarter
        let quarter = 0.25 * FOOT;
        let foot =
            body.cuboid(0.0125, [3.0 * quarter, FOOT_WIDTH, ANKLE_HEIGHT], [0.5 * quarter, 0.0, -0.5 * ANKLE_HEIGHT]);
        let thin = 0.3 * ANKLE_HEIGHT;
        let toe = body.cuboid(0.002, [quarter, FOOT_WIDTH, thin], [0.5 * quarter, 0.0, -0.5 * thin]);
        let hip = [0.0, y * HIP_HALF_WIDTH, 0.0];
        body.segment("Pelvis", &joint("Hip"), "xyz", &own("UpperLeg"), hip, &leg[0]);
        body.segment(&own("UpperLeg"), &joint("Knee"), "yz", &own("LowerLeg"), [0.0, 0.0, -THIGH.length], &leg[1]);
        body.segment(&own("LowerLeg"), &joint("Ankle"), "xyz", &own("Foot"), [0.0, 0.0, -SHANK.length], &foot);
        let ball = [2.0 * quarter, 0.0, thin - ANKLE_HEIGHT];
        body.segment(&own("Foot"), &joint("BallFoot"), "y", &own("Toe"), ball, &toe);
    }
    body.description
}

/// The seated body: pelvis and 11 segments, 19 degrees of freedom; root `Pelvis`.
pub fn seated12(person: &BodyParameters) -> Description {
    let mut body = Body::new("seated12", person.height, person.mass);
    let pelvis = body.trunk(0.142, 0.100, 0.174, HIP_HEIGHT, L5);
    body.link("Pelvis", &pelvis);
    let up = |from: f64, to: f64| [0.0, 0.0, to - from];
    let lumbar = body.trunk(0.139, 0.095, 0.160, L5, T12);
    body.segment("Pelvis", "jLumbar", "xy", "Lumbar", up(HIP_HEIGHT, L5), &lumbar);
    let thorax = body.trunk(0.216, 0.105, 0.170, T12, NECK);
    body.segment("Lumbar", "jThorax", "yz", "Thorax", up(L5, T12), &thorax);
    let head = body.trunk(0.081, 0.105, 0.085, NECK, 1.0);
    body.segment("Thorax", "jNeck", "xyz", "Head", up(T12, NECK), &head);
    for (side, y) in SIDES {
        let own = |name: &str| format!("{side}{name}");
        let upper = body.limb(&UPPER_ARM, 2, -1.0);
        let shoulder = [0.0, y * SHOULDER_HALF_WIDTH, SHOULDER_HEIGHT - T12];
        body.segment("Thorax", &format!("j{side}Shoulder"), "xyz", &own("UpperArm"), shoulder, &upper);
        let hand = body.limb(&HAND, 2, -1.0).seen_at(0.0, -FOREARM.length * person.height);
        let lower = body.limb(&FOREARM, 2, -1.0).with(hand);
        let elbow = [0.0, 0.0, -UPPER_ARM.length];
        body.segment(&own("UpperArm"), &format!("j{side}Elbow"), "y", &own("ForeArm"), elbow, &lower);
    }
    for (side, y) in SIDES {
        let own = |name: &str| format!("{side}{name}");
        let thigh = body.limb(&THIGH, 0, 1.0);
        let hip = [0.0, y * HIP_HALF_WIDTH, 0.0];
        body.segment("Pelvis", &format!("j{side}Hip"), "y", &own("Thigh"), hip, &thigh);
        let foot = body.cuboid(
            0.0145,
            [FOOT, FOOT_WIDTH, ANKLE_HEIGHT],
            [0.25 * FOOT, 0.0, -SHANK.length - 0.5 * ANKLE_HEIGHT],
        );
        let shank = body.limb(&SHANK, 2, -1.0).with(foot);
        body.segment(&own("Thigh"), &format!("j{side}Knee"), "y", &own("Shank"), [THIGH.length, 0.0, 0.0], &shank);
    }
    body.description
}

/// The pose of a frame in its link, from its origin.
pub fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose { origin: Vector3::new(x, y, z), ..Pose::identity() }
}
