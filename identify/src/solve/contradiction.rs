//! What is wrong where no allowed values explain the rows, in words for the user.

use super::{Constraint, Regression};
use nalgebra::{DMatrix, DVector};

/// What least squares without bounds and constraints would give, compared with what is allowed: the unknowns that
/// end outside, and which rows say so. Empty if there is nothing to tell.
pub fn details(regression: &Regression) -> String {
    let Some(theta) = unconstrained(regression) else { return String::new() };
    let mut outside: Vec<String> = regression
        .unknowns
        .iter()
        .zip(&theta)
        .filter(|(unknown, value)| **value < unknown.lower || **value > unknown.upper)
        .map(|(unknown, value)| {
            format!("{} would be {value:.3e} (allowed {:.3e}..{:.3e})", unknown.name, unknown.lower, unknown.upper)
        })
        .collect();
    for constraint in &regression.constraints {
        let (broken, rows) = match constraint {
            Constraint::NonNegative(row) => (row.at(&theta) < 0.0, std::slice::from_ref(row)),
            Constraint::SecondOrder(rows) => {
                let norm = rows[1..].iter().map(|row| row.at(&theta).powi(2)).sum::<f64>().sqrt();
                (rows[0].at(&theta) < norm, rows.as_slice())
            }
        };
        if broken {
            let mut names: Vec<&str> = rows
                .iter()
                .flat_map(|row| &row.terms)
                .map(|(index, _)| regression.unknowns[*index].name.as_str())
                .collect();
            names.sort_unstable();
            names.dedup();
            outside.push(format!("{} would not fit together", names.join(", ")));
        }
    }
    if outside.is_empty() {
        return String::new();
    }
    let rows: Vec<String> = regression
        .groups
        .iter()
        .map(|group| format!("{} rows of {} in {}", group.len(), group.name, group.unit))
        .collect();
    format!(
        ": without them {}, by {}; check signs, units and delays of the channels",
        outside.join(", "),
        rows.join(" and ")
    )
}

/// Least squares without bounds, every group scaled to the size of its right-hand sides.
fn unconstrained(regression: &Regression) -> Option<Vec<f64>> {
    let n = regression.unknowns.len();
    let (mut gram, mut side) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
    for group in regression.groups.iter().filter(|group| !group.is_empty()) {
        let size = group.y.iter().map(|y| y * y).sum::<f64>().sqrt().max(f64::MIN_POSITIVE.sqrt());
        for i in 0..group.len() {
            let row = DVector::from_iterator(n, group.row(i).iter().map(|a| a / size));
            gram.ger(1.0, &row, &row, 1.0);
            side.axpy(group.y[i] / size, &row, 1.0);
        }
    }
    for (index, unknown) in regression.unknowns.iter().enumerate() {
        if let Some((mean, std)) = unknown.prior {
            let weight = gram.diagonal().max().max(f64::MIN_POSITIVE) * 1e-6 / (std * std).max(f64::MIN_POSITIVE);
            gram[(index, index)] += weight;
            side[index] += weight * mean;
        }
    }
    let theta = super::covariance::inverse(&gram) * side;
    theta.iter().all(|value| value.is_finite()).then(|| theta.as_slice().to_vec())
}
