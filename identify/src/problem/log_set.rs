//! The logs of a fit: what each of them says alone, which are left out, and their joint answer.

use super::findings::Findings;
use super::fit::{Doubts, Fit};
use super::several::{combine, compare};
use super::varying::{Varying, together};
use super::{FitError, Known, Target};
use crate::log::Log;
use crate::progress::Progress;
use crate::result::{Law, OfLog, Parameter, Trace, Verdict};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

/// The logs' own answers are combined where that makes a standard error so much smaller than one noise level for all.
const SHARPER: f64 = 0.8;

/// The logs of a fit, and what each of them says alone.
pub struct LogSet<'a> {
    logs: &'a [Log],
    /// The known parameters of each log.
    pub known: Vec<Known>,
    /// The estimates of each log alone; none of a single log, and of those that are left out.
    alone: Vec<Option<Findings>>,
    /// The logs that are not left out.
    pub chosen: Vec<usize>,
    /// Which were left out, and why.
    pub warnings: Vec<String>,
    /// How parameters vary from log to log.
    pub laws: Vec<Law>,
}

impl<'a> LogSet<'a> {
    /// Estimates each of several logs alone, and leaves out what the request allows to.
    pub fn new(fit: &Fit, logs: &'a [Log], known: &Known) -> Result<Self, FitError> {
        let mut known = vec![known.clone(); logs.len()];
        for (log, name, value) in &fit.request.of_log {
            known[*log].set(name, *value)?;
        }
        let (alone, chosen) = (vec![None; logs.len()], (0..logs.len()).collect());
        let mut set = Self { logs, known, alone, chosen, warnings: Vec::new(), laws: Vec::new() };
        if logs.len() > 1 {
            set.estimate_alone(fit)?;
            if fit.request.skip_bad {
                set.leave_out(fit);
            }
        }
        if set.chosen.is_empty() {
            return Err(FitError::Request("no log is left to fit".to_owned()));
        }
        Ok(set)
    }

    fn estimate_alone(&mut self, fit: &Fit) -> Result<(), FitError> {
        let own = self.logs.par_iter().zip(&self.known);
        let answers: Vec<_> =
            own.map(|(log, known)| fit.run(std::slice::from_ref(log), known, &Progress::none())).collect();
        for (index, answer) in answers.into_iter().enumerate() {
            match answer {
                Ok(findings) => self.alone[index] = Some(findings),
                Err(error) if fit.request.skip_bad => {
                    self.warnings.push(format!("{} was left out: {error}", self.logs[index].source));
                    self.chosen.retain(|other| *other != index);
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Leaves out logs that contradict the others, the worst first, as long as at least two are left that agree better.
    fn leave_out(&mut self, fit: &Fit) {
        while self.chosen.len() > 2 {
            let shared = fit.targets.iter().filter(|target| fit.wanted.contains(&target.name) && !of_a_log(target));
            let shared = shared.filter(|target| !fit.request.per_log.contains(&target.name));
            let worst = shared.filter_map(|target| {
                let comparison = compare(&self.alone, &target.name)?;
                comparison.contradicts.then_some((comparison.odd, &target.name))
            });
            let Some(((index, apart), name)) = worst.max_by(|a, b| a.0.1.total_cmp(&b.0.1)) else { break };
            self.warnings.push(format!(
                "{} was left out: its {name} is {apart:.0} standard errors from that of the other logs",
                self.logs[index].source
            ));
            self.alone[index] = None;
            self.chosen.retain(|other| *other != index);
        }
    }

    /// The logs that are fitted.
    pub fn used(&self) -> Cow<'a, [Log]> {
        if self.chosen.len() == self.logs.len() {
            Cow::Borrowed(self.logs)
        } else {
            self.chosen.iter().map(|&index| self.logs[index].clone()).collect()
        }
    }

    /// What is known of the first log that is fitted.
    pub fn first_known(&self) -> &Known {
        &self.known[self.chosen[0]]
    }

    /// The joint answer of the logs, and which parameters each of them has its own of; what contradicts is a doubt.
    pub fn settle(
        &mut self,
        joint: Findings,
        fit: &Fit,
        doubts: &mut Doubts,
    ) -> Result<(Findings, BTreeSet<String>), FitError> {
        let mut free: BTreeSet<String> =
            fit.request.per_log.iter().filter(|name| fit.wanted.contains(name)).cloned().collect();
        if self.chosen.len() < 2 {
            return Ok((joint, BTreeSet::new()));
        }
        let varies = |name: &str| fit.request.varies.iter().any(|(other, _)| other == name);
        for target in fit.targets.iter().filter(|target| fit.wanted.contains(&target.name)) {
            let Some(comparison) = compare(&self.alone, &target.name).filter(|comparison| comparison.contradicts)
            else {
                continue;
            };
            if of_a_log(target) {
                free.insert(target.name.clone());
            } else if !free.contains(&target.name) && !varies(&target.name) {
                let (odd, apart) = comparison.odd;
                doubts.entry(target.name.clone()).or_default().push(format!(
                    "the logs contradict each other (chi2/dof {:.1}); {} is {apart:.0} standard errors from the others \
                     (--skip-bad leaves such a log out, --per-log {} gives each log its own value)",
                    comparison.reduced, self.logs[odd].source, target.name
                ));
            }
        }
        let answers: Vec<&Findings> = self.chosen.iter().filter_map(|&index| self.alone[index].as_ref()).collect();
        if !fit.request.varies.is_empty() {
            let varying = self.varying(fit)?;
            let Some(together) = together(&answers, &free, &varying) else {
                return Err(FitError::Request(
                    "--varies: every log by itself must tell what varies and what all share; give what a log does not tell \
                     (--set), or leave it out (--only)"
                        .to_owned(),
                ));
            };
            self.take(together.own);
            self.laws = together.laws;
            return Ok((together.findings, free));
        }
        let Some(combined) = combine(&answers, &free) else { return Ok((joint, BTreeSet::new())) };
        let must = !free.is_empty() || !fit.request.of_log.is_empty();
        let complete = joint.found.iter().all(|found| answers.iter().all(|log| log.get(&found.name).is_some()));
        let sharper = joint.found.iter().any(|found| {
            combined.get(&found.name).is_some_and(|other| other.spread < SHARPER * found.spread && found.spread > 0.0)
        });
        Ok(if must || (complete && sharper) { (combined, free) } else { (joint, BTreeSet::new()) })
    }

    /// What varies, with the means of the channels that it follows.
    fn varying(&self, fit: &Fit) -> Result<Vec<Varying>, FitError> {
        let mean = |log: &Log, channel: &str| {
            let values = log.series(channel).unwrap_or_default();
            let finite = values.iter().filter(|value| value.is_finite());
            let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
            if count > 0.0 {
                Ok(sum / count)
            } else {
                Err(FitError::Request(format!("--varies: {} has no samples of {channel}", log.source)))
            }
        };
        let of = |(name, channel): &(String, Option<String>)| {
            let means = |channel: &String| -> Result<_, FitError> {
                let means =
                    self.chosen.iter().map(|&index| mean(&self.logs[index], channel)).collect::<Result<_, _>>()?;
                Ok((channel.clone(), means))
            };
            Ok(Varying { name: name.clone(), follows: channel.as_ref().map(means).transpose()? })
        };
        fit.request.varies.iter().filter(|(name, _)| fit.wanted.contains(name)).map(of).collect()
    }

    /// Takes over what each log has of its own, given what all share.
    fn take(&mut self, own: Vec<Vec<(String, f64, f64)>>) {
        for (index, own) in self.chosen.iter().zip(own) {
            let Some(findings) = &mut self.alone[*index] else { continue };
            for (name, value, spread) in own {
                if let Some(found) = findings.found.iter_mut().find(|found| found.name == name) {
                    (found.value, found.spread, found.bias) = (value, spread, 0.0);
                    found.coloured.clear();
                }
            }
        }
    }

    /// A parameter that was fitted for each log by itself: mean and scatter, and the value of each log.
    pub fn per_log(&self, name: &str, targets: &[Target]) -> Parameter {
        let own = self.own(name);
        let count = own.len().max(1) as f64;
        let mean = own.values().map(|of| of.value).sum::<f64>() / count;
        let scatter = own.values().map(|of| (of.value - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        let std_error = own.values().map(|of| of.std_error.powi(2)).sum::<f64>() / count;
        let std_error = (scatter + std_error).sqrt();
        Parameter {
            value: mean,
            unit: targets.iter().find(|target| target.name == *name).map_or("1", |target| &target.unit).to_owned(),
            std_error,
            sampling_std: std_error,
            ci95: [mean - 1.96 * std_error, mean + 1.96 * std_error],
            verdict: Verdict::PerLog,
            per_log: own,
            ..Parameter::default()
        }
    }

    /// The values that each log has of a parameter.
    pub fn own(&self, name: &str) -> BTreeMap<String, OfLog> {
        let of = |(log, findings): (&Log, &Option<Findings>)| {
            let found = findings.as_ref()?.get(name)?;
            let std_error = found.own_error().hypot(found.judgement.systematic_std);
            Some((log.source.clone(), OfLog { value: found.value, std_error }))
        };
        self.logs.iter().zip(&self.alone).filter_map(of).collect()
    }

    /// All signals of the fitted logs with the values found for all of them and for each.
    pub fn signals(&self, fit: &Fit, found: &Findings, parameters: &BTreeMap<String, Parameter>) -> Vec<Trace> {
        let of = |&index: &usize| {
            let mut known = self.known[index].with(found.values()).with_delays(&found.delays);
            for (name, parameter) in parameters {
                if let Some(own) = parameter.per_log.get(&self.logs[index].source) {
                    known.assume(name, own.value);
                }
            }
            fit.predict_all(std::slice::from_ref(&self.logs[index]), &known)
        };
        self.chosen.iter().flat_map(of).map(|prediction| prediction.trace).collect()
    }
}

/// Whether a parameter belongs to a log by its nature: the posture of a person, the bias of a sensor.
fn of_a_log(target: &Target) -> bool {
    let last = target.name.rsplit('.').next().unwrap_or("");
    target.name.starts_with("rest.") || last.starts_with("rest_") || last.ends_with("_bias")
}
