//! Convex regression with physical constraints, and sequential convex refinement.
//!
//! ```text
//! Regression (linear rows, bounds, cones) -> robust scale -> loss: conic program or compressed Newton -> polish -> Solution
//! Smooth     (residuals of a simulation)  -> the same, once per step, inside a trust region           -> Solution
//! ```
//!
//! A [`Regression`] is plain data: rows `y = A theta + noise` in groups that share a unit and a noise
//! level, bounds on the unknowns, linear inequalities and second-order cones. [`solve`] takes it to a
//! [`Solution`] with covariance, conditioning and everything a verdict needs.
//!
//! # Which algorithm runs
//!
//! | loss | up to [`Options::exact_rows`] rows | more rows |
//! |---|---|---|
//! | least squares | QR-compressed to one row per unknown, then Clarabel | the same |
//! | Huber | the same as for more rows; where it proves no minimiser, the exact conic program in Clarabel, then Newton again | Newton on the active pieces, each step a compressed QP in Clarabel |
//! | L1 | the exact conic (linear) program in Clarabel | Huber with a threshold shrunk towards zero |
//!
//! Newton on the piecewise quadratic Huber cost ends after finitely many steps in the exact minimiser,
//! so that it needs no other proof. An interior-point method stops slightly inside an active
//! bound; [`polish`] puts the answer on it.

pub mod compress;
pub mod conic;
mod contradiction;
pub mod covariance;
pub mod instrument;
pub mod polish;
pub mod profile;
pub mod refine;
pub mod robust;
pub mod student;

pub use refine::{Smooth, SmoothGroup, Trust, TrustNorm, refine};
pub use student::student;

use compress::Factors;
use nalgebra::{DMatrix, DVector};

/// A linear regression `y = A theta + noise` under physical constraints.
#[derive(Clone, Debug, Default)]
pub struct Regression {
    /// What it is about, for messages.
    pub name: String,
    /// The coefficients that are sought.
    pub unknowns: Vec<Unknown>,
    /// Groups of rows; each has its own noise level.
    pub groups: Vec<Rows>,
    /// Constraints beyond the bounds of the unknowns.
    pub constraints: Vec<Constraint>,
}

/// One coefficient of a regression: often a product of physical parameters.
#[derive(Clone, Debug)]
pub struct Unknown {
    /// Name for messages.
    pub name: String,
    /// Smallest allowed value, may be `-inf`.
    pub lower: f64,
    /// Largest allowed value, may be `inf`.
    pub upper: f64,
    /// Mean and standard deviation known beforehand, if any: one more row, always quadratic.
    pub prior: Option<(f64, f64)>,
}

impl Unknown {
    /// A coefficient within bounds.
    pub fn within(name: &str, lower: f64, upper: f64) -> Self {
        Self { name: name.to_owned(), lower, upper, prior: None }
    }

    /// A coefficient that may take any value.
    pub fn free(name: &str) -> Self {
        Self::within(name, f64::NEG_INFINITY, f64::INFINITY)
    }

    /// The same with a mean and standard deviation known beforehand.
    pub fn with_prior(mut self, mean: f64, std: f64) -> Self {
        self.prior = Some((mean, std));
        self
    }
}

/// Where the noise level of a group of rows comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// From the residuals of a first least-squares pass: 1.4826 times their median absolute deviation.
    Robust,
    /// Known standard deviation, in the unit of the rows.
    Known(f64),
}

/// A group of rows with one unit and one noise level.
#[derive(Clone, Debug)]
pub struct Rows {
    /// Name for reports.
    pub name: String,
    /// Unit of the right-hand side.
    pub unit: &'static str,
    /// Number of unknowns.
    pub columns: usize,
    /// The regressors, row after row: `columns` values each.
    pub a: Vec<f64>,
    /// The right-hand sides.
    pub y: Vec<f64>,
    /// Rows whose noise may be correlated share a cluster: neighbouring windows, rows of one instant.
    pub cluster: Vec<u32>,
    /// Instruments, shaped as `a`, or empty. If given, the moments `Z'(y - A theta)` are minimised.
    pub instruments: Vec<f64>,
    /// Covariance that sensor noise alone gives `[row, right-hand side]`, `columns + 1` squared
    /// values, or empty if unknown. From it follows the bias that noisy regressors cause.
    pub noise: Vec<f64>,
    /// Per channel, the covariance that the largest plausible noise of it with a correlation time would give
    /// `[row, right-hand side]`, shaped as `noise`: how far noise that is not white could pull the unknowns.
    pub coloured: Vec<(String, Vec<f64>)>,
    /// What each right-hand side holds that the regressors do not model, as far as it can be estimated:
    /// `y = A theta + neglected + noise`. As long as `y`, or empty. It is left in `y`; the bias tells
    /// how far it pulls the unknowns.
    pub neglected: Vec<f64>,
    /// Whether `neglected` is a guess of its size only: it stays part of the bias, never subtracted.
    pub guessed: bool,
    /// Where the noise level comes from.
    pub scale: Scale,
}

impl Rows {
    /// An empty group for `columns` unknowns.
    pub fn new(name: &str, unit: &'static str, columns: usize) -> Self {
        Self {
            name: name.to_owned(),
            unit,
            columns,
            a: Vec::new(),
            y: Vec::new(),
            cluster: Vec::new(),
            instruments: Vec::new(),
            noise: Vec::new(),
            coloured: Vec::new(),
            neglected: Vec::new(),
            guessed: false,
            scale: Scale::Robust,
        }
    }

    /// Makes room for so many more rows.
    pub fn reserve(&mut self, rows: usize) {
        self.a.reserve(rows * self.columns);
        self.y.reserve(rows);
        self.cluster.reserve(rows);
        self.neglected.reserve(rows);
    }

    /// Adds a row; one with a value that is not finite is left out, and `false` says so.
    pub fn push(&mut self, row: &[f64], rhs: f64, cluster: u32) -> bool {
        debug_assert_eq!(row.len(), self.columns);
        let finite = rhs.is_finite() && row.iter().all(|value| value.is_finite());
        if finite {
            self.a.extend_from_slice(row);
            self.y.push(rhs);
            self.cluster.push(cluster);
        }
        finite
    }

    /// Adds a row with its instruments.
    pub fn push_instrumented(&mut self, row: &[f64], rhs: f64, instruments: &[f64], cluster: u32) -> bool {
        debug_assert_eq!(instruments.len(), self.columns);
        let added = instruments.iter().all(|value| value.is_finite()) && self.push(row, rhs, cluster);
        if added {
            self.instruments.extend_from_slice(instruments);
        }
        added
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.y.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.y.is_empty()
    }

    /// One row of regressors.
    pub fn row(&self, index: usize) -> &[f64] {
        &self.a[index * self.columns..(index + 1) * self.columns]
    }

    /// `y - A theta`, row by row.
    pub fn residuals(&self, theta: &[f64]) -> Vec<f64> {
        (0..self.len()).map(|i| self.y[i] - dot(self.row(i), theta)).collect()
    }
}

/// An affine expression of the unknowns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Affine {
    /// Index of the unknown and its factor.
    pub terms: Vec<(usize, f64)>,
    /// The constant.
    pub constant: f64,
}

impl Affine {
    /// From `(unknown, factor)` pairs and a constant.
    pub fn new(terms: &[(usize, f64)], constant: f64) -> Self {
        Self { terms: terms.to_vec(), constant }
    }

    /// Its value.
    pub fn at(&self, theta: &[f64]) -> f64 {
        self.terms.iter().map(|&(index, factor)| factor * theta[index]).sum::<f64>() + self.constant
    }
}

/// A convex constraint on the unknowns.
#[derive(Clone, Debug, PartialEq)]
pub enum Constraint {
    /// The expression is not negative.
    NonNegative(Affine),
    /// The norm of all expressions but the first is at most the first. A symmetric 2x2 matrix with
    /// diagonal `a`, `c` and off-diagonal `b` is positive semidefinite iff `(a + c, 2 b, a - c)` is in
    /// this cone.
    SecondOrder(Vec<Affine>),
}

/// Loss of the regression.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Loss {
    /// Least squares.
    Ls,
    /// Huber: quadratic for small residuals, linear beyond [`HUBER_DELTA`] standard deviations.
    #[default]
    Huber,
    /// Least absolute values.
    L1,
}

impl Loss {
    /// The word on the command line and in `fit.json`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Ls => "ls",
            Self::Huber => "huber",
            Self::L1 => "l1",
        }
    }

    /// Cost of a residual in standard deviations.
    pub(crate) fn of(self, r: f64) -> f64 {
        match self {
            Self::Ls => 0.5 * r * r,
            Self::L1 => r.abs(),
            Self::Huber if r.abs() <= HUBER_DELTA => 0.5 * r * r,
            Self::Huber => HUBER_DELTA * (r.abs() - 0.5 * HUBER_DELTA),
        }
    }
}

/// Threshold of the Huber loss in standard deviations: 95 % efficiency under normal noise.
pub const HUBER_DELTA: f64 = 1.345;

/// Settings of [`solve`].
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// The loss.
    pub loss: Loss,
    /// Passes that estimate the noise levels before the final solve.
    pub scale_passes: usize,
    /// Up to this many rows L1, and a Huber cost whose minimiser Newton's method does not prove, go to Clarabel as the exact
    /// conic program.
    pub exact_rows: usize,
    /// Subtract the estimated bias from the solution.
    pub correct: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { loss: Loss::Huber, scale_passes: 1, exact_rows: 1000, correct: false }
    }
}

/// How exactly a conic program was solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accuracy {
    /// To full tolerance.
    Solved,
    /// Only to the solver's reduced tolerance: a warning.
    AlmostSolved,
}

impl Accuracy {
    /// Name in files, as the solver prints it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Solved => "Solved",
            Self::AlmostSolved => "AlmostSolved",
        }
    }
}

/// Why there is no solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// Fewer usable rows than needed.
    #[error("{regression}: {rows} usable rows for {unknowns} unknowns")]
    TooFewRows {
        /// The regression.
        regression: String,
        /// Rows there are.
        rows: usize,
        /// Unknowns there are.
        unknowns: usize,
    },
    /// The rows do not determine all unknowns, whatever the noise.
    #[error("{regression}: the log does not excite it, its regressors are zero or copies of each other")]
    Singular {
        /// The regression.
        regression: String,
    },
    /// No allowed values of the unknowns explain the rows, so that the conic program has no usable solution.
    #[error("{regression}: the data contradict the allowed signs and ranges of its unknowns{details}")]
    Contradiction {
        /// The regression.
        regression: String,
        /// Which unknowns or constraints, and what the rows alone would make of them.
        details: String,
    },
    /// The simulated residuals are not finite even at the start.
    #[error("{regression}: the simulation diverges at the start values")]
    Diverged {
        /// The refinement.
        regression: String,
    },
}

/// The answer to a [`Regression`] or a refinement, with what is needed to judge it.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Name of the regression.
    pub name: String,
    /// The unknowns.
    pub theta: Vec<f64>,
    /// Their covariance (sandwich over clusters), see [`covariance`].
    pub covariance: DMatrix<f64>,
    /// Estimated bias of each unknown: how far noise in the regressors ([`Rows::noise`]) and what the
    /// rows neglect ([`Rows::neglected`]) pull it. Not subtracted from `theta` unless
    /// [`Options::correct`] asks for it; then what is left are guesses ([`Rows::guessed`]).
    pub bias: Vec<f64>,
    /// Per channel, how far its noise could pull each unknown if it is not white, and if it is all that the residuals
    /// have beyond white noise ([`Rows::coloured`]); empty where white noise explains the residuals. Only one of them
    /// can be true.
    pub coloured: Vec<(String, Vec<f64>)>,
    /// The sandwich over clusters alone: without their correlation and the factor for small samples, and for L1 that of
    /// least squares.
    pub sandwich: DMatrix<f64>,
    /// Degrees of freedom of the covariance: independent clusters of rows less the unknowns, at least 1.
    pub degrees_of_freedom: f64,
    /// Share of sensor noise in what each unknown's regressor adds to the others, 0 to 1: near 1 there
    /// is no signal to learn from. Zeros where [`Rows::noise`] is not given.
    pub noise_share: Vec<f64>,
    /// Which unknowns sit at a bound or at an active linear inequality.
    pub at_bound: Vec<bool>,
    /// Condition number of the regressors with columns scaled to unit norm.
    pub condition_number: f64,
    /// Inverse of the information matrix: the covariance if rows were independent with the given
    /// noise levels. Its correlations tell which unknowns the rows cannot tell apart.
    pub inverse_information: DMatrix<f64>,
    /// Noise level of each group, in its unit.
    pub scales: Vec<f64>,
    /// Residuals of each group, in its unit.
    pub residuals: Vec<Vec<f64>>,
    /// Number of rows used.
    pub rows: usize,
    /// How exactly the last program was solved.
    pub accuracy: Accuracy,
    /// Cost after each accepted step of a refinement; one value for a regression.
    pub cost: Vec<f64>,
    /// Profiles of unknowns of a refinement, see [`Smooth::profiled`].
    pub profiles: Vec<(usize, profile::Curve)>,
}

impl Solution {
    /// Standard error of an unknown: sampling error and regressor-noise bias, root sum of squares.
    pub fn std(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt().hypot(self.bias[index])
    }
}

/// Solves a regression.
///
/// Rows are divided by the noise level of their group, columns are scaled to unit root mean square,
/// then the loss is minimised under the constraints as the module's table says. Groups with
/// [`Rows::instruments`] are solved by [`instrument::solve`] instead; the loss then does not apply.
pub fn solve(regression: &Regression, options: &Options) -> Result<Solution, SolveError> {
    solve_within(regression, options).map_err(|error| match error {
        SolveError::Contradiction { regression: name, .. } => {
            SolveError::Contradiction { regression: name, details: contradiction::details(regression) }
        }
        other => other,
    })
}

fn solve_within(regression: &Regression, options: &Options) -> Result<Solution, SolveError> {
    let unknowns = regression.unknowns.len();
    let rows: usize = regression.groups.iter().map(Rows::len).sum();
    let priors = regression.unknowns.iter().filter(|unknown| unknown.prior.is_some()).count();
    if rows + priors < unknowns + 1 {
        return Err(SolveError::TooFewRows { regression: regression.name.clone(), rows, unknowns });
    }
    let factors = Factors::of(regression);
    if covariance::is_singular(regression, &factors) {
        return Err(SolveError::Singular { regression: regression.name.clone() });
    }
    if regression.groups.iter().any(|group| !group.instruments.is_empty()) {
        return instrument::solve(regression);
    }
    let mut scales: Vec<f64> =
        regression.groups.iter().map(|group| if let Scale::Known(scale) = group.scale { scale } else { 1.0 }).collect();
    if regression.groups.iter().any(|group| group.scale == Scale::Robust) {
        for _ in 0..options.scale_passes {
            let first = robust::minimise(regression, &factors, &scales, Loss::Ls, options, None)?;
            for (group, scale) in regression.groups.iter().zip(&mut scales) {
                if group.scale == Scale::Robust && !group.is_empty() {
                    *scale = robust::deviation(&group.residuals(&first.theta), &group.y);
                }
            }
        }
    }
    let minimum = robust::minimise(regression, &factors, &scales, options.loss, options, None)?;
    Ok(covariance::of_regression(regression, &factors, &scales, options, minimum))
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds `weight a b'` to a matrix, without the vectors that nalgebra's `ger` would need for each row of a regression.
fn add_outer(matrix: &mut DMatrix<f64>, weight: f64, a: &[f64], b: &[f64]) {
    for (column, b) in matrix.as_mut_slice().chunks_exact_mut(a.len()).zip(b) {
        let factor = weight * b;
        // Unknowns of one log have zeros in the rows of all others.
        if factor != 0.0 {
            column.iter_mut().zip(a).for_each(|(cell, a)| *cell += factor * a);
        }
    }
}

/// Adds `weight a` to a vector.
fn add_scaled(vector: &mut DVector<f64>, weight: f64, a: &[f64]) {
    vector.as_mut_slice().iter_mut().zip(a).for_each(|(cell, a)| *cell += weight * a);
}
