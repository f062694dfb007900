//! What a fit is asked for, besides the logs.

use crate::log::Log;
use crate::solve::Loss;

/// Settings of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitRequest {
    /// Start values by FMU name (`--params`); checked against the declarations.
    pub start: Vec<(String, f64)>,
    /// Known values by FMU name (`--set`); checked against the declarations, they win over `start`. They hold: a
    /// parameter that is given is not fitted.
    pub settings: Vec<(String, f64)>,
    /// Values with a standard deviation (`--known`, `--prior`): a prior of what is fitted, and for everything else a
    /// known value whose uncertainty is considered.
    pub known: Vec<(String, f64, f64)>,
    /// Ranges that fitted parameters must stay in (`--bound`).
    pub bounds: Vec<(String, f64, f64)>,
    /// Parameters that each log has a value of its own of (`--per-log`).
    pub per_log: Vec<String>,
    /// Known values of one log, by its index (`--set FILE:name=value`).
    pub of_log: Vec<(usize, String, f64)>,
    /// Standard deviations of sensors (`--sensor`): `CHANNEL.gain_std`, `.bias_std`, `.delay_std`.
    pub sensors: Vec<(String, f64)>,
    /// Sensors and known values are exact but for noise and for what `sensors` and `known` say (`--exact`).
    pub exact: bool,
    /// Leave out logs that contradict the others (`--skip-bad`).
    pub skip_bad: bool,
    /// Logs that only judge the result (`--held-out`); without one the last 40 % of each log do.
    pub held_out: Vec<Log>,
    /// Whether the signals of the fitted logs are wanted, for `--residuals`.
    pub residuals: bool,
    /// Parameters to fit (`--only`); empty means the vehicle's usual ones.
    pub only: Vec<String>,
    /// Loss.
    pub loss: Loss,
    /// Refine the regression by output error.
    pub refine: bool,
    /// Subtract the estimated bias of the regressions (`--correct`).
    pub correct: bool,
}
