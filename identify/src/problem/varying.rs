//! Parameters that differ from log to log by more than noise: their law over the logs and their scatter about it.
//!
//! The answer of log `l` alone to the parameters that logs share, `theta_l` with the covariance `C_l` of its errors, is
//!
//! ```text
//! theta_l = X_l beta + u_l + e_l,   e_l ~ (0, C_l),   u_l ~ (0, T),   T = diag(tau^2), 0 where nothing varies
//! ```
//!
//! `X_l` has a column of ones per parameter and, where a parameter follows a channel, one more with the channel's mean
//! over the log less that over all logs. The scatter `tau` is that with which the weighted squares of what is left are as
//! many as their degrees of freedom (Paule and Mandel 1982); `beta` is the generalised least squares. A log's own values
//! are the best linear prediction `X_l beta + T (C_l + T)^-1 (theta_l - X_l beta)`, and what each log has alone (a mass)
//! follows through its covariance with them.

use super::findings::{Findings, Found};
use crate::result::Law;
use crate::solve::covariance::inverse;
use crate::solve::student;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;

/// A parameter that varies, and the mean of a channel over each log that it follows.
#[derive(Clone, Debug)]
pub struct Varying {
    /// FMU name.
    pub name: String,
    /// The channel and its mean over each log.
    pub follows: Option<(String, Vec<f64>)>,
}

/// What the logs say together.
pub struct Together {
    /// The shared parameters, those that vary at the mean of what they follow.
    pub findings: Findings,
    /// How they vary.
    pub laws: Vec<Law>,
    /// Value and standard error of what each log has of its own, by its name.
    pub own: Vec<Vec<(String, f64, f64)>>,
}

/// A linear law through values with standard errors, and the scatter about it that their differences need.
struct Line {
    scatter: f64,
    /// `chi2/dof` without any scatter.
    reduced: f64,
}

/// Weighted least squares of values on the columns; the weighted sum of squares of what is left.
fn squares(columns: &[Vec<f64>], values: &[f64], variances: &[f64]) -> f64 {
    let n = columns.len();
    let (mut gram, mut side) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
    for (l, (value, variance)) in values.iter().zip(variances).enumerate() {
        let row = DVector::from_iterator(n, columns.iter().map(|column| column[l]));
        gram.ger(1.0 / variance, &row, &row, 1.0);
        side.axpy(value / variance, &row, 1.0);
    }
    let beta = inverse(&gram) * side;
    let left = |l: usize| values[l] - columns.iter().zip(beta.iter()).map(|(column, b)| column[l] * b).sum::<f64>();
    variances.iter().enumerate().map(|(l, variance)| left(l).powi(2) / variance).sum()
}

fn line(columns: &[Vec<f64>], values: &[f64], errors: &[f64]) -> Line {
    let dof = values.len().saturating_sub(columns.len()) as f64;
    let with = |scatter: f64| {
        let variances: Vec<f64> = errors.iter().map(|error| error * error + scatter * scatter).collect();
        squares(columns, values, &variances)
    };
    let alone = with(0.0);
    let reduced = if dof > 0.0 { alone / dof } else { 0.0 };
    if dof < 1.0 || alone <= dof {
        return Line { scatter: 0.0, reduced };
    }
    let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
    // The more scatter the fewer squares.
    let (mut from, mut to) = (0.0, 10.0 * (high - low));
    for _ in 0..60 {
        let middle = 0.5 * (from + to);
        if with(middle) > dof { from = middle } else { to = middle }
    }
    Line { scatter: to, reduced }
}

/// The shared parameters of the logs' answers, those of `free` being each log's own, those of `varying` a law and a
/// scatter. None if a log lacks an answer to one of them.
pub fn together(logs: &[&Findings], free: &BTreeSet<String>, varying: &[Varying]) -> Option<Together> {
    let design = Design::new(logs, free, varying)?;
    let lines: Vec<Line> = design.laws.iter().map(|law| design.line(law.parameter)).collect();
    let squares = GeneralisedLeastSquares::new(logs, &design, &lines)?;
    let findings = findings(logs, &design, &squares)?;
    let own =
        logs.iter().zip(&squares.parts).map(|(log, part)| own_values(log, free, &design, &squares, part)).collect();
    let laws = laws(&design, &squares, &lines);
    findings.found.iter().all(|found| found.value.is_finite()).then_some(Together { findings, laws, own })
}

/// What a varying parameter follows.
struct Follows {
    /// Number of the parameter.
    parameter: usize,
    /// The channel; empty if it follows none.
    channel: String,
    /// The channel's mean over all logs.
    reference: f64,
}

/// The columns of `X` and the answers to be explained.
struct Design<'a> {
    /// The shared parameters.
    names: Vec<&'a str>,
    /// Number of the parameter to which a column belongs, and the column's value in each log.
    columns: Vec<(usize, Vec<f64>)>,
    laws: Vec<Follows>,
    /// Of each parameter the answer of each log.
    answers: Vec<Vec<&'a Found>>,
}

impl<'a> Design<'a> {
    fn new(logs: &[&'a Findings], free: &BTreeSet<String>, varying: &[Varying]) -> Option<Self> {
        let shared = |found: &&Found| !free.contains(&found.name) && found.spread > 0.0;
        let names: Vec<&str> = logs.first()?.found.iter().filter(shared).map(|found| found.name.as_str()).collect();
        let mut columns: Vec<_> = (0..names.len()).map(|k| (k, vec![1.0; logs.len()])).collect();
        let mut laws = Vec::new();
        for vary in varying {
            let parameter = names.iter().position(|name| *name == vary.name)?;
            let (channel, reference) = match &vary.follows {
                Some((channel, means)) => {
                    let reference = means.iter().sum::<f64>() / means.len() as f64;
                    columns.push((parameter, means.iter().map(|mean| mean - reference).collect()));
                    (channel.clone(), reference)
                }
                None => (String::new(), f64::NAN),
            };
            laws.push(Follows { parameter, channel, reference });
        }
        let answers = |name: &&str| -> Option<Vec<&'a Found>> { logs.iter().map(|log| log.get(name)).collect() };
        let answers = names.iter().map(answers).collect::<Option<_>>()?;
        Some(Self { names, columns, laws, answers })
    }

    /// The line through the answers to one parameter.
    fn line(&self, parameter: usize) -> Line {
        let own: Vec<Vec<f64>> =
            self.columns.iter().filter(|(of, _)| *of == parameter).map(|(_, column)| column.clone()).collect();
        let values: Vec<f64> = self.answers[parameter].iter().map(|found| found.value).collect();
        let errors: Vec<f64> = self.answers[parameter].iter().map(|found| found.own_error()).collect();
        line(&own, &values, &errors)
    }
}

/// Covariance of the errors of a log's answers to two parameters: by noise together, by bias and colour each.
fn covariance(log: &Findings, a: &str, b: &str) -> Option<f64> {
    let place = |name: &str| log.found.iter().position(|found| found.name == name);
    let (i, j) = (place(a)?, place(b)?);
    let own = if i == j { log.found[i].own_error().powi(2) - log.found[i].spread.powi(2) } else { 0.0 };
    Some(log.covariance[(i, j)] + own)
}

/// One log in the generalised least squares.
struct Part {
    /// `C_l`
    errors: DMatrix<f64>,
    /// `X_l`
    design: DMatrix<f64>,
    /// `theta_l`
    answer: DVector<f64>,
    /// `(C_l + T)^-1`
    weight: DMatrix<f64>,
}

/// `beta` with the covariance of its errors.
struct GeneralisedLeastSquares {
    /// `T`
    scatter: DMatrix<f64>,
    parts: Vec<Part>,
    beta: DVector<f64>,
    of_beta: DMatrix<f64>,
    /// By how much the standard errors of few logs are larger than those of many.
    few: f64,
}

impl GeneralisedLeastSquares {
    fn new(logs: &[&Findings], design: &Design, lines: &[Line]) -> Option<Self> {
        let (n, p) = (design.names.len(), design.columns.len());
        let mut scatter = DMatrix::<f64>::zeros(n, n);
        for (law, line) in design.laws.iter().zip(lines) {
            scatter[(law.parameter, law.parameter)] = line.scatter.powi(2);
        }
        let (mut information, mut side) = (DMatrix::<f64>::zeros(p, p), DVector::<f64>::zeros(p));
        let mut parts = Vec::new();
        for (l, log) in logs.iter().enumerate() {
            let mut errors = DMatrix::zeros(n, n);
            for (i, a) in design.names.iter().enumerate() {
                for (j, b) in design.names.iter().enumerate() {
                    errors[(i, j)] = covariance(log, a, b)?;
                }
            }
            let mut of_log = DMatrix::<f64>::zeros(n, p);
            design.columns.iter().enumerate().for_each(|(column, (k, values))| of_log[(*k, column)] = values[l]);
            let answer = DVector::from_iterator(n, design.answers.iter().map(|found| found[l].value));
            let weight = inverse(&(&errors + &scatter));
            information += of_log.transpose() * &weight * &of_log;
            side += of_log.transpose() * &weight * &answer;
            parts.push(Part { errors, design: of_log, answer, weight });
        }
        let of_beta = inverse(&information);
        let beta = &of_beta * side;
        let few = student((logs.len() as f64 - p as f64 / n.max(1) as f64).max(1.0));
        Some(Self { scatter, parts, beta, of_beta, few })
    }

    /// Standard error of an element of `beta`.
    fn std_error(&self, index: usize) -> f64 {
        self.few * self.of_beta[(index, index)].max(0.0).sqrt()
    }
}

/// Value and standard error of what a log has of its own: the varying parameters by their best linear prediction, and
/// what it has alone.
fn own_values(
    log: &Findings,
    free: &BTreeSet<String>,
    design: &Design,
    squares: &GeneralisedLeastSquares,
    part: &Part,
) -> Vec<(String, f64, f64)> {
    let (n, scatter) = (design.names.len(), &squares.scatter);
    let gain = scatter * &part.weight;
    let law = &part.design * &squares.beta;
    let shared = &law + &gain * (&part.answer - &law);
    let rest = DMatrix::identity(n, n) - &gain;
    let of_law = &part.design * &squares.of_beta * part.design.transpose();
    let of_shared = scatter - &gain * scatter + &rest * of_law * rest.transpose();
    let varying = design.laws.iter().map(|law| {
        let k = law.parameter;
        (design.names[k].to_owned(), shared[k], of_shared[(k, k)].max(0.0).sqrt())
    });
    let mut own: Vec<_> = varying.collect();
    for name in free {
        let Some(found) = log.get(name) else { continue };
        let with = design.names.iter().map(|other| covariance(log, name, other).unwrap_or(0.0));
        let slope = (inverse(&part.errors) * DVector::from_iterator(n, with.clone())).transpose();
        let value = found.value + (&slope * (&shared - &part.answer))[0];
        let explained = (&slope * DVector::from_iterator(n, with))[0];
        let variance = found.own_error().powi(2) - explained + (&slope * &of_shared * slope.transpose())[0];
        own.push((name.clone(), value, variance.max(0.0).sqrt()));
    }
    own
}

fn laws(design: &Design, squares: &GeneralisedLeastSquares, lines: &[Line]) -> Vec<Law> {
    let n = design.names.len();
    let law = |(law, line): (&Follows, &Line)| {
        let slope = design.columns.iter().skip(n).position(|(of, _)| *of == law.parameter).map(|place| n + place);
        Law {
            parameter: design.names[law.parameter].to_owned(),
            channel: law.channel.clone(),
            reference: law.reference,
            slope: slope.map_or(f64::NAN, |place| squares.beta[place]),
            slope_std_error: slope.map_or(f64::NAN, |place| squares.std_error(place)),
            scatter: line.scatter,
            disagreement: line.reduced,
        }
    };
    design.laws.iter().zip(lines).map(law).collect()
}

/// The shared parameters as findings of all logs.
fn findings(logs: &[&Findings], design: &Design, squares: &GeneralisedLeastSquares) -> Option<Findings> {
    let n = design.names.len();
    let found = design.names.iter().zip(&design.answers).enumerate().map(|(k, (name, all))| {
        let least = |of: fn(&Found) -> f64| all.iter().map(|found| of(found)).fold(f64::INFINITY, f64::min);
        Some(Found {
            name: (*name).to_owned(),
            value: squares.beta[k],
            spread: squares.std_error(k),
            bias: 0.0,
            coloured: Vec::new(),
            judgement: all.first()?.judgement,
            at_bound: all.iter().all(|found| found.at_bound),
            noise_share: least(|found| found.noise_share),
            correlation: least(|found| found.correlation),
            condition_number: least(|found| found.condition_number),
        })
    });
    let found: Vec<Found> = found.collect::<Option<_>>()?;
    let lines = |of: fn(&Findings) -> &Vec<String>| {
        let mut lines: Vec<String> = logs.iter().flat_map(|log| of(log)).cloned().collect();
        lines.sort();
        lines.dedup();
        lines
    };
    Some(Findings {
        covariance: squares.of_beta.view((0, 0), (n, n)).into_owned() * squares.few.powi(2),
        warnings: lines(|log| &log.warnings),
        notes: lines(|log| &log.notes),
        rows: logs.iter().map(|log| log.rows).sum(),
        condition_number: logs.iter().map(|log| log.condition_number).fold(f64::NAN, f64::max),
        almost: logs.iter().any(|log| log.almost),
        corrected: logs.iter().all(|log| log.corrected),
        delays: logs.iter().flat_map(|log| &log.delays).cloned().collect(),
        offsets: logs.iter().flat_map(|log| &log.offsets).cloned().collect(),
        profiles: Vec::new(),
        decisions: logs.iter().flat_map(|log| log.decisions.clone()).collect(),
        of_parts: logs.iter().flat_map(|log| log.of_parts.clone()).collect(),
        given_up: Default::default(),
        found,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Twelve values on a line with a scatter that is twice their errors: the scatter is found, on the average of
    /// many draws, and the line's squares are then as many as their degrees of freedom.
    #[test]
    fn a_scatter_beyond_the_errors_is_found() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let at: Vec<f64> = (0..12).map(|l| f64::from(l) - 5.5).collect();
        let columns = [vec![1.0; 12], at.clone()];
        let mut mean = 0.0;
        for _ in 0..400 {
            let values: Vec<f64> = at.iter().map(|x| 3.0 - 0.2 * x + 0.2 * normal() + 0.1 * normal()).collect();
            let found = line(&columns, &values, &[0.1; 12]);
            mean += found.scatter.powi(2) / 400.0;
            assert!(found.scatter == 0.0 || found.reduced > 1.0);
        }
        assert!((mean / 0.04 - 1.0).abs() < 0.1, "{mean}");
    }
}
