//! Several logs: whether they agree, which one does not, and their joint answer where each has values of its own.
//!
//! Every log is estimated alone. A parameter that all logs share is the same up to its standard errors:
//! `chi2 = sum (theta_l - mean)^2 / s_l^2` with as many degrees of freedom as logs less one. Where some parameters belong
//! to the logs (a rest angle, a bias), the shared ones are the generalised least squares of the logs' answers,
//! `min sum over l of (theta_l - [shared; own_l])' C_l^-1 (...)`, which is the joint fit with the others free per log,
//! with each log's own noise level.

use super::findings::{Findings, Found};
use nalgebra::{DMatrix, DVector};
use std::collections::{BTreeMap, BTreeSet};

/// Quantile of the normal distribution beyond which logs contradict each other: one in two thousand.
const CONTRADICTION: f64 = 3.3;

/// What the logs say of one parameter.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// `chi2 / dof`.
    pub reduced: f64,
    /// Whether that is more than chance.
    pub contradicts: bool,
    /// The log that is farthest from the others, and in how many standard errors.
    pub odd: (usize, f64),
}

/// Compares the answers of the logs to one parameter; none with fewer than two.
pub fn compare(logs: &[Option<Findings>], name: &str) -> Option<Comparison> {
    let answers: Vec<(usize, f64, f64)> = logs
        .iter()
        .enumerate()
        .filter_map(|(index, log)| {
            let found = log.as_ref()?.get(name)?;
            let error = found.own_error();
            (error > 0.0 && !found.tells_nothing() && !found.at_bound).then_some((index, found.value, error))
        })
        .collect();
    if answers.len() < 2 {
        return None;
    }
    let mean_without = |out: Option<usize>| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (_, value, error) in answers.iter().filter(|(index, ..)| Some(*index) != out) {
            sum += value / (error * error);
            weight += 1.0 / (error * error);
        }
        (sum / weight, weight.powf(-0.5))
    };
    let (mean, _) = mean_without(None);
    let chi2: f64 = answers.iter().map(|(_, value, error)| ((value - mean) / error).powi(2)).sum();
    let dof = (answers.len() - 1) as f64;
    // Wilson and Hilferty: the cube root of chi2 / dof is nearly normal.
    let spread = 2.0 / (9.0 * dof);
    let normal = ((chi2 / dof).cbrt() - (1.0 - spread)) / spread.sqrt();
    let odd = answers.iter().map(|(index, value, error)| {
        let (others, of_others) = mean_without(Some(*index));
        (*index, (value - others).abs() / error.hypot(of_others))
    });
    let odd = odd.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
    Some(Comparison { reduced: chi2 / dof, contradicts: normal > CONTRADICTION, odd })
}

/// The shared parameters from the logs' answers, those of `free` being each log's own. A log that tells nothing of a
/// parameter has no share in it, unless no log tells of it.
pub fn combine(logs: &[&Findings], free: &BTreeSet<String>) -> Option<Findings> {
    let mut names: Vec<&str> = Vec::new();
    for found in logs.iter().flat_map(|log| &log.found) {
        if !free.contains(&found.name) && !names.contains(&found.name.as_str()) {
            names.push(&found.name);
        }
    }
    let n = names.len();
    let told: BTreeSet<&str> = logs
        .iter()
        .flat_map(|log| &log.found)
        .filter(|found| !found.tells_nothing())
        .map(|found| found.name.as_str())
        .collect();
    let place = |name: &str| names.iter().position(|other| *other == name);
    let mut information = DMatrix::<f64>::zeros(n, n);
    // Weights of each log's estimates in the shared ones, once the information is complete.
    let mut parts: Vec<(DMatrix<f64>, Vec<usize>)> = Vec::new();
    for log in logs {
        // Marginal covariance of the shared ones: the log's own parameters are free in it already.
        let shares =
            |found: &Found| !(free.contains(&found.name) || found.tells_nothing() && told.contains(&*found.name));
        let kept: Vec<usize> = (0..log.found.len()).filter(|&i| shares(&log.found[i])).collect();
        let covariance = DMatrix::from_fn(kept.len(), kept.len(), |i, j| {
            let own = if i == j { 1e-12 * log.found[kept[i]].value.powi(2) + f64::MIN_POSITIVE } else { 0.0 };
            log.covariance[(kept[i], kept[j])] + own
        });
        let inverse = crate::solve::covariance::inverse(&covariance);
        let places: Vec<usize> = kept.iter().filter_map(|&i| place(&log.found[i].name)).collect();
        for (i, &row) in places.iter().enumerate() {
            for (j, &column) in places.iter().enumerate() {
                information[(row, column)] += inverse[(i, j)];
            }
        }
        let mut weight = DMatrix::<f64>::zeros(n, log.found.len());
        for (i, &row) in places.iter().enumerate() {
            for (j, &column) in kept.iter().enumerate() {
                weight[(row, column)] = inverse[(i, j)];
            }
        }
        parts.push((weight, kept));
    }
    let covariance = crate::solve::covariance::inverse(&information);
    let (mut theta, mut bias) = (DVector::<f64>::zeros(n), DVector::<f64>::zeros(n));
    let mut coloured: BTreeMap<String, DVector<f64>> = BTreeMap::new();
    for (log, (weight, _)) in logs.iter().zip(&parts) {
        let gain = &covariance * weight;
        theta += &gain * DVector::from_iterator(log.found.len(), log.found.iter().map(|found| found.value));
        bias += &gain * DVector::from_iterator(log.found.len(), log.found.iter().map(|found| found.bias));
        let channels: BTreeSet<&String> = log.found.iter().flat_map(|f| f.coloured.iter().map(|(c, _)| c)).collect();
        for channel in channels {
            let pull = log.found.iter().map(|found| {
                found.coloured.iter().filter(|(name, _)| name == channel).map(|(_, pull)| pull).sum::<f64>()
            });
            let pull = &gain * DVector::from_iterator(log.found.len(), pull);
            *coloured.entry(channel.clone()).or_insert_with(|| DVector::zeros(n)) += pull;
        }
    }
    let least = |name: &str, of: &dyn Fn(&Found) -> f64| {
        logs.iter().filter_map(|log| log.get(name)).map(of).fold(f64::INFINITY, f64::min)
    };
    let found = names.iter().enumerate().map(|(i, name)| {
        let first = logs.iter().find_map(|log| log.get(name))?;
        Some(Found {
            name: (*name).to_owned(),
            value: theta[i],
            spread: covariance[(i, i)].max(0.0).sqrt(),
            bias: bias[i],
            coloured: coloured.iter().map(|(channel, pull)| (channel.clone(), pull[i])).collect(),
            judgement: first.judgement,
            at_bound: logs.iter().filter_map(|log| log.get(name)).all(|found| found.at_bound),
            noise_share: least(name, &|found| found.noise_share),
            correlation: least(name, &|found| found.correlation),
            condition_number: least(name, &|found| found.condition_number),
        })
    });
    let found: Vec<Found> = found.collect::<Option<_>>()?;
    let mut given_up = BTreeMap::new();
    for (name, reason) in logs.iter().flat_map(|log| &log.given_up) {
        if place(name).is_none() && !free.contains(name) {
            given_up.insert(name.clone(), reason.clone());
        }
    }
    let all = |of: &dyn Fn(&Findings) -> &Vec<String>| {
        let mut lines: Vec<String> = logs.iter().flat_map(|log| of(log)).cloned().collect();
        lines.sort();
        lines.dedup();
        lines
    };
    found.iter().all(|found| found.value.is_finite()).then(|| Findings {
        covariance,
        delays: logs.iter().flat_map(|log| &log.delays).cloned().collect(),
        offsets: logs.iter().flat_map(|log| &log.offsets).cloned().collect(),
        profiles: Vec::new(),
        decisions: logs.iter().flat_map(|log| log.decisions.clone()).collect(),
        of_parts: logs.iter().flat_map(|log| log.of_parts.clone()).collect(),
        given_up,
        warnings: all(&|log| &log.warnings),
        notes: all(&|log| &log.notes),
        rows: logs.iter().map(|log| log.rows).sum(),
        condition_number: logs.iter().map(|log| log.condition_number).fold(f64::NAN, f64::max),
        almost: logs.iter().any(|log| log.almost),
        corrected: logs.iter().all(|log| log.corrected),
        found,
    })
}
