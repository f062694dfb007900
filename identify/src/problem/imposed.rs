//! Values that are given or known beforehand, imposed on solutions.
//!
//! A parameter is a function of the unknowns of a regression. Where its value is given (`--set`), bounded (`--bound`) or
//! known with a standard deviation (`--prior`), the solution is moved onto that value: least squares under an equation,
//! in the metric of the regression, or weighed against it by their covariances. The function is linearised at the
//! last answer and the problem is estimated again until it holds, so that later stages see the value, too.

use crate::solve::Solution;
use nalgebra::{DMatrix, DVector};

/// What is known of a parameter beforehand.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    /// FMU name.
    pub name: String,
    /// What is known.
    pub what: Knowledge,
}

/// A value, a value with its standard deviation, or a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Knowledge {
    /// It has this value.
    Value(f64),
    /// It has this value, give or take a standard deviation.
    Prior(f64, f64),
    /// It is in this range.
    Range(f64, f64),
}

/// `row . unknowns = value +- std` on one solution; a standard deviation of zero is an equation.
#[derive(Clone, Debug)]
pub struct Imposition {
    /// Whose value this is.
    pub name: String,
    /// Index of the solution in the order of solving.
    pub fit: usize,
    /// The row.
    pub row: Vec<f64>,
    /// The value.
    pub value: f64,
    /// The standard deviation.
    pub std: f64,
}

/// Moves a solution onto a condition; returns how many standard deviations the two were apart.
pub fn impose(solution: &mut Solution, condition: &Imposition) -> f64 {
    let n = solution.theta.len();
    if condition.row.len() != n {
        return 0.0;
    }
    let row = DVector::from_column_slice(&condition.row);
    let bias = DVector::from_column_slice(&solution.bias);
    let theta = DVector::from_column_slice(&solution.theta);
    let missing = condition.value - row.dot(&theta);
    let own = row.dot(&(&solution.covariance * &row)) + row.dot(&bias).powi(2);
    let apart = missing.abs() / (own + condition.std * condition.std).sqrt().max(f64::MIN_POSITIVE);
    let metric = if condition.std > 0.0 {
        &solution.covariance + &bias * bias.transpose()
    } else {
        solution.inverse_information.clone()
    };
    let seen = &metric * &row;
    let size = row.dot(&seen) + condition.std * condition.std;
    if !(size > 0.0 && size.is_finite()) {
        return 0.0;
    }
    let gain = seen / size;
    let keep = DMatrix::identity(n, n) - &gain * row.transpose();
    solution.theta = (theta + &gain * missing).as_slice().to_vec();
    solution.bias = (&keep * bias).as_slice().to_vec();
    for (_, pull) in &mut solution.coloured {
        *pull = (&keep * DVector::from_column_slice(pull)).as_slice().to_vec();
    }
    let noise = &gain * gain.transpose() * condition.std * condition.std;
    solution.covariance = &keep * &solution.covariance * keep.transpose() + &noise;
    // An unknown that is held is none that the rows must tell apart from the others.
    let inner = &keep * &solution.inverse_information * keep.transpose();
    solution.inverse_information = inner + noise;
    apart
}
