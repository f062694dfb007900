//! One comparison: what all candidates share, and their simulated logs and fits.

use super::promise::{Promise, probability, promise, told};
use super::search::{Point, search};
use super::suppose::Supposed;
use super::{Candidate, DesignError, DesignRequest, HELPS, Interest, Plan, Repeat};
use crate::check::short;
use crate::log::Log;
use crate::log::columns::nearest;
use crate::problem::{FitRequest, Target};
use crate::progress::{Interrupted, Progress};
use crate::result::{FitReport, Parameter};
use crate::simulate::{Request, SimulateError, Values};
use crate::vehicle::Vehicle;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Settings that can be searched together.
const MOST_LIMITS: usize = 3;
/// The present logs are noisier than the simulated ones if they are predicted so many times worse.
const NOISIER: f64 = 1.5;
/// Natural logarithm of what an unknown parameter's relative standard error counts as, so that no known one outweighs it.
const UNKNOWN: f64 = 1e3;

/// An estimate that is so many standard errors from the drawn machine is none: of a drive that does not excite it.
const MISSES: f64 = 10.0;

/// Every so many of the drawn machines is the fitted one, as far as that is known.
const FITTED: u64 = 3;

/// What is asked for, checked as far as that needs no fit.
pub struct Asked {
    /// The fit of the present logs, and of each candidate.
    pub fit: FitRequest,
    /// What can be fitted.
    targets: Vec<Target>,
    /// Values that are known of the machine, whether they are fitted or not.
    known: Values,
}

impl Asked {
    pub fn new(vehicle: &Vehicle, request: &DesignRequest) -> Result<Self, DesignError> {
        check_subject(vehicle, request)?;
        check_limits(vehicle, request)?;
        let targets = (vehicle.problem.targets)(&[]);
        let fittable: Vec<&str> =
            targets.iter().map(|target| target.name.as_str()).filter(|name| !name.ends_with("_std")).collect();
        if let Some(name) = request.parameters.iter().find(|name| !fittable.contains(&name.as_str())) {
            return Err(DesignError::Request(match nearest(name, &fittable) {
                Some(near) => format!("--for {name}: cannot be fitted; did you mean {near}?"),
                None => format!("--for {name}: cannot be fitted; there are {}", fittable.join(", ")),
            }));
        }
        let unforeseen = vehicle.simulation.manoeuvres.unforeseen;
        if let Some(name) = request.parameters.iter().find(|name| unforeseen.contains(&name.as_str())) {
            return Err(DesignError::Request(format!(
                "--for {name}: simulated drives do not foresee its standard error well enough to promise one"
            )));
        }
        let of_fit = request.fit.iter().flat_map(|fit| fit.settings.iter().map(|(n, v)| (n.clone(), *v)));
        let given = request.settings.iter().filter(|(name, _)| !of_simulation(name)).cloned();
        let known: Values = of_fit.chain(request.start.iter().cloned()).chain(given).collect();

        let in_fit = |name: &str| request.fit.as_ref().is_some_and(|fit| fit.parameters.contains_key(name));
        let wanted = |name: &str| request.parameters.iter().any(|other| other == name);
        let set = |name: &str| request.settings.iter().any(|(other, _)| other == name);
        // What a fit held stays held, and so does what is set, unless it is of interest.
        let held = |name: &str| {
            let of_fit = request.fit.as_ref().is_some_and(|fit| fit.settings.contains_key(name) && !in_fit(name));
            fittable.contains(&name) && !wanted(name) && (of_fit || set(name))
        };
        let (settings, start): (Values, Values) = known.iter().cloned().partition(|(name, _)| held(name));
        let extra = fittable.iter().filter(|name| {
            let usual = targets.iter().any(|target| target.name == **name && target.usual);
            !usual && (wanted(name) || in_fit(name))
        });
        let extra: Vec<&str> = extra.copied().collect();
        let mut only = Vec::new();
        if !extra.is_empty() {
            let usual = targets.iter().filter(|target| target.usual && !held(&target.name)).map(|t| t.name.as_str());
            only = usual.chain(extra).map(str::to_owned).collect();
        }
        let fit = FitRequest {
            start,
            settings,
            known: request.known.clone(),
            only,
            sensors: request.sensors.clone(),
            exact: request.exact,
            ..FitRequest::default()
        };
        Ok(Self { fit, targets, known })
    }

    /// The value that is taken as known of a parameter.
    fn value(&self, vehicle: &Vehicle, name: &str) -> Option<f64> {
        let priors = self.fit.known.iter().map(|(name, value, _)| (name, value));
        let given = priors.chain(self.known.iter().rev().map(|(name, value)| (name, value)));
        let given = given.filter(|(other, _)| *other == name).map(|(_, value)| *value).next();
        given.or_else(|| vehicle.parameters().iter().find(|v| v.name == name).map(|v| v.start))
    }
}

/// Whether a setting is one of the simulation and not of the machine.
fn of_simulation(name: &str) -> bool {
    name.starts_with("plant.") || name.starts_with("noise.")
}

/// Whether the machine can be driven on purpose, and the fit is of it.
fn check_subject(vehicle: &Vehicle, request: &DesignRequest) -> Result<(), DesignError> {
    let refuse = |text: String| Err(DesignError::Request(text));
    if vehicle.simulation.manoeuvres.scenarios.is_empty() {
        return refuse(format!(
            "{vehicle}: its built-in plants have no manoeuvre with commands that could be driven on purpose"
        ));
    }
    if let Some(fit) = &request.fit {
        if fit.vehicle != vehicle.name {
            return refuse(format!("the fit is of {}, not of {vehicle}", fit.vehicle));
        }
        if let Some(why) = &fit.refused {
            return refuse(format!("the fit was refused and tells nothing: {why}"));
        }
    }
    Ok(())
}

fn check_limits(vehicle: &Vehicle, request: &DesignRequest) -> Result<(), DesignError> {
    let manoeuvres = &vehicle.simulation.manoeuvres;
    let names: Vec<&str> = manoeuvres.knobs.iter().map(|knob| knob.name).collect();
    let declared = (manoeuvres.settings)();
    if request.limits.len() > MOST_LIMITS {
        let count = request.limits.len();
        return Err(DesignError::Request(format!("{count} limits: at most {MOST_LIMITS} settings are searched")));
    }
    for (name, low, high) in &request.limits {
        let refuse = |what: String| Err(DesignError::Request(format!("--limit {name}: {what}")));
        if !names.contains(&name.as_str()) {
            return refuse(match nearest(name, &names) {
                Some(near) => format!("is no setting of a manoeuvre; did you mean {near}?"),
                None => format!("is no setting of a manoeuvre; there are {}", names.join(", ")),
            });
        }
        if !(low.is_finite() && high.is_finite() && low < high) {
            return refuse(format!("{low}..{high} is no range"));
        }
        let variable = declared.iter().find(|variable| variable.name == *name);
        if let Some(Err(error)) = variable.map(|v| v.check(*low).and_then(|()| v.check(*high))) {
            return refuse(error.to_string());
        }
    }
    Ok(())
}

/// What all candidates share.
pub struct Study<'a> {
    vehicle: &'a Vehicle,
    request: &'a DesignRequest,
    asked: Asked,
    /// The present logs without their truth.
    logs: Vec<Log>,
    /// What is known of the machine now.
    now: Option<FitReport>,
    supposed: Supposed,
    interest: Vec<Interest>,
    /// Size of each parameter of interest, which makes standard errors with different units comparable.
    size: Vec<f64>,
}

impl<'a> Study<'a> {
    pub fn new(
        vehicle: &'a Vehicle,
        request: &'a DesignRequest,
        asked: Asked,
        logs: Vec<Log>,
        present: Option<FitReport>,
    ) -> Result<Self, DesignError> {
        let now = present.or_else(|| request.fit.clone());
        let held = |name: &str| asked.fit.settings.iter().any(|(other, _)| other == name);
        let fitted = |target: &&Target| {
            let chosen = if asked.fit.only.is_empty() { target.usual } else { asked.fit.only.contains(&target.name) };
            chosen && !held(&target.name) && !target.name.ends_with("_std")
        };
        let targets: Vec<&Target> = asked.targets.iter().filter(fitted).collect();
        let unforeseen = vehicle.simulation.manoeuvres.unforeseen;
        let foreseen: Vec<&Target> =
            targets.iter().copied().filter(|target| !unforeseen.contains(&target.name.as_str())).collect();
        let names =
            if request.parameters.is_empty() { wanting(now.as_ref(), &foreseen) } else { request.parameters.clone() };
        let of = |name: &str| now.as_ref().and_then(|fit| fit.parameters.get(name));
        if let Some(name) = names.iter().find(|name| of(name).is_some_and(|p| !p.per_log.is_empty())) {
            let text = format!("{name}: each log has a value of its own, to which another log adds nothing");
            return Err(DesignError::Request(text));
        }
        let known = |name: &str| asked.value(vehicle, name);
        let supposed = Supposed::of(now.as_ref(), &targets, &names, &known, vehicle.simulation.manoeuvres.supposed);
        let interest = names.iter().map(|name| {
            let told = of(name).filter(|parameter| told(parameter));
            let unknown = supposed.unknown.iter().find(|(other, ..)| other == name);
            let unit = asked.targets.iter().find(|target| target.name == *name).map_or("1", |target| &target.unit);
            Interest {
                name: name.clone(),
                unit: unit.to_owned(),
                value: told.map(|parameter| parameter.value),
                std_error: told.map(|parameter| parameter.std_error),
                identified: told.is_some_and(|parameter| parameter.identified),
                supposed: unknown.map(|(_, low, high)| (*low, *high)),
            }
        });
        let interest: Vec<Interest> = interest.collect();
        let size = names.iter().map(|name| {
            let middle = supposed.middle().into_iter().find(|(other, _)| other == name).map(|(_, value)| value.abs());
            middle.filter(|value| value.is_finite() && *value > 0.0).unwrap_or(1.0)
        });
        let size = size.collect();
        let logs = logs.iter().map(|log| log.slice(0..log.len(), |name| !name.starts_with("true_"))).collect();
        Ok(Self { vehicle, request, asked, logs, now, supposed, interest, size })
    }

    /// The scenarios that come into question.
    pub fn scenarios(&self) -> Result<Vec<&'static str>, DesignError> {
        let all = self.vehicle.simulation.manoeuvres.scenarios;
        if let Some(name) = self.request.scenarios.iter().find(|name| !all.contains(&name.as_str())) {
            return Err(DesignError::Request(match nearest(name, all) {
                Some(near) => format!("--scenario {name}: is no manoeuvre to choose; did you mean {near}?"),
                None => format!("--scenario {name}: is no manoeuvre to choose; there are {}", all.join(", ")),
            }));
        }
        let asked = |name: &&str| self.request.scenarios.is_empty() || self.request.scenarios.iter().any(|s| s == name);
        let chosen: Vec<_> = all.iter().copied().filter(asked).collect();
        // A setting that the plant refuses is no fault of a candidate.
        if let Some(first) = chosen.first() {
            let middle: Vec<_> = self.limits_of(first).iter().map(|(_, low, high)| 0.5 * (low + high)).collect();
            let settings = self.settings_of(first, &middle);
            self.simulate(first, &settings, &self.supposed.middle(), self.request.seed, &[])?;
        }
        Ok(chosen)
    }

    /// The limits that mean something in a scenario.
    fn limits_of(&self, scenario: &str) -> Vec<(String, f64, f64)> {
        let knobs = self.vehicle.simulation.manoeuvres.knobs;
        let acts = |name: &str| knobs.iter().any(|knob| knob.name == name && knob.acts_in(scenario));
        self.request.limits.iter().filter(|(name, ..)| acts(name)).cloned().collect()
    }

    /// Values in the order of a scenario's limits, by their names.
    pub fn settings_of(&self, scenario: &str, values: &[f64]) -> Values {
        self.limits_of(scenario).iter().zip(values).map(|((name, ..), value)| (name.clone(), *value)).collect()
    }

    /// A log of a machine with these parameters, with the channels and the sample period of the present logs.
    fn simulate(
        &self,
        scenario: &str,
        settings: &[(String, f64)],
        machine: &[(String, f64)],
        seed: u64,
        more: &[(String, f64)],
    ) -> Result<Log, SimulateError> {
        let held: Values =
            self.asked.known.iter().filter(|(n, _)| !machine.iter().any(|(m, _)| m == n)).cloned().collect();
        let values: Values = held.iter().chain(machine).cloned().collect();
        let mut all = self.period();
        all.extend((self.vehicle.simulation.manoeuvres.plant)(&values));
        all.extend(self.request.settings.iter().filter(|(name, _)| of_simulation(name)).cloned());
        all.extend(settings.iter().chain(more).cloned());
        self.vehicle.simulate(&Request { scenario: scenario.to_owned(), seed, settings: all })
    }

    /// The sample period of the present logs, if the plant can have it.
    fn period(&self) -> Values {
        let Some(log) = self.logs.first() else { return Vec::new() };
        // A clock of a hundred samples per second writes 0.01 and 0.0100000001.
        let period = (log.period() * 1e6).round() * 1e-6;
        let declared = self.vehicle.parameters();
        let variable = declared.iter().find(|variable| variable.name == "sample_period");
        let allowed = variable.is_some_and(|variable| variable.check(period).is_ok());
        if allowed { vec![("sample_period".to_owned(), period)] } else { Vec::new() }
    }

    /// The fit of the present logs with some of a manoeuvre; nothing if the plant or the fit refuses it.
    fn fitted(
        &self,
        scenario: &str,
        settings: &[(String, f64)],
        machine: &[(String, f64)],
        seeds: &[u64],
    ) -> Option<(FitReport, f64)> {
        let there: BTreeSet<&str> =
            self.logs.iter().flat_map(|log| log.channels.iter().map(|c| c.name.as_str())).collect();
        let keep = |name: &str| !name.starts_with("true_") && (there.is_empty() || there.contains(name));
        let (mut logs, mut duration) = (self.logs.clone(), 0.0);
        for (index, seed) in seeds.iter().enumerate() {
            let log = self.simulate(scenario, settings, machine, *seed, &[]).ok()?;
            duration += log.duration();
            let mut log = log.slice(0..log.len(), keep);
            log.source = format!("{scenario} {} (simulated)", index + 1);
            logs.push(log);
        }
        let report = self.vehicle.fit(&logs, &self.asked.fit, &Progress::none()).ok()?;
        Some((report, duration))
    }

    /// The settings of a scenario within its limits that are best for the machine as it is known now.
    pub fn best_settings(&self, scenario: &str, progress: &Progress) -> Result<Option<Point>, Interrupted> {
        let limits = self.limits_of(scenario);
        if limits.is_empty() {
            return Ok(Some(Point { values: Vec::new(), score: 0.0 }));
        }
        let machine = self.supposed.middle();
        let best = search(&limits, &|values| {
            progress.check()?;
            let settings = self.settings_of(scenario, values);
            let fit = self.fitted(scenario, &settings, &machine, &[self.request.seed]);
            Ok(fit.map(|(report, _)| {
                let parameter = |interest: &Interest| report.parameters.get(&interest.name).filter(|p| told(p));
                self.sum(self.interest.iter().map(|interest| parameter(interest).map(|p| p.std_error)))
            }))
        });
        progress.advance(1);
        best
    }

    /// The fits of the drawn machines with a manoeuvre driven so often, and how long that takes.
    fn drives(
        &self,
        scenario: &str,
        settings: &[(String, f64)],
        times: usize,
        progress: &Progress,
    ) -> Result<Vec<(FitReport, f64)>, Interrupted> {
        let first = self.request.seed.wrapping_add(1);
        let fits: Vec<Option<_>> = (0..self.request.draws as u64)
            .into_par_iter()
            .map(|draw| {
                progress.check()?;
                // The standard error of a poor log may be far too large. Machines that differ from the fitted one by all of it
                // contradict the present logs as the real one does not.
                let scale = if draw % FITTED == 0 { 0.0 } else { 1.0 };
                let machine = self.supposed.draw(first.wrapping_add(draw), scale);
                let seed = |k: usize| first.wrapping_add(draw).wrapping_add(1000 * k as u64);
                let seeds: Vec<u64> = (0..times).map(seed).collect();
                let mut fit = self.fitted(scenario, settings, &machine, &seeds);
                // What misses the machine that drove by many of its standard errors tells nothing of it.
                if let Some((report, _)) = &mut fit {
                    let misses = |name: &str, p: &Parameter| {
                        let truth = machine.iter().find(|(other, _)| other == name);
                        truth.is_some_and(|(_, truth)| (p.value - truth).abs() > MISSES * p.std_error)
                    };
                    report.parameters.retain(|name, parameter| !misses(name, parameter));
                }
                progress.advance(1);
                Ok(fit)
            })
            .collect::<Result<_, Interrupted>>()?;
        Ok(fits.into_iter().flatten().collect())
    }

    fn promises(&self, fits: &[FitReport]) -> Vec<Option<Promise>> {
        self.interest.iter().map(|interest| promise(&interest.name, fits, self.request.draws)).collect()
    }

    /// What one drive of a manoeuvre is worth; nothing if no fit can be made of any.
    pub fn candidate(
        &self,
        scenario: &str,
        settings: Values,
        progress: &Progress,
    ) -> Result<Option<Candidate>, Interrupted> {
        let drives = self.drives(scenario, &settings, 1, progress)?;
        let Some((_, duration)) = drives.first() else { return Ok(None) };
        let (duration, fits) = (*duration, drives.into_iter().map(|(fit, _)| fit).collect::<Vec<_>>());
        let settings = settings.into_iter().collect();
        Ok(Some(Candidate { scenario: scenario.to_owned(), settings, duration, promises: self.promises(&fits) }))
    }

    /// What a manoeuvre is worth that is driven so often.
    pub fn repeat(&self, best: &Candidate, times: usize, progress: &Progress) -> Result<Repeat, Interrupted> {
        let settings: Values = best.settings.iter().map(|(name, value)| (name.clone(), *value)).collect();
        let fits = self.drives(&best.scenario, &settings, times, progress)?;
        let fits: Vec<FitReport> = fits.into_iter().map(|(fit, _)| fit).collect();
        Ok(Repeat { times, duration: times as f64 * best.duration, promises: self.promises(&fits) })
    }

    /// The less, the better: the product of the relative standard errors; one that stays unknown outweighs all others.
    pub fn score(&self, promises: &[Option<Promise>]) -> f64 {
        self.sum(promises.iter().map(|promise| promise.as_ref().map(|promise| promise.std_error)))
    }

    fn sum(&self, errors: impl Iterator<Item = Option<f64>>) -> f64 {
        errors.zip(&self.size).map(|(std, size)| std.map_or(UNKNOWN, |std| (std / size).ln())).sum()
    }

    /// The commands of a candidate without the noise of the sensors, as a log.
    pub fn inputs(&self, best: &Candidate) -> Result<Log, DesignError> {
        let manoeuvres = &self.vehicle.simulation.manoeuvres;
        let noises = (manoeuvres.settings)().into_iter().filter(|v| v.name.starts_with("noise."));
        let quiet: Values = noises.map(|variable| (variable.name, 0.0)).collect();
        let settings: Values = best.settings.iter().map(|(name, value)| (name.clone(), *value)).collect();
        let log = self.simulate(&best.scenario, &settings, &self.supposed.middle(), self.request.seed, &quiet)?;
        let mut inputs = log.slice(0..log.len(), |name| manoeuvres.commands.contains(&name));
        inputs.source = format!("plan {}", best.scenario);
        Ok(inputs)
    }

    /// The whole answer.
    pub fn plan(self, candidates: Vec<Candidate>, repeats: Vec<Repeat>, inputs: Option<Log>) -> Plan {
        let smaller = |(now, after): (&Interest, &Option<Promise>)| match (now.std_error, after) {
            (Some(now), Some(after)) => after.std_error < HELPS * now,
            (None, Some(_)) => true,
            (_, None) => false,
        };
        let helps = candidates.first().is_some_and(|best| self.interest.iter().zip(&best.promises).any(smaller));
        let notes = self.notes(&candidates);
        Plan {
            vehicle: self.vehicle.name.to_owned(),
            parameters: self.interest,
            candidates,
            repeats,
            helps,
            draws: self.request.draws,
            probability: probability(self.request.draws),
            notes,
            inputs,
        }
    }

    /// What the promises rest on, and where driving stops helping.
    fn notes(&self, candidates: &[Candidate]) -> Vec<String> {
        let mut notes = Vec::new();
        if self.logs.is_empty() && self.request.fit.is_some() {
            notes.push("without the present logs the promises are those of the new log alone".to_owned());
        }
        let supposed = |(name, low, high): &(String, f64, f64)| format!("{name} {}..{}", short(*low), short(*high));
        let unknown: Vec<String> = self.supposed.unknown.iter().map(supposed).collect();
        if !unknown.is_empty() {
            notes.push(format!("not known yet, and supposed within: {}", unknown.join(", ")));
        }
        let Some(best) = candidates.first() else {
            notes.push("no manoeuvre could be simulated and fitted with these values".to_owned());
            return notes;
        };
        notes.extend(self.noisier(best));
        for (index, interest) in self.interest.iter().enumerate() {
            let name = &interest.name;
            let Some(promise) = &best.promises[index] else {
                let other = candidates.iter().find(|candidate| candidate.promises[index].is_some());
                notes.push(match other {
                    Some(other) => format!("{name}: {} tells it, the best for all does not", other.scenario),
                    None => format!("{name}: no manoeuvre of the built-in plants tells it within these limits"),
                });
                continue;
            };
            let considered = promise.by_noise.powi(2) < 0.5 * promise.std_error.powi(2);
            if let Some(cause) = promise.limited_by.as_ref().filter(|_| considered) {
                notes.push(format!("{name}: limited by the {cause}: {}, not more driving", cure(cause)));
            }
        }
        notes
    }

    /// Signals that the fit of the present logs predicts worse than a simulated log: noise that the promises do not know of.
    fn noisier(&self, best: &Candidate) -> Option<String> {
        let now = self.now.as_ref().filter(|_| !self.logs.is_empty())?;
        let settings: Values = best.settings.iter().map(|(name, value)| (name.clone(), *value)).collect();
        let log = self.simulate(&best.scenario, &settings, &self.supposed.middle(), self.request.seed, &[]).ok()?;
        let alone = self.vehicle.fit(&[log], &self.asked.fit, &Progress::none()).ok()?;
        let errors = |fit: &FitReport, name: &str| -> Option<f64> {
            let of = fit.validation.signals.iter().filter(|signal| signal.name == name);
            let all: Vec<f64> = of.map(|signal| signal.rmse_training).filter(|rmse| rmse.is_finite()).collect();
            (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
        };
        let names: BTreeSet<&str> = now.validation.signals.iter().map(|signal| signal.name.as_str()).collect();
        let worse = names.into_iter().filter_map(|name| {
            let ratio = errors(now, name)? / errors(&alone, name)?;
            (ratio > NOISIER).then(|| format!("{name} {ratio:.1} times"))
        });
        let worse: Vec<String> = worse.collect();
        (!worse.is_empty()).then(|| {
            format!(
                "the fit predicts the present logs worse than simulated ones ({}): noise or what the plant lacks; with it the \
                 standard errors will be larger than promised (--set noise.NAME=STD makes the simulated sensors noisier)",
                worse.join(", ")
            )
        })
    }
}

/// The parameters that a fit leaves to be found: those not identified, or else the one with the widest relative interval;
/// without a fit all.
fn wanting(fit: Option<&FitReport>, targets: &[&Target]) -> Vec<String> {
    let usual = || targets.iter().filter(|target| !target.optional).map(|target| target.name.clone());
    let Some(fit) = fit else { return usual().collect() };
    let shared = || {
        let is_target = |name: &str| targets.iter().any(|target| target.name == name);
        fit.parameters.iter().filter(move |(name, p)| is_target(name) && p.per_log.is_empty())
    };
    let optional = |name: &str| targets.iter().any(|target| target.name == name && target.optional);
    let open = shared().filter(|(name, p)| !p.identified && !optional(name)).map(|(name, _)| name.clone());
    let open: Vec<String> = open.collect();
    if !open.is_empty() {
        return open;
    }
    let relative = |p: &crate::result::Parameter| (p.std_error / p.value).abs();
    let known = shared().filter(|(_, p)| told(p) && p.identified);
    let widest = known.max_by(|a, b| relative(a.1).total_cmp(&relative(b.1)));
    widest.map_or_else(|| usual().collect(), |(name, _)| vec![name.clone()])
}

/// What makes a considered cause smaller.
fn cure(cause: &str) -> &'static str {
    match cause {
        _ if cause.starts_with("known value") => "a better measurement of it",
        _ if ["gain of", "bias of", "delay of"].iter().any(|start| cause.starts_with(start)) => "a better sensor",
        _ => "a better sensor or model",
    }
}
