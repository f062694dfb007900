//! What a problem's `estimate` works with: solves, records estimates, and turns all of it into a report.

use super::findings::{Findings, Found, Offset};
use super::imposed::{Given, Imposition, Knowledge, impose};
use super::{FitError, FitRequest, Target};
use crate::assess::Limits;
use crate::progress::Progress;
use crate::result::Delay;
use crate::solve::compress::Factors;
use crate::solve::profile::{self, Curve, Function};
use crate::solve::{self, Accuracy, Loss, Options, Regression, Smooth, Solution, SolveError, robust, student};
use nalgebra::{DMatrix, DVector};
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

/// A solution kept in the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fitted(usize);

/// How an estimate is judged beyond the usual limits.
#[derive(Clone, Copy, Debug, Default)]
pub struct Judgement {
    /// Thresholds of the verdict.
    pub limits: Limits,
    /// Standard deviation from causes that act on every sample alike and that only the machine knows of; those of
    /// its sensors and known values are considered anyway. Part of the standard error.
    pub systematic_std: f64,
    /// Judge by this size instead of the estimate's own, for parameters that may well be zero.
    pub size: Option<f64>,
    /// Why it is not identified whatever its standard error, if the machine knows a reason.
    pub doubt: Option<&'static str>,
}

#[derive(Clone)]
struct Estimate {
    name: String,
    fit: usize,
    value: f64,
    /// What it is of the unknowns.
    of: Rc<Function>,
    /// Derivatives with respect to the unknowns of its solution.
    gradient: Vec<f64>,
    judgement: Judgement,
}

/// Solves and remembers.
pub struct Session<'a> {
    /// Where a refinement tells how far it is.
    pub progress: Progress,
    options: Options,
    /// Only differences between fits are looked for.
    coarse: bool,
    targets: &'a [Target],
    solutions: Vec<Solution>,
    /// Parameters whose profile is wanted.
    profiled: &'a [String],
    /// For that the regressions, each with the number of its solution.
    regressions: Vec<(usize, Regression, Options)>,
    impositions: Vec<Imposition>,
    estimates: Vec<Estimate>,
    delays: Vec<Delay>,
    offsets: Vec<Offset>,
    decisions: BTreeMap<String, bool>,
    /// Which of them hold for a fit to a part of the logs, too.
    of_parts: BTreeSet<String>,
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
            coarse: false,
            targets,
            solutions: Vec::new(),
            profiled: &[],
            regressions: Vec::new(),
            impositions: Vec::new(),
            estimates: Vec::new(),
            delays: Vec::new(),
            offsets: Vec::new(),
            decisions: BTreeMap::new(),
            of_parts: BTreeSet::new(),
            given_up: BTreeMap::new(),
            warnings: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// The same for differences between fits: least squares, which has the same sensitivities and needs no iteration.
    pub(super) fn coarse(mut self, coarse: bool) -> Self {
        self.coarse = coarse;
        if coarse {
            self.options.loss = Loss::Ls;
        }
        self
    }

    /// The same with decisions that another fit took.
    pub(super) fn decided(mut self, decisions: Option<&BTreeMap<String, bool>>) -> Self {
        self.decisions = decisions.cloned().unwrap_or_default();
        self
    }

    /// What a fit decides by its data, as which of two models it takes: what `now` says, or, where only differences
    /// between fits are looked for, what the fit decided that they are differences of. They would jump otherwise.
    pub fn decide(&mut self, what: &str, now: bool) -> bool {
        *self.decisions.entry(what.to_owned()).or_insert(now)
    }

    /// The same, and a fit to a part of the logs takes the decision over, too: to compare a part with the whole if they come
    /// from different models would say nothing.
    pub fn decide_for_parts(&mut self, what: &str, now: bool) -> bool {
        self.of_parts.insert(what.to_owned());
        self.decide(what, now)
    }

    /// The same with conditions that its solutions must meet.
    pub(super) fn under(mut self, impositions: Vec<Imposition>) -> Self {
        self.impositions = impositions;
        self
    }

    /// The same with the profiles of these parameters.
    pub(super) fn profiling(mut self, profiled: &'a [String]) -> Self {
        self.profiled = profiled;
        self
    }

    /// Whether the profile of a parameter is wanted: a refinement makes those of its unknowns, see
    /// [`Smooth::profiled`](crate::solve::Smooth).
    pub fn profiles(&self, name: &str) -> bool {
        self.profiled.iter().any(|other| other == name)
    }

    /// Whether the user asked to subtract the estimated bias.
    pub fn corrects(&self) -> bool {
        self.options.correct
    }

    /// Whether it matters what noise the rows hold ([`Rows::noise`](crate::solve::Rows)): it makes biases, which the estimates
    /// of a fit that only differences are looked for with do not contain unless they are subtracted.
    pub fn weighs_noise(&self) -> bool {
        !self.coarse || self.options.correct
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
            Ok(solution) => {
                let fit = self.keep(solution);
                if !self.profiled.is_empty() {
                    self.regressions.push((fit.0, regression.clone(), options));
                }
                Ok(Some(fit))
            }
            Err(
                error
                @ (SolveError::TooFewRows { .. } | SolveError::Singular { .. } | SolveError::Contradiction { .. }),
            ) => {
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
            self.warn(format!(
                "{}: the logs hardly tell its unknowns apart, and they end at the edge of what is physically possible: the \
                 values are less exact than their intervals say",
                solution.name
            ));
        }
        let mut solution = solution;
        let fit = self.solutions.len();
        for condition in self.impositions.iter().filter(|condition| condition.fit == fit) {
            impose(&mut solution, condition);
        }
        self.solutions.push(solution);
        Fitted(fit)
    }

    /// A solution.
    pub fn solution(&self, fit: Fitted) -> &Solution {
        &self.solutions[fit.0]
    }

    /// Records a parameter as a smooth function of a solution's unknowns; a later record of the same
    /// name replaces it. A name that is not a target is ignored, so that nuisance parameters cost nothing.
    pub fn estimate(&mut self, name: &str, fit: Fitted, of: impl Fn(&[f64]) -> f64 + 'static) {
        self.estimate_judged(name, fit, Judgement::default(), of);
    }

    /// As [`estimate`](Self::estimate) with its own limits.
    pub fn estimate_judged(
        &mut self,
        name: &str,
        fit: Fitted,
        judgement: Judgement,
        of: impl Fn(&[f64]) -> f64 + 'static,
    ) {
        self.record(name, fit, judgement, Rc::new(of));
    }

    fn record(&mut self, name: &str, fit: Fitted, judgement: Judgement, of: Rc<Function>) {
        let (value, gradient) = self.linearised(fit, &*of);
        let estimate = Estimate { name: name.to_owned(), fit: fit.0, value, of, gradient, judgement };
        self.estimates.retain(|other| other.name != name);
        self.given_up.remove(name);
        if self.targets.iter().any(|target| target.name == name) {
            self.estimates.push(estimate);
        }
    }

    /// Records how much later a channel of a log is than others, s, as a smooth function of a solution's unknowns. Its
    /// uncertainty is in those of the solution's estimates, so that it is not considered again.
    pub fn delay(&mut self, log: &str, channel: &str, against: &str, fit: Fitted, of: impl Fn(&[f64]) -> f64) {
        let (value, gradient) = self.linearised(fit, &of);
        let gradient = DVector::from_vec(gradient);
        let solution = &self.solutions[fit.0];
        let variance = gradient.dot(&(&solution.covariance * &gradient)).max(0.0);
        self.delays.push(Delay {
            log: log.to_owned(),
            channel: channel.to_owned(),
            against: against.to_owned(),
            value,
            std_error: variance.sqrt() * student(solution.degrees_of_freedom),
        });
    }

    /// Records how much larger a channel of a log is than others say, in the mean. The bias that is considered for the channel
    /// is at least that large.
    pub fn offset(&mut self, offset: Offset) {
        self.offsets.push(offset);
    }

    /// What was recorded with [`offset`](Self::offset).
    pub fn offsets(&self) -> &[Offset] {
        &self.offsets
    }

    /// Value and gradient of a smooth function of a solution's unknowns.
    fn linearised(&self, fit: Fitted, of: &dyn Fn(&[f64]) -> f64) -> (f64, Vec<f64>) {
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
        (value, gradient.collect())
    }

    /// Widens an estimate's standard error to at least this, as a systematic one.
    pub fn widen(&mut self, name: &str, std: f64) {
        let Some(index) = self.estimates.iter().position(|estimate| estimate.name == name) else { return };
        let missing = (std * std - self.error_of(&self.estimates[index]).powi(2)).max(0.0).sqrt();
        let judgement = &mut self.estimates[index].judgement;
        judgement.systematic_std = judgement.systematic_std.hypot(missing);
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

    /// Something the user must know: the fit ends with warnings. Several solutions may say the same; it is told once.
    pub fn warn(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.warnings.contains(&text) {
            self.warnings.push(text);
        }
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

    /// The conditions that what is given puts on the solutions, linearised at the estimates, and the largest step
    /// that is left to meet them, in units of what each of them allows.
    pub(super) fn conditions(&self, given: &[Given]) -> (Vec<Imposition>, f64) {
        let mut all = Vec::new();
        let mut left = 0.0_f64;
        for Given { name, what } in given {
            let Some(estimate) = self.estimates.iter().find(|estimate| estimate.name == *name) else { continue };
            let before = self.impositions.iter().find(|condition| condition.name == *name);
            let (value, std) = match *what {
                Knowledge::Value(value) => (value, 0.0),
                Knowledge::Prior(value, std) => (value, std),
                Knowledge::Range(low, high) => {
                    let outside = estimate.value < low || estimate.value > high;
                    if before.is_none() && !outside {
                        continue;
                    }
                    (if (estimate.value - low).abs() < (estimate.value - high).abs() { low } else { high }, 0.0)
                }
            };
            let theta = &self.solutions[estimate.fit].theta;
            let here: f64 = solve::dot(&estimate.gradient, theta);
            let target = here + (value - estimate.value);
            let size = if std > 0.0 { 1e-2 * std } else { 1e-7 * value.abs().max(1e-6) };
            left = left.max(match before {
                Some(before) if std > 0.0 => (target - before.value).abs() / size,
                _ if std > 0.0 => f64::INFINITY,
                _ => (value - estimate.value).abs() / size,
            });
            all.push(Imposition {
                name: name.clone(),
                fit: estimate.fit,
                row: estimate.gradient.clone(),
                value: target,
                std,
            });
        }
        (all, left)
    }

    /// Value and standard error of what is given, as the logs alone have it.
    pub(super) fn alone(&self, given: &[Given]) -> Vec<(String, f64, f64)> {
        let of = |given: &Given| Some((given.name.clone(), self.value(&given.name)?, self.std_error(&given.name)?));
        given.iter().filter_map(of).collect()
    }

    fn error_of(&self, estimate: &Estimate) -> f64 {
        let (spread, bias) = self.spread_and_bias(estimate);
        spread.hypot(bias).hypot(estimate.judgement.systematic_std)
    }

    /// Standard deviation by noise, scaled so that 1.96 of it are the quantile of Student's distribution; bias.
    fn spread_and_bias(&self, estimate: &Estimate) -> (f64, f64) {
        let solution = &self.solutions[estimate.fit];
        let gradient = DVector::from_column_slice(&estimate.gradient);
        let variance = gradient.dot(&(&solution.covariance * &gradient)).max(0.0);
        let bias = gradient.dot(&DVector::from_column_slice(&solution.bias));
        (variance.sqrt() * student(solution.degrees_of_freedom), bias)
    }

    fn found(&self, estimate: &Estimate, range: (f64, f64)) -> Found {
        let solution = &self.solutions[estimate.fit];
        let involved: Vec<usize> = (0..estimate.gradient.len()).filter(|&i| estimate.gradient[i] != 0.0).collect();
        let edge = 1e-6 * estimate.value.abs().max(1e-9);
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
        let (spread, bias) = self.spread_and_bias(estimate);
        let coloured =
            solution.coloured.iter().map(|(channel, pull)| (channel.clone(), solve::dot(&estimate.gradient, pull)));
        Found {
            name: estimate.name.clone(),
            value: estimate.value,
            spread,
            bias,
            coloured: coloured.collect(),
            judgement: estimate.judgement,
            at_bound: involved.iter().any(|&i| solution.at_bound[i])
                || estimate.value <= range.0 + edge
                || estimate.value >= range.1 - edge,
            noise_share: involved.iter().map(|&i| solution.noise_share[i]).fold(0.0, f64::max),
            correlation,
            condition_number: solution.condition_number,
        }
    }

    /// The profile of an estimate within a range: by refits with the weights of the fit, or, where values that are given
    /// have moved its solution, by the solution's covariance.
    pub(super) fn profile(&self, name: &str, range: (f64, f64)) -> Result<Option<(Curve, bool)>, FitError> {
        let Some(estimate) = self.estimates.iter().find(|estimate| estimate.name == name) else { return Ok(None) };
        let solution = &self.solutions[estimate.fit];
        let (spread, _) = self.spread_and_bias(estimate);
        if self.impositions.iter().any(|condition| condition.fit == estimate.fit) {
            return Ok(profile::parabola(estimate.value, spread, range).map(|curve| (curve, false)));
        }
        let mut involved = (0..estimate.gradient.len()).filter(|i| estimate.gradient[*i] != 0.0);
        if let (Some(index), None) = (involved.next(), involved.next())
            && let Some((_, curve)) = solution.profiles.iter().find(|(other, _)| *other == index)
        {
            return Ok(Some((of_unknown(curve, &solution.theta, index, &*estimate.of), true)));
        }
        let Some((_, regression, options)) = self.regressions.iter().find(|(fit, ..)| *fit == estimate.fit) else {
            return Ok(None);
        };
        let instrumented = regression.groups.iter().any(|group| !group.instruments.is_empty());
        let form = if instrumented { profile::quadratic(regression, solution) } else { None };
        let (regression, loss, scales) = match &form {
            Some(form) => (form, Loss::Ls, vec![1.0]),
            None if instrumented => return Ok(None),
            None => (regression, options.loss, solution.scales.clone()),
        };
        let factors = Factors::of(regression);
        let refit = |pull: Option<&profile::Pull>, _: &[f64]| {
            let minimum = robust::minimise(regression, &factors, &scales, loss, options, pull)?;
            let cost = profile::cost(regression, &scales, loss, &minimum.theta);
            Ok((minimum.theta, cost))
        };
        let gradient = DVector::from_column_slice(&estimate.gradient);
        let curve = profile::curve(&profile::Subject {
            theta: &solution.theta,
            of: &*estimate.of,
            std: spread,
            std_of_cost: gradient.dot(&(&solution.inverse_information * &gradient)).max(0.0).sqrt(),
            range,
            refit: &refit,
        })?;
        // An answer by instruments minimises no cost: its quadratic form is that of the covariance.
        Ok(curve.map(|curve| (curve, !instrumented)))
    }

    /// All that was found, for the report.
    pub(super) fn findings(&self) -> Findings {
        let target = |estimate: &Estimate| self.targets.iter().find(|target| target.name == estimate.name);
        let kept: Vec<(&Estimate, &Target)> = self.estimates.iter().filter_map(|e| Some((e, target(e)?))).collect();
        let n = kept.len();
        // Of one solution by the delta method, of different solutions zero: their rows come from different equations.
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let (one, other) = (kept[i].0, kept[j].0);
            if one.fit != other.fit {
                return 0.0;
            }
            let solution = &self.solutions[one.fit];
            let (a, b) = (DVector::from_column_slice(&one.gradient), DVector::from_column_slice(&other.gradient));
            a.dot(&(&solution.covariance * b)) * student(solution.degrees_of_freedom).powi(2)
        });
        let mut used: Vec<usize> = kept.iter().map(|(estimate, _)| estimate.fit).collect();
        used.sort_unstable();
        used.dedup();
        let solutions: Vec<&Solution> = used.iter().map(|&index| &self.solutions[index]).collect();
        Findings {
            found: kept.iter().map(|(estimate, target)| self.found(estimate, target.range)).collect(),
            covariance,
            delays: self.delays.clone(),
            offsets: self.offsets.clone(),
            profiles: Vec::new(),
            decisions: self.decisions.clone(),
            of_parts: self.of_parts.clone(),
            given_up: self.given_up.clone(),
            warnings: self.warnings.clone(),
            notes: self.notes.clone(),
            rows: solutions.iter().map(|solution| solution.rows).sum(),
            condition_number: solutions.iter().map(|s| s.condition_number).fold(f64::NAN, f64::max),
            almost: solutions.iter().any(|solution| solution.accuracy == Accuracy::AlmostSolved),
            corrected: self.options.correct,
        }
    }
}

/// The profile of a monotone function of one unknown, from that of the unknown.
fn of_unknown(curve: &Curve, theta: &[f64], index: usize, of: &Function) -> Curve {
    let mut moved = theta.to_vec();
    let mut map = |value: f64| {
        moved[index] = value;
        if value.is_finite() { of(&moved) } else { value }
    };
    let mut mapped = Curve {
        value: curve.value.iter().map(|value| map(*value)).collect(),
        crossings: curve.crossings.map(|ends| ends.map(&mut map)),
        better: curve.better.map(&mut map),
        ..curve.clone()
    };
    if mapped.value.first() > mapped.value.last() {
        mapped.value.reverse();
        mapped.statistic.reverse();
        mapped.crossings.iter_mut().for_each(|ends| ends.reverse());
        mapped.ends.reverse();
    }
    mapped
}
