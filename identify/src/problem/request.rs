//! What a fit is asked for, besides the logs.

use super::imposed::{Given, Knowledge};
use super::{Declared, FitError, Known, Target};
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
    /// Parameters that differ from log to log, with the channel that they follow, if any (`--varies`): the mean, how it
    /// changes with the channel's mean over a log, and the scatter of the logs are fitted.
    pub varies: Vec<(String, Option<String>)>,
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
    /// Parameters whose profile is wanted (`--profile`).
    pub profile: Vec<String>,
    /// Loss.
    pub loss: Loss,
    /// Refine the regression by output error.
    pub refine: bool,
    /// Subtract the estimated bias of the regressions (`--correct`).
    pub correct: bool,
}

impl FitRequest {
    /// The declared parameters with the values that were given for all logs.
    pub(super) fn known_values(&self, declared: &Declared) -> Result<Known, FitError> {
        let mut known = Known::new(declared.parameters.clone());
        for (name, value) in self.start.iter().chain(&self.settings) {
            known.set(name, *value)?;
        }
        for (name, value, std) in &self.known {
            known.set(name, *value)?;
            if !(std.is_finite() && *std >= 0.0) {
                let text = format!("{name} = {value} +- {std}: a standard deviation is not negative");
                return Err(FitError::Request(text));
            }
        }
        Ok(known)
    }

    /// What is given of parameters that can be fitted; bounds narrow their ranges.
    pub(super) fn given(&self, targets: &mut [Target]) -> Result<Vec<Given>, FitError> {
        let mut all = Vec::new();
        let unknown = |asked: &str, option: &str, targets: &[Target]| {
            let known = targets.iter().map(|target| target.name.as_str()).collect::<Vec<_>>().join(", ");
            FitError::Request(format!("{option} {asked}: cannot be fitted; there are {known}"))
        };
        for (name, low, high) in &self.bounds {
            let Some(target) = targets.iter_mut().find(|target| target.name == *name) else {
                return Err(unknown(name, "--bound", targets));
            };
            let (low, high) = (low.max(target.range.0), high.min(target.range.1));
            if low.is_nan() || high.is_nan() || low >= high {
                let (from, to) = target.range;
                return Err(FitError::Request(format!(
                    "--bound {name}: {low}..{high} is no range within {from}..{to}"
                )));
            }
            target.range = (low, high);
            all.push(Given { name: name.clone(), what: Knowledge::Range(low, high) });
        }
        if let Some(name) = self.per_log.iter().find(|name| targets.iter().all(|target| target.name != **name)) {
            return Err(unknown(name, "--per-log", targets));
        }
        let named = |name: &String| targets.iter().any(|target| target.name == *name);
        if let Some(name) = self.profile.iter().find(|name| !named(name)) {
            return Err(unknown(name, "--profile", targets));
        }
        if let Some((name, _)) = self.varies.iter().find(|(name, _)| !named(name)) {
            return Err(unknown(name, "--varies", targets));
        }
        let fittable = |name: &str| targets.iter().any(|target| target.name == *name && !target.contested);
        // Who asks by name to fit what was given gives a value to start from.
        let held = self.settings.iter().filter(|(name, _)| fittable(name) && !self.only.contains(name));
        for (name, value) in held {
            all.push(Given { name: name.clone(), what: Knowledge::Value(*value) });
        }
        for (name, value, std) in self.known.iter().filter(|(name, ..)| fittable(name)) {
            let what = if *std > 0.0 { Knowledge::Prior(*value, *std) } else { Knowledge::Value(*value) };
            all.push(Given { name: name.clone(), what });
        }
        Ok(all)
    }

    /// The parameters to fit: those that were asked for, or the usual ones that were not given.
    pub(super) fn wanted(&self, targets: &[Target]) -> Result<Vec<String>, FitError> {
        let is_given = |name: &str| self.settings.iter().any(|(given, _)| given == name);
        if self.only.is_empty() {
            let usual = targets.iter().filter(|target| target.usual && (target.contested || !is_given(&target.name)));
            let names: Vec<String> = usual.map(|target| target.name.clone()).collect();
            return if names.is_empty() {
                Err(FitError::Request("--set gives every parameter that would be fitted".to_owned()))
            } else {
                Ok(names)
            };
        }
        if let Some(asked) = self.only.iter().find(|asked| targets.iter().all(|target| target.name != **asked)) {
            let known = targets.iter().map(|target| target.name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(FitError::UnknownTarget { asked: asked.clone(), known });
        }
        Ok(self.only.clone())
    }
}
