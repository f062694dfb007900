//! A body of jointed segments as truth: positions, velocities and forces of every segment in the
//! axes of an inertial frame, one vector equation at a time.
//!
//! Classical recursion of Newton and Euler: kinematics from the base outwards, forces from the tips
//! inwards, each about the joint of its segment. Gravity is a force here, and nothing is a
//! 6-vector. [`Body::forward`] solves the same equations for the accelerations, with the inertia of what each joint carries.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Unit, Vector3};

/// A segment behind one revolute joint; the base has none. Its own axes begin at the joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Number of the segment that carries it; parents come first. None for the base.
    pub parent: Option<usize>,
    /// Place of its joint in the parent's axes, m.
    pub origin: Vector3<f64>,
    /// Its own axes at zero joint angle, as columns in the parent's axes.
    pub rotation: Matrix3<f64>,
    /// Axis of the joint, unit, in its own axes.
    pub axis: Vector3<f64>,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass from the joint, in its own axes, m.
    pub com: Vector3<f64>,
    /// Rotational inertia about the centre of mass, in its own axes, kg m2.
    pub inertia: Matrix3<f64>,
}

/// Motion of the base, all in the inertial frame; accelerations without gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseMotion {
    /// Axes of the base, as columns.
    pub rotation: Matrix3<f64>,
    /// Angular velocity, rad/s.
    pub rate: Vector3<f64>,
    /// Angular acceleration, rad/s2.
    pub angular_acceleration: Vector3<f64>,
    /// Acceleration of its origin, m/s2.
    pub acceleration: Vector3<f64>,
}

impl BaseMotion {
    /// At rest, axes along the inertial ones.
    pub fn rest() -> Self {
        let zero = Vector3::zeros();
        Self { rotation: Matrix3::identity(), rate: zero, angular_acceleration: zero, acceleration: zero }
    }
}

/// A force and a moment of the surroundings on a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Number of the segment.
    pub segment: usize,
    /// Where it acts, in the segment's axes, m.
    pub at: Vector3<f64>,
    /// Force in the inertial frame, N.
    pub force: Vector3<f64>,
    /// Moment in the inertial frame, N m.
    pub moment: Vector3<f64>,
}

/// What a segment does, all in the inertial frame; accelerations without gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentState {
    /// Its own axes, as columns.
    pub rotation: Matrix3<f64>,
    /// Place of its joint relative to the base's origin, m.
    pub position: Vector3<f64>,
    /// Velocity of its joint relative to the base's origin, m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity, rad/s.
    pub rate: Vector3<f64>,
    /// Angular acceleration, rad/s2.
    pub angular_acceleration: Vector3<f64>,
    /// Acceleration of its joint, m/s2.
    pub acceleration: Vector3<f64>,
    /// Force that its joint (for the base: the seat or the ground) puts on it, N.
    pub force: Vector3<f64>,
    /// Moment of its joint on it about its joint, N m.
    pub moment: Vector3<f64>,
}

impl SegmentState {
    fn zero() -> Self {
        let zero = Vector3::zeros();
        Self {
            rotation: Matrix3::identity(),
            position: zero,
            velocity: zero,
            rate: zero,
            angular_acceleration: zero,
            acceleration: zero,
            force: zero,
            moment: zero,
        }
    }

    /// What an accelerometer at `at` (m, the segment's axes) reads, in these axes, m/s2; `gravity` in the inertial frame,
    /// m/s2.
    pub fn specific_force(&self, at: &Vector3<f64>, gravity: &Vector3<f64>) -> Vector3<f64> {
        let arm = self.rotation * at;
        let acceleration =
            self.acceleration + self.angular_acceleration.cross(&arm) + self.rate.cross(&self.rate.cross(&arm));
        self.rotation.transpose() * (acceleration - gravity)
    }

    /// A force (N) and its moment about the joint (N m), both in the inertial frame, as force and moment about `at` (m,
    /// the segment's axes) in the segment's axes.
    pub fn seen_at(&self, at: &Vector3<f64>, force: &Vector3<f64>, about_joint: &Vector3<f64>) -> [f64; 6] {
        let moment = about_joint - (self.rotation * at).cross(force);
        let (f, m) = (self.rotation.transpose() * force, self.rotation.transpose() * moment);
        [f.x, f.y, f.z, m.x, m.y, m.z]
    }
}

/// A body and its gravity.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// The segments; number 0 is the base, segment k has joint k - 1.
    pub segments: Vec<Segment>,
    /// Gravity in the inertial frame, m/s2.
    pub gravity: Vector3<f64>,
}

impl Body {
    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.segments.len() - 1
    }

    /// Mass of all segments, kg.
    pub fn mass(&self) -> f64 {
        self.segments.iter().map(|segment| segment.mass).sum()
    }

    /// Inverse dynamics: the torques that make this motion, and the state of every segment.
    pub fn inverse(
        &self,
        base: &BaseMotion,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        pushes: &[Push],
    ) -> (Vec<f64>, Vec<SegmentState>) {
        let mut states = vec![SegmentState::zero(); self.segments.len()];
        states[0].rotation = base.rotation;
        states[0].rate = base.rate;
        states[0].angular_acceleration = base.angular_acceleration;
        states[0].acceleration = base.acceleration;
        for (k, segment) in self.segments.iter().enumerate() {
            let Some(p) = segment.parent else { continue };
            let up = states[p];
            let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(segment.axis), q[k - 1]);
            let rotation = up.rotation * segment.rotation * turn.matrix();
            let axis = rotation * segment.axis;
            let arm = up.rotation * segment.origin;
            states[k] = SegmentState {
                rotation,
                position: up.position + arm,
                velocity: up.velocity + up.rate.cross(&arm),
                rate: up.rate + axis * qd[k - 1],
                angular_acceleration: up.angular_acceleration + axis * qdd[k - 1] + up.rate.cross(&(axis * qd[k - 1])),
                acceleration: up.acceleration
                    + up.angular_acceleration.cross(&arm)
                    + up.rate.cross(&up.rate.cross(&arm)),
                ..SegmentState::zero()
            };
        }
        for (state, segment) in states.iter_mut().zip(&self.segments) {
            let (w, alpha) = (state.rate, state.angular_acceleration);
            let com = state.rotation * segment.com;
            let acceleration = state.acceleration + alpha.cross(&com) + w.cross(&w.cross(&com));
            let inertia = state.rotation * segment.inertia * state.rotation.transpose();
            state.force = (acceleration - self.gravity) * segment.mass;
            state.moment = inertia * alpha + w.cross(&(inertia * w)) + com.cross(&state.force);
        }
        for push in pushes {
            let state = &mut states[push.segment];
            let arm = state.rotation * push.at;
            state.force -= push.force;
            state.moment -= push.moment + arm.cross(&push.force);
        }
        let mut torque = vec![0.0; self.joints()];
        for k in (1..self.segments.len()).rev() {
            let own = states[k];
            torque[k - 1] = (own.rotation * self.segments[k].axis).dot(&own.moment);
            if let Some(p) = self.segments[k].parent {
                let arm = own.position - states[p].position;
                states[p].force += own.force;
                states[p].moment += own.moment + arm.cross(&own.force);
            }
        }
        (torque, states)
    }

    /// Forward dynamics: the joint accelerations under these torques. None if the inertia matrix is
    /// not positive definite (a joint that moves no mass).
    pub fn forward(
        &self,
        base: &BaseMotion,
        q: &[f64],
        qd: &[f64],
        torque: &[f64],
        pushes: &[Push],
    ) -> Option<Vec<f64>> {
        let n = self.joints();
        let (bias, states) = self.inverse(base, q, qd, &vec![0.0; n], pushes);
        let inertia = self.joint_inertia(&states);
        let right = DVector::from_iterator(n, torque.iter().zip(&bias).map(|(t, b)| t - b));
        Some(inertia.cholesky()?.solve(&right).as_slice().to_vec())
    }

    /// Inertia matrix of the joints: what each joint feels of a unit acceleration of each other, by the momentum of all
    /// that the accelerated joint carries as one rigid body (the composite rigid body method; Featherstone, Rigid Body
    /// Dynamics Algorithms, 2008, 6.2), about the base's origin.
    fn joint_inertia(&self, states: &[SegmentState]) -> DMatrix<f64> {
        let n = self.joints();
        let mut carried: Vec<Carried> = states.iter().zip(&self.segments).map(Carried::by).collect();
        for k in (1..=n).rev() {
            if let Some(p) = self.segments[k].parent {
                let own = carried[k];
                carried[p].add(&own);
            }
        }
        let axes: Vec<_> = states.iter().zip(&self.segments).map(|(state, of)| state.rotation * of.axis).collect();
        let mut inertia = DMatrix::zeros(n, n);
        for j in 1..=n {
            let (place, Carried { mass, first, second }) = (states[j].position, carried[j]);
            let force = axes[j].cross(&(first - place * mass));
            let moment = second * axes[j] - first.cross(&axes[j].cross(&place));
            let mut i = j;
            while let Some(up) = self.segments[i].parent {
                let felt = axes[i].dot(&(moment - states[i].position.cross(&force)));
                (inertia[(i - 1, j - 1)], inertia[(j - 1, i - 1)]) = (felt, felt);
                i = up;
            }
        }
        inertia
    }
}

/// All that a joint carries, as one rigid body in the inertial frame.
#[derive(Clone, Copy)]
struct Carried {
    /// Mass, kg.
    mass: f64,
    /// First moment of mass about the base's origin, kg m.
    first: Vector3<f64>,
    /// Rotational inertia about the base's origin, kg m2.
    second: Matrix3<f64>,
}

impl Carried {
    fn by((state, segment): (&SegmentState, &Segment)) -> Self {
        let (mass, com) = (segment.mass, state.position + state.rotation * segment.com);
        let steiner = (Matrix3::from_diagonal_element(com.norm_squared()) - com * com.transpose()) * mass;
        let second = state.rotation * segment.inertia * state.rotation.transpose() + steiner;
        Self { mass, first: com * mass, second }
    }

    fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.first += other.first;
        self.second += other.second;
    }
}

/// A rigid lump, in its own axes at its own origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Lump {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub com: Vector3<f64>,
    /// Rotational inertia about the centre of mass, kg m2.
    pub inertia: Matrix3<f64>,
}

/// A revolute joint between two lumps.
#[derive(Clone, Debug, PartialEq)]
pub struct Hinge {
    /// Lump that the joint hangs on.
    pub parent: usize,
    /// Lump that it carries, whose origin lies in the joint.
    pub child: usize,
    /// Place in the parent's axes, m.
    pub origin: Vector3<f64>,
    /// The child's axes at zero angle in the parent's.
    pub rotation: Matrix3<f64>,
    /// Unit axis in the child's axes.
    pub axis: Vector3<f64>,
}

/// A body put together from lumps, standing on one of them.
#[derive(Clone, Debug)]
pub struct Rooted {
    /// The body.
    pub body: Body,
    /// Segment of each lump.
    pub segment: Vec<usize>,
    /// Where each lump's origin is in its segment's axes, m.
    pub place: Vec<Vector3<f64>>,
    /// Hinge of each joint of the body.
    pub hinge: Vec<usize>,
}

impl Rooted {
    /// Walks from the lump `base` through all hinges; one that is walked backwards turns its carrier
    /// about itself.
    pub fn new(lumps: &[Lump], hinges: &[Hinge], base: usize, gravity: Vector3<f64>) -> Self {
        let mut rooted = Self {
            body: Body { segments: vec![], gravity },
            segment: vec![usize::MAX; lumps.len()],
            place: vec![Vector3::zeros(); lumps.len()],
            hinge: vec![],
        };
        let still =
            Attach { parent: None, origin: Vector3::zeros(), rotation: Matrix3::identity(), axis: Vector3::z() };
        rooted.add(base, still, &lumps[base], Vector3::zeros());
        let mut grown = true;
        while grown {
            grown = false;
            for (h, hinge) in hinges.iter().enumerate() {
                let known = [hinge.parent, hinge.child].map(|lump| rooted.segment[lump] != usize::MAX);
                if known[0] == known[1] {
                    continue;
                }
                grown = true;
                rooted.hinge.push(h);
                if known[0] {
                    let up = rooted.segment[hinge.parent];
                    let origin = rooted.place[hinge.parent] + hinge.origin;
                    let joint = Attach { parent: Some(up), origin, rotation: hinge.rotation, axis: hinge.axis };
                    rooted.add(hinge.child, joint, &lumps[hinge.child], Vector3::zeros());
                } else {
                    // the carrier becomes the segment, its origin moves into the joint
                    let up = rooted.segment[hinge.child];
                    let joint = Attach {
                        parent: Some(up),
                        origin: rooted.place[hinge.child],
                        rotation: hinge.rotation.transpose(),
                        axis: -(hinge.rotation * hinge.axis),
                    };
                    rooted.add(hinge.parent, joint, &lumps[hinge.parent], -hinge.origin);
                }
            }
        }
        rooted
    }

    fn add(&mut self, lump: usize, joint: Attach, of: &Lump, place: Vector3<f64>) {
        self.segment[lump] = self.body.segments.len();
        self.place[lump] = place;
        let Attach { parent, origin, rotation, axis } = joint;
        let com = of.com + place;
        self.body.segments.push(Segment { parent, origin, rotation, axis, mass: of.mass, com, inertia: of.inertia });
    }
}

/// The joint of a new segment.
struct Attach {
    parent: Option<usize>,
    origin: Vector3<f64>,
    rotation: Matrix3<f64>,
    axis: Vector3<f64>,
}
