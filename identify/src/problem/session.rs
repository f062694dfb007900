//! What a problem's `estimate` works with: solves, records estimates, and turns all of it into a report.

use super::{FitError, FitRequest, Known, Target};
use crate::assess::{Evidence, Limits, Verdict, verdict};
use crate::progress::Progress;
use crate::result::{CorrelationPair, Covariance, FitReport, Parameter, Verdict as Shade};
use crate::solve::{self, Accuracy, Loss, Options, Regression, Smooth, Solution, SolveError};
use nalgebra::DVector;
use std::collections::BTreeMap;

/// A solution kept in the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fitted(usize);

/// How an estimate is judged beyond the usual limits.
#[derive(Clone, Copy, Debug, Default)]
pub struct Judgement {
    /// Thresholds of the verdict.
    pub limits: Limits,
    /// Standard deviation from causes that act on every sample alike (a sensor's bias). Part of the
    /// standard error and the interval, not of the verdict: an estimate that absorbs such a cause is
    /// the right one for an estimator that uses the same sensors.
    pub systematic_std: f64,
    /// Judge by this size instead of the estimate's own, for parameters that may well be zero.
    pub size: Option<f64>,
}

#[derive(Clone, Debug)]
struct Estimate {
    name: String,
    fit: usize,
    value: f64,
    /// Derivatives with respect to the unknowns of its solution.
    gradient: Vec<f64>,
    judgement: Judgement,
}

/// Solves and remembers.
pub struct Session<'a> {
    /// Where a refinement tells how far it is.
    pub progress: Progress,
    options: Options,
    targets: &'a [Target],
    solutions: Vec<Solution>,
    estimates: Vec<Estimate>,
    given_up: BTreeMap<String, String>,
    warnings: Vec<String>,
    notes: Vec<String>,
}

impl<'a> Session<'a> {
    /// An empty session.
    pub fn new(request: &FitRequest, targets: &'a [Target]) -> Self {
        Self {
            progress: Progress::none(),
            options: Options { loss: request.loss, correct: request.correct, ..Options::default() },
            targets,
            solutions: Vec::new(),
            estimates: Vec::new(),
            given_up: BTreeMap::new(),
            warnings: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Whether the user asked to subtract the estimated bias.
    pub fn corrects(&self) -> bool {
        self.options.correct
    }

    /// The loss the user asked for.
    pub fn loss(&self) -> Loss {
        self.options.loss
    }

    /// Solves a regression with the user's loss. With too few usable rows, or rows
    /// that cannot tell the unknowns apart, the answer is `None` and
    /// the named parameters are reported as not identifiable.
    pub fn solve(&mut self, regression: &Regression, parameters: &[&str]) -> Result<Option<Fitted>, FitError> {
        self.solve_with(regression, self.options, parameters)
    }

    /// As [`solve`](Self::solve) with other options.
    pub fn solve_with(
        &mut self,
        regression: &Regression,
        options: Options,
        parameters: &[&str],
    ) -> Result<Option<Fitted>, FitError> {
        match solve::solve(regression, &options) {
            Ok(solution) => Ok(Some(self.keep(solution))),
            Err(error @ (SolveError::TooFewRows { .. } | SolveError::Singular { .. })) => {
                parameters.iter().for_each(|name| self.give_up(name, &error.to_string()));
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Refines smooth residuals with the user's loss.
    pub fn refine(&mut self, smooth: &Smooth) -> Result<Fitted, FitError> {
        let solution = solve::refine(smooth, self.options.loss)?;
        Ok(self.keep(solution))
    }

    /// Adds to a solution's covariance what it owes to a fixed parameter: half the way between its answers with
    /// that parameter one standard deviation smaller and larger (a consider covariance).
    pub fn consider(&mut self, fit: Fitted, smaller: &Regression, larger: &Regression) -> Result<(), FitError> {
        let (low, high) = (solve::solve(smaller, &self.options)?, solve::solve(larger, &self.options)?);
        let shift = DVector::from_fn(low.theta.len(), |i, _| 0.5 * (high.theta[i] - low.theta[i]));
        self.solutions[fit.0].covariance.ger(1.0, &shift, &shift, 1.0);
        Ok(())
    }

    /// Keeps a solution that was made elsewhere.
    pub fn keep(&mut self, solution: Solution) -> Fitted {
        if solution.accuracy == Accuracy::AlmostSolved {
            self.warn(format!("{}: the conic solver reached only its reduced accuracy", solution.name));
        }
        self.solutions.push(solution);
        Fitted(self.solutions.len() - 1)
    }

    /// A solution.
    pub fn solution(&self, fit: Fitted) -> &Solution {
        &self.solutions[fit.0]
    }

    /// Records a parameter as a smooth function of a solution's unknowns; a later record of the same
    /// name replaces it. A name that is not a target is ignored, so that nuisance parameters cost nothing.
    pub fn estimate(&mut self, name: &str, fit: Fitted, of: impl Fn(&[f64]) -> f64) {
        self.estimate_judged(name, fit, Judgement::default(), of);
    }

    /// As [`estimate`](Self::estimate) with its own limits.
    pub fn estimate_judged(&mut self, name: &str, fit: Fitted, judgement: Judgement, of: impl Fn(&[f64]) -> f64) {
        let solution = &self.solutions[fit.0];
        let value = of(&solution.theta);
        // Central differences: the step is small against both the value and its uncertainty.
        let gradient = (0..solution.theta.len()).map(|index| {
            let size = solution.theta[index].abs().max(solution.std(index));
            let step = 1e-5 * if size > 0.0 && size.is_finite() { size } else { 1.0 };
            let mut moved = solution.theta.clone();
            moved[index] += step;
            let ahead = of(&moved);
            moved[index] -= 2.0 * step;
            (ahead - of(&moved)) / (2.0 * step)
        });
        let estimate = Estimate { name: name.to_owned(), fit: fit.0, value, gradient: gradient.collect(), judgement };
        self.estimates.retain(|other| other.name != name);
        self.given_up.remove(name);
        if self.targets.iter().any(|target| target.name == name) {
            self.estimates.push(estimate);
        }
    }

    /// Reports a parameter as not identifiable, with the reason, unless it has been estimated.
    pub fn give_up(&mut self, name: &str, reason: &str) {
        if self.estimates.iter().all(|estimate| estimate.name != name) {
            self.given_up.insert(name.to_owned(), reason.to_owned());
        }
    }

    /// Takes back an estimate that a later stage found worthless.
    pub fn retract(&mut self, name: &str, reason: &str) {
        self.estimates.retain(|estimate| estimate.name != name);
        self.given_up.insert(name.to_owned(), reason.to_owned());
    }

    /// The estimate of a parameter so far.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.estimates.iter().find(|estimate| estimate.name == name).map(|estimate| estimate.value)
    }

    /// All estimates so far.
    pub fn values(&self) -> impl Iterator<Item = (&str, f64)> {
        self.estimates.iter().map(|estimate| (estimate.name.as_str(), estimate.value))
    }

    /// The standard error of an estimate so far.
    pub fn std_error(&self, name: &str) -> Option<f64> {
        self.estimates.iter().find(|estimate| estimate.name == name).map(|estimate| self.error_of(estimate))
    }

    /// Something the user must know: the fit ends with warnings.
    pub fn warn(&mut self, text: impl Into<String>) {
        self.warnings.push(text.into());
    }

    /// Something good to know.
    pub fn note(&mut self, text: impl Into<String>) {
        self.notes.push(text.into());
    }

    /// Every wanted parameter that was neither estimated nor given up is given up.
    pub(super) fn complete(&mut self, wanted: &[String]) {
        for name in wanted {
            if !self.given_up.contains_key(name) {
                self.give_up(name, "the logs hold nothing that depends on it");
            }
        }
        // What was estimated on the way and not asked for is no result.
        self.estimates.retain(|estimate| wanted.contains(&estimate.name));
        self.given_up.retain(|name, _| wanted.contains(name));
    }

    fn error_of(&self, estimate: &Estimate) -> f64 {
        self.sampling_error(estimate).hypot(estimate.judgement.systematic_std)
    }

    fn sampling_error(&self, estimate: &Estimate) -> f64 {
        let (spread, bias) = self.spread_and_bias(estimate);
        spread.hypot(bias)
    }

    fn spread_and_bias(&self, estimate: &Estimate) -> (f64, f64) {
        let solution = &self.solutions[estimate.fit];
        let gradient = DVector::from_column_slice(&estimate.gradient);
        let variance = gradient.dot(&(&solution.covariance * &gradient)).max(0.0);
        (variance.sqrt(), gradient.dot(&DVector::from_column_slice(&solution.bias)))
    }

    /// Which estimates are mostly biased, if the user may have that subtracted.
    fn note_on_bias(&self) -> Option<String> {
        let biased = self.estimates.iter().filter_map(|estimate| {
            let (spread, bias) = self.spread_and_bias(estimate);
            (bias.abs() > spread).then(|| format!("{} by about {bias:.2e}", estimate.name))
        });
        let biased = biased.collect::<Vec<_>>().join(", ");
        (!self.options.correct && !biased.is_empty())
            .then(|| format!("biased beyond chance: {biased} (--correct subtracts what is known of it)"))
    }

    fn evidence(&self, estimate: &Estimate, range: (f64, f64)) -> Evidence {
        let solution = &self.solutions[estimate.fit];
        let involved: Vec<usize> = (0..estimate.gradient.len()).filter(|&i| estimate.gradient[i] != 0.0).collect();
        let edge = 1e-9 * estimate.value.abs().max(1e-9);
        // Among the estimates of this solution, not its raw coefficients: k and k phi_0 go together
        // even where k and phi_0 are well known.
        let gradient = DVector::from_column_slice(&estimate.gradient);
        let seen = &solution.inverse_information * &gradient;
        let others = self.estimates.iter().filter(|other| other.fit == estimate.fit && other.name != estimate.name);
        let correlation = others.map(|other| {
            let other = DVector::from_column_slice(&other.gradient);
            let product = gradient.dot(&seen) * other.dot(&(&solution.inverse_information * &other));
            if product > 0.0 { (other.dot(&seen) / product.sqrt()).abs() } else { 0.0 }
        });
        let correlation = correlation.fold(0.0, f64::max);
        Evidence {
            value: estimate.judgement.size.unwrap_or(estimate.value),
            std_error: self.sampling_error(estimate),
            noise_share: involved.iter().map(|&i| solution.noise_share[i]).fold(0.0, f64::max),
            at_bound: involved.iter().any(|&i| solution.at_bound[i])
                || estimate.value <= range.0 + edge
                || estimate.value >= range.1 - edge,
            correlation,
            condition_number: solution.condition_number,
        }
    }

    /// The report of everything but logs, settings and validation.
    pub(super) fn report(&self, known: &Known) -> FitReport {
        let mut report =
            FitReport { warnings: self.warnings.clone(), notes: self.notes.clone(), ..FitReport::default() };
        report.notes.extend(self.note_on_bias());
        let mut used: Vec<usize> = self.estimates.iter().map(|estimate| estimate.fit).collect();
        used.sort_unstable();
        used.dedup();
        for estimate in &self.estimates {
            let Some(target) = self.targets.iter().find(|target| target.name == estimate.name) else { continue };
            let evidence = self.evidence(estimate, target.range);
            let limits = estimate.judgement.limits;
            let outcome = verdict(&evidence, &limits);
            let verdict = match &outcome {
                Verdict::Identified => Shade::Identified,
                Verdict::Unidentified(_) if evidence.at_bound => Shade::AtBound,
                Verdict::Unidentified(_) if evidence.std_error < evidence.value.abs() => Shade::Weak,
                Verdict::Unidentified(_) => Shade::NotIdentifiable,
            };
            if let Verdict::Unidentified(reasons) = &outcome {
                report.warnings.push(format!("{} is not identified: {}", estimate.name, reasons.join("; ")));
            }
            let std_error = self.error_of(estimate);
            let half = 1.96 * std_error;
            let parameter = Parameter {
                value: estimate.value,
                unit: target.unit.clone(),
                std_error,
                ci95: [estimate.value - half, estimate.value + half],
                identified: outcome == Verdict::Identified,
                at_bound: evidence.at_bound,
                verdict,
                start: known.find(&estimate.name),
            };
            report.parameters.insert(estimate.name.clone(), parameter);
        }
        for (name, reason) in &self.given_up {
            let Some(target) = self.targets.iter().find(|target| target.name == *name) else { continue };
            report.warnings.push(format!("{name} is not identified: {reason}"));
            let parameter = Parameter {
                value: f64::NAN,
                unit: target.unit.clone(),
                std_error: f64::NAN,
                ci95: [f64::NAN; 2],
                identified: false,
                verdict: Shade::NotIdentifiable,
                start: known.find(name),
                ..Parameter::default()
            };
            report.parameters.insert(name.clone(), parameter);
        }
        let solutions: Vec<&Solution> = used.iter().map(|&index| &self.solutions[index]).collect();
        report.condition_number = solutions.iter().map(|s| s.condition_number).fold(f64::NAN, f64::max);
        report.windows_used = solutions.iter().map(|solution| solution.rows).sum();
        let almost = solutions.iter().any(|solution| solution.accuracy == Accuracy::AlmostSolved);
        report.solver_status = if solutions.is_empty() {
            "not run"
        } else if almost {
            "AlmostSolved"
        } else {
            "Solved"
        }
        .to_owned();
        self.covariance_into(&mut report);
        report
    }

    /// Covariance between estimates: of one solution by the delta method, of different solutions zero
    /// (their rows come from different equations).
    fn covariance_into(&self, report: &mut FitReport) {
        let n = self.estimates.len();
        if n == 0 {
            return;
        }
        let mut matrix = vec![vec![0.0; n]; n];
        for (i, one) in self.estimates.iter().enumerate() {
            for (j, other) in self.estimates.iter().enumerate() {
                if i == j {
                    matrix[i][j] = self.error_of(one).powi(2);
                } else if one.fit == other.fit {
                    let solution = &self.solutions[one.fit];
                    let (a, b) =
                        (DVector::from_column_slice(&one.gradient), DVector::from_column_slice(&other.gradient));
                    let bias = DVector::from_column_slice(&solution.bias);
                    matrix[i][j] = a.dot(&(&solution.covariance * &b)) + a.dot(&bias) * b.dot(&bias);
                }
            }
        }
        let pair = (0..n).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| {
            let correlation = matrix[i][j] / (matrix[i][i] * matrix[j][j]).sqrt();
            (i, j, if correlation.is_finite() { correlation } else { 0.0 })
        });
        report.correlation_worst_pair =
            pair.max_by(|a, b| a.2.abs().total_cmp(&b.2.abs())).map(|(i, j, correlation)| {
                let name = |index: usize| self.estimates[index].name.clone();
                CorrelationPair { parameters: [name(j), name(i)], correlation }
            });
        let parameters = self.estimates.iter().map(|estimate| estimate.name.clone()).collect();
        report.covariance = Some(Covariance { parameters, matrix });
    }
}
