//! The result of a fit or of a tuning: what `fit.json` and `tune.json` hold.

use crate::finding::{Finding, Severity};
use crate::log::Log;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the file format; readers refuse a newer one.
pub const FORMAT_VERSION: u32 = 1;

/// A whole result. Serialised it is `fit.json`; numbers that are not finite are written as `null`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Always [`FORMAT_VERSION`] when written by this program.
    pub format_version: u32,
    /// The vehicle's name on the command line, as `nursing-robot`.
    pub vehicle: String,
    /// The fitted parameters by their FMU names.
    pub parameters: BTreeMap<String, Parameter>,
    /// Covariance of the fitted parameters, if there is one.
    #[serde(default)]
    pub covariance: Option<Covariance>,
    /// The two parameters that the data tell apart worst.
    #[serde(default)]
    pub correlation_worst_pair: Option<CorrelationPair>,
    /// Condition number of the regressor with columns of unit length (the worst block, if several).
    #[serde(default, with = "maybe")]
    pub condition_number: f64,
    /// `ls`, `huber` or `l1`; the objective for a tuning.
    pub loss: String,
    /// Number of windows (regression rows) that entered the fit.
    #[serde(default)]
    pub windows_used: usize,
    /// How well the fit predicts the part of the logs that it has not seen.
    #[serde(default)]
    pub validation: Validation,
    /// The logs that were read.
    pub logs: Vec<LogEntry>,
    /// What the solver said, as `Solved`.
    #[serde(default)]
    pub solver_status: String,
    /// What the user must know before using the result; not empty means exit code 1.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// What is good to know and no reason to worry.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// What was found in the logs before anything was fitted to them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub findings: Vec<Finding>,
    /// How late channels are, where the fit of the machine finds that along with its parameters.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub delays: Vec<Delay>,
    /// How parameters vary from log to log, where that was asked for (`--varies`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub laws: Vec<Law>,
    /// Profiles of parameters, where they were asked for (`--profile`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub profiles: Vec<Profile>,
    /// Known values that the fit relied on (`--set`, `--params`), by their FMU names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, f64>,
    /// True values of the parameters, where the logs carry them as constant channels `true_<name>`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub references: BTreeMap<String, f64>,
    /// Why there is no result: then only the logs and the warnings say something, and nothing may be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    /// Measured and predicted signals of the held-out part, for the HTML report only.
    #[serde(skip)]
    pub traces: Vec<Trace>,
    /// Measured and predicted signals of the fitted logs with the result, for `--residuals` only.
    #[serde(skip)]
    pub fitted: Vec<Trace>,
}

/// One fitted parameter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Fitted value.
    #[serde(with = "maybe")]
    pub value: f64,
    /// Unit in the FMI spelling, `1` if it has none.
    pub unit: String,
    /// Standard deviation of the value; NaN if unknown.
    #[serde(with = "maybe")]
    pub std_error: f64,
    /// 95 % confidence interval `[low, high]`.
    #[serde(with = "maybe_pair")]
    pub ci95: [f64; 2],
    /// The data determine this parameter well enough to be used.
    pub identified: bool,
    /// The value sits at a bound of what is physically allowed.
    pub at_bound: bool,
    /// The same judgement with more shades.
    #[serde(default)]
    pub verdict: Verdict,
    /// Standard deviation by noise and by the bias that noise in the regressors causes, without what is considered:
    /// sensors, known values, noise that may not be white.
    #[serde(default, with = "maybe")]
    pub sampling_std: f64,
    /// What the uncertainty is made of, the largest causes first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub contributions: Vec<Contribution>,
    /// The value of each log by its file, where each has its own.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub per_log: BTreeMap<String, OfLog>,
    /// The value that the fit started from or that holds without this fit, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<f64>,
}

/// A cause of uncertainty and its part of the standard error; independent parts add their squares.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Contribution {
    /// What it is, in words.
    pub cause: String,
    /// Its standard deviation, in the parameter's unit.
    #[serde(with = "maybe")]
    pub std: f64,
}

/// The value of a parameter in one of several logs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OfLog {
    /// The value.
    #[serde(with = "maybe")]
    pub value: f64,
    /// Its standard error.
    #[serde(with = "maybe")]
    pub std_error: f64,
}

/// How much later a channel of a log is than others.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Delay {
    /// The log.
    pub log: String,
    /// The channel.
    pub channel: String,
    /// What it is compared with, in words.
    pub against: String,
    /// The delay, s.
    #[serde(with = "maybe")]
    pub value: f64,
    /// Its standard error, s.
    #[serde(with = "maybe")]
    pub std_error: f64,
}

/// How a parameter varies from log to log: `value + slope (mean of the channel over the log - reference)`, give or take
/// the scatter; the value stands among the parameters, those of the logs in its `per_log`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// FMU name of the parameter.
    pub parameter: String,
    /// The channel that it follows; empty if none.
    pub channel: String,
    /// Mean of the channel over all logs.
    #[serde(with = "maybe")]
    pub reference: f64,
    /// Change of the parameter per unit of the channel.
    #[serde(with = "maybe")]
    pub slope: f64,
    /// Standard error of the slope.
    #[serde(with = "maybe")]
    pub slope_std_error: f64,
    /// Standard deviation of the logs about the law, beyond the errors of their fits.
    #[serde(with = "maybe")]
    pub scatter: f64,
    /// `chi2/dof` of the logs about the law by the errors of their fits alone.
    #[serde(with = "maybe")]
    pub disagreement: f64,
}

/// How much worse the best fit becomes when a parameter is held away from its estimate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// FMU name of the parameter.
    pub parameter: String,
    /// The estimate.
    #[serde(with = "maybe")]
    pub estimate: f64,
    /// Its standard deviation by noise, times what Student's distribution adds.
    #[serde(with = "maybe")]
    pub std: f64,
    /// Values at which it was held, ascending, in its unit.
    pub values: Vec<f64>,
    /// `2 (Q(value) - Q(estimate)) / inflation` with the cost `Q` of the best fit there; chi-squared with one degree of
    /// freedom at the truth, 3.84 at 95 %.
    pub statistic: Vec<f64>,
    /// Whether the others were fitted anew at each value; otherwise it is a parabola by the covariance.
    pub refitted: bool,
    /// How many times larger the variance of the estimate is than independent noise of the fit's weights would make it.
    #[serde(with = "maybe")]
    pub inflation: f64,
    /// 95 % interval by noise alone; `null` where it has no end.
    #[serde(with = "maybe_pair")]
    pub noise95: [f64; 2],
    /// 99.7 % interval by noise alone.
    #[serde(with = "maybe_pair")]
    pub noise997: [f64; 2],
    /// 95 % interval with all that is considered: sensors, known values, noise that may not be white.
    #[serde(with = "maybe_pair")]
    pub ci95: [f64; 2],
    /// How the curve ends below and above.
    pub ends: [ProfileEnd; 2],
}

/// How one side of a profile ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProfileEnd {
    /// It passes 99.7 %.
    #[default]
    Passed,
    /// At a bound of what is allowed, still below that.
    Bound,
    /// Nowhere: the logs exclude no value, however far.
    Open,
}

/// How far the data determine a parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Determined by the data.
    #[default]
    Identified,
    /// Seen by the data, but too uncertain or too entangled with another parameter to be used.
    Weak,
    /// The data say nothing about it.
    NotIdentifiable,
    /// Pushed against a physical bound: model and data disagree.
    AtBound,
    /// Only special manoeuvres show it, these logs do not, and nobody asked for it: it keeps its known value.
    PriorOnly,
    /// Each log has its own value.
    PerLog,
}

impl Verdict {
    /// The words of the table.
    pub fn words(self) -> &'static str {
        match self {
            Self::Identified => "identified",
            Self::Weak => "weak",
            Self::NotIdentifiable => "not identifiable",
            Self::AtBound => "at bound",
            Self::PriorOnly => "prior only",
            Self::PerLog => "per log",
        }
    }
}

impl Law {
    /// In words, for the parameter with its value at the reference.
    pub(crate) fn words(&self, parameter: &Parameter) -> String {
        let Self { channel, reference, slope, slope_std_error, scatter, disagreement, .. } = self;
        let law = if channel.is_empty() {
            String::new()
        } else {
            format!(
                " at {channel} {reference:.4}, and changes by {slope:.3e} +- {slope_std_error:.1e} with each unit of it"
            )
        };
        format!(
            "{} is {:.4}{law}; the logs scatter about that by {scatter:.2e} beyond their own errors (chi2/dof {disagreement:.1} \
             without that)",
            self.parameter, parameter.value
        )
    }
}

impl Parameter {
    /// Value over standard error: how many standard errors away from zero.
    pub fn t_ratio(&self) -> f64 {
        self.value / self.std_error
    }
}

/// A covariance matrix with the names of its rows and columns.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    /// Parameter of each row and column.
    pub parameters: Vec<String>,
    /// Rows, in the product of the parameters' units.
    #[serde(with = "maybe_matrix")]
    pub matrix: Vec<Vec<f64>>,
}

/// Two parameters and the correlation of their estimates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CorrelationPair {
    /// The two names.
    pub parameters: [String; 2],
    /// Their correlation, -1 to 1.
    #[serde(with = "maybe")]
    pub correlation: f64,
}

/// Prediction of the part of the logs that the fit has not seen.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Share of each log that was held out, 0 to 1.
    #[serde(with = "maybe")]
    pub held_out: f64,
    /// One entry per predicted signal.
    pub signals: Vec<SignalFit>,
}

/// How well one signal is predicted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SignalFit {
    /// The channel, or what the regression rows stand for (`pitch moment`).
    pub name: String,
    /// Unit of the errors.
    pub unit: String,
    /// The log that it is of.
    #[serde(default)]
    pub log: String,
    /// Samples or windows compared.
    pub samples: usize,
    /// Root mean square of the prediction error.
    #[serde(with = "maybe")]
    pub rmse: f64,
    /// The same figure on the part that was fitted.
    #[serde(default, with = "maybe")]
    pub rmse_training: f64,
    /// 100 % means a perfect prediction, 0 % one that is no better than the mean:
    /// `100 (1 - ||measured - predicted|| / ||measured - mean||)`.
    #[serde(with = "maybe")]
    pub fit_percent: f64,
    /// The same figure on the part that was fitted; much better than `fit_percent` means over-fitting.
    #[serde(default, with = "maybe")]
    pub fit_percent_training: f64,
    /// Autocorrelation of the residual at the lag of one independent sample; near 0 if only noise is left.
    #[serde(default, with = "maybe")]
    pub residual_correlation: f64,
}

/// A log that was read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LogEntry {
    /// Path as given.
    pub file: String,
    /// SHA-256 of the file's bytes, hexadecimal; of the samples if it never was a file.
    pub sha256: String,
    /// Number of samples.
    pub samples: usize,
}

impl From<&Log> for LogEntry {
    fn from(log: &Log) -> Self {
        Self { file: log.source.clone(), sha256: log.sha256.clone(), samples: log.len() }
    }
}

/// One measured signal with its prediction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// What it is, as `body pitch`.
    pub name: String,
    /// Unit of both.
    pub unit: String,
    /// The log it comes from.
    pub log: String,
    /// Times, s.
    pub time: Vec<f64>,
    /// Measured values; NaN if missing.
    pub measured: Vec<f64>,
    /// Predicted values.
    pub predicted: Vec<f64>,
}

impl FitReport {
    /// [`solver_status`](Self::solver_status) in words.
    pub(crate) fn solver_words(&self) -> &str {
        match self.solver_status.as_str() {
            "Solved" => "exactly",
            "AlmostSolved" => "less exactly than the intervals say",
            "not run" => "nothing",
            other => other,
        }
    }

    /// Whether there is something that the user must know: the condition of exit code 1.
    pub fn has_warnings(&self) -> bool {
        let of_no_use =
            |p: &Parameter| p.at_bound || !(p.identified || matches!(p.verdict, Verdict::PriorOnly | Verdict::PerLog));
        let found = self.findings.iter().any(|finding| finding.severity >= Severity::Warning);
        found || !self.warnings.is_empty() || self.parameters.values().any(of_no_use)
    }

    /// Parameters that may be used as start values of an estimator.
    pub fn identified(&self) -> impl Iterator<Item = (&str, &Parameter)> {
        self.parameters.iter().filter(|(_, p)| p.identified).map(|(name, p)| (name.as_str(), p))
    }

    /// Takes over true values of the fitted parameters from channels `true_<name>`, if they are
    /// constant and the same in all logs.
    pub fn refer_to(&mut self, logs: &[Log]) {
        for name in self.parameters.keys() {
            let channel = format!("true_{name}");
            let constant = |log: &Log| {
                let values = log.series(&channel).filter(|values| !values.is_empty())?;
                let first = Some(values.at(0)).filter(|value| value.is_finite())?;
                (!values.any(|value| value != first)).then_some(first)
            };
            let values: Option<Vec<f64>> = logs.iter().map(constant).collect();
            if let Some([first, rest @ ..]) = values.as_deref()
                && rest.iter().all(|value| value == first)
            {
                self.references.insert(name.clone(), *first);
            }
        }
    }

    /// The file's text, ending in a new line.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }
}

/// Numbers that may be NaN or infinite are `null` in JSON and NaN when read back.
mod maybe {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::NAN))
    }
}

mod maybe_pair {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(pair: &[f64; 2], to: S) -> Result<S::Ok, S::Error> {
        pair.map(|value| value.is_finite().then_some(value)).serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 2], D::Error> {
        Ok(<[Option<f64>; 2]>::deserialize(from)?.map(|value| value.unwrap_or(f64::NAN)))
    }
}

mod maybe_matrix {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(rows: &[Vec<f64>], to: S) -> Result<S::Ok, S::Error> {
        let finite = |row: &Vec<f64>| row.iter().map(|v| v.is_finite().then_some(*v)).collect::<Vec<_>>();
        rows.iter().map(finite).collect::<Vec<_>>().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vec<f64>>, D::Error> {
        let rows = Vec::<Vec<Option<f64>>>::deserialize(from)?;
        Ok(rows.into_iter().map(|row| row.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect()).collect())
    }
}
