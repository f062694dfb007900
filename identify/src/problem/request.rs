//! What a fit is asked for, besides the logs.

use crate::solve::Loss;

/// Settings of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitRequest {
    /// Start values by FMU name (`--params`); checked against the declarations.
    pub start: Vec<(String, f64)>,
    /// Known values by FMU name (`--set`); checked against the declarations, they win over `start`.
    pub settings: Vec<(String, f64)>,
    /// Parameters to fit (`--only`); empty means the vehicle's usual ones.
    pub only: Vec<String>,
    /// Loss.
    pub loss: Loss,
    /// Refine the regression by output error.
    pub refine: bool,
    /// Subtract the estimated bias of the regressions (`--correct`).
    pub correct: bool,
}
