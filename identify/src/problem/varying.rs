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
use crate::assess::student;
use crate::result::Law;
use crate::solve::covariance::inverse;
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
    let first = logs.first()?;
    let shared = |found: &&Found| !free.contains(&found.name) && found.spread > 0.0;
    let names: Vec<&str> = first.found.iter().filter(shared).map(|found| found.name.as_str()).collect();
    let n = names.len();
    // Columns of the design: which parameter, and its value in each log.
    let mut columns: Vec<(usize, Vec<f64>)> = (0..n).map(|k| (k, vec![1.0; logs.len()])).collect();
    let mut references = Vec::new();
    for vary in varying {
        let k = names.iter().position(|name| *name == vary.name)?;
        let (channel, reference) = match &vary.follows {
            Some((channel, means)) => {
                let reference = means.iter().sum::<f64>() / means.len() as f64;
                columns.push((k, means.iter().map(|mean| mean - reference).collect()));
                (channel.clone(), reference)
            }
            None => (String::new(), f64::NAN),
        };
        references.push((k, channel, reference));
    }
    let answers = |name: &str| -> Option<Vec<&Found>> { logs.iter().map(|log| log.get(name)).collect() };
    let all: Vec<Vec<&Found>> = names.iter().map(|name| answers(name)).collect::<Option<_>>()?;
    let mut scatter = DMatrix::<f64>::zeros(n, n);
    let mut lines = Vec::new();
    for (k, ..) in &references {
        let own: Vec<Vec<f64>> = columns.iter().filter(|(of, _)| of == k).map(|(_, column)| column.clone()).collect();
        let values: Vec<f64> = all[*k].iter().map(|found| found.value).collect();
        let errors: Vec<f64> = all[*k].iter().map(|found| found.own_error()).collect();
        let line = line(&own, &values, &errors);
        scatter[(*k, *k)] = line.scatter.powi(2);
        lines.push(line);
    }
    // Errors of a log's answers: by noise together, by bias and colour each.
    let place = |log: &Findings, name: &str| log.found.iter().position(|found| found.name == name);
    let covariance = |log: &Findings, a: &str, b: &str| -> Option<f64> {
        let (i, j) = (place(log, a)?, place(log, b)?);
        let own = if i == j { log.found[i].own_error().powi(2) - log.found[i].spread.powi(2) } else { 0.0 };
        Some(log.covariance[(i, j)] + own)
    };
    let p = columns.len();
    let (mut information, mut side) = (DMatrix::<f64>::zeros(p, p), DVector::<f64>::zeros(p));
    let mut parts = Vec::new();
    for (l, log) in logs.iter().enumerate() {
        let mut errors = DMatrix::zeros(n, n);
        for (i, a) in names.iter().enumerate() {
            for (j, b) in names.iter().enumerate() {
                errors[(i, j)] = covariance(log, a, b)?;
            }
        }
        let mut design = DMatrix::<f64>::zeros(n, p);
        columns.iter().enumerate().for_each(|(column, (k, values))| design[(*k, column)] = values[l]);
        let answer = DVector::from_iterator(n, all.iter().map(|found| found[l].value));
        let weight = inverse(&(&errors + &scatter));
        information += design.transpose() * &weight * &design;
        side += design.transpose() * &weight * &answer;
        parts.push((errors, design, answer, weight));
    }
    let of_beta = inverse(&information);
    let beta = &of_beta * side;
    let few = student((logs.len() as f64 - p as f64 / n.max(1) as f64).max(1.0));
    let own = logs.iter().zip(&parts).map(|(log, (errors, design, answer, weight))| {
        let gain = &scatter * weight;
        let law = design * &beta;
        let shared = &law + &gain * (answer - &law);
        let rest = DMatrix::identity(n, n) - &gain;
        let of_law = design * &of_beta * design.transpose();
        let of_shared = &scatter - &gain * &scatter + &rest * of_law * rest.transpose();
        let mut all: Vec<(String, f64, f64)> = references
            .iter()
            .map(|(k, ..)| (names[*k].to_owned(), shared[*k], of_shared[(*k, *k)].max(0.0).sqrt()))
            .collect();
        for name in free {
            let Some(found) = log.get(name) else { continue };
            let with = names.iter().map(|other| covariance(log, name, other).unwrap_or(0.0));
            let slope = (inverse(errors) * DVector::from_iterator(n, with.clone())).transpose();
            let value = found.value + (&slope * (&shared - answer))[0];
            let told = (&slope * DVector::from_iterator(n, with))[0];
            let variance = found.own_error().powi(2) - told + (&slope * &of_shared * slope.transpose())[0];
            all.push((name.clone(), value, variance.max(0.0).sqrt()));
        }
        all
    });
    let own = own.collect();
    let laws = references.iter().zip(&lines).map(|((k, channel, reference), line)| {
        let slope = columns.iter().skip(n).position(|(of, _)| of == k).map(|place| n + place);
        Law {
            parameter: names[*k].to_owned(),
            channel: channel.clone(),
            reference: *reference,
            slope: slope.map_or(f64::NAN, |place| beta[place]),
            slope_std_error: slope.map_or(f64::NAN, |place| few * of_beta[(place, place)].max(0.0).sqrt()),
            scatter: line.scatter,
            disagreement: line.reduced,
        }
    });
    let laws = laws.collect();
    let found = names.iter().enumerate().map(|(k, name)| {
        let (first, all) = (first.get(name)?, &all[k]);
        let least = |of: fn(&Found) -> f64| all.iter().map(|found| of(found)).fold(f64::INFINITY, f64::min);
        Some(Found {
            name: (*name).to_owned(),
            value: beta[k],
            spread: few * of_beta[(k, k)].max(0.0).sqrt(),
            bias: 0.0,
            coloured: Vec::new(),
            judgement: first.judgement,
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
    let findings = Findings {
        covariance: of_beta.view((0, 0), (n, n)).into_owned() * few.powi(2),
        warnings: lines(|log| &log.warnings),
        notes: lines(|log| &log.notes),
        rows: logs.iter().map(|log| log.rows).sum(),
        condition_number: logs.iter().map(|log| log.condition_number).fold(f64::NAN, f64::max),
        almost: logs.iter().any(|log| log.almost),
        corrected: logs.iter().all(|log| log.corrected),
        delays: logs.iter().flat_map(|log| &log.delays).cloned().collect(),
        decisions: logs.iter().flat_map(|log| log.decisions.clone()).collect(),
        given_up: Default::default(),
        found,
    };
    findings.found.iter().all(|found| found.value.is_finite()).then_some(Together { findings, laws, own })
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
