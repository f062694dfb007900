//! The built-in bodies against the reference models: names, masses, inertias, centre of mass.

use super::cases::*;
use nalgebra::Vector3;
use wheelstate::model::multibody::anthropometry::{BodyParameters, human48, seated12};
use wheelstate::model::multibody::equations::{Base, Equations};
use wheelstate::model::multibody::tree::Tree;

#[test]
fn generated_bodies_are_the_reference_models() {
    let person = BodyParameters { height: 1.70, mass: 65.0 };
    for (generated, name) in [(human48(&person), "human48"), (seated12(&person), "seated12")] {
        let expected = model(name);
        assert_eq!(generated.name, expected.name);
        for (a, b) in generated.links.iter().zip(&expected.links) {
            assert_eq!(a.name, b.name);
            assert!((a.mass - b.mass).abs() < 1e-12, "{}: {} {}", a.name, a.mass, b.mass);
            assert!(largest_difference(&a.com, &b.com) < 1e-12, "{}: {:?} {:?}", a.name, a.com, b.com);
            assert!(largest_difference(&a.inertia, &b.inertia) < 1e-12, "{}: {:?} {:?}", a.name, a.inertia, b.inertia);
        }
        for (a, b) in generated.joints.iter().zip(&expected.joints) {
            assert_eq!((&a.name, &a.parent, &a.child, &a.kind), (&b.name, &b.parent, &b.child, &b.kind));
            assert!(largest_difference(&a.xyz, &b.xyz) < 1e-12, "{}: {:?} {:?}", a.name, a.xyz, b.xyz);
            assert_eq!((a.rpy, a.axis), (b.rpy, b.axis));
        }
        assert_eq!(generated.links.len(), expected.links.len());
        assert_eq!(generated.joints.len(), expected.joints.len());
    }
}

#[test]
fn masses_add_up() {
    for (height, mass) in [(1.5, 48.0), (1.67, 61.1), (2.0, 130.0)] {
        for body in [human48(&BodyParameters { height, mass }), seated12(&BodyParameters { height, mass })] {
            let sum: f64 = body.links.iter().map(|l| l.mass).sum();
            assert!((sum - mass).abs() < 1e-12 * mass);
            let tree = Tree::new(&body, "Pelvis", false, &[]).unwrap();
            assert!(tree.warnings.is_empty());
            assert!((tree.mass() - mass).abs() < 1e-12 * mass);
        }
    }
}

#[test]
fn the_centre_of_mass_is_that_of_the_reference() {
    for name in CASES {
        let mut case = case(name);
        case.step(false);
        let (com, _) = case.body.equations().centre_of_mass();
        let off = largest_difference(com.as_slice(), &numbers(&case.data["com_base"]));
        assert!(off < 1e-12, "{name}: {off:e}");
    }
}

#[test]
fn velocity_of_the_centre_of_mass_is_its_difference_quotient() {
    let tree = Tree::new(&human48(&BodyParameters::default()), "LeftFoot", false, &[]).unwrap();
    let n = tree.dof();
    let q: Vec<f64> = (0..n).map(|i| 0.3 * (i as f64).sin()).collect();
    let qd: Vec<f64> = (0..n).map(|i| (1.7 * i as f64).cos()).collect();
    let mut equations = Equations::new(tree, Base::Fixed(Vector3::new(0.0, 0.0, -9.81)), vec![]).unwrap();
    let zero = Vector3::zeros();
    let h = 1e-6;
    let mut at = |t: f64| {
        let moved: Vec<f64> = q.iter().zip(&qd).map(|(q, qd)| q + t * qd).collect();
        equations.update(&moved, &qd, &zero);
        equations.centre_of_mass()
    };
    let (after, before, here) = (at(h), at(-h), at(0.0));
    let quotient = (after.0 - before.0) / (2.0 * h);
    assert!((quotient - here.1).norm() < 1e-8, "{quotient} {}", here.1);
}
