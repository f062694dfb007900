//! The plant of a described body, and the noise of its sensors.

use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::model::multibody::tree::Description;
use wheelstate::plant::human_dynamics::{Hinge, Lump, Rooted};

/// A described body as plant, standing on one link.
pub(super) struct Person {
    pub rooted: Rooted,
    links: Vec<String>,
    /// Joint names in the order of the plant's joints.
    pub joints: Vec<String>,
}

impl Person {
    pub fn new(description: &Description, base: &str, gravity: Vector3<f64>) -> Self {
        let number = |name: &str| description.links.iter().position(|l| l.name == name).unwrap_or(0);
        let lumps: Vec<Lump> = (description.links.iter())
            .map(|l| {
                let [xx, xy, xz, yy, yz, zz] = l.inertia;
                let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
                Lump { mass: l.mass, com: Vector3::from(l.com), inertia }
            })
            .collect();
        let hinges: Vec<Hinge> = (description.joints.iter())
            .map(|j| Hinge {
                parent: number(&j.parent),
                child: number(&j.child),
                origin: Vector3::from(j.xyz),
                rotation: *Rotation3::from_euler_angles(j.rpy[0], j.rpy[1], j.rpy[2]).matrix(),
                axis: Vector3::from(j.axis).normalize(),
            })
            .collect();
        let rooted = Rooted::new(&lumps, &hinges, number(base), gravity);
        let joints = rooted.hinge.iter().map(|&h| description.joints[h].name.clone()).collect();
        Self { rooted, links: description.links.iter().map(|l| l.name.clone()).collect(), joints }
    }

    /// Segment of a link and the place of the link's point in the segment's axes.
    pub fn place(&self, link: &str, at: &Vector3<f64>) -> (usize, Vector3<f64>) {
        let number = self.links.iter().position(|l| l == link).unwrap_or(0);
        (self.rooted.segment[number], self.rooted.place[number] + at)
    }

    /// Number of a joint.
    pub fn joint(&self, name: &str) -> usize {
        self.joints.iter().position(|j| j == name).unwrap_or(0)
    }
}

/// White noise from one seed.
pub(super) struct Noise(ChaCha8Rng);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub fn of(&mut self, std: f64) -> f64 {
        let draw: f64 = StandardNormal.sample(&mut self.0);
        std * draw
    }
}

/// From 0 to 1 between two times, with continuous acceleration, and back to 0 likewise.
pub(super) fn plateau(t: f64, rise: (f64, f64), fall: (f64, f64)) -> f64 {
    step(t, rise) - step(t, fall)
}

/// From 0 to 1 between two times, with continuous acceleration.
pub(super) fn step(t: f64, (from, to): (f64, f64)) -> f64 {
    let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}
