//! Accelerations, wrenches and joint torques of any tree of bodies from noisy sensors: the
//! equations of [`model::multibody`](crate::model::multibody) solved by [`filter::map`](crate::filter::map).

use crate::Status;
use crate::filter::map::{LANES, Map, Method, Numbers, Pattern};
use crate::model::multibody::equations::{Base, Equations, Kind, Slots};
use crate::model::multibody::error::ModelError;
use crate::model::multibody::prior::Variances;
use crate::model::multibody::scatter::{Scatter, ScatterParameters};
use crate::model::multibody::sensors::Sensor;
use crate::model::multibody::tree::Tree;
use nalgebra::{Vector3, Vector6};
use std::f64::consts::TAU;

/// A step that changed nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// A coordinate, a rate or the base's angular velocity is NaN or infinite.
    #[error("a joint position, a joint velocity or the base's angular velocity is not finite")]
    NotFinite,
    /// Neither method could solve the problem in double precision.
    #[error("the information matrix is singular to working precision")]
    SingularInformation,
}

/// Redundancy `1 - h` of a row below which only its own reading says what it measures. The prior
/// alone gives a row about its variance over the prior's.
const LEAST_REDUNDANCY: f64 = 0.01;

/// What moves: one sample of the posture.
#[derive(Clone, Copy, Debug)]
pub struct Posture<'a> {
    /// Joint positions in the order of [`Tree::dof_names`], rad (m).
    pub q: &'a [f64],
    /// Joint velocities, rad/s (m/s).
    pub qd: &'a [f64],
    /// Angular velocity of a moving base in base axes, rad/s.
    pub base_rate: [f64; 3],
}

/// One estimate per step, no memory between steps. Allocates at construction only.
#[derive(Clone, Debug)]
pub struct WholeBody {
    equations: Equations,
    map: Map,
    /// Weights of all rows when all are present, and of this step.
    full_weight: Vec<f64>,
    weight: Vec<f64>,
    right: Vec<f64>,
    present: Vec<bool>,
    precision: Vec<f64>,
    /// `sum ln` of the precisions.
    log_precision: f64,
    prior_mean: Vec<f64>,
    /// Where each sensor's samples start in the samples of a step.
    sample_start: Vec<usize>,
    /// Errors of the body that are considered, and what they make of torques and base wrench.
    scatter: Option<Scatter>,
    scattered: Vec<f64>,
    /// First row of Newton's and Euler's equations of each body.
    net_wrench_row: Vec<Option<usize>>,
    /// Covariances of some estimates with all variables, and the influence of each body's net wrench on them.
    covariance: Vec<[f64; LANES]>,
    influence: Vec<[[f64; LANES]; 6]>,
}

/// Fronts for the elimination along the tree: a body's front has its own variables and the wrenches
/// to its children, and bodies are eliminated from the leaves.
fn fronts(equations: &Equations) -> Vec<u32> {
    let bodies = &equations.tree().bodies;
    let mut front = vec![0; equations.variables()];
    for (b, (body, slots)) in bodies.iter().zip(equations.slots()).enumerate() {
        let Some(slots) = slots else { continue };
        for kind in Kind::ALL {
            let owner = if kind == Kind::ParentWrench { body.parent.unwrap_or(b) } else { b };
            front[slots.range(kind)].fill((bodies.len() - 1 - owner) as u32);
        }
    }
    front
}

/// How well readings agree with what all other information predicts of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Innovations {
    /// Normalised innovation squared per row, 0 without rows.
    pub nis: f64,
    /// Number of rows.
    pub rows: usize,
}

impl WholeBody {
    /// Builds the estimator of a tree with its sensors and variances.
    pub fn new(tree: Tree, base: Base, sensors: Vec<Sensor>, variances: &Variances) -> Result<Self, ModelError> {
        let mut sample_start = vec![0];
        for sensor in &sensors {
            sample_start.push(sample_start[sample_start.len() - 1] + sensor.quantity.rows());
        }
        let equations = Equations::new(tree, base, sensors)?;
        let inverse = |v: Vec<f64>| v.into_iter().map(|v| 1.0 / v).collect::<Vec<f64>>();
        let full_weight = inverse(variances.of_rows(&equations)?);
        let precision = inverse(variances.of_variables(&equations)?);
        let rows = equations.rows();
        let map = Map::new(&Pattern {
            unknowns: equations.variables(),
            start: &rows.start,
            column: &rows.column,
            varies: &rows.varies,
            monitored: equations.constraint_rows()..rows.len(),
            front: &fronts(&equations),
        });
        Ok(Self {
            map,
            weight: full_weight.clone(),
            right: vec![0.0; full_weight.len()],
            present: vec![true; full_weight.len()],
            prior_mean: vec![variances.mean; precision.len()],
            log_precision: sum_of_logarithms(precision.iter().copied()),
            full_weight,
            precision,
            sample_start,
            scatter: None,
            scattered: vec![0.0; equations.tree().dof() + 6],
            net_wrench_row: (0..equations.tree().bodies.len())
                .map(|body| equations.net_wrench_rows(body).map(|rows| rows.start))
                .collect(),
            covariance: vec![[0.0; LANES]; equations.variables()],
            influence: vec![[[0.0; LANES]; 6]; equations.tree().bodies.len()],
            equations,
        })
    }

    /// Considers errors of the body's own numbers; without, these are taken as exact.
    pub fn considering(self, parameters: &ScatterParameters) -> Self {
        let exact = *parameters == ScatterParameters::NONE;
        let scatter = (!exact).then(|| Scatter::new(self.equations.tree(), parameters));
        Self { scatter, ..self }
    }

    /// Estimates from one sample of the posture and of all sensors, in their order; what is not
    /// finite among the sensors' samples is missing. With `variances` also computes the variances
    /// of all variables.
    pub fn step(&mut self, posture: &Posture, samples: &[f64], variances: bool) -> Result<Status, StepError> {
        let status = self.prepare(posture, samples)?;
        let numbers = numbers(&self.equations, &self.right, &self.weight, &self.precision, &self.prior_mean);
        match self.map.solve(&numbers, variances) {
            Ok(Method::SparseLdl) => Ok(status),
            Ok(Method::TreeQr) => Ok(status | Status::RECOVERED),
            Err(_) => Err(StepError::SingularInformation),
        }
    }

    /// The same by the orthogonal method alone, for comparison.
    pub fn step_by_qr(&mut self, posture: &Posture, samples: &[f64], variances: bool) -> Result<Status, StepError> {
        let status = self.prepare(posture, samples)?;
        let numbers = numbers(&self.equations, &self.right, &self.weight, &self.precision, &self.prior_mean);
        match self.map.solve_by_qr(&numbers, variances) {
            Ok(()) => Ok(status),
            Err(_) => Err(StepError::SingularInformation),
        }
    }

    /// Moves the rows to the posture and takes the samples.
    fn prepare(&mut self, posture: &Posture, samples: &[f64]) -> Result<Status, StepError> {
        let finite = |v: &[f64]| v.iter().all(|x| x.is_finite());
        if !(finite(posture.q) && finite(posture.qd) && finite(&posture.base_rate)) {
            return Err(StepError::NotFinite);
        }
        self.equations.update(posture.q, posture.qd, &Vector3::from(posture.base_rate));
        let constraints = self.equations.constraint_rows();
        for (right, offset) in self.right.iter_mut().zip(&self.equations.rows().offset).take(constraints) {
            *right = -offset;
        }
        let mut status = Status::OK;
        let mut measured = false;
        for (s, sensor) in self.equations.sensors().iter().enumerate() {
            let taken = &samples[self.sample_start[s]..self.sample_start[s + 1]];
            status.raise_if(taken.iter().any(|y| y.is_nan()), Status::MISSING);
            status.raise_if(taken.iter().any(|y| y.is_infinite()), Status::INFINITE);
            if sensor.equation_rows() > 0 {
                let rows = self.equations.sensor_rows(s);
                self.equations.take(s, taken, &mut self.right[rows.clone()], &mut self.present[rows]);
            }
        }
        for row in constraints..self.weight.len() {
            self.weight[row] = if self.present[row] { self.full_weight[row] } else { 0.0 };
            measured |= self.present[row];
        }
        status.raise_if(!measured, Status::NO_MEASUREMENT);
        Ok(status)
    }

    /// The mean of all variables; see [`Equations::slots`].
    pub fn mean(&self) -> &[f64] {
        self.map.mean()
    }

    /// The variances of all variables of the last step that computed them.
    pub fn variance(&self) -> &[f64] {
        self.map.variance()
    }

    /// What the considered errors of the body add to the variances of the torques, in the order of [`Tree::dof_names`], and
    /// of the wrench on a moving base, after a step with variances: by the solver's own influence of each body's wrench on
    /// each of them, one more solution per estimate.
    pub fn scattered(&mut self) -> &[f64] {
        let Some(scatter) = &mut self.scatter else { return &self.scattered };
        scatter.take(&self.equations, self.map.mean());
        let dof = self.equations.tree().dof();
        let base = self.equations.slots()[0].map(|slots| slots.range(Kind::ParentWrench).start);
        let estimates = dof + if base.is_some() { 6 } else { 0 };
        for first in (0..estimates).step_by(LANES) {
            // The last ones are asked for twice rather than fewer than fill the lanes.
            let of_lane: [usize; LANES] = std::array::from_fn(|k| (first + k).min(estimates - 1));
            let unknowns = of_lane.map(|estimate| match base {
                Some(base) if estimate >= dof => base + estimate - dof,
                _ => self.torque_slot(estimate),
            });
            if !self.map.covariances(&unknowns, &mut self.covariance) {
                return self.scattered_by_statics();
            }
            for (body, first) in self.net_wrench_row.iter().enumerate() {
                let Some(first) = first else { continue };
                for k in 0..6 {
                    self.influence[body][k] = self.equations.rows().times(first + k, &self.covariance);
                    self.influence[body][k].iter_mut().for_each(|influence| *influence *= self.weight[first + k]);
                }
            }
            let Some(scatter) = &self.scatter else { break };
            for (lane, estimate) in of_lane.into_iter().enumerate() {
                let influence = |body: usize| Vector6::from_fn(|k, _| self.influence[body][k][lane]);
                let bodies = (0..self.influence.len()).filter(|&body| self.net_wrench_row[body].is_some());
                self.scattered[estimate] = scatter.variance(bodies.map(|body| (body, influence(body))));
            }
        }
        &self.scattered
    }

    /// The same with influences by statics, which costs little: the same where no wrench is measured that the others already
    /// say.
    pub fn scattered_by_statics(&mut self) -> &[f64] {
        if let Some(scatter) = &mut self.scatter {
            scatter.take(&self.equations, self.map.mean());
            scatter.by_statics(&self.equations, &mut self.scattered);
        }
        &self.scattered
    }

    /// The equations.
    pub fn equations(&self) -> &Equations {
        &self.equations
    }

    /// The solver, for its size.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// Samples that a step takes.
    pub fn samples(&self) -> usize {
        self.sample_start[self.sample_start.len() - 1]
    }

    /// Rows of measurements present in the last step.
    pub fn measurements(&self) -> usize {
        self.present[self.equations.constraint_rows()..].iter().filter(|p| **p).count()
    }

    /// Torque of the joint with coordinate `dof` in `d`.
    pub fn torque_slot(&self, dof: usize) -> usize {
        let (body, k) = self.equations.tree().dof_places[dof];
        let slots = self.equations.slots()[body].unwrap_or(Slots { start: 0, dof: 0 });
        slots.range(Kind::Torque).start + k
    }

    /// Residual `b - A mean` of a row of the last step, and its weight.
    pub fn residual(&self, row: usize) -> (f64, f64) {
        let rows = self.equations.rows();
        let entries = rows.start[row]..rows.start[row + 1];
        let mean = self.map.mean();
        let entries = rows.value[entries.clone()].iter().zip(&rows.column[entries]);
        let product: f64 = entries.map(|(value, column)| value * mean[*column as usize]).sum();
        (self.right[row] - product, self.weight[row])
    }

    /// `sum residual^2 / variance` over the rows of a sensor present in the last step, and their number.
    pub fn sensor_chi2(&self, sensor: usize) -> (f64, usize) {
        let rows = self.equations.sensor_rows(sensor);
        rows.fold((0.0, 0), |(sum, count), row| {
            let (residual, weight) = self.residual(row);
            (sum + weight * residual * residual, count + usize::from(self.present[row]))
        })
    }

    /// Innovations of the rows of the sensors that `counts` picks, after a step with variances.
    ///
    /// The innovation of a row is its reading minus what all other information predicts. With
    /// residual r at the estimate, weight w and leverage h it is `r / (1 - h)` with variance
    /// `1 / (w (1 - h))`, so its normalised square is `w r^2 / (1 - h)`. Rows that nothing else
    /// predicts (h near 1) say nothing about model and noise and do not count.
    pub fn innovations(&self, counts: impl Fn(usize) -> bool) -> Innovations {
        let numbers = numbers(&self.equations, &self.right, &self.weight, &self.precision, &self.prior_mean);
        let mut found = Innovations::default();
        for sensor in (0..self.equations.sensors().len()).filter(|&s| counts(s)) {
            for row in self.equations.sensor_rows(sensor).filter(|&row| self.present[row]) {
                let Some(leverage) = self.map.leverage(row, &numbers) else { continue };
                let redundancy = 1.0 - leverage;
                if redundancy > LEAST_REDUNDANCY {
                    let (residual, weight) = self.residual(row);
                    let square = weight * residual * residual / redundancy;
                    found.nis += square;
                    found.rows += 1;
                }
            }
        }
        found.nis /= found.rows.max(1) as f64;
        found
    }

    /// Logarithm of the joint density of equations and readings under noise and prior, from the factor of
    /// the last step; 0 if the orthogonal method had to step in:
    /// `-1/2 (objective + ln det Lambda - sum ln w - sum ln p + n ln 2 pi)` with the `n` rows present.
    pub fn log_likelihood(&self) -> f64 {
        let weights = || self.weight.iter().copied().filter(|weight| *weight > 0.0);
        let determinant = sum_of_logarithms(self.map.ldl().pivots().iter().copied());
        if !determinant.is_finite() {
            return 0.0;
        }
        let known = sum_of_logarithms(weights()) + self.log_precision;
        -0.5 * (self.objective() + determinant - known + weights().count() as f64 * TAU.ln())
    }

    /// The whole objective at the mean: rows and prior.
    pub fn objective(&self) -> f64 {
        let rows = (0..self.weight.len()).map(|row| {
            let (residual, weight) = self.residual(row);
            weight * residual * residual
        });
        let prior = self.precision.iter().zip(self.map.mean()).zip(&self.prior_mean);
        rows.sum::<f64>() + prior.map(|((p, x), m)| p * (x - m) * (x - m)).sum::<f64>()
    }
}

/// `sum ln x`; products are cheaper than logarithms.
fn sum_of_logarithms(numbers: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut product) = (0.0, 1.0_f64);
    for x in numbers {
        product *= x;
        if !(1e-150..1e150).contains(&product) {
            sum += product.ln();
            product = 1.0;
        }
    }
    sum + product.ln()
}

fn numbers<'a>(
    equations: &'a Equations,
    right: &'a [f64],
    weight: &'a [f64],
    precision: &'a [f64],
    mean: &'a [f64],
) -> Numbers<'a> {
    Numbers { value: &equations.rows().value, right, weight, precision, mean }
}
