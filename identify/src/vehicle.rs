//! One record per machine: all that the commands know of it.

use crate::check::{self, Checks, Finding};
use crate::finding::Severity;
use crate::log::Log;
use crate::problem::{self, Declared, FitError, FitRequest, Known, Problem};
use crate::progress::Progress;
use crate::result::{FitReport, Parameter};
use crate::run::{self, Parameters, ParametersError, Run, RunError, Settings};
use crate::simulate::{Companion, Request, SimulateError, Simulation};
use crate::tune::{self, Subject, TuneError, TuneReport, TuneRequest};
use std::path::Path;
use wheelstate::{Estimator, ParameterError, Variable, Variables};

/// A machine: its estimator and what `identify` adds to it.
#[derive(Clone, Copy)]
pub struct Vehicle {
    /// Name on the command line and in `fit.json`.
    pub name: &'static str,
    /// What it is, in one line of the help.
    pub about: &'static str,
    /// Its estimator.
    pub estimator: Seat,
    /// How its parameters are identified.
    pub problem: Problem,
    /// What its logs must be like for that.
    pub checks: Checks,
    /// How its logs are simulated.
    pub simulation: Simulation,
    /// What a log must carry before noise is tuned on it: samples of at least one input of each group, `*` standing
    /// for any ending. Accelerations alone are not enough for any machine, and a speed alone fits every machine.
    pub needed: &'static [&'static [&'static str]],
    /// Floors of the process noise that follow from what is known of the machine, by FMU name, from the values of
    /// its parameters in the order of their declaration.
    pub noise_floors: fn(&[f64]) -> Vec<(String, f64)>,
    /// Whether it is a body tree, which `estimate` and `bench` read from a file.
    pub body_tree: bool,
}

/// An estimator's place in a record: what is asked of its type.
#[derive(Clone, Copy)]
pub struct Seat {
    /// [`Estimator::NAME`], also the name of the FMU.
    pub name: &'static str,
    parameters: fn() -> Vec<Variable>,
    inputs: fn() -> Vec<Variable>,
    tune: Tune,
    run: fn(&Log, &Settings, &Progress) -> Result<Run, RunError>,
}

/// [`tune::tune`] of one estimator.
type Tune = fn(&Subject, &[Log], &[Log], &TuneRequest, &Progress) -> Result<TuneReport, TuneError>;

impl Seat {
    /// The place of this estimator.
    pub const fn of<E: Estimator + 'static>() -> Self {
        Self {
            name: E::NAME,
            parameters: E::Parameters::declare,
            inputs: E::Inputs::declare,
            tune: tune::tune::<E>,
            run: run::run::<E>,
        }
    }
}

impl Vehicle {
    /// The parameters of its estimator.
    pub fn parameters(&self) -> Vec<Variable> {
        (self.estimator.parameters)()
    }

    /// The inputs of its estimator, which are the channels of its logs.
    pub fn inputs(&self) -> Vec<Variable> {
        (self.estimator.inputs)()
    }

    /// Says of a column by its name whether it is read without being asked for: inputs, what only the fit reads, and true
    /// values for reports.
    pub fn reads(&self) -> impl Fn(&str) -> bool + use<> {
        let (inputs, known, checks) = (self.inputs(), Known::new(self.parameters()), self.checks);
        move |name| {
            let subject = check::Subject { inputs: &inputs, known: &known, checks: &checks };
            name.starts_with("true_") || subject.reads(name)
        }
    }

    /// Looks for what is wrong with a log before anything is fitted to it, see [`check::check`]; `settings` are known
    /// parameters by FMU name.
    pub fn check(&self, log: &Log, settings: &[(String, f64)]) -> Result<Vec<Finding>, ParameterError> {
        let mut known = Known::new(self.parameters());
        for (name, value) in settings {
            known.set(name, *value)?;
        }
        let inputs = self.inputs();
        Ok(check::check(&check::Subject { inputs: &inputs, known: &known, checks: &self.checks }, log))
    }

    /// What a log tells about each parameter, and which part of it tells most: the standard errors of a fit to the whole
    /// and to its parts.
    pub fn information(
        &self,
        log: &Log,
        settings: &[(String, f64)],
        progress: &Progress,
    ) -> Result<Vec<Finding>, FitError> {
        let request = FitRequest { settings: settings.to_vec(), ..FitRequest::default() };
        let whole = self.fit(std::slice::from_ref(log), &request, progress)?;
        let count = ((log.duration() / LEAST_PART) as usize).min(MOST_PARTS);
        let mut parts = Vec::new();
        for k in (0..count).filter(|_| count > 1) {
            let range = log.len() * k / count..log.len() * (k + 1) / count;
            let part = log.slice(range, |name| !name.starts_with("true_"));
            match self.fit(std::slice::from_ref(&part), &request, progress) {
                Ok(report) => parts.push((part.time[0], part.time[part.len() - 1], report)),
                Err(FitError::Interrupted(stop)) => return Err(stop.into()),
                // A part may be too short for any fit: then it tells nothing.
                Err(_) => {}
            }
        }
        // What a fit says exactly is no estimate: a standard error that is to be used as a start value, for example.
        let estimates = whole.parameters.iter().filter(|(_, parameter)| parameter.std_error != 0.0);
        Ok(estimates.map(|(name, parameter)| told(log, name, parameter, &parts)).collect())
    }

    /// Fits its parameters to logs, see [`problem::fit`].
    ///
    /// ```
    /// use wheelstate_identify::problem::FitRequest;
    /// use wheelstate_identify::progress::Progress;
    /// use wheelstate_identify::simulate::Request;
    /// use wheelstate_identify::vehicles;
    ///
    /// let chair = vehicles::ALL.iter().find(|vehicle| vehicle.name == "wheelchair").expect("it is one of them");
    /// let log = chair.simulate(&Request { scenario: "identification".into(), seed: 1, ..Request::default() })?;
    /// let report = chair.fit(std::slice::from_ref(&log), &FitRequest::default(), &Progress::none())?;
    /// let (mass, truth) = (&report.parameters["chair.mass"], log.require("true_chair.mass")?[0]);
    /// assert!(mass.identified && (mass.value - truth).abs() < 3.0 * mass.std_error);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn fit(&self, logs: &[Log], request: &FitRequest, progress: &Progress) -> Result<FitReport, FitError> {
        let declared = Declared { parameters: self.parameters(), inputs: self.inputs() };
        problem::fit(&self.problem, self.name, &declared, logs, request, progress)
    }

    /// Tunes the noise settings of its estimator on logs, see [`tune::tune`]; `held_out` logs only judge the result.
    pub fn tune(
        &self,
        logs: &[Log],
        held_out: &[Log],
        request: &TuneRequest,
        progress: &Progress,
    ) -> Result<TuneReport, TuneError> {
        let subject = Subject { vehicle: self.name, needed: self.needed, noise_floors: self.noise_floors };
        (self.estimator.tune)(&subject, logs, held_out, request, progress)
    }

    /// Runs its estimator over a log, see [`run`](mod@run).
    ///
    /// ```
    /// use wheelstate_identify::progress::Progress;
    /// use wheelstate_identify::run::Settings;
    /// use wheelstate_identify::simulate::Request;
    /// use wheelstate_identify::vehicles;
    ///
    /// let chair = vehicles::ALL.iter().find(|vehicle| vehicle.name == "wheelchair").expect("it is one of them");
    /// let log = chair.simulate(&Request { scenario: "climb".into(), seed: 1, ..Request::default() })?;
    /// let heading = ("initial.heading".to_owned(), std::f64::consts::FRAC_PI_2); // straight up
    /// let run = chair.run(&log, &Settings { parameters: vec![heading], ..Settings::default() }, &Progress::none())?;
    /// let last = log.len() - 1; // the times of the run are those of the log, and one more
    /// let at = |name| run.column(name).expect("it is an output of the FMU")[last];
    /// assert!((at("slope") - log.require("true_slope")?[last]).abs() < 3.0 * at("slope_std"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn run(&self, log: &Log, settings: &Settings, progress: &Progress) -> Result<Run, RunError> {
        (self.estimator.run)(log, settings, progress)
    }

    /// Parameters of its estimator from a file as `pack --params` takes it, see [`Parameters::read`].
    pub fn read_parameters(&self, path: &Path) -> Result<Parameters, ParametersError> {
        Parameters::read(path, self.name, &self.parameters())
    }

    /// Runs a scenario.
    pub fn simulate(&self, request: &Request) -> Result<Log, SimulateError> {
        (self.simulation.run)(request)
    }

    /// The files that a scenario writes beside its log.
    pub fn companions(&self, request: &Request) -> Result<Vec<Companion>, SimulateError> {
        (self.simulation.companions)(request)
    }
}

/// Shortest part of a log that is looked at by itself, s, and how many there are at most.
const LEAST_PART: f64 = 10.0;
const MOST_PARTS: usize = 6;

/// One parameter: how well the whole log tells it, and the part that tells most, by the information `1/std_error^2`.
fn told(log: &Log, name: &str, parameter: &Parameter, parts: &[(f64, f64, FitReport)]) -> Finding {
    let mut finding = Finding {
        file: log.source.clone(),
        channel: String::new(),
        time: None,
        code: "expected-accuracy".to_owned(),
        severity: Severity::Note,
        message: String::new(),
        suggestion: format!("{} by this log alone", parameter.verdict.words()),
    };
    // Where nothing happens or a bound holds there is no standard error to speak of.
    let tells = |p: &&Parameter| p.std_error.is_finite() && p.std_error > 0.0 && !p.at_bound;
    if Some(parameter).filter(tells).is_none() {
        finding.message = format!("{name}: the log says nothing about it");
        return finding;
    }
    let unit = if parameter.unit == "1" { String::new() } else { format!(" {}", parameter.unit) };
    finding.message = format!(
        "{name}: about {}, and a standard error of {}{unit} is to be expected",
        check::short(parameter.value),
        check::short(parameter.std_error)
    );
    let information =
        |report: &FitReport| report.parameters.get(name).filter(tells).map_or(0.0, |p| p.std_error.powi(-2));
    let all: f64 = parts.iter().map(|(.., report)| information(report)).sum();
    let best = parts.iter().max_by(|a, b| information(&a.2).total_cmp(&information(&b.2)));
    if let Some((from, to, report)) = best.filter(|_| all > 0.0) {
        let share = 100.0 * information(report) / all;
        finding.message += &format!("; {from:.0} s to {to:.0} s tell most, {share:.0} %");
        finding.time = Some(*from);
    }
    finding
}

impl std::fmt::Display for Vehicle {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.pad(self.name)
    }
}

impl std::fmt::Debug for Vehicle {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(self.name)
    }
}
