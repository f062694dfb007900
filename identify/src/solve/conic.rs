//! Conic programs and their solution by Clarabel.
//!
//! A [`Program`] is `min 1/2 x'P x + q'x` over rows that are zero, non-negative or in second-order
//! cones. Its rows are written as affine expressions of the variables; Clarabel's own form
//! `A x + s = b`, `s` in the cone, is made at the end (`s` = expression).

use super::{Accuracy, Affine, Constraint, HUBER_DELTA, Loss, SolveError, dot};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus, SupportedConeT,
    ZeroConeT,
};

/// A conic program under construction.
#[derive(Clone, Debug, Default)]
pub struct Program {
    variables: usize,
    quadratic: Vec<(usize, usize, f64)>,
    linear: Vec<f64>,
    zero: Vec<Affine>,
    non_negative: Vec<Affine>,
    second_order: Vec<Vec<Affine>>,
}

/// The solution of a [`Program`].
#[derive(Clone, Debug)]
pub struct Optimum {
    /// The variables.
    pub x: Vec<f64>,
    /// Value and multiplier of each non-negative row, in the order they were added.
    pub non_negative: Vec<(f64, f64)>,
    /// Distance of each second-order cone row from the cone's surface, relative to its size.
    pub cone_margin: Vec<f64>,
    /// Value of the dual program: no point that meets the constraints costs less.
    pub least_cost: f64,
    /// How exactly it was solved.
    pub accuracy: Accuracy,
}

/// Cost above the minimum, in units of the noise, that no user sees: the answer is within a hundredth of a standard error,
/// `sqrt(2 cost)` in the metric of the information.
pub const NEGLIGIBLE: f64 = 5e-5;

impl Program {
    /// Adds `count` variables and returns the index of the first.
    pub fn add(&mut self, count: usize) -> usize {
        let first = self.variables;
        self.variables += count;
        self.linear.resize(self.variables, 0.0);
        first
    }

    /// Adds `1/2 factor x_i^2` to the cost.
    pub fn square(&mut self, index: usize, factor: f64) {
        self.quadratic.push((index, index, factor));
    }

    /// Adds `factor x_i` to the cost.
    pub fn cost(&mut self, index: usize, factor: f64) {
        self.linear[index] += factor;
    }

    /// Requires the expression to vanish.
    pub fn zero(&mut self, expression: Affine) {
        self.zero.push(expression);
    }

    /// Requires the expression not to be negative.
    pub fn non_negative(&mut self, expression: Affine) {
        self.non_negative.push(expression);
    }

    /// Requires the norm of all but the first expression to be at most the first.
    pub fn second_order(&mut self, rows: Vec<Affine>) {
        self.second_order.push(rows);
    }

    /// Solves it. Any end but `Solved` and `AlmostSolved` means that the constraints and the cost contradict each other:
    /// Clarabel proves it (infeasible), or runs out of digits on the way.
    pub fn solve(&self, name: &str) -> Result<Optimum, SolveError> {
        let rows = self.zero.iter().chain(&self.non_negative).chain(self.second_order.iter().flatten());
        let (mut i, mut j, mut v, mut b) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (index, row) in rows.enumerate() {
            for &(variable, factor) in &row.terms {
                i.push(index);
                j.push(variable);
                v.push(-factor);
            }
            b.push(row.constant);
        }
        let a = CscMatrix::new_from_triplets(b.len(), self.variables, i, j, v);
        let mut upper = (Vec::new(), Vec::new(), Vec::new());
        for &(row, column, value) in &self.quadratic {
            upper.0.push(row);
            upper.1.push(column);
            upper.2.push(value);
        }
        let p = CscMatrix::new_from_triplets(self.variables, self.variables, upper.0, upper.1, upper.2);
        let mut cones: Vec<SupportedConeT<f64>> = Vec::new();
        if !self.zero.is_empty() {
            cones.push(ZeroConeT(self.zero.len()));
        }
        if !self.non_negative.is_empty() {
            cones.push(NonnegativeConeT(self.non_negative.len()));
        }
        cones.extend(self.second_order.iter().map(|rows| SecondOrderConeT(rows.len())));
        let failed = || SolveError::Contradiction { regression: name.to_owned(), details: String::new() };
        // Tight first; where rounding forbids that, Clarabel's own tolerance is a full solution too.
        let mut last = None;
        for tolerance in [1e-10, 1e-8] {
            let settings = DefaultSettings {
                verbose: false,
                max_iter: 400,
                tol_gap_abs: tolerance,
                tol_gap_rel: tolerance,
                tol_feas: tolerance,
                ..Default::default()
            };
            let mut solver = DefaultSolver::new(&p, &self.linear, &a, &b, &cones, settings).map_err(|_| failed())?;
            solver.solve();
            let status = solver.solution.status;
            last = Some((status, solver.solution));
            if status == SolverStatus::Solved {
                break;
            }
        }
        let Some((status, solution)) = last else { return Err(failed()) };
        let accuracy = match status {
            SolverStatus::Solved => Accuracy::Solved,
            SolverStatus::AlmostSolved => Accuracy::AlmostSolved,
            _ => return Err(failed()),
        };
        let start = self.zero.len();
        let non_negative = (start..start + self.non_negative.len()).map(|k| (solution.s[k], solution.z[k])).collect();
        let mut start = start + self.non_negative.len();
        let mut cone_margin = Vec::new();
        for rows in &self.second_order {
            let s = &solution.s[start..start + rows.len()];
            let norm = s[1..].iter().map(|value| value * value).sum::<f64>().sqrt();
            cone_margin.push((s[0] - norm) / s[0].abs().max(f64::MIN_POSITIVE));
            start += rows.len();
        }
        Ok(Optimum { x: solution.x, non_negative, cone_margin, least_cost: solution.obj_val_dual, accuracy })
    }
}

/// Bounds and constraints of a regression, in the scaled unknowns `z_j = scale_j theta_j` that a
/// program works with.
#[derive(Clone, Debug)]
pub struct Feasible {
    /// Expressions that are not negative.
    pub half_spaces: Vec<Affine>,
    /// Which unknowns a half space is about: its index if it is the bound of one of them.
    pub bound_of: Vec<Option<usize>>,
    /// Second-order cones.
    pub cones: Vec<Vec<Affine>>,
}

impl Feasible {
    /// From bounds `(lower, upper)` per unknown and constraints, `scale` being one factor per unknown.
    pub fn new(bounds: &[(f64, f64)], constraints: &[Constraint], scale: &[f64]) -> Self {
        let scaled = |expression: &Affine| {
            // A row of unit size keeps slack and multiplier comparable.
            let terms: Vec<_> =
                expression.terms.iter().map(|&(index, factor)| (index, factor / scale[index])).collect();
            let size = terms.iter().map(|(_, factor)| factor * factor).sum::<f64>().sqrt();
            (Affine { terms, constant: expression.constant }, if size > 0.0 { size } else { 1.0 })
        };
        let divided = |(mut expression, size): (Affine, f64)| {
            expression.terms.iter_mut().for_each(|(_, factor)| *factor /= size);
            expression.constant /= size;
            expression
        };
        let mut all = Self { half_spaces: Vec::new(), bound_of: Vec::new(), cones: Vec::new() };
        for (index, &(lower, upper)) in bounds.iter().enumerate() {
            if lower.is_finite() {
                all.half_spaces.push(Affine::new(&[(index, 1.0)], -lower * scale[index]));
                all.bound_of.push(Some(index));
            }
            if upper.is_finite() {
                all.half_spaces.push(Affine::new(&[(index, -1.0)], upper * scale[index]));
                all.bound_of.push(Some(index));
            }
        }
        for constraint in constraints {
            match constraint {
                Constraint::NonNegative(expression) => {
                    all.half_spaces.push(divided(scaled(expression)));
                    all.bound_of.push(None);
                }
                Constraint::SecondOrder(rows) => {
                    let rows: Vec<_> = rows.iter().map(scaled).collect();
                    let size = rows.iter().map(|(_, size)| *size).fold(0.0, f64::max);
                    all.cones.push(rows.into_iter().map(|(row, _)| divided((row, size))).collect());
                }
            }
        }
        all
    }

    /// Adds the constraints to a program whose first variables are the scaled unknowns. The half
    /// spaces come first among the program's non-negative rows if called before any other is added.
    pub fn constrain(&self, program: &mut Program) {
        self.half_spaces.iter().for_each(|row| program.non_negative(row.clone()));
        self.cones.iter().for_each(|rows| program.second_order(rows.clone()));
    }

    /// The same set with all lengths divided by `size`.
    pub fn shrunk(&self, size: f64) -> Self {
        let mut all = self.clone();
        all.half_spaces.iter_mut().chain(all.cones.iter_mut().flatten()).for_each(|row| row.constant /= size);
        all
    }

    /// The same set for the distance from `origin`.
    pub fn shifted(&self, origin: &[f64]) -> Self {
        let mut all = self.clone();
        for row in all.half_spaces.iter_mut().chain(all.cones.iter_mut().flatten()) {
            row.constant = row.at(origin);
        }
        all
    }

    /// Whether a point satisfies everything, up to `slack`.
    pub fn holds(&self, z: &[f64], slack: f64) -> bool {
        self.half_spaces.iter().all(|row| row.at(z) >= -slack)
            && self.cones.iter().all(|rows| {
                let norm = rows[1..].iter().map(|row| row.at(z).powi(2)).sum::<f64>().sqrt();
                rows[0].at(z) >= norm - slack
            })
    }
}

/// The exact conic program of a loss: variables `[z, ...]`, one or more per row.
///
/// `rows` yields `(regressors, right-hand side)` in units of the noise, regressors in scaled
/// unknowns; `quadratic` rows (priors) always count as squares. The program is written for the
/// distance from `origin`, best the least-squares answer, which keeps its numbers near one.
///
/// - least squares: `[z, r]`, `A z - r = y`, cost `1/2 r'r`
/// - Huber: `[z, u, t+, t-]`, `A z - u - t+ + t- = y`, cost `1/2 u'u + 1.345 (t+ + t-)`
/// - L1: `[z, t+, t-]`, `A z - t+ + t- = y`, cost `t+ + t-`
pub fn exact<'a>(
    name: &str,
    loss: Loss,
    origin: &[f64],
    rows: impl Iterator<Item = (&'a [f64], f64)>,
    quadratic: &[(Vec<f64>, f64)],
    feasible: &Feasible,
) -> Result<Optimum, SolveError> {
    let mut program = Program::default();
    let z = program.add(origin.len());
    feasible.shifted(origin).constrain(&mut program);
    let mut residual = |row: &[f64], rhs: f64, loss: Loss| {
        let mut terms: Vec<_> = row.iter().enumerate().map(|(index, &factor)| (z + index, factor)).collect();
        if loss != Loss::L1 {
            let u = program.add(1);
            program.square(u, 1.0);
            terms.push((u, -1.0));
        }
        if loss != Loss::Ls {
            let t = program.add(2);
            let price = if loss == Loss::Huber { HUBER_DELTA } else { 1.0 };
            for (index, sign) in [(t, -1.0), (t + 1, 1.0)] {
                program.cost(index, price);
                program.non_negative(Affine::new(&[(index, 1.0)], 0.0));
                terms.push((index, sign));
            }
        }
        program.zero(Affine { terms, constant: dot(row, origin) - rhs });
    };
    rows.for_each(|(row, rhs)| residual(row, rhs, loss));
    quadratic.iter().for_each(|(row, rhs)| residual(row, *rhs, Loss::Ls));
    let mut optimum = program.solve(name)?;
    optimum.x.truncate(origin.len());
    optimum.x.iter_mut().zip(origin).for_each(|(x, origin)| *x += origin);
    optimum.non_negative.truncate(feasible.half_spaces.len());
    Ok(optimum)
}
