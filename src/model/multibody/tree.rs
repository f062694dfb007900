//! Kinematic trees: links and joints as described, then checked, lumped, re-rooted and numbered.

use super::error::{ModelError, ModelWarning};
use super::spatial::{Inertia, Pose, axis_rotation};
use nalgebra::{Matrix3, Vector3, Vector6};

/// Most joints that may act between two bodies of a compact tree.
pub const MAX_JOINT_DOF: usize = 6;

/// A link as described by a file or a generator.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Name, unique among the links.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in link axes, m.
    pub com: [f64; 3],
    /// Rotational inertia about the centre of mass in link axes: xx, xy, xz, yy, yz, zz, kg m2.
    pub inertia: [f64; 6],
}

/// How a joint moves.
#[derive(Clone, Debug, PartialEq)]
pub enum JointKind {
    /// Turns about its axis (URDF: revolute, continuous).
    Revolute,
    /// Slides along its axis.
    Prismatic,
    /// Does not move; its child is lumped into its parent.
    Fixed,
    /// Any other type, by its name; refused.
    Other(String),
}

/// A joint as described by a file or a generator.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name, unique among the joints.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Name of the link it hangs on.
    pub parent: String,
    /// Name of the link it carries.
    pub child: String,
    /// Origin of the child's frame in the parent's, m.
    pub xyz: [f64; 3],
    /// Roll, pitch, yaw of the child's frame in the parent's at zero displacement, rad.
    pub rpy: [f64; 3],
    /// Axis in the child's frame; any length but zero.
    pub axis: [f64; 3],
}

/// A whole description.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Description {
    /// Name of the model.
    pub name: String,
    /// The links.
    pub links: Vec<Link>,
    /// The joints.
    pub joints: Vec<Joint>,
}

/// One degree of freedom between a body and its parent: `pre * J(sign q) * post`.
#[derive(Clone, Debug)]
pub struct Step {
    /// Number of the coordinate in `q`.
    pub dof: usize,
    /// From the parent's frame to the joint's frame before it moves.
    pub pre: Pose,
    /// From the joint's frame after it moved to the child's frame.
    pub post: Pose,
    /// Unit axis in the joint's frame.
    pub axis: Vector3<f64>,
    /// Slides instead of turning.
    pub prismatic: bool,
    /// -1 if the tree runs through the joint from its child to its parent.
    pub sign: f64,
    /// Motion of the child relative to the parent per unit of velocity, at the child's frame.
    pub screw: Vector6<f64>,
}

impl Step {
    /// Pose of the parent in the child at displacement `q`.
    pub fn child_from_parent(&self, q: f64) -> Pose {
        // J(sign q) inverted is J(-sign q)
        let back = if self.prismatic {
            Pose { rotation: Matrix3::identity(), origin: self.axis * (-self.sign * q) }
        } else {
            Pose { rotation: axis_rotation(&self.axis, -self.sign * q), origin: Vector3::zeros() }
        };
        self.post.inverse().compose(&back).compose(&self.pre.inverse())
    }
}

/// A rigid body of the tree. Parents have smaller numbers than their children.
#[derive(Clone, Debug)]
pub struct Body {
    /// Name of the link whose frame the body uses.
    pub name: String,
    /// Number of the parent body; `None` for the base.
    pub parent: Option<usize>,
    /// The joints between the parent and this body, from the parent outwards. One in a chain form.
    pub steps: Vec<Step>,
    /// Inertia at the body's origin.
    pub inertia: Inertia,
    /// Numbers of the children.
    pub children: Vec<usize>,
}

/// Where a named link is: its body and its pose in the body's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Number of the body.
    pub body: usize,
    /// Pose of the link's frame in the body's frame.
    pub pose: Pose,
}

/// A checked tree of bodies, rooted at a base.
#[derive(Clone, Debug)]
pub struct Tree {
    /// Name of the model.
    pub name: String,
    /// The bodies; the base is number 0.
    pub bodies: Vec<Body>,
    /// Names of the moving joints in the order of the description: the order of `q`.
    pub dof_names: Vec<String>,
    /// Where each described link is.
    pub places: Vec<(String, Place)>,
    /// What is unusual.
    pub warnings: Vec<ModelWarning>,
    /// For each coordinate of `q`: the body its joint carries and the joint's place among that body's steps.
    pub dof_places: Vec<(usize, usize)>,
    fixed_joints: Vec<String>,
    /// The link that each moving joint carries, as described.
    carried: Vec<String>,
}

/// One edge of the graph of links that are rigid among themselves.
struct Edge {
    joint: usize,
    parent: usize,
    child: usize,
}

impl Tree {
    /// Builds the tree with the base at link `base`, numbering bodies breadth-first, neighbours in
    /// the order of the joints. Links behind fixed joints are lumped into their parents; if
    /// `compact`, massless bodies with one child that are not in `keep` are merged into joints
    /// with several degrees of freedom.
    pub fn new(description: &Description, base: &str, compact: bool, keep: &[&str]) -> Result<Self, ModelError> {
        let warnings = check_links(&description.links)?;
        let ends = check_joints(description)?;
        check_tree(description, &ends)?;
        let base_link = link_number(description, base)?;

        let (group, pose_in_group) = lump(description, &ends, base_link);
        let mut dof_of_joint = vec![usize::MAX; description.joints.len()];
        let mut dof_names = Vec::new();
        let mut fixed_joints = Vec::new();
        let mut edges = Vec::new();
        let mut carried = Vec::new();
        for (j, joint) in description.joints.iter().enumerate() {
            if joint.kind == JointKind::Fixed {
                fixed_joints.push(joint.name.clone());
                continue;
            }
            dof_of_joint[j] = dof_names.len();
            dof_names.push(joint.name.clone());
            carried.push(joint.child.clone());
            edges.push(Edge { joint: j, parent: ends[j].0, child: ends[j].1 });
        }

        // breadth-first from the base's group; `group` names a group by its representative link
        let mut order = vec![group[base_link]];
        let mut bodies = vec![new_body(description, &group, &pose_in_group, group[base_link], None, vec![])];
        let mut used = vec![false; edges.len()];
        let mut next = 0;
        while next < order.len() {
            for (e, edge) in edges.iter().enumerate() {
                if used[e] {
                    continue;
                }
                let forward = group[edge.parent] == order[next];
                if !forward && group[edge.child] != order[next] {
                    continue;
                }
                used[e] = true;
                let far = if forward { group[edge.child] } else { group[edge.parent] };
                let step =
                    make_step(&description.joints[edge.joint], dof_of_joint[edge.joint], &pose_in_group, edge, forward);
                bodies.push(new_body(description, &group, &pose_in_group, far, Some(next), vec![step]));
                order.push(far);
            }
            next += 1;
        }

        let mut places: Vec<(String, Place)> = (description.links.iter().enumerate())
            .map(|(l, link)| {
                let body = order.iter().position(|&g| g == group[l]).unwrap_or(0);
                (link.name.clone(), Place { body, pose: pose_in_group[l] })
            })
            .collect();
        if compact {
            merge_massless(&mut bodies, &mut places, keep);
        }
        for b in 1..bodies.len() {
            if let Some(p) = bodies[b].parent {
                bodies[p].children.push(b);
            }
        }
        let mut dof_places = vec![(0, 0); dof_names.len()];
        for (b, body) in bodies.iter().enumerate() {
            for (k, step) in body.steps.iter().enumerate() {
                dof_places[step.dof] = (b, k);
            }
        }
        let name = description.name.clone();
        Ok(Self { name, bodies, dof_names, places, warnings, dof_places, fixed_joints, carried })
    }

    /// Number of degrees of freedom.
    pub fn dof(&self) -> usize {
        self.dof_names.len()
    }

    /// Total mass, kg.
    pub fn mass(&self) -> f64 {
        self.bodies.iter().map(|body| body.inertia.mass).sum()
    }

    /// Where a link is.
    pub fn place(&self, link: &str) -> Result<&Place, ModelError> {
        let found = self.places.iter().find(|(name, _)| name == link);
        found.map(|(_, place)| place).ok_or_else(|| ModelError::UnknownLink(link.to_owned()))
    }

    /// The coordinate of a joint.
    pub fn coordinate(&self, joint: &str) -> Result<usize, ModelError> {
        if self.fixed_joints.iter().any(|name| name == joint) {
            return Err(ModelError::FixedJoint(joint.to_owned()));
        }
        let found = self.dof_names.iter().position(|name| name == joint);
        found.ok_or_else(|| ModelError::UnknownJoint(joint.to_owned()))
    }
}

impl Tree {
    /// Where the link is that a joint carries.
    pub fn carried(&self, joint: &str) -> Result<&Place, ModelError> {
        self.place(&self.carried[self.coordinate(joint)?])
    }
}

fn link_number(description: &Description, name: &str) -> Result<usize, ModelError> {
    let found = description.links.iter().position(|link| link.name == name);
    found.ok_or_else(|| ModelError::UnknownLink(name.to_owned()))
}

fn check_links(links: &[Link]) -> Result<Vec<ModelWarning>, ModelError> {
    if links.is_empty() {
        return Err(ModelError::Empty);
    }
    let mut warnings = Vec::new();
    for (i, link) in links.iter().enumerate() {
        if links[..i].iter().any(|other| other.name == link.name) {
            return Err(ModelError::DuplicateName(link.name.clone(), "link"));
        }
        let finite = |v: &f64| v.is_finite();
        if !(link.mass.is_finite() && link.com.iter().all(finite) && link.inertia.iter().all(finite)) {
            return Err(ModelError::NotFinite(link.name.clone()));
        }
        if link.mass < 0.0 {
            return Err(ModelError::NegativeMass(link.name.clone(), link.mass));
        }
        let mut moments = inertia_matrix(&link.inertia).symmetric_eigenvalues();
        moments.as_mut_slice().sort_by(f64::total_cmp);
        let tolerance = 1e-9 * moments[2].abs().max(1.0);
        if moments[0] < -tolerance {
            return Err(ModelError::InertiaNotPsd(link.name.clone(), moments[0]));
        }
        if moments[0] + moments[1] < moments[2] - tolerance {
            warnings.push(ModelWarning::TriangleInequality(link.name.clone()));
        }
    }
    if links.iter().map(|link| link.mass).sum::<f64>() <= 0.0 {
        return Err(ModelError::ZeroTotalMass);
    }
    Ok(warnings)
}

/// The link numbers (parent, child) of every joint.
fn check_joints(description: &Description) -> Result<Vec<(usize, usize)>, ModelError> {
    let joints = &description.joints;
    let mut ends = Vec::with_capacity(joints.len());
    for (j, joint) in joints.iter().enumerate() {
        if joints[..j].iter().any(|other| other.name == joint.name) {
            return Err(ModelError::DuplicateName(joint.name.clone(), "joint"));
        }
        if let JointKind::Other(kind) = &joint.kind {
            return Err(ModelError::UnsupportedJoint(joint.name.clone(), kind.clone()));
        }
        if !joint.xyz.iter().chain(&joint.rpy).chain(&joint.axis).all(|v| v.is_finite()) {
            return Err(ModelError::NotFinite(joint.name.clone()));
        }
        let length = Vector3::from(joint.axis).norm();
        if joint.kind != JointKind::Fixed && !(length > 1e-12 && length.is_finite()) {
            return Err(ModelError::BadAxis(joint.name.clone()));
        }
        ends.push((link_number(description, &joint.parent)?, link_number(description, &joint.child)?));
    }
    Ok(ends)
}

fn check_tree(description: &Description, ends: &[(usize, usize)]) -> Result<(), ModelError> {
    let links = &description.links;
    let mut parent = vec![None; links.len()];
    for &(p, c) in ends {
        if parent[c].replace(p).is_some() || p == c {
            return Err(ModelError::KinematicLoop(links[c].name.clone()));
        }
    }
    let mut roots = (0..links.len()).filter(|&l| parent[l].is_none());
    match (roots.next(), roots.next()) {
        (None, _) => return Err(ModelError::KinematicLoop(links[0].name.clone())),
        (Some(a), Some(b)) => return Err(ModelError::Disconnected(links[a].name.clone(), links[b].name.clone())),
        _ => {}
    }
    // one root and one parent each: whoever does not come to the root in time walks in a circle
    for l in 0..links.len() {
        let mut at = l;
        for _ in 0..links.len() {
            at = parent[at].unwrap_or(at);
        }
        if parent[at].is_some() {
            return Err(ModelError::KinematicLoop(links[at].name.clone()));
        }
    }
    Ok(())
}

/// Groups links that are rigid among themselves: the representative of each link's group and the
/// link's pose in the representative's frame. The base represents its group, elsewhere the link
/// nearest to the root does.
fn lump(description: &Description, ends: &[(usize, usize)], base: usize) -> (Vec<usize>, Vec<Pose>) {
    let n = description.links.len();
    let mut parent = vec![None; n];
    for (joint, &(p, c)) in description.joints.iter().zip(ends) {
        if joint.kind == JointKind::Fixed {
            parent[c] = Some((p, Pose::from_xyz_rpy(&joint.xyz, &joint.rpy)));
        }
    }
    let mut group = Vec::with_capacity(n);
    let mut poses = Vec::with_capacity(n);
    for l in 0..n {
        let (mut at, mut pose) = (l, Pose::identity());
        while let Some((up, step)) = &parent[at] {
            pose = step.compose(&pose);
            at = *up;
        }
        group.push(at);
        poses.push(pose);
    }
    let (top, base_in_top) = (group[base], poses[base]);
    if top != base {
        for l in (0..n).filter(|&l| group[l] == top).collect::<Vec<_>>() {
            group[l] = base;
            poses[l] = if l == base { Pose::identity() } else { base_in_top.inverse().compose(&poses[l]) };
        }
    }
    (group, poses)
}

fn inertia_matrix(i: &[f64; 6]) -> Matrix3<f64> {
    Matrix3::new(i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5])
}

fn new_body(
    description: &Description,
    group: &[usize],
    poses: &[Pose],
    representative: usize,
    parent: Option<usize>,
    steps: Vec<Step>,
) -> Body {
    let members = description.links.iter().enumerate().filter(|(l, _)| group[*l] == representative);
    let inertia = members.fold(Inertia::zero(), |sum, (l, link)| {
        let own = Inertia::from_centre(link.mass, &Vector3::from(link.com), &inertia_matrix(&link.inertia));
        sum.plus(&if l == representative { own } else { own.seen_from(&poses[l]) })
    });
    let name = description.links[representative].name.clone();
    Body { name, parent, steps, inertia, children: vec![] }
}

fn make_step(joint: &Joint, dof: usize, poses: &[Pose], edge: &Edge, forward: bool) -> Step {
    // parent group -> joint: the parent link's pose, then the joint's origin; joint -> child group
    let near = poses[edge.parent].compose(&Pose::from_xyz_rpy(&joint.xyz, &joint.rpy));
    let far = poses[edge.child].inverse();
    let (pre, post, sign) = if forward { (near, far, 1.0) } else { (far.inverse(), near.inverse(), -1.0) };
    let axis = Vector3::from(joint.axis).normalize();
    let prismatic = joint.kind == JointKind::Prismatic;
    let own = if prismatic {
        super::spatial::join(&axis, &Vector3::zeros())
    } else {
        super::spatial::join(&Vector3::zeros(), &axis)
    };
    // the joint's own motion leaves its screw in place, so it may be taken before or after it
    let screw = post.inverse().motion(&(own * sign));
    Step { dof, pre, post, axis, prismatic, sign, screw }
}

/// Merges massless bodies with exactly one child into the joint to that child.
fn merge_massless(bodies: &mut Vec<Body>, places: &mut Vec<(String, Place)>, keep: &[&str]) {
    let mut b = 1;
    while b < bodies.len() {
        let children: Vec<usize> = (b + 1..bodies.len()).filter(|&c| bodies[c].parent == Some(b)).collect();
        let steps = bodies[b].steps.len();
        let named = places.iter().any(|(name, place)| place.body == b && keep.contains(&name.as_str()));
        let mergeable = bodies[b].inertia.mass == 0.0 && bodies[b].inertia.rotational.amax() == 0.0 && !named;
        if !(mergeable && children.len() == 1 && steps + bodies[children[0]].steps.len() <= MAX_JOINT_DOF) {
            b += 1;
            continue;
        }
        let child = children[0];
        let gone = bodies[b].clone();
        let mut merged = gone.steps;
        merged.append(&mut bodies[child].steps);
        bodies[child].steps = merged;
        bodies[child].parent = gone.parent;
        bodies.remove(b);
        for body in bodies.iter_mut() {
            body.parent = body.parent.map(|p| if p > b { p - 1 } else { p });
        }
        // a merged link has no frame of its own any more
        places.retain(|(_, place)| place.body != b);
        for (_, place) in places.iter_mut() {
            place.body -= usize::from(place.body > b);
        }
    }
}
