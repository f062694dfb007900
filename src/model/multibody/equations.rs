//! The equations of motion and the measurements of a tree as sparse rows in one vector `d`.
//!
//! Latella et al. (2019), eqs. 2 to 4, in spatial form. `d` holds per body
//! `[a(6) fB(6) f(6) tau(n) fx(6) qdd(n)]`: proper acceleration, net wrench, wrench from the parent,
//! joint torque, external wrench, joint acceleration. Per body and in this order the rows are
//!
//! | | rows | expression = 0 |
//! |---|---|---|
//! | acceleration | 6 | `-a_i + X_i a_p + S_i qdd_i + (X_i v_p) x vJ + cJ` |
//! | net wrench | 6 | `-fB_i + I_i a_i + v_i x* I_i v_i` |
//! | wrench balance | 6 | `-f_i + fB_i - fx_i + sum_c X_c' f_c` |
//! | torque | n | `-tau_i + S_i' f_i` |
//!
//! Gravity is no force here: `a` is what an accelerometer feels, so a base at rest has `-g`. The
//! paper's base is fixed and not part of `d`; the moving base used here as well adds
//! `[a_0 fB_0 f_0 fx_0]` with `f_0` the wrench of the seat, taken in the inertial frame that moves
//! with the base's origin at this instant (`v_0 = [0; w_0]`), which needs neither its orientation
//! nor its velocity.

use super::error::ModelError;
use super::rows::{Copy, Origin, Rows, RowsBuilder};
use super::sensors::{Mounted, Sees, Sensor, inertial_wrench, mount};
use super::spatial::{Pose, cross_motion, cross_wrench, join};
use super::tree::{MAX_JOINT_DOF, Tree};
use nalgebra::{Vector3, Vector6};

/// How the base is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Base {
    /// At rest and not part of `d`; with the gravity vector in base axes, m/s2.
    Fixed(Vector3<f64>),
    /// Moving with a seat or floating; part of `d`.
    Moving,
}

/// The six kinds of variables of a body, in their order in `d`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Proper acceleration `a`, m/s2 and rad/s2.
    Acceleration,
    /// Net wrench `fB`, N and N.m.
    NetWrench,
    /// Wrench from the parent (or the seat) `f`, N and N.m.
    ParentWrench,
    /// Joint torque `tau`, N.m.
    Torque,
    /// External wrench `fx`, N and N.m.
    ExternalWrench,
    /// Joint acceleration `qdd`, rad/s2.
    JointAcceleration,
}

impl Kind {
    /// All kinds in their order in `d`.
    pub const ALL: [Self; 6] = [
        Self::Acceleration,
        Self::NetWrench,
        Self::ParentWrench,
        Self::Torque,
        Self::ExternalWrench,
        Self::JointAcceleration,
    ];
}

/// The four kinds of constraint rows of a body, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Equation {
    /// Acceleration of a body from its parent's.
    Acceleration,
    /// Newton and Euler.
    NetWrench,
    /// Sum of the wrenches on a body.
    WrenchBalance,
    /// Torque of a joint from the wrench through it.
    Torque,
}

/// Where a body's variables are in `d`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slots {
    /// First variable.
    pub start: usize,
    /// Degrees of freedom of the body's joint.
    pub dof: usize,
}

impl Slots {
    /// The variables of a kind.
    pub fn range(&self, kind: Kind) -> std::ops::Range<usize> {
        let (s, n) = (self.start, self.dof);
        match kind {
            Kind::Acceleration => s..s + 6,
            Kind::NetWrench => s + 6..s + 12,
            Kind::ParentWrench => s + 12..s + 18,
            Kind::Torque => s + 18..s + 18 + n,
            Kind::ExternalWrench => s + 18 + n..s + 24 + n,
            Kind::JointAcceleration => s + 24 + n..s + 24 + 2 * n,
        }
    }
}

/// The rows of a tree with its sensors; [`update`](Self::update) moves them with the posture.
#[derive(Clone, Debug)]
pub struct Equations {
    tree: Tree,
    base: Base,
    slots: Vec<Option<Slots>>,
    sensors: Vec<Sensor>,
    mounted: Vec<Mounted>,
    rows: Rows,
    copies: Vec<Copy>,
    constraint_rows: usize,
    /// Body and equation of each constraint row.
    owners: Vec<(usize, Equation)>,
    sensor_start: Vec<usize>,
    /// X (36 per body, row by row), then S (36 per body, column by column), then the blocks of
    /// sensors that see through a joint (36 each).
    moving: Vec<f64>,
    through: Vec<(usize, usize, f64)>,
    pose: Vec<Pose>,
    velocity: Vec<Vector6<f64>>,
}

const GENERIC: [f64; 3] = [0.618_033_988_749, 0.414_213_562_373, 0.732_050_807_568];

impl Equations {
    /// Writes the rows of a tree and its sensors; the sensors' rows follow the constraints.
    pub fn new(tree: Tree, base: Base, sensors: Vec<Sensor>) -> Result<Self, ModelError> {
        let moves = base == Base::Moving;
        let mounted = sensors.iter().map(|s| mount(&tree, moves, s)).collect::<Result<Vec<_>, _>>()?;
        let n = tree.bodies.len();
        let mut slots = Vec::with_capacity(n);
        let mut start = 0;
        for (b, body) in tree.bodies.iter().enumerate() {
            let slot = Slots { start, dof: body.steps.len() };
            let present = b > 0 || moves;
            start += if present { 24 + 2 * slot.dof } else { 0 };
            slots.push(present.then_some(slot));
        }
        let mut equations = Self {
            base,
            slots,
            sensors,
            mounted,
            rows: Rows::default(),
            copies: vec![],
            constraint_rows: 0,
            owners: vec![],
            sensor_start: vec![],
            moving: vec![0.0; 72 * n],
            through: vec![],
            pose: vec![Pose::identity(); n],
            velocity: vec![Vector6::zeros(); n],
            tree,
        };
        let mut builder = RowsBuilder::default();
        equations.write_constraints(&mut builder);
        equations.constraint_rows = equations.owners.len();
        equations.write_sensors(&mut builder);
        equations.moving = vec![0.0; 72 * n + 36 * equations.through.len()];

        let dof = equations.tree.dof();
        let postures: Vec<_> = (0..3)
            .map(|k| {
                let q: Vec<f64> = (0..dof).map(|i| 0.2 + 0.9 * (GENERIC[k] * (i + k + 1) as f64).fract()).collect();
                equations.move_to(&q, &vec![0.0; dof], &Vector3::zeros());
                equations.moving.clone()
            })
            .collect();
        (equations.rows, equations.copies) = builder.finish(&postures);
        equations.update(&vec![0.0; dof], &vec![0.0; dof], &Vector3::zeros());
        Ok(equations)
    }

    fn write_constraints(&mut self, builder: &mut RowsBuilder) {
        use Origin::{Constant, Slot};
        let n = self.tree.bodies.len();
        for b in 0..n {
            let Some(slot) = self.slots[b] else { continue };
            let body = &self.tree.bodies[b];
            let [a, fb, f, tau, fx, qdd] = Kind::ALL.map(|kind| slot.range(kind).start);
            let mut own = |equation, rows| self.owners.extend(std::iter::repeat_n((b, equation), rows));
            if let Some(parent) = body.parent {
                own(Equation::Acceleration, 6);
                for r in 0..6 {
                    builder.row();
                    builder.push(a + r, Constant(-1.0));
                    if let Some(p) = self.slots[parent] {
                        for c in 0..6 {
                            builder.push(p.start + c, Slot(36 * b + 6 * r + c, 1.0));
                        }
                    }
                    for k in 0..slot.dof {
                        builder.push(qdd + k, Slot(36 * (n + b) + 6 * k + r, 1.0));
                    }
                }
            }
            own(Equation::NetWrench, 6);
            let inertia = body.inertia.matrix();
            for r in 0..6 {
                builder.row();
                builder.push(fb + r, Constant(-1.0));
                for c in 0..6 {
                    builder.push(a + c, Constant(inertia[(r, c)]));
                }
            }
            own(Equation::WrenchBalance, 6);
            for r in 0..6 {
                builder.row();
                builder.push(f + r, Constant(-1.0));
                builder.push(fb + r, Constant(1.0));
                builder.push(fx + r, Constant(-1.0));
                for &child in &body.children {
                    let child_f = self.slots[child].map_or(0, |s| s.range(Kind::ParentWrench).start);
                    for c in 0..6 {
                        builder.push(child_f + c, Slot(36 * child + 6 * c + r, 1.0));
                    }
                }
            }
            own(Equation::Torque, slot.dof);
            for k in 0..slot.dof {
                builder.row();
                builder.push(tau + k, Constant(-1.0));
                for c in 0..6 {
                    builder.push(f + c, Slot(36 * (n + b) + 6 * k + c, 1.0));
                }
            }
        }
    }

    fn write_sensors(&mut self, builder: &mut RowsBuilder) {
        let n = self.tree.bodies.len();
        let mut row = self.constraint_rows;
        for (s, sensor) in self.mounted.iter().enumerate() {
            self.sensor_start.push(row);
            row += sensor.rows;
            // a wrench behind a joint is seen through `sign * map * X'`
            let behind: Vec<(usize, f64)> = match &sensor.sees {
                Sees::Ground => self.tree.bodies[0].children.iter().map(|&c| (c, 1.0)).collect(),
                Sees::Reaction(body) => vec![(*body, -1.0)],
                _ => vec![],
            };
            let first = 72 * n + 36 * self.through.len();
            self.through.extend(behind.iter().map(|&(body, sign)| (body, s, sign)));
            let slot = |body: usize| self.slots[body].unwrap_or(Slots { start: 0, dof: 0 });
            for r in 0..sensor.rows {
                builder.row();
                let mut seen = |kind: Kind, body: usize| {
                    for c in 0..6 {
                        builder.push(slot(body).range(kind).start + c, Origin::Constant(sensor.map[(r, c)]));
                    }
                };
                match sensor.sees {
                    Sees::Acceleration(body) => seen(Kind::Acceleration, body),
                    Sees::External(body) => seen(Kind::ExternalWrench, body),
                    Sees::Internal(body) => seen(Kind::ParentWrench, body),
                    Sees::Torque(body, k) => {
                        builder.push(slot(body).range(Kind::Torque).start + k, Origin::Constant(sensor.map[(0, 0)]));
                    }
                    Sees::Coordinate(body, k) => {
                        builder.push(
                            slot(body).range(Kind::JointAcceleration).start + k,
                            Origin::Constant(sensor.map[(0, 0)]),
                        );
                    }
                    Sees::Ground | Sees::Reaction(_) | Sees::Velocity(_) => {
                        for (block, &(body, _)) in behind.iter().enumerate() {
                            let f = slot(body).range(Kind::ParentWrench).start;
                            for c in 0..6 {
                                builder.push(f + c, Origin::Slot(first + 36 * block + 6 * r + c, 1.0));
                            }
                        }
                    }
                }
            }
        }
        self.sensor_start.push(row);
    }

    /// Kinematics: poses, velocities, and the table of moving values.
    fn move_to(&mut self, q: &[f64], qd: &[f64], base_rate: &Vector3<f64>) {
        let n = self.tree.bodies.len();
        self.velocity[0] = match self.base {
            Base::Fixed(_) => Vector6::zeros(),
            Base::Moving => join(&Vector3::zeros(), base_rate),
        };
        for (b, body) in self.tree.bodies.iter().enumerate().skip(1) {
            let parent = body.parent.unwrap_or(0);
            let columns = &mut self.moving[36 * (n + b)..36 * (n + b) + 6 * body.steps.len()];
            let mut pose = Pose::identity();
            let mut velocity = self.velocity[parent];
            for (k, step) in body.steps.iter().enumerate() {
                let x = step.child_from_parent(q[step.dof]);
                pose = if k == 0 { x } else { x.compose(&pose) };
                for earlier in columns.chunks_exact_mut(6).take(k) {
                    earlier.copy_from_slice(x.motion(&Vector6::from_column_slice(earlier)).as_slice());
                }
                columns[6 * k..6 * k + 6].copy_from_slice(step.screw.as_slice());
                velocity = x.motion(&velocity) + step.screw * qd[step.dof];
            }
            self.pose[b] = pose;
            self.velocity[b] = velocity;
            // X_i = [[R, p~ R], [0, R]]; the zeros are never touched
            let x = &mut self.moving[36 * b..36 * b + 36];
            let (r, p) = (&pose.rotation, &pose.origin);
            for c in 0..3 {
                let (r0, r1, r2) = (r[(0, c)], r[(1, c)], r[(2, c)]);
                (x[c], x[6 + c], x[12 + c]) = (r0, r1, r2);
                (x[21 + c], x[27 + c], x[33 + c]) = (r0, r1, r2);
                x[3 + c] = p.y * r2 - p.z * r1;
                x[9 + c] = p.z * r0 - p.x * r2;
                x[15 + c] = p.x * r1 - p.y * r0;
            }
        }
        for (block, &(body, sensor, sign)) in self.through.iter().enumerate() {
            let seen = self.mounted[sensor].map * self.pose[body].inverse().wrench_matrix() * sign;
            let first = 72 * n + 36 * block;
            for r in 0..6 {
                for c in 0..6 {
                    self.moving[first + 6 * r + c] = seen[(r, c)];
                }
            }
        }
    }

    /// Moves the rows to a posture `q`, its rates `qd` (rad, rad/s; order of
    /// [`Tree::dof_names`]) and the angular velocity of the base in base axes (rad/s; ignored if it
    /// is fixed).
    pub fn update(&mut self, q: &[f64], qd: &[f64], base_rate: &Vector3<f64>) {
        self.move_to(q, qd, base_rate);
        for copy in &self.copies {
            self.rows.value[copy.entry as usize] = copy.sign * self.moving[copy.slot as usize];
        }
        let weight = match self.base {
            Base::Fixed(gravity) => join(&-gravity, &Vector3::zeros()),
            Base::Moving => Vector6::zeros(),
        };
        let mut row = 0;
        for (b, body) in self.tree.bodies.iter().enumerate() {
            if self.slots[b].is_none() {
                continue;
            }
            if let Some(parent) = body.parent {
                let mut bias = self.bias(b, parent, qd);
                if parent == 0 && self.slots[0].is_none() {
                    bias += self.pose[b].motion(&weight);
                }
                self.rows.offset[row..row + 6].copy_from_slice(bias.as_slice());
                row += 6;
            }
            let v = &self.velocity[b];
            let gyroscopic = cross_wrench(v, &body.inertia.times(v));
            self.rows.offset[row..row + 6].copy_from_slice(gyroscopic.as_slice());
            row += 12 + body.steps.len();
        }
        let base_wrench = inertial_wrench(&self.tree.bodies[0].inertia, &self.velocity[0], &weight);
        for (sensor, &start) in self.mounted.iter().zip(&self.sensor_start) {
            let body = if let Sees::Acceleration(body) = sensor.sees { body } else { 0 };
            let bias = sensor.bias(&self.velocity[body], &base_wrench);
            self.rows.offset[start..start + sensor.rows].copy_from_slice(&bias.as_slice()[..sensor.rows]);
        }
    }

    /// `(X_i v_p) x vJ + cJ`, by recursion over the joint's degrees of freedom.
    fn bias(&self, b: usize, parent: usize, qd: &[f64]) -> Vector6<f64> {
        let steps = &self.tree.bodies[b].steps;
        if let [step] = steps.as_slice() {
            return cross_motion(&self.velocity[b], &(step.screw * qd[step.dof]));
        }
        // with S in the last frame: v grows by s qd per degree of freedom, c by v x s qd
        let n = self.tree.bodies.len();
        let mut velocity = self.pose[b].motion(&self.velocity[parent]);
        let mut bias = Vector6::zeros();
        for (k, step) in steps.iter().enumerate().take(MAX_JOINT_DOF) {
            let first = 36 * (n + b) + 6 * k;
            let own = Vector6::from_column_slice(&self.moving[first..first + 6]) * qd[step.dof];
            bias += cross_motion(&velocity, &own);
            velocity += own;
        }
        bias
    }

    /// Pose of a body's parent in the body, as the posture last updated to has it.
    pub fn from_parent(&self, body: usize) -> &Pose {
        &self.pose[body]
    }

    /// Motion of a body relative to its parent per unit of velocity of the `k`th degree of freedom between them.
    pub fn screw(&self, body: usize, k: usize) -> Vector6<f64> {
        let first = 36 * (self.tree.bodies.len() + body) + 6 * k;
        Vector6::from_column_slice(&self.moving[first..first + 6])
    }

    /// Proper acceleration of the base's origin in a solution, base axes, m/s2.
    pub fn base_acceleration(&self, mean: &[f64]) -> Vector3<f64> {
        match (self.base, self.slots[0]) {
            (Base::Moving, Some(slots)) => Vector3::from_column_slice(&mean[slots.start..slots.start + 3]),
            (Base::Fixed(gravity), _) => -gravity,
            (Base::Moving, None) => Vector3::zeros(),
        }
    }

    /// The rows of Newton's and Euler's equations of a body, if it is part of `d`.
    pub fn net_wrench_rows(&self, body: usize) -> Option<std::ops::Range<usize>> {
        let first = self.owners.iter().position(|owner| *owner == (body, Equation::NetWrench))?;
        Some(first..first + 6)
    }

    /// The tree.
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// The sensors.
    pub fn sensors(&self) -> &[Sensor] {
        &self.sensors
    }

    /// The rows, constraints first.
    pub fn rows(&self) -> &Rows {
        &self.rows
    }

    /// Number of constraint rows.
    pub fn constraint_rows(&self) -> usize {
        self.constraint_rows
    }

    /// Body and equation of each constraint row.
    pub fn owners(&self) -> &[(usize, Equation)] {
        &self.owners
    }

    /// The rows of a sensor.
    pub fn sensor_rows(&self, sensor: usize) -> std::ops::Range<usize> {
        self.sensor_start[sensor]..self.sensor_start[sensor + 1]
    }

    /// Where each body's variables are in `d`; `None` for a fixed base.
    pub fn slots(&self) -> &[Option<Slots>] {
        &self.slots
    }

    /// Number of variables.
    pub fn variables(&self) -> usize {
        self.slots.iter().flatten().map(|s| 24 + 2 * s.dof).sum()
    }

    /// Variances of a sensor's rows.
    pub fn sensor_variance(&self, sensor: usize) -> &[f64] {
        &self.mounted[sensor].variance[..self.mounted[sensor].rows]
    }

    /// Takes the samples of a sensor into right sides `y - b_Y`; false where the sample is missing
    /// (not finite). A sensor with a full covariance is missing whole.
    pub fn take(&self, sensor: usize, samples: &[f64], right: &mut [f64], present: &mut [bool]) {
        let mounted = &self.mounted[sensor];
        let mut y = Vector6::zeros();
        for (slot, sample) in y.iter_mut().zip(samples) {
            *slot = *sample;
        }
        let whole = mounted.whitening.is_none() || samples.iter().all(|s| s.is_finite());
        if let (Some(w), true) = (&mounted.whitening, whole) {
            y = w * y;
        }
        for (k, row) in self.sensor_rows(sensor).enumerate() {
            let here = whole && samples[k].is_finite();
            present[k] = here;
            right[k] = if here { y[k] - self.rows.offset[row] } else { 0.0 };
        }
    }

    /// Angular velocity of a gyroscope in its axes as the posture's rates have it, rad/s.
    pub fn gyroscope(&self, sensor: usize) -> Option<Vector3<f64>> {
        let mounted = &self.mounted[sensor];
        let Sees::Velocity(body) = mounted.sees else { return None };
        Some(mounted.pose.rotation.tr_mul(&super::spatial::angular(&self.velocity[body])))
    }

    /// Centre of mass in the base's frame, m, and its velocity relative to the base's origin, in
    /// base axes, m/s, of the posture last updated to.
    pub fn centre_of_mass(&self) -> (Vector3<f64>, Vector3<f64>) {
        // leaves to root without memory: each body's first moment and momentum walk to the base
        let mut moment = Vector3::zeros();
        let mut momentum = Vector3::zeros();
        for (b, body) in self.tree.bodies.iter().enumerate() {
            let mut first = body.inertia.moment;
            let mut carried = super::spatial::linear(&body.inertia.times(&self.velocity[b]));
            let mut at = b;
            while let Some(parent) = self.tree.bodies[at].parent {
                let x = &self.pose[at];
                first = x.rotation.tr_mul(&(first - x.origin * body.inertia.mass));
                carried = x.rotation.tr_mul(&carried);
                at = parent;
            }
            moment += first;
            momentum += carried;
        }
        let mass = self.tree.mass();
        (moment / mass, momentum / mass)
    }
}
