//! Whether a parameter may be called identified.

/// Thresholds of [`verdict`].
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest condition number of the scaled regressors.
    pub condition_number: f64,
    /// Largest standard error relative to the estimate.
    pub relative_error: f64,
    /// Largest standard error where zero is a natural value (an angle, a bias), absolute; `None`
    /// judges by the relative one.
    pub absolute_error: Option<f64>,
    /// Largest correlation with another parameter of the same regression.
    pub correlation: f64,
    /// Largest share of sensor noise in what the regressor adds to the others.
    pub noise_share: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { condition_number: 1e3, relative_error: 0.3, absolute_error: None, correlation: 0.98, noise_share: 0.5 }
    }
}

/// What is known of one estimate.
#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    /// The estimate.
    pub value: f64,
    /// Its standard error, regressor-noise bias included.
    pub std_error: f64,
    /// Whether it, or a coefficient it is made of, sits at a bound.
    pub at_bound: bool,
    /// Largest absolute correlation with another parameter of its regression.
    pub correlation: f64,
    /// Largest share of noise in its regressors, see [`Solution::noise_share`](crate::solve::Solution).
    pub noise_share: f64,
    /// Condition number of its regression.
    pub condition_number: f64,
}

/// Identified, or why not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The log determines the parameter.
    Identified,
    /// It does not, for these reasons.
    Unidentified(Vec<String>),
}

/// Judges an estimate.
pub fn verdict(evidence: &Evidence, limits: &Limits) -> Verdict {
    let mut reasons = Vec::new();
    if evidence.at_bound {
        reasons.push("sits at its bound".to_owned());
    }
    let allowed = limits.absolute_error.unwrap_or(limits.relative_error * evidence.value.abs());
    if !evidence.std_error.is_finite() {
        reasons.push("nothing in the logs depends on its size".to_owned());
    } else if evidence.std_error > allowed {
        reasons.push(match limits.absolute_error {
            Some(limit) => format!("standard error {:.3e} exceeds {limit}", evidence.std_error),
            None if evidence.std_error >= evidence.value.abs() => {
                format!("standard error {:.3e} exceeds the estimate {:.3e}", evidence.std_error, evidence.value)
            }
            None => format!(
                "standard error is {:.0} % of the estimate (limit {:.0} %)",
                100.0 * evidence.std_error / evidence.value.abs(),
                100.0 * limits.relative_error
            ),
        });
    }
    if evidence.condition_number.is_nan() || evidence.condition_number > limits.condition_number {
        reasons.push(format!(
            "condition number {:.1e} exceeds {:.0e}",
            evidence.condition_number, limits.condition_number
        ));
    }
    if evidence.noise_share > limits.noise_share {
        reasons.push(format!(
            "the log does not excite it: {:.0} % of what its regressor shows is sensor noise",
            100.0 * evidence.noise_share.min(1.0)
        ));
    }
    if evidence.correlation > limits.correlation {
        reasons.push(format!(
            "correlation {:.3} with another parameter exceeds {}",
            evidence.correlation, limits.correlation
        ));
    }
    if reasons.is_empty() { Verdict::Identified } else { Verdict::Unidentified(reasons) }
}
