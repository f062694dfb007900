//! Bodies from URDF files.

use super::EstimateError;
use nalgebra::Matrix3;
use std::path::Path;
use urdf_rs::JointType;
use wheelstate::model::multibody::spatial::rpy_rotation;
use wheelstate::model::multibody::tree::{Description, Joint, JointKind, Link};

/// Reads a URDF file: links, inertias and joints; shapes, limits and materials are left out. A
/// joint that mimics another one counts as one of its own.
pub fn read(path: &Path) -> Result<Description, EstimateError> {
    let file = path.display().to_string();
    let fail = |what: String| EstimateError::new(&file, what.replace('\n', " "));
    let text = std::fs::read_to_string(path).map_err(|e| fail(format!("cannot be read: {e}")))?;
    let robot = urdf_rs::read_from_string(&text).map_err(|e| fail(format!("is no URDF: {e}")))?;
    Ok(Description {
        name: robot.name,
        links: robot.links.iter().map(link).collect(),
        joints: robot.joints.iter().map(joint).collect(),
    })
}

fn link(link: &urdf_rs::Link) -> Link {
    let i = &link.inertial.inertia;
    let own = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    // the inertia is given in axes that may be turned against the link's
    let rpy = link.inertial.origin.rpy.0;
    let r = rpy_rotation(&rpy);
    let turned = if rpy == [0.0; 3] { own } else { r * own * r.transpose() };
    Link {
        name: link.name.clone(),
        mass: link.inertial.mass.value,
        com: link.inertial.origin.xyz.0,
        inertia: [turned.m11, turned.m12, turned.m13, turned.m22, turned.m23, turned.m33],
    }
}

fn joint(joint: &urdf_rs::Joint) -> Joint {
    let kind = match &joint.joint_type {
        JointType::Revolute | JointType::Continuous => JointKind::Revolute,
        JointType::Prismatic => JointKind::Prismatic,
        JointType::Fixed => JointKind::Fixed,
        JointType::Floating => JointKind::Other("floating".to_owned()),
        JointType::Planar => JointKind::Other("planar".to_owned()),
        JointType::Spherical => JointKind::Other("spherical".to_owned()),
    };
    Joint {
        name: joint.name.clone(),
        kind,
        parent: joint.parent.link.clone(),
        child: joint.child.link.clone(),
        xyz: joint.origin.xyz.0,
        rpy: joint.origin.rpy.0,
        axis: joint.axis.xyz.0,
    }
}

/// A description as URDF text.
pub fn write(description: &Description) -> String {
    let three = |v: &[f64; 3]| format!("{:?} {:?} {:?}", v[0], v[1], v[2]);
    let mut text = format!("<robot name=\"{}\">\n", description.name);
    for link in &description.links {
        let [xx, xy, xz, yy, yz, zz] = link.inertia;
        text += &format!(
            "  <link name=\"{}\"><inertial><origin xyz=\"{}\" rpy=\"0 0 0\"/><mass value=\"{:?}\"/><inertia \
             ixx=\"{xx:?}\" ixy=\"{xy:?}\" ixz=\"{xz:?}\" iyy=\"{yy:?}\" iyz=\"{yz:?}\" izz=\"{zz:?}\"/></inertial></link>\n",
            link.name,
            three(&link.com),
            link.mass,
        );
    }
    for joint in &description.joints {
        let kind = match &joint.kind {
            JointKind::Revolute => "revolute",
            JointKind::Prismatic => "prismatic",
            JointKind::Fixed => "fixed",
            JointKind::Other(kind) => kind,
        };
        text += &format!(
            "  <joint name=\"{}\" type=\"{kind}\"><parent link=\"{}\"/><child link=\"{}\"/><origin xyz=\"{}\" \
             rpy=\"{}\"/><axis xyz=\"{}\"/><limit effort=\"1000\" velocity=\"100\" lower=\"-3.2\" upper=\"3.2\"/></joint>\n",
            joint.name,
            joint.parent,
            joint.child,
            three(&joint.xyz),
            three(&joint.rpy),
            three(&joint.axis),
        );
    }
    text + "</robot>\n"
}
