//! From logs and a request to the report: all estimations of a fit and what they say of each other.

use super::considered::{Cause, causes, pieces};
use super::findings::{Effect, Findings};
use super::imposed::{Given, Knowledge};
use super::session::Session;
use super::several::{self, combine, compare};
use super::{FitError, FitRequest, Known, Prediction, Problem, TRAINING_SHARE, Target, Task};
use crate::assess::validation::signal_fit;
use crate::log::Log;
use crate::progress::Progress;
use crate::result::{FORMAT_VERSION, FitReport, LogEntry, Parameter, SignalFit, Validation, Verdict as Shade};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
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
/// A first part of the logs that differs by so many standard errors from the whole contradicts it.
const UNSTEADY: f64 = 4.5;
/// A value that is given contradicts the logs if it is so many standard errors away.
const CONTRADICTS: f64 = 4.0;
/// A prediction of what was fitted that is so much worse than a constant, in percent, is none.
const NO_MODEL: f64 = -20.0;
/// Errors of the held-out part over those of the fitted part beyond which the fit does not predict.
const UNPREDICTED: f64 = 2.5;
/// Fewest values that a prediction is judged by.
const JUDGED: usize = 6;
/// The logs' own answers are combined where that makes a standard error so much smaller than one noise level for all.
const SHARPER: f64 = 0.8;

/// One fit: what all of its estimations share.
struct Fit<'a> {
    problem: &'a Problem,
    request: &'a FitRequest,
    targets: &'a [Target],
    wanted: &'a [String],
    given: &'a [Given],
}

/// Reasons against estimates, by the parameter's name.
type Doubts = BTreeMap<String, Vec<String>>;

impl Fit<'_> {
    /// Estimates from some logs, until all that is given holds.
    fn run(&self, logs: &[Log], known: &Known, coarse: bool, progress: &Progress) -> Result<Findings, FitError> {
        let task = Task {
            logs,
            known,
            wanted: self.wanted,
            only: !self.request.only.is_empty(),
            refine: self.request.refine,
            exact: self.request.exact,
            coarse,
            progress,
        };
        let new = || Session::new(self.request, self.targets).coarse(coarse);
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
        for (name, value, error) in alone.iter().filter(|_| !coarse) {
            let Some(given) = self.given.iter().find(|given| given.name == *name) else { continue };
            let (told, std) = match given.what {
                Knowledge::Value(told) => (told, 0.0),
                Knowledge::Prior(told, std) => (told, std),
                Knowledge::Range(..) => continue,
            };
            let apart = (value - told).abs();
            if apart > CONTRADICTS * error.hypot(std) && apart > 0.05 * told.abs() {
                session.warn(format!(
                    "{name} = {told} was given, but the logs contradict it: alone they say {value:.4} +- {error:.2}"
                ));
            }
        }
        session.complete(self.wanted);
        Ok(session.findings())
    }

    /// What each cause of error does to the estimates of these logs.
    fn effects(&self, logs: &[Log], known: &Known, causes: &[Cause], of: &Findings) -> Vec<Effect> {
        let some = pieces(logs);
        let none = Progress::none();
        let Ok(base) = self.run(&some, known, true, &none) else { return Vec::new() };
        let effect = |cause: &Cause| {
            let (logs, changed) = cause.apply(&some, known);
            let moved = self.run(logs.as_deref().unwrap_or(&some), changed.as_ref().unwrap_or(known), true, &none);
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
    if logs.is_empty() {
        return Err(FitError::NoLog);
    }
    let mut known = Known::new(declared.parameters.clone());
    for (name, value) in request.start.iter().chain(&request.settings) {
        known.set(name, *value)?;
    }
    for (name, value, std) in &request.known {
        known.set(name, *value)?;
        if !(std.is_finite() && *std >= 0.0) {
            return Err(FitError::Request(format!("{name} = {value} +- {std}: a standard deviation is not negative")));
        }
    }
    let mut targets = (problem.targets)(logs);
    let given = given(&mut targets, request)?;
    let wanted = wanted(&targets, request)?;
    let fit = Fit { problem, request, targets: &targets, wanted: &wanted, given: &given };
    progress.start_shares("fitting");
    let mut known_of = vec![known.clone(); logs.len()];
    for (log, name, value) in &request.of_log {
        known_of[*log].set(name, *value)?;
    }

    let mut chosen: Vec<usize> = (0..logs.len()).collect();
    let mut warnings = Vec::new();
    let mut alone: Vec<Option<Findings>> = vec![None; logs.len()];
    if logs.len() > 1 {
        let own = logs.par_iter().zip(&known_of);
        let answers: Vec<_> =
            own.map(|(log, known)| fit.run(std::slice::from_ref(log), known, false, &Progress::none())).collect();
        for (index, answer) in answers.into_iter().enumerate() {
            match answer {
                Ok(findings) => alone[index] = Some(findings),
                Err(error) if request.skip_bad => {
                    warnings.push(format!("{} was left out: {error}", logs[index].source));
                    chosen.retain(|other| *other != index);
                }
                Err(error) => return Err(error),
            }
        }
        if request.skip_bad {
            leave_out(&mut alone, &mut chosen, logs, &fit, &mut warnings);
        }
    }
    if chosen.is_empty() {
        return Err(FitError::Request("no log is left to fit".to_owned()));
    }
    let used: Vec<Log>;
    let used: &[Log] = if chosen.len() == logs.len() {
        logs
    } else {
        used = chosen.iter().map(|&index| logs[index].clone()).collect();
        &used
    };

    let joint = fit.run(used, &known_of[chosen[0]], false, &progress.part(0.0..0.35))?;
    let mut doubts = Doubts::new();
    let (mut findings, free) = settle(joint, &alone, &chosen, logs, &fit, &mut doubts);
    findings.warnings.extend(warnings);
    for name in request.only.iter().filter(|name| request.settings.iter().any(|(given, _)| given == *name)) {
        findings
            .notes
            .push(format!("{name} was given and asked for: it was fitted, and its value only started the fit"));
    }

    progress.describe("considering what the logs do not show");
    let causes =
        causes(used, &declared.inputs, &declared.parameters, &known, request, &wanted).map_err(FitError::Request)?;
    let effects = fit.effects(used, &known_of[chosen[0]], &causes, &findings);
    progress.reach(0.6);
    progress.check()?;

    progress.describe("validating");
    let values: Vec<(String, f64)> = findings.values().map(|(name, value)| (name.to_owned(), value)).collect();
    let with_values = |known: &Known| {
        let mut known = known.clone();
        values.iter().for_each(|(name, value)| known.assume(name, *value));
        known
    };
    let mut validation = Validation::default();
    let mut traces = Vec::new();
    let first = &known_of[chosen[0]];
    if request.held_out.is_empty() {
        let (training, held_out): (Vec<Log>, Vec<Log>) = used.iter().map(split).unzip();
        let parts: Vec<(Vec<Log>, Vec<Log>, &Known)> = if free.is_empty() && request.of_log.is_empty() {
            vec![(training, held_out, first)]
        } else {
            let one = |((index, training), held_out): ((&usize, Log), Log)| {
                (vec![training], vec![held_out], &known_of[*index])
            };
            chosen.iter().zip(training).zip(held_out).map(one).collect()
        };
        let single = parts.len() == 1;
        for (training, held_out, known) in &parts {
            // The first part alone may not suffice: then there is nothing to validate with.
            let Ok(early) = fit.run(training, known, false, &Progress::none()) else { continue };
            progress.check()?;
            if single {
                compare_parts(&early, &findings, &effects, &mut doubts);
            }
            let mut known = (*known).clone();
            early.values().for_each(|(name, value)| known.assume(name, value));
            judge(&fit, held_out, training, &known, &findings, &effects, &mut validation, &mut traces, &mut doubts);
        }
        validation.held_out = 1.0 - TRAINING_SHARE;
    } else {
        let known = with_values(first);
        judge(&fit, &request.held_out, used, &known, &findings, &effects, &mut validation, &mut traces, &mut doubts);
        validation.held_out = 1.0;
    }
    progress.reach(1.0);

    let mut report = findings.report(&effects, &doubts, &targets, &known, !request.only.is_empty());
    let files: Vec<String> = logs.iter().map(|log| log.source.clone()).collect();
    for name in &free {
        let own = several::own(&alone, &files, name);
        let count = own.len().max(1) as f64;
        let mean = own.values().map(|of| of.value).sum::<f64>() / count;
        let scatter = own.values().map(|of| (of.value - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        let std_error = own.values().map(|of| of.std_error.powi(2)).sum::<f64>() / count;
        let std_error = (scatter + std_error).sqrt();
        let unit = targets.iter().find(|target| target.name == *name).map_or("1", |target| &target.unit).to_owned();
        let parameter = Parameter {
            value: mean,
            unit,
            std_error,
            sampling_std: std_error,
            ci95: [mean - 1.96 * std_error, mean + 1.96 * std_error],
            verdict: Shade::PerLog,
            per_log: own,
            ..Parameter::default()
        };
        report.parameters.insert(name.clone(), parameter);
        report.notes.push(format!("{name} was fitted for each log by itself; the table has its mean and scatter"));
    }
    let known_values = request.known.iter().map(|(name, value, _)| (name.clone(), *value));
    Ok(FitReport {
        format_version: FORMAT_VERSION,
        vehicle: vehicle.to_owned(),
        loss: request.loss.word().to_owned(),
        logs: used.iter().map(LogEntry::from).collect(),
        settings: request.start.iter().chain(&request.settings).cloned().chain(known_values).collect(),
        fitted: fitted(&fit, used, &chosen, &known_of, &values, &report),
        validation,
        traces,
        ..report
    })
}

/// What is given of parameters that can be fitted; bounds narrow their ranges.
fn given(targets: &mut [Target], request: &FitRequest) -> Result<Vec<Given>, FitError> {
    let mut all = Vec::new();
    let unknown = |asked: &str, option: &str, targets: &[Target]| {
        let known = targets.iter().map(|target| target.name.as_str()).collect::<Vec<_>>().join(", ");
        FitError::Request(format!("{option} {asked}: cannot be fitted; there are {known}"))
    };
    for (name, low, high) in &request.bounds {
        let Some(target) = targets.iter_mut().find(|target| target.name == *name) else {
            return Err(unknown(name, "--bound", targets));
        };
        let (low, high) = (low.max(target.range.0), high.min(target.range.1));
        if low.is_nan() || high.is_nan() || low >= high {
            let (from, to) = target.range;
            return Err(FitError::Request(format!("--bound {name}: {low}..{high} is no range within {from}..{to}")));
        }
        target.range = (low, high);
        all.push(Given { name: name.clone(), what: Knowledge::Range(low, high) });
    }
    if let Some(name) = request.per_log.iter().find(|name| targets.iter().all(|target| target.name != **name)) {
        return Err(unknown(name, "--per-log", targets));
    }
    let fittable = |name: &str| targets.iter().any(|target| target.name == *name && !target.contested);
    // Who asks by name to fit what was given gives a value to start from.
    let held = request.settings.iter().filter(|(name, _)| fittable(name) && !request.only.contains(name));
    for (name, value) in held {
        all.push(Given { name: name.clone(), what: Knowledge::Value(*value) });
    }
    for (name, value, std) in request.known.iter().filter(|(name, ..)| fittable(name)) {
        let what = if *std > 0.0 { Knowledge::Prior(*value, *std) } else { Knowledge::Value(*value) };
        all.push(Given { name: name.clone(), what });
    }
    Ok(all)
}

/// The parameters to fit: those that were asked for, or the usual ones that were not given.
fn wanted(targets: &[Target], request: &FitRequest) -> Result<Vec<String>, FitError> {
    let is_given = |name: &str| request.settings.iter().any(|(given, _)| given == name);
    if request.only.is_empty() {
        let usual = targets.iter().filter(|target| target.usual && (target.contested || !is_given(&target.name)));
        let names: Vec<String> = usual.map(|target| target.name.clone()).collect();
        return if names.is_empty() {
            Err(FitError::Request("--set gives every parameter that would be fitted".to_owned()))
        } else {
            Ok(names)
        };
    }
    if let Some(asked) = request.only.iter().find(|asked| targets.iter().all(|target| target.name != **asked)) {
        let known = targets.iter().map(|target| target.name.as_str()).collect::<Vec<_>>().join(", ");
        return Err(FitError::UnknownTarget { asked: asked.clone(), known });
    }
    Ok(request.only.clone())
}

/// Whether a parameter belongs to a log by its nature: the posture of a person, the bias of a sensor.
fn of_a_log(target: &Target) -> bool {
    let last = target.name.rsplit('.').next().unwrap_or("");
    target.name.starts_with("rest.") || last.starts_with("rest_") || last.ends_with("_bias")
}

/// Leaves out logs that contradict the others, the worst first, as long as at least two are left that agree better.
fn leave_out(
    alone: &mut [Option<Findings>],
    chosen: &mut Vec<usize>,
    logs: &[Log],
    fit: &Fit,
    warnings: &mut Vec<String>,
) {
    while chosen.len() > 2 {
        let shared = fit.targets.iter().filter(|target| fit.wanted.contains(&target.name) && !of_a_log(target));
        let shared = shared.filter(|target| !fit.request.per_log.contains(&target.name));
        let worst = shared.filter_map(|target| {
            let comparison = compare(alone, &target.name)?;
            comparison.contradicts.then_some((comparison.odd, &target.name))
        });
        let Some(((index, apart), name)) = worst.max_by(|a, b| a.0.1.total_cmp(&b.0.1)) else { break };
        warnings.push(format!(
            "{} was left out: its {name} is {apart:.0} standard errors from that of the other logs",
            logs[index].source
        ));
        alone[index] = None;
        chosen.retain(|other| *other != index);
    }
}

/// The joint answer of the logs, and which parameters each of them has its own of; what contradicts is a doubt.
fn settle(
    joint: Findings,
    alone: &[Option<Findings>],
    chosen: &[usize],
    logs: &[Log],
    fit: &Fit,
    doubts: &mut Doubts,
) -> (Findings, BTreeSet<String>) {
    let mut free: BTreeSet<String> =
        fit.request.per_log.iter().filter(|name| fit.wanted.contains(name)).cloned().collect();
    if chosen.len() < 2 {
        return (joint, BTreeSet::new());
    }
    for target in fit.targets.iter().filter(|target| fit.wanted.contains(&target.name)) {
        let Some(comparison) = compare(alone, &target.name).filter(|comparison| comparison.contradicts) else {
            continue;
        };
        if of_a_log(target) {
            free.insert(target.name.clone());
        } else if !free.contains(&target.name) {
            let (odd, apart) = comparison.odd;
            doubts.entry(target.name.clone()).or_default().push(format!(
                "the logs contradict each other (chi2/dof {:.1}); {} is {apart:.0} standard errors from the others \
                 (--skip-bad leaves such a log out, --per-log {} gives each log its own value)",
                comparison.reduced, logs[odd].source, target.name
            ));
        }
    }
    let answers: Vec<&Findings> = chosen.iter().filter_map(|&index| alone[index].as_ref()).collect();
    let Some(combined) = combine(&answers, &free) else { return (joint, BTreeSet::new()) };
    let must = !free.is_empty() || !fit.request.of_log.is_empty();
    let complete = joint.found.iter().all(|found| answers.iter().all(|log| log.get(&found.name).is_some()));
    let sharper = joint.found.iter().any(|found| {
        combined.get(&found.name).is_some_and(|other| other.spread < SHARPER * found.spread && found.spread > 0.0)
    });
    if must || (complete && sharper) { (combined, free) } else { (joint, BTreeSet::new()) }
}

/// The part of a log that the validation's fit sees and the rest, both without the references
/// (`true_*`) that no fit looks at: they may be most of a simulated log.
fn split(log: &Log) -> (Log, Log) {
    let at = (log.len() as f64 * TRAINING_SHARE).round() as usize;
    let part = |samples: std::ops::Range<usize>| log.slice(samples, |name| !name.starts_with("true_"));
    (part(0..at), part(at..log.len()))
}

/// Doubts about estimates of which the first part of the logs says something else than the whole.
fn compare_parts(early: &Findings, whole: &Findings, effects: &[Effect], doubts: &mut Doubts) {
    for (found, error) in whole.found.iter().zip(whole.errors(effects)) {
        let Some(before) = early.get(&found.name).filter(|before| before.spread > 0.0) else { continue };
        // The whole contains the part: the variance of their difference is the difference of their variances.
        let apart =
            (before.own_error().powi(2) - found.own_error().powi(2)).max(0.4 * before.own_error().powi(2)).sqrt();
        let difference = (before.value - found.value).abs();
        let limits = found.judgement.limits;
        let matters = 0.1 * limits.absolute_error.unwrap_or(limits.relative_error * found.value.abs());
        if difference > UNSTEADY * apart && difference > error.max(matters) {
            doubts.entry(found.name.clone()).or_default().push(format!(
                "the first {:.0} % of the logs say {:.4} +- {:.2}, the whole {:.4}",
                100.0 * TRAINING_SHARE,
                before.value,
                before.own_error(),
                found.value
            ));
        }
    }
}

/// Predicts logs that were not fitted, and those that were; a signal that is not predicted is a doubt about every
/// parameter that its prediction depends on.
#[allow(clippy::too_many_arguments, reason = "what was fitted, what is predicted, and where the judgement goes")]
fn judge(
    fit: &Fit,
    held_out: &[Log],
    training: &[Log],
    known: &Known,
    findings: &Findings,
    effects: &[Effect],
    validation: &mut Validation,
    traces: &mut Vec<crate::result::Trace>,
    doubts: &mut Doubts,
) {
    let none = Progress::none();
    let predict = |logs: &[Log], known: &Known| -> Vec<Prediction> {
        (fit.problem.validate)(&Task {
            logs,
            known,
            wanted: fit.wanted,
            only: !fit.request.only.is_empty(),
            refine: fit.request.refine,
            exact: fit.request.exact,
            coarse: false,
            progress: &none,
        })
    };
    let (ahead, behind) = (predict(held_out, known), predict(training, known));
    let trained: Vec<SignalFit> = behind.iter().map(signal_fit).collect();
    let mut failed = Vec::new();
    for (index, prediction) in ahead.iter().enumerate() {
        let mut signal = signal_fit(prediction);
        let same = trained.iter().find(|other| other.name == signal.name && other.log == signal.log);
        let same = same.or_else(|| trained.iter().find(|other| other.name == signal.name));
        if let Some(same) = same {
            signal.fit_percent_training = same.fit_percent;
            signal.rmse_training = same.rmse;
            let enough = signal.samples >= JUDGED && same.samples >= JUDGED;
            if enough && same.fit_percent < NO_MODEL {
                failed.push((
                    index,
                    format!(
                        "{} is predicted worse than by a constant ({:.0} %) even where it was fitted",
                        signal.name, same.fit_percent
                    ),
                ));
            } else if enough && signal.fit_percent < 0.0 && signal.rmse > UNPREDICTED * same.rmse {
                failed.push((index, format!(
                    "{} is not predicted where it was not fitted ({:.0} %, error {:.1} times that of the fitted part)",
                    signal.name,
                    signal.fit_percent,
                    signal.rmse / same.rmse
                )));
            }
        }
        validation.signals.push(signal);
    }
    if !failed.is_empty() {
        let errors = findings.errors(effects);
        for (found, error) in findings.found.iter().zip(errors) {
            let mut moved = known.clone();
            moved.assume(&found.name, found.value + error.max(0.02 * found.value.abs()).max(1e-9));
            let other = predict(held_out, &moved);
            for (index, reason) in &failed {
                let (now, then) = (&ahead[*index].trace.predicted, other.get(*index).map(|p| &p.trace.predicted));
                if then.is_some_and(|then| now.iter().zip(then).any(|(a, b)| (a - b).abs() > 1e-9 * a.abs())) {
                    let all = doubts.entry(found.name.clone()).or_default();
                    if !all.contains(reason) {
                        all.push(reason.clone());
                    }
                }
            }
        }
    }
    traces.extend(ahead.into_iter().map(|prediction| prediction.trace));
}

/// All signals of the fitted logs with the result.
fn fitted(
    fit: &Fit,
    used: &[Log],
    chosen: &[usize],
    known_of: &[Known],
    values: &[(String, f64)],
    report: &FitReport,
) -> Vec<crate::result::Trace> {
    if !fit.request.residuals {
        return Vec::new();
    }
    let none = Progress::none();
    let mut all = Vec::new();
    for (log, index) in used.iter().zip(chosen) {
        let mut known = known_of[*index].clone();
        values.iter().for_each(|(name, value)| known.assume(name, *value));
        for (name, parameter) in &report.parameters {
            if let Some(own) = parameter.per_log.get(&log.source) {
                known.assume(name, own.value);
            }
        }
        let task = Task {
            logs: std::slice::from_ref(log),
            known: &known,
            wanted: fit.wanted,
            only: !fit.request.only.is_empty(),
            refine: fit.request.refine,
            exact: fit.request.exact,
            coarse: false,
            progress: &none,
        };
        all.extend((fit.problem.validate)(&task).into_iter().map(|prediction| prediction.trace));
    }
    all
}
