//! Bodies from URDF files.
//!
//! Only what dynamics needs is looked at: links with their inertias, joints with their frames and axes. Shapes, materials,
//! limits, transmissions and whatever else a file holds never refuse it.

use super::EstimateError;
use nalgebra::Matrix3;
use roxmltree::{Document, Node};
use std::path::Path;
use wheelstate::model::multibody::spatial::rpy_rotation;
use wheelstate::model::multibody::tree::{Description, Joint, JointKind, Link};

/// Reads a URDF file: links, inertias and joints, in m, kg, kg.m2 and rad as the format has them. A joint that mimics
/// another one counts as one of its own. Errors name file, line and link or joint.
pub fn read(path: &Path) -> Result<Description, EstimateError> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|e| EstimateError::new(&file, format!("cannot be read: {e}")))?;
    parse(&file, &text)
}

/// Parses the text of a URDF file; `file` is named in errors.
fn parse(file: &str, text: &str) -> Result<Description, EstimateError> {
    let fail = |what: String| EstimateError::new(file, what.replace('\n', " "));
    let document = Document::parse(text).map_err(|e| fail(format!("is not a URDF: {e}")))?;
    let robot = document.root_element();
    let reader = Reader { file, document: &document };
    if document.descendants().any(|node| node.tag_name().namespace().is_some_and(|name| name.contains("xacro"))) {
        return Err(fail("is an unexpanded xacro file; `xacro FILE > body.urdf` expands it".to_owned()));
    }
    if robot.tag_name().name() != "robot" {
        return Err(fail(format!("is not a URDF: <robot> is expected, not <{}>", robot.tag_name().name())));
    }
    let elements = |name: &'static str| robot.children().filter(move |node| node.has_tag_name(name));
    Ok(Description {
        name: robot.attribute("name").unwrap_or_default().to_owned(),
        links: elements("link").map(|node| reader.link(node)).collect::<Result<_, _>>()?,
        joints: elements("joint").map(|node| reader.joint(node)).collect::<Result<_, _>>()?,
    })
}

/// Reads elements and knows the line of each.
struct Reader<'a> {
    file: &'a str,
    document: &'a Document<'a>,
}

impl Reader<'_> {
    fn fail(&self, node: Node, owner: &str, what: String) -> EstimateError {
        let line = self.document.text_pos_at(node.range().start).row;
        let what = format!("{owner}: {what}");
        EstimateError::new(&format!("{}:{line}", self.file), what.replace('\n', " "))
    }

    /// The name of a link or joint, and how to call it in errors.
    fn name(&self, node: Node) -> Result<(String, String), EstimateError> {
        let kind = node.tag_name().name();
        match node.attribute("name") {
            Some(name) => Ok((name.to_owned(), format!("{kind} '{}'", name.escape_debug()))),
            None => Err(self.fail(node, &format!("a {kind}"), "has no name".to_owned())),
        }
    }

    fn link(&self, node: Node) -> Result<Link, EstimateError> {
        let (name, owner) = self.name(node)?;
        let mut link = Link { name, mass: 0.0, com: [0.0; 3], inertia: [0.0; 6] };
        let Some(inertial) = child(node, "inertial") else { return Ok(link) };
        let origin = self.origin(inertial, &owner)?;
        link.com = origin.0;
        if let Some(mass) = child(inertial, "mass") {
            link.mass = self.number(mass, &owner, "value")?;
        }
        if let Some(inertia) = child(inertial, "inertia") {
            let entry = |key: &str| self.number(inertia, &owner, key);
            let (xx, xy, xz) = (entry("ixx")?, entry("ixy")?, entry("ixz")?);
            let (yy, yz, zz) = (entry("iyy")?, entry("iyz")?, entry("izz")?);
            let own = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            // the inertia is given in axes that may be rotated relative to the link's
            let r = rpy_rotation(&origin.1);
            let turned = if origin.1 == [0.0; 3] { own } else { r * own * r.transpose() };
            link.inertia = [turned.m11, turned.m12, turned.m13, turned.m22, turned.m23, turned.m33];
        }
        Ok(link)
    }

    fn joint(&self, node: Node) -> Result<Joint, EstimateError> {
        let (name, owner) = self.name(node)?;
        let kind = match node.attribute("type") {
            Some("revolute" | "continuous") => JointKind::Revolute,
            Some("prismatic") => JointKind::Prismatic,
            Some("fixed") => JointKind::Fixed,
            Some(other) => JointKind::Other(other.to_owned()),
            None => return Err(self.fail(node, &owner, "has no type".to_owned())),
        };
        let end = |key: &str| {
            let found = child(node, key).and_then(|node| node.attribute("link"));
            found.map(str::to_owned).ok_or_else(|| self.fail(node, &owner, format!("has no <{key} link=\"...\"/>")))
        };
        let (xyz, rpy) = self.origin(node, &owner)?;
        // The axis that the format takes without one.
        let axis = child(node, "axis").map_or(Ok([1.0, 0.0, 0.0]), |axis| self.three(axis, &owner, "xyz"))?;
        Ok(Joint { name, kind, parent: end("parent")?, child: end("child")?, xyz, rpy, axis })
    }

    /// Position, and roll, pitch, yaw; zeros where they are left out.
    fn origin(&self, node: Node, owner: &str) -> Result<([f64; 3], [f64; 3]), EstimateError> {
        let Some(origin) = child(node, "origin") else { return Ok(([0.0; 3], [0.0; 3])) };
        Ok((self.three(origin, owner, "xyz")?, self.three(origin, owner, "rpy")?))
    }

    fn number(&self, node: Node, owner: &str, key: &str) -> Result<f64, EstimateError> {
        let text = node.attribute(key).unwrap_or_default();
        let number = text.trim().parse().ok();
        let tag = node.tag_name().name();
        number
            .ok_or_else(|| self.fail(node, owner, format!("<{tag} {key}=\"{}\"> is not a number", text.escape_debug())))
    }

    /// Three numbers of an attribute, zeros if it is left out.
    fn three(&self, node: Node, owner: &str, key: &str) -> Result<[f64; 3], EstimateError> {
        let Some(text) = node.attribute(key) else { return Ok([0.0; 3]) };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        let tag = node.tag_name().name();
        let fail = || self.fail(node, owner, format!("<{tag} {key}=\"{}\"> is not three numbers", text.escape_debug()));
        numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(fail)
    }
}

/// The first element of this name in another.
fn child<'a, 'd>(node: Node<'a, 'd>, name: &str) -> Option<Node<'a, 'd>> {
    node.children().find(|child| child.has_tag_name(name))
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

#[cfg(test)]
mod tests {
    use super::*;

    const INERTIAL: &str = "<inertial><mass value=\"2\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>";

    fn body(link: &str, joint: &str) -> String {
        format!(
            "<robot name=\"r\">\n<link name=\"a\"/>\n<link name=\"b\">{INERTIAL}{link}</link>\n<joint name=\"j\" \
             type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 1 0\"/>{joint}</joint></robot>"
        )
    }

    #[test]
    fn what_dynamics_does_not_need_refuses_no_model() {
        let plain = parse("m.urdf", &body("", "")).unwrap();
        assert_eq!((plain.links[1].mass, plain.joints[0].axis), (2.0, [0.0, 1.0, 0.0]));
        let shape = "<geometry><box size=\"1 1 1\"/></geometry>";
        for (link, joint) in [
            (format!("<visual>{shape}<material name=\"m\"><texture/></material></visual>"), ""),
            (format!("<visual>{shape}<material><color rgba=\"1 0 0 1\"/></material></visual>"), ""),
            ("<visual><geometry><mesh/></geometry></visual>".to_owned(), ""),
            ("<collision><geometry><cylinder length=\"1\"/></geometry></collision>".to_owned(), ""),
            (format!("<visual><origin xyz=\"0 0 0\"/><origin xyz=\"0 0 0\"/>{shape}</visual>"), ""),
            (String::new(), "<limit lower=\"-1\" upper=\"1\"/>"),
            (String::new(), "<limit/><safety_controller soft_lower_limit=\"-1\"/><dynamics/><calibration/><mimic/>"),
        ] {
            assert_eq!(parse("m.urdf", &body(&link, joint)).unwrap(), plain, "{link} {joint}");
        }
    }

    #[test]
    fn elements_nested_without_end_do_not_end_the_process() {
        let deep = "<a>".repeat(200_000) + &"</a>".repeat(200_000);
        let plain = parse("m.urdf", &body("", "")).unwrap();
        assert_eq!(parse("m.urdf", &body(&deep, "")).unwrap(), plain);
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_link() {
        for (text, expected) in [
            (
                body("", "").replace("value=\"2\"", "value=\"x\""),
                "m.urdf:3: link 'b': <mass value=\"x\"> is not a number",
            ),
            (body("", "").replace("0 1 0", "0 1"), "m.urdf:4: joint 'j': <axis xyz=\"0 1\"> is not three numbers"),
            (body("", "").replace("<parent link=\"a\"/>", ""), "m.urdf:4: joint 'j': has no <parent"),
            (body("", "").replace("link name=\"b\"", "link"), "m.urdf:3: a link: has no name"),
            ("<sdf/>".to_owned(), "m.urdf: is not a URDF: <robot> is expected, not <sdf>"),
            ("<robot".to_owned(), "m.urdf: is not a URDF"),
            (
                "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:body/></robot>".to_owned(),
                "m.urdf: is an unexpanded xacro file",
            ),
            ("<a>".repeat(20_000), "m.urdf: is not a URDF"),
        ] {
            let error = parse("m.urdf", &text).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error:?} instead of {expected:?}");
        }
    }
}
