//! Variances of the equations and of the variables before anything is measured.

use super::equations::{Equation, Equations, Kind};
use super::error::ModelError;

/// How exact the equations are and how wide the prior of `d` is.
///
/// The equations mix units (m/s2, N, N.m), so each kind has its own variance. What is set for one
/// body overrides what is set for all.
#[derive(Clone, Debug, PartialEq)]
pub struct Variances {
    /// Variance of the rows of each [`Equation`], in their order.
    pub equation: [f64; 4],
    /// Prior variance of each [`Kind`] of variable, in their order.
    pub prior: [f64; 6],
    /// Prior mean of all variables.
    pub mean: f64,
    /// Equations of one body.
    pub equation_of: Vec<(usize, Equation, f64)>,
    /// Variables of one body: variance of the first three (linear, force) and of the others
    /// (angular, moment); joint variables use the first.
    pub prior_of: Vec<(usize, Kind, [f64; 2])>,
}

impl Default for Variances {
    /// The paper's case B with the prior of its authors' software: 1e-4 and 1e4.
    fn default() -> Self {
        Self { equation: [1e-4; 4], prior: [1e4; 6], mean: 0.0, equation_of: vec![], prior_of: vec![] }
    }
}

fn check(what: &str, variance: f64) -> Result<(), ModelError> {
    if variance > 0.0 && variance.is_finite() && (1.0 / variance).is_finite() {
        return Ok(());
    }
    Err(ModelError::BadVariance(what.to_owned(), variance))
}

impl Variances {
    /// Variance of every row of the equations, sensors included.
    pub fn of_rows(&self, equations: &Equations) -> Result<Vec<f64>, ModelError> {
        let words = ["acceleration", "net_wrench", "wrench_balance", "torque"];
        for (word, &v) in words.iter().zip(&self.equation) {
            check(&format!("equation '{word}'"), v)?;
        }
        let mut rows: Vec<f64> = equations.owners().iter().map(|&(_, e)| self.equation[e as usize]).collect();
        for &(body, equation, v) in &self.equation_of {
            check(&format!("equation '{}' of body {body}", words[equation as usize]), v)?;
            for (row, owner) in rows.iter_mut().zip(equations.owners()) {
                if *owner == (body, equation) {
                    *row = v;
                }
            }
        }
        for sensor in 0..equations.sensors().len() {
            rows.extend_from_slice(equations.sensor_variance(sensor));
        }
        Ok(rows)
    }

    /// Prior variance of every variable.
    pub fn of_variables(&self, equations: &Equations) -> Result<Vec<f64>, ModelError> {
        let mut variables = vec![0.0; equations.variables()];
        for slots in equations.slots().iter().flatten() {
            for (kind, &v) in Kind::ALL.iter().zip(&self.prior) {
                check("the prior", v)?;
                variables[slots.range(*kind)].fill(v);
            }
        }
        for &(body, kind, v) in &self.prior_of {
            check("a prior", v[0])?;
            check("a prior", v[1])?;
            if let Some(slots) = equations.slots()[body] {
                for (k, slot) in slots.range(kind).enumerate() {
                    variables[slot] = v[k / 3 % 2];
                }
            }
        }
        Ok(variables)
    }
}
