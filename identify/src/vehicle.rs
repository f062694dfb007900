//! One record per machine: all that the commands know of it.

use crate::check::{self, Checks, Finding};
use crate::log::Log;
use crate::problem::{self, FitError, FitRequest, Known, Problem};
use crate::progress::Progress;
use crate::result::FitReport;
use crate::simulate::{Companion, Request, SimulateError, Simulation};
use crate::tune::{self, Subject, TuneError, TuneReport, TuneRequest};
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
}

/// [`tune::tune`] of one estimator.
type Tune = fn(&Subject, &[Log], &[Log], &TuneRequest, &Progress) -> Result<TuneReport, TuneError>;

impl Seat {
    /// The place of this estimator.
    pub const fn of<E: Estimator + 'static>() -> Self {
        Self { name: E::NAME, parameters: E::Parameters::declare, inputs: E::Inputs::declare, tune: tune::tune::<E> }
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
        problem::fit(&self.problem, self.name, self.parameters(), logs, request, progress)
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

    /// Runs a scenario.
    pub fn simulate(&self, request: &Request) -> Result<Log, SimulateError> {
        (self.simulation.run)(request)
    }

    /// The files that a scenario writes beside its log.
    pub fn companions(&self, request: &Request) -> Result<Vec<Companion>, SimulateError> {
        (self.simulation.companions)(request)
    }
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
