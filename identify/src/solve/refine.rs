//! Sequential convex refinement: output error and other smooth residuals.
//!
//! At the current point the residuals are linearised, and the step minimises the robust cost of the
//! linear model in Clarabel under the bounds and a trust region (a second-order cone, or a box). A step
//! that lowers the true cost enough is taken and the trust region grows; otherwise it shrinks.
//! Equations: Gauss-Newton with Huber rows, one convex program per step.

use super::compress::Factors;
use super::{
    Affine, Constraint, Loss, Options, Regression, Rows, Scale, Solution, SolveError, Unknown, covariance, profile,
    robust, student,
};
use crate::progress::Progress;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A group of residuals of one unit.
#[derive(Clone, Debug)]
pub struct SmoothGroup {
    /// Name for reports.
    pub name: String,
    /// Unit of the residuals.
    pub unit: &'static str,
    /// Noise level; a robust one is estimated from the residuals after each pass.
    pub scale: Scale,
    /// Consecutive rows whose noise may be correlated.
    pub cluster_rows: usize,
}

/// Shape of the trust region of steps `d`, in units of the typical sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrustNorm {
    /// `|d / typical|_2 <= radius`, a second-order cone.
    Euclidean,
    /// `|d_i / typical_i| <= radius` for every unknown.
    Box,
}

/// The trust region.
#[derive(Clone, Copy, Debug)]
pub struct Trust {
    /// First radius.
    pub radius: f64,
    /// Largest radius.
    pub largest: f64,
    /// Its shape.
    pub norm: TrustNorm,
    /// Share of the predicted fall of the cost that a step must reach to be taken.
    pub accept: f64,
}

impl Default for Trust {
    fn default() -> Self {
        Self { radius: 0.5, largest: 10.0, norm: TrustNorm::Euclidean, accept: 0.0 }
    }
}

/// What computes the residuals of every group at a point.
pub type Residuals<'a> = dyn Fn(&[f64]) -> Vec<Vec<f64>> + Sync + 'a;

/// Smooth residuals `measured - simulated(theta)` to be made small.
pub struct Smooth<'a> {
    /// What it is about, for messages.
    pub name: String,
    /// The unknowns with bounds and priors.
    pub unknowns: Vec<Unknown>,
    /// Where to start.
    pub start: Vec<f64>,
    /// Typical size of each unknown: unit of the trust region and, times 1e-4, the difference step.
    pub typical: Vec<f64>,
    /// The groups of residuals.
    pub groups: Vec<SmoothGroup>,
    /// Residuals per group at a point; always as many; NaN = no sample there.
    pub residuals: &'a Residuals<'a>,
    /// Constraints beyond the bounds.
    pub constraints: Vec<Constraint>,
    /// The trust region.
    pub trust: Trust,
    /// Passes over the whole refinement between which [`Scale::Robust`] groups are rescaled.
    pub passes: usize,
    /// Residuals of a fuller model, if there is one: their difference at the end point is what the
    /// refinement neglects, see [`Rows::neglected`].
    pub fuller: Option<&'a Residuals<'a>>,
    /// Subtract the bias that this causes.
    pub correct: bool,
    /// The unknowns whose [`profile`](mod@super::profile) is wanted.
    pub profiled: Vec<usize>,
    /// Where to tell how far it is.
    pub progress: Progress,
}

/// Steps per pass at most.
const STEPS: usize = 15;
/// Attempts per step at most.
const ATTEMPTS: usize = 6;
/// A smaller relative fall of the cost ends a pass.
const TOLERANCE: f64 = 1e-6;
/// The same for the refits of a profile, whose differences count.
const PROFILE_TOLERANCE: f64 = 1e-9;

/// Minimises the robust cost of smooth residuals.
///
/// Errors if the residuals are not finite at the start. A trial point at which they are not
/// finite counts as infinitely bad. The covariance is the sandwich at the end point; it does not
/// know of errors of the simulated model itself.
pub fn refine(problem: &Smooth, loss: Loss) -> Result<Solution, SolveError> {
    let start: Vec<f64> = problem
        .start
        .iter()
        .zip(&problem.unknowns)
        .map(|(value, unknown)| value.clamp(unknown.lower, unknown.upper))
        .collect();
    let mut scales: Vec<f64> =
        problem.groups.iter().map(|group| if let Scale::Known(scale) = group.scale { scale } else { 1.0 }).collect();
    let mut point =
        Descended { residuals: (problem.residuals)(&start), theta: start, accuracy: super::Accuracy::Solved };
    let diverged = || SolveError::Diverged { regression: problem.name.clone() };
    let rescale = |residuals: &[Vec<f64>], scales: &mut [f64]| {
        for ((group, residuals), scale) in problem.groups.iter().zip(residuals).zip(scales) {
            if group.scale == Scale::Robust {
                let present: Vec<f64> = residuals.iter().copied().filter(|r| r.is_finite()).collect();
                *scale = robust::deviation(&present, &present);
            }
        }
    };
    let first = &point.residuals;
    if first.iter().flatten().any(|r| r.is_infinite()) || !first.iter().flatten().any(|r| r.is_finite()) {
        return Err(diverged());
    }
    let mut costs = Vec::new();
    let passes = problem.passes.max(1);
    for pass in 0..passes {
        rescale(&point.residuals, &mut scales);
        let progress = problem.progress.piece(pass, passes);
        let descent = Descent { problem, scales: &scales, loss, pull: None, tolerance: TOLERANCE, progress };
        point = descent.from(point, &mut costs)?;
    }
    let Descended { theta, residuals, accuracy } = point;
    let jacobian = jacobian(problem, &theta, &residuals, &problem.progress);
    let fuller = problem.fuller.map(|fuller| fuller(&theta));
    let end = linearised(problem, &theta, &residuals, &jacobian, f64::INFINITY, fuller.as_deref());
    let at_bound = theta
        .iter()
        .zip(&problem.unknowns)
        .zip(&problem.typical)
        .map(|((value, unknown), typical)| {
            value - unknown.lower < 1e-9 * typical || unknown.upper - value < 1e-9 * typical
        })
        .collect();
    let minimiser = robust::Minimiser { theta: vec![0.0; theta.len()], at_bound, accuracy };
    let options = Options { loss, correct: problem.correct, ..Options::default() };
    let mut solution = covariance::of_regression(&end, &Factors::of(&end), &scales, &options, minimiser);
    solution.theta.iter_mut().zip(&theta).for_each(|(step, value)| *step += value);
    solution.cost = costs;
    for index in problem.profiled.iter().copied() {
        if let Some(curve) = profile(problem, &solution, index, loss)? {
            solution.profiles.push((index, curve));
        }
    }
    Ok(solution)
}

/// The profile of one unknown with the weights of the answer and the inflation by its covariance.
pub fn profile(
    problem: &Smooth,
    solution: &Solution,
    index: usize,
    loss: Loss,
) -> Result<Option<profile::Curve>, SolveError> {
    let refit = |pull: Option<&profile::Pull>, from: &[f64]| {
        let progress = Progress::none();
        let descent = Descent { problem, scales: &solution.scales, loss, pull, tolerance: PROFILE_TOLERANCE, progress };
        let clamped =
            from.iter().zip(&problem.unknowns).map(|(value, unknown)| value.clamp(unknown.lower, unknown.upper));
        let theta: Vec<f64> = clamped.collect();
        let residuals = (problem.residuals)(&theta);
        if !residuals.iter().flatten().any(|r| r.is_finite()) {
            return Err(SolveError::Diverged { regression: problem.name.clone() });
        }
        let point = Descended { residuals, theta, accuracy: super::Accuracy::Solved };
        let end = descent.from(point, &mut Vec::new())?;
        let least = cost(problem, &end.residuals, &solution.scales, &end.theta, loss);
        Ok((end.theta, least))
    };
    let std = |variance: f64| variance.max(0.0).sqrt();
    profile::curve(&profile::Subject {
        theta: &solution.theta,
        of: &move |theta| theta[index],
        std: std(solution.covariance[(index, index)]) * student(solution.degrees_of_freedom),
        std_of_cost: std(solution.inverse_information[(index, index)]),
        range: (problem.unknowns[index].lower, problem.unknowns[index].upper),
        refit: &refit,
    })
}

/// One descent with fixed weights, perhaps pulled.
struct Descent<'a> {
    problem: &'a Smooth<'a>,
    scales: &'a [f64],
    loss: Loss,
    pull: Option<&'a profile::Pull>,
    tolerance: f64,
    progress: Progress,
}

/// A point of a descent.
struct Descended {
    theta: Vec<f64>,
    residuals: Vec<Vec<f64>>,
    accuracy: super::Accuracy,
}

impl Descent<'_> {
    fn cost(&self, residuals: &[Vec<f64>], theta: &[f64]) -> f64 {
        cost(self.problem, residuals, self.scales, theta, self.loss) + self.pull.map_or(0.0, |pull| pull.cost(theta))
    }

    /// Descends from a point; `costs` gets the cost there and after each step.
    fn from(&self, start: Descended, costs: &mut Vec<f64>) -> Result<Descended, SolveError> {
        let problem = self.problem;
        let options = Options { loss: self.loss, ..Options::default() };
        let mut point = start;
        let count = |residuals: &[Vec<f64>]| -> Vec<usize> {
            residuals.iter().map(|group| group.iter().filter(|r| r.is_finite()).count()).collect()
        };
        let present = count(&point.residuals);
        let mut trust = problem.trust.radius;
        let mut value = self.cost(&point.residuals, &point.theta);
        costs.push(value);
        for step in 0..STEPS {
            let jacobian = jacobian(problem, &point.theta, &point.residuals, &self.progress.piece(step, STEPS));
            let before = value;
            for _ in 0..ATTEMPTS {
                let step = linearised(problem, &point.theta, &point.residuals, &jacobian, trust, None);
                let pull = self.pull.map(|pull| pull.from(&point.theta));
                let minimum =
                    robust::minimise(&step, &Factors::of(&step), self.scales, self.loss, &options, pull.as_ref())?;
                if minimum.accuracy != super::Accuracy::Solved {
                    point.accuracy = minimum.accuracy;
                }
                let trial: Vec<f64> = point
                    .theta
                    .iter()
                    .zip(&minimum.theta)
                    .zip(&problem.unknowns)
                    .map(|((from, step), unknown)| (from + step).clamp(unknown.lower, unknown.upper))
                    .collect();
                let predicted: Vec<Vec<f64>> =
                    step.groups.iter().map(|group| group.residuals(&minimum.theta)).collect();
                let fall = value - self.cost(&predicted, &trial);
                let residuals = (problem.residuals)(&trial);
                let complete = count(&residuals) == present;
                let reached = if complete { self.cost(&residuals, &trial) } else { f64::INFINITY };
                if reached < value && value - reached >= problem.trust.accept * fall {
                    (point.theta, point.residuals) = (trial, residuals);
                    value = reached;
                    costs.push(value);
                    trust = (2.0 * trust).min(problem.trust.largest);
                    break;
                }
                trust *= 0.25;
            }
            if before - value < self.tolerance * before {
                break;
            }
        }
        Ok(point)
    }
}

fn cost(problem: &Smooth, residuals: &[Vec<f64>], scales: &[f64], theta: &[f64], loss: Loss) -> f64 {
    let rows: f64 = residuals
        .iter()
        .zip(scales)
        .map(|(group, scale)| group.iter().filter(|r| !r.is_nan()).map(|r| loss.of(r / scale)).sum::<f64>())
        .sum();
    let priors: f64 = problem
        .unknowns
        .iter()
        .zip(theta)
        .filter_map(|(unknown, value)| unknown.prior.map(|(mean, std)| 0.5 * ((value - mean) / std).powi(2)))
        .sum();
    rows + priors
}

/// Forward differences of `-residuals`, one vector per unknown and group.
fn jacobian(problem: &Smooth, theta: &[f64], current: &[Vec<f64>], progress: &Progress) -> Vec<Vec<Vec<f64>>> {
    let done = AtomicUsize::new(0);
    (0..theta.len())
        .into_par_iter()
        .map(|index| {
            let mut moved = theta.to_vec();
            let step = 1e-4 * problem.typical[index];
            moved[index] += step;
            let ahead = (problem.residuals)(&moved);
            progress.reach((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / theta.len() as f64);
            current
                .iter()
                .zip(&ahead)
                .map(|(now, then)| now.iter().zip(then).map(|(now, then)| (now - then) / step).collect())
                .collect()
        })
        .collect()
}

/// The linear regression of a step `d`: `residual = -J d + noise` within bounds and trust region; given the
/// residuals of a fuller model, with what it neglects.
fn linearised(
    problem: &Smooth,
    theta: &[f64],
    current: &[Vec<f64>],
    jacobian: &[Vec<Vec<f64>>],
    trust: f64,
    fuller: Option<&[Vec<f64>]>,
) -> Regression {
    let n = theta.len();
    let unknowns = problem.unknowns.iter().zip(theta).zip(&problem.typical).map(|((unknown, value), typical)| {
        let reach = if problem.trust.norm == TrustNorm::Box { trust * typical } else { f64::INFINITY };
        Unknown {
            name: unknown.name.clone(),
            lower: (unknown.lower - value).max(-reach),
            upper: (unknown.upper - value).min(reach),
            prior: unknown.prior.map(|(mean, std)| (mean - value, std)),
        }
    });
    let groups = problem.groups.iter().enumerate().map(|(index, group)| {
        let mut rows = Rows::new(&group.name, group.unit, n);
        let mut row = vec![0.0; n];
        let size = group.cluster_rows.max(1);
        for (i, residual) in current[index].iter().enumerate() {
            row.iter_mut().zip(jacobian).for_each(|(value, column)| *value = column[index][i]);
            if rows.push(&row, *residual, (i / size) as u32)
                && let Some(fuller) = fuller
            {
                let neglected = residual - fuller[index][i];
                rows.neglected.push(if neglected.is_finite() { neglected } else { 0.0 });
            }
        }
        rows
    });
    let mut constraints: Vec<Constraint> = problem
        .constraints
        .iter()
        .map(|constraint| {
            let shift = |row: &Affine| Affine { terms: row.terms.clone(), constant: row.at(theta) };
            match constraint {
                Constraint::NonNegative(row) => Constraint::NonNegative(shift(row)),
                Constraint::SecondOrder(rows) => Constraint::SecondOrder(rows.iter().map(shift).collect()),
            }
        })
        .collect();
    if problem.trust.norm == TrustNorm::Euclidean && trust.is_finite() {
        let mut cone = vec![Affine::new(&[], trust)];
        cone.extend(
            problem.typical.iter().enumerate().map(|(index, typical)| Affine::new(&[(index, 1.0 / typical)], 0.0)),
        );
        constraints.push(Constraint::SecondOrder(cone));
    }
    Regression { name: problem.name.clone(), unknowns: unknowns.collect(), groups: groups.collect(), constraints }
}
