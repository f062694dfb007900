//! From logs and a request to the report: all estimations of a fit and what they say of each other.

use super::considered::{Cause, causes, pieces};
use super::findings::{Effect, Findings, Profiled};
use super::imposed::{Given, Knowledge};
use super::log_set::LogSet;
use super::outliers::replaced;
use super::profiled::{Said, profiles};
use super::session::Session;
use super::validate::Judge;
use super::{FitError, FitRequest, Known, Prediction, Problem, Target, Task};
use crate::log::{LONG, Log};
use crate::progress::Progress;
use crate::result::{FORMAT_VERSION, FitReport, LogEntry, Validation};
use rayon::prelude::*;
use std::collections::BTreeMap;
use wheelstate::Variable;

/// What the declarations of a machine's estimator say.
#[derive(Clone, Debug)]
pub struct Declared {
    /// What may be given as known.
    pub parameters: Vec<Variable>,
    /// The channels of its logs.
    pub inputs: Vec<Variable>,
}

/// Linearisations until what is given holds.
const PASSES: usize = 6;
/// A value that is given contradicts the logs if it is so many standard errors away.
const CONTRADICTS: f64 = 4.0;

/// One fit: what all of its estimations share.
pub struct Fit<'a> {
    /// How the parameters are identified.
    pub problem: &'a Problem,
    /// What was asked for.
    pub request: &'a FitRequest,
    /// What can be fitted.
    pub targets: &'a [Target],
    /// What is fitted.
    pub wanted: &'a [String],
    /// What is known of that beforehand.
    pub given: &'a [Given],
    /// The channels of the logs.
    pub inputs: &'a [Variable],
    /// Logs that only judge the result.
    pub held_out: &'a [Log],
    /// Samples from which a log is a long one.
    pub long: usize,
}

/// Reasons against estimates, by the parameter's name.
pub type Doubts = BTreeMap<String, Vec<String>>;

impl Fit<'_> {
    fn task<'a>(&'a self, logs: &'a [Log], known: &'a Known, coarse: bool, progress: &'a Progress) -> Task<'a> {
        Task {
            logs,
            known,
            wanted: self.wanted,
            only: !self.request.only.is_empty(),
            refine: self.request.refine,
            exact: self.request.exact,
            sensors: &self.request.sensors,
            inputs: self.inputs,
            coarse,
            long: self.long,
            brief: true,
            progress,
        }
    }

    /// Predictions of the logs' signals with these parameters.
    pub fn predict(&self, logs: &[Log], known: &Known) -> Vec<Prediction> {
        (self.problem.validate)(&self.task(logs, known, false, &Progress::none()))
    }

    /// The same, every value of them.
    pub fn predict_all(&self, logs: &[Log], known: &Known) -> Vec<Prediction> {
        (self.problem.validate)(&Task { brief: false, ..self.task(logs, known, false, &Progress::none()) })
    }

    /// Estimates from some logs, until all that is given holds.
    pub fn run(&self, logs: &[Log], known: &Known, progress: &Progress) -> Result<Findings, FitError> {
        self.estimate(logs, known, None, false, &[], progress)
    }

    /// The same with what another fit has decided.
    pub fn run_as(
        &self,
        logs: &[Log],
        known: &Known,
        decisions: &BTreeMap<String, bool>,
        progress: &Progress,
    ) -> Result<Findings, FitError> {
        self.estimate(logs, known, Some(decisions), false, &[], progress)
    }

    /// The same with the profiles that were asked for.
    fn run_profiled(&self, logs: &[Log], known: &Known, progress: &Progress) -> Result<Findings, FitError> {
        self.estimate(logs, known, None, false, &self.request.profile, progress)
    }

    /// The same with what another fit has decided; coarsely where only differences from that fit are looked for.
    fn estimate(
        &self,
        logs: &[Log],
        known: &Known,
        decisions: Option<&BTreeMap<String, bool>>,
        coarse: bool,
        profiled: &[String],
        progress: &Progress,
    ) -> Result<Findings, FitError> {
        let task = self.task(logs, known, coarse, progress);
        let new = || Session::new(self.request, self.targets).coarse(coarse).decided(decisions).profiling(profiled);
        let mut session = new();
        (self.problem.estimate)(&task, &mut session)?;
        let alone = session.alone(self.given);
        for _ in 0..PASSES {
            let (conditions, left) = session.conditions(self.given);
            if conditions.is_empty() || left < 1.0 {
                break;
            }
            session = new().under(conditions);
            (self.problem.estimate)(&task, &mut session)?;
        }
        if !coarse {
            self.warn_of_contradicted(&alone, &mut session);
        }
        session.complete(self.wanted);
        let mut findings = session.findings();
        for name in profiled {
            progress.check()?;
            let range = self.targets.iter().find(|target| target.name == *name).map(|target| target.range);
            let curve = session.profile(name, range.unwrap_or((f64::MIN, f64::MAX)))?;
            findings.profiles.extend(curve.map(|(curve, refitted)| Profiled { name: name.clone(), curve, refitted }));
        }
        Ok(findings)
    }

    /// Warns of given values that the logs alone contradict; `alone` has value and standard error of each parameter.
    fn warn_of_contradicted(&self, alone: &[(String, f64, f64)], session: &mut Session) {
        for (name, value, error) in alone {
            let Some(given) = self.given.iter().find(|given| given.name == *name) else { continue };
            let (known, std) = match given.what {
                Knowledge::Value(known) => (known, 0.0),
                Knowledge::Prior(known, std) => (known, std),
                Knowledge::Range(..) => continue,
            };
            let apart = (value - known).abs();
            if apart > CONTRADICTS * error.hypot(std) && apart > 0.05 * known.abs() {
                session.warn(format!(
                    "{name} = {known} was given, but the logs contradict it: alone they say {value:.4} +- {error:.2}"
                ));
            }
        }
    }

    /// What each cause of error does to the estimates of these logs.
    fn effects(&self, logs: &[Log], known: &Known, causes: &[Cause], of: &Findings) -> Vec<Effect> {
        let some = pieces(logs);
        let none = Progress::none();
        let run = |logs: &[Log], known: &Known| self.estimate(logs, known, Some(&of.decisions), true, &[], &none);
        let Ok(base) = run(&some, known) else { return Vec::new() };
        let effect = |cause: &Cause| {
            let (logs, changed) = cause.apply(&some, known);
            let moved = run(logs.as_deref().unwrap_or(&some), changed.as_ref().unwrap_or(known));
            let shift = of.found.iter().map(|found| {
                // What does not vary with the data, as a standard deviation that is fitted along, has no error of theirs.
                let moved = moved.as_ref().ok().filter(|_| found.spread > 0.0).and_then(|moved| moved.get(&found.name));
                match (base.get(&found.name), moved) {
                    (Some(base), Some(moved)) if moved.value.is_finite() => (moved.value - base.value) / cause.steps,
                    _ => 0.0,
                }
            });
            Effect { cause: cause.name.clone(), shift: shift.collect() }
        };
        causes.par_iter().map(effect).collect()
    }
}

/// Fits a vehicle's parameters to logs and judges the result.
///
/// The parameters come from the whole logs. For the validation the same fit is made on the first 60 %
/// of each log and its predictions are compared with the other 40 %, or those of the whole fit with logs that are
/// held out. A parameter that the logs do not determine, or that any of the checks contradicts, is part of the report
/// with its reason among the warnings; errors are for logs, settings and solver states that allow no report at all.
///
/// `vehicle` is the name that the report gets.
pub fn fit(
    problem: &Problem,
    vehicle: &str,
    declared: &Declared,
    logs: &[Log],
    request: &FitRequest,
    progress: &Progress,
) -> Result<FitReport, FitError> {
    fit_from(LONG, problem, vehicle, declared, logs, request, progress)
}

/// The same, where a log is long from so many samples on.
pub fn fit_from(
    long: usize,
    problem: &Problem,
    vehicle: &str,
    declared: &Declared,
    logs: &[Log],
    request: &FitRequest,
    progress: &Progress,
) -> Result<FitReport, FitError> {
    if logs.is_empty() {
        return Err(FitError::NoLog);
    }
    let (logs, outliers) = replaced(logs, problem.outliers);
    let (logs, (held_out, _)) = (logs.as_ref(), replaced(&request.held_out, problem.outliers));
    let known = request.known_values(declared)?;
    let mut targets = (problem.targets)(logs);
    let given = request.given(&mut targets)?;
    let wanted = request.wanted(&targets)?;
    let fit = Fit {
        problem,
        request,
        targets: &targets,
        wanted: &wanted,
        given: &given,
        inputs: &declared.inputs,
        held_out: &held_out,
        long,
    };

    progress.start_shares("fitting");
    let mut set = LogSet::new(&fit, logs, &known)?;
    let used = set.used();
    let joint = fit.run_profiled(&used, set.first_known(), &progress.part(0.0..0.35))?;
    let mut doubts = Doubts::new();
    let (mut findings, free) = set.settle(joint, &fit, &mut doubts)?;
    findings.warnings.extend(set.warnings.iter().cloned());
    findings.notes.extend(outliers);
    for name in request.only.iter().filter(|name| request.settings.iter().any(|(given, _)| given == *name)) {
        findings
            .notes
            .push(format!("{name} was given and asked for: it was fitted, and its value only started the fit"));
    }

    progress.describe("considering what the logs do not show");
    let mut causes = causes(&used, declared, &known, request, &wanted, &findings.offsets).map_err(FitError::Request)?;
    // The estimates have in them what a delay that was fitted along does not tell.
    let fitted = |cause: &Cause| findings.delays.iter().any(|d| cause.delays(&d.channel) || cause.delays(&d.against));
    causes.retain(|cause| !fitted(cause));
    let effects = fit.effects(&used, set.first_known(), &causes, &findings);
    progress.reach(0.6);
    progress.check()?;

    progress.describe("validating");
    let mut judge = Judge {
        fit: &fit,
        findings: &findings,
        effects: &effects,
        doubts,
        validation: Validation::default(),
        traces: Vec::new(),
    };
    judge.validate(&set, &used, !(free.is_empty() && request.of_log.is_empty()), progress)?;
    let Judge { mut doubts, validation, traces, .. } = judge;
    progress.reach(1.0);

    let said = profiles(request, &findings, &effects, &targets, &mut doubts);
    let mut report = findings.report(&effects, &doubts, &targets, &known, !request.only.is_empty());
    for name in &free {
        report.parameters.insert(name.clone(), set.per_log(name, &targets));
        report.notes.push(format!("{name} was fitted for each log by itself; the table has its mean and scatter"));
    }
    for law in &set.laws {
        if let Some(parameter) = report.parameters.get_mut(&law.parameter) {
            parameter.per_log = set.own(&law.parameter);
            report.notes.push(law.words(parameter));
        }
    }
    report.laws.clone_from(&set.laws);
    let Said { profiles, notes, warnings } = said;
    report.profiles = profiles;
    report.notes.extend(notes);
    report.warnings.extend(warnings);
    let known_values = request.known.iter().map(|(name, value, _)| (name.clone(), *value));
    Ok(FitReport {
        format_version: FORMAT_VERSION,
        vehicle: vehicle.to_owned(),
        loss: request.loss.word().to_owned(),
        logs: used.iter().map(LogEntry::from).collect(),
        settings: request.start.iter().chain(&request.settings).cloned().chain(known_values).collect(),
        fitted: if request.residuals { set.signals(&fit, &findings, &report.parameters) } else { Vec::new() },
        validation,
        traces,
        ..report
    })
}
