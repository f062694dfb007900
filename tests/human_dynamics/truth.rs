//! Descriptions as plants. The simulations of `identify` turn theirs into plants once more: `plant` may not know the
//! model's descriptions, and the core's tests cannot know `identify`.

use nalgebra::{Matrix3, Rotation3, Vector3};
use wheelstate::model::multibody::tree::Description;
use wheelstate::plant::human_dynamics::{Hinge, Lump, Rooted};

pub fn rooted(description: &Description, base: &str, gravity: Vector3<f64>) -> Rooted {
    let number = |name: &str| description.links.iter().position(|l| l.name == name).unwrap();
    let lumps: Vec<Lump> = (description.links.iter())
        .map(|l| {
            let i = l.inertia;
            let inertia = Matrix3::new(i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5]);
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
    Rooted::new(&lumps, &hinges, number(base), gravity)
}
