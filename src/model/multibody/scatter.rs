//! What errors of the body itself, and of where its base says that down is, make of joint torques and of the base's wrench.
//!
//! The rows take masses, centres of mass and inertias as exact, while those of a person come from a table. If the net wrench of
//! body i is `w_i` larger than its row says, an estimate o is off by `mu_oi' w_i` to first order. Errors that are not estimated
//! but *considered* (Schmidt 1966) add to its variance, with the net wrench `[F; c x F + N]` of body i about its centre of mass c:
//!
//! | error | wrench per unit | standard deviation |
//! |---|---|---|
//! | mass of a segment, centre and radii of gyration kept | `[F; c x F + N] / m` | `segment_mass_std * m` |
//! | centre of mass, each axis | `[0; e x F]` | `segment_com_std` times the radius of gyration |
//! | inertia about the centre of mass | `[0; N]` | `segment_inertia_std` |
//! | the base's axes, about each axis | `[m e; m c x e]` of all bodies with `e = axis x a_0` | `inclination_std` |
//!
//! The errors are independent of one another, but the segments' masses add up to the person's, whose own error is `mass_std`:
//! with `s_i` the standard deviations and `u_i` what a kilogram of segment i makes of the estimate,
//! `sum s^2 u^2 - (sum s^2 u)^2 / sum s^2 + mass_std^2 (sum s^2 u / sum s^2)^2`.
//!
//! Influences `mu` come from the solver, or from statics: where no redundant wrench is measured, a wrench on a body reaches all
//! joints between it and the base, `mu_oi = X_i S_o`. Redundant wrenches change that.

use super::equations::{Equations, Kind};
use super::spatial::{angular, linear};
use super::tree::Tree;
use nalgebra::{Matrix3, Vector3, Vector6};

variables! {
    /// How well the body is known, as standard deviations. The defaults of the segments are what the tables of Winter (2009,
    /// 4.1) and of de Leva (1996, 4, women and men) differ by: 16 % (rms) in mass, from 1 % for a forearm to 39 % for a thigh;
    /// 3.5 % of a limb's length in its centre of mass; 26 % in inertia. 1 kg is clothes, shoes and a meal.
    #[derive(Copy)]
    pub struct ScatterParameters {
        /// Standard deviation of the person's mass.
        mass_std: f64 = 1.0, "kg", [0.0, 100.0];
        /// Standard deviation of each segment's mass, as a share of it; their sum is as well known as the person's mass.
        segment_mass_std: f64 = 0.15, "1", [0.0, 1.0];
        /// Standard deviation of each segment's centre of mass along each axis, as a share of its radius of gyration (0.3 of a limb's length).
        segment_com_std: f64 = 0.1, "1", [0.0, 1.0];
        /// Standard deviation of each segment's inertia about its centre of mass, as a share of it.
        segment_inertia_std: f64 = 0.25, "1", [0.0, 1.0];
        /// Standard deviation of the base's axes about each axis: its accelerometer's mounting, or the floor.
        inclination_std: f64 = 0.01, "rad", [0.0, 0.5];
    }
}

impl ScatterParameters {
    /// A body that is known exactly.
    pub const NONE: Self = Self {
        mass_std: 0.0,
        segment_mass_std: 0.0,
        segment_com_std: 0.0,
        segment_inertia_std: 0.0,
        inclination_std: 0.0,
    };
}

/// A body's numbers and what its net wrench is in this step.
#[derive(Clone, Copy, Debug)]
struct Segment {
    mass: f64,
    com: Vector3<f64>,
    mass_variance: f64,
    com_variance: f64,
    /// From its axes to the base's.
    rotation: Matrix3<f64>,
    force: Vector3<f64>,
    /// About the centre of mass.
    moment: Vector3<f64>,
}

/// The considered errors of one body. Allocates at construction only.
#[derive(Clone, Debug)]
pub struct Scatter {
    parameters: ScatterParameters,
    segments: Vec<Segment>,
    /// Sum of the segments' variances of mass, kg^2.
    mass_variance: f64,
    /// Proper acceleration of the base's origin, base axes, m/s2.
    base_acceleration: Vector3<f64>,
    /// The bodies that each body carries, itself first, parents before children.
    carried: Vec<Vec<usize>>,
    influence: Vec<Vector6<f64>>,
}

/// What the errors make of one estimate, summed over the bodies.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    /// Sum of `s^2 u` and of `s^2 u^2` of the masses.
    mass: [f64; 2],
    /// Variance by centres of mass and inertias.
    shape: f64,
    /// What a unit of proper acceleration of all bodies makes of the estimate, base axes.
    field: Vector3<f64>,
}

impl Scatter {
    /// For a tree.
    pub fn new(tree: &Tree, parameters: &ScatterParameters) -> Self {
        let n = tree.bodies.len();
        let segment = |body: &super::tree::Body| {
            let i = &body.inertia;
            let (mut com, mut com_variance) = (Vector3::zeros(), 0.0);
            if i.mass > 0.0 {
                com = i.moment / i.mass;
                let about_com = i.rotational.trace() - 2.0 * i.mass * com.norm_squared();
                com_variance = parameters.segment_com_std.powi(2) * (0.5 * about_com / i.mass).max(0.0);
            }
            Segment {
                mass: i.mass,
                com,
                mass_variance: (parameters.segment_mass_std * i.mass).powi(2),
                com_variance,
                rotation: Matrix3::identity(),
                force: Vector3::zeros(),
                moment: Vector3::zeros(),
            }
        };
        let segments: Vec<Segment> = tree.bodies.iter().map(segment).collect();
        let mut carried: Vec<Vec<usize>> = (0..n).map(|b| vec![b]).collect();
        for b in 0..n {
            let mut above = tree.bodies[b].parent;
            while let Some(a) = above {
                carried[a].push(b);
                above = tree.bodies[a].parent;
            }
        }
        Self {
            parameters: *parameters,
            mass_variance: segments.iter().map(|s| s.mass_variance).sum(),
            segments,
            base_acceleration: Vector3::zeros(),
            carried,
            influence: vec![Vector6::zeros(); n],
        }
    }

    /// Takes posture and net wrenches of a solution `mean` of the equations.
    pub fn take(&mut self, equations: &Equations, mean: &[f64]) {
        self.base_acceleration = equations.base_acceleration(mean);
        for (b, body) in equations.tree().bodies.iter().enumerate() {
            if let Some(parent) = body.parent {
                self.segments[b].rotation =
                    self.segments[parent].rotation * equations.from_parent(b).rotation.transpose();
            }
            let Some(slots) = equations.slots()[b] else { continue };
            let net = Vector6::from_column_slice(&mean[slots.range(Kind::NetWrench)]);
            let segment = &mut self.segments[b];
            segment.force = linear(&net);
            segment.moment = angular(&net) - segment.com.cross(&segment.force);
        }
    }

    /// The variance of an estimate on which a wrench on body b, in its axes at its origin, has the influence `influence(b)`.
    pub fn variance(&self, bodies: impl Iterator<Item = (usize, Vector6<f64>)>) -> f64 {
        let mut sum = Sum::default();
        let inertia_variance = self.parameters.segment_inertia_std.powi(2);
        for (b, influence) in bodies {
            let s = &self.segments[b];
            if s.mass == 0.0 {
                continue;
            }
            let (by_force, by_moment) = (linear(&influence), angular(&influence));
            // of a force at the centre of mass
            let at_com = by_force + by_moment.cross(&s.com);
            let by_inertia = by_moment.dot(&s.moment);
            let per_mass = (at_com.dot(&s.force) + by_inertia) / s.mass;
            sum.mass[0] += s.mass_variance * per_mass;
            sum.mass[1] += s.mass_variance * per_mass * per_mass;
            sum.shape += s.com_variance * by_moment.cross(&s.force).norm_squared();
            sum.shape += inertia_variance * by_inertia * by_inertia;
            sum.field += s.rotation * at_com * s.mass;
        }
        let p = &self.parameters;
        let mut variance = sum.shape + (p.inclination_std * sum.field.cross(&self.base_acceleration).norm()).powi(2);
        if self.mass_variance > 0.0 {
            let common = sum.mass[0] / self.mass_variance;
            variance += (sum.mass[1] - sum.mass[0] * common).max(0.0) + (p.mass_std * common).powi(2);
        }
        variance
    }

    /// The variances of all joint torques and of the wrench on a moving base by statics, in the order of
    /// [`Tree::dof_names`] and then force and moment.
    pub fn by_statics(&mut self, equations: &Equations, variances: &mut [f64]) {
        let tree = equations.tree();
        for (dof, &(body, k)) in tree.dof_places.iter().enumerate() {
            variances[dof] = self.of_screw(equations, body, equations.screw(body, k));
        }
        if equations.slots()[0].is_some() {
            for axis in 0..6 {
                let unit = Vector6::from_fn(|k, _| f64::from(u8::from(k == axis)));
                variances[tree.dof() + axis] = self.of_screw(equations, 0, unit);
            }
        }
    }

    /// The variance of the component along a screw of the wrench that holds a body.
    fn of_screw(&mut self, equations: &Equations, body: usize, screw: Vector6<f64>) -> f64 {
        self.influence[body] = screw;
        for &b in &self.carried[body][1..] {
            let parent = equations.tree().bodies[b].parent.unwrap_or(body);
            self.influence[b] = equations.from_parent(b).motion(&self.influence[parent]);
        }
        self.variance(self.carried[body].iter().map(|&b| (b, self.influence[b])))
    }
}
