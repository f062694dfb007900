//! One instance of an FMU: phases, values and the sampling of a communication step.
//!
//! A refused call changes nothing; its [`Refusal`] says what was wrong and what would be allowed.

use crate::clock::{Clock, MOST_SAMPLES};
use crate::machine::Machine;
use crate::model::{Access, Model, Place, Type, check_parameter, shown_start};
use crate::phase::{Call, Phase};
use crate::refusal::{Answer, Level, Refusal};
use crate::screen::Screen;
use crate::snapshot::{Core, Snapshots};
use wheelstate::Status;

/// One instance.
pub struct Instance {
    model: Model,
    guid: String,
    core: Core,
    machine: Box<dyn Machine>,
    period: f64,
    /// The machine has outputs that are not yet among the values.
    unread: bool,
    /// Room for outputs.
    fresh: Vec<f64>,
    screen: Screen,
    /// The states that the host holds.
    snapshots: Snapshots,
}

impl Instance {
    /// A fresh instance of a model; `guid` goes into serialised states.
    pub fn new(model: Model, guid: impl Into<String>) -> Self {
        let inputs = Model::starts(&model.inputs);
        let core = Core {
            phase: Phase::Instantiated,
            clock: Clock::new(0.0),
            stop: None,
            parameters: Model::starts(&model.parameters),
            slopes: vec![0.0; inputs.len()],
            sloped: false,
            held: inputs.clone(),
            given: vec![false; inputs.len()],
            inputs,
            outputs: Model::starts(&model.outputs),
            stale: true,
        };
        let machine = model.machine();
        let mut screen = Screen::default();
        screen.update(&model, &core.parameters);
        let (fresh, snapshots) = (core.outputs.clone(), Snapshots::default());
        Self { model, guid: guid.into(), core, machine, period: 0.0, unread: false, fresh, screen, snapshots }
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The GUID of the FMU.
    pub fn guid(&self) -> &str {
        &self.guid
    }

    /// The communication point, s.
    pub fn time(&self) -> f64 {
        self.core.clock.now()
    }

    /// What was initialised, for the host's log.
    pub fn summary(&self) -> String {
        let changed = self.model.parameters.iter().zip(&self.core.parameters);
        let changed: Vec<_> = changed.filter(|(variable, value)| variable.start != **value).collect();
        let list: Vec<_> = changed.iter().map(|(variable, value)| format!("{} = {value}", variable.name)).collect();
        let list = if list.is_empty() { "all parameters as started".to_owned() } else { list.join(", ") };
        format!("{} samples every {} s from {} s; {list}", self.model.name, self.period, self.time())
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        self.core.phase
    }

    /// Marks the instance as lost.
    pub fn fail(&mut self) {
        self.core.phase = Phase::Fatal;
    }

    /// Refuses a call that the present phase does not allow.
    pub fn allow(&self, call: Call, function: &str) -> Answer<()> {
        let phase = self.core.phase;
        if call.phases().contains(&phase) {
            return Ok(());
        }
        let names: Vec<_> = call.phases().iter().map(|phase| phase.name()).collect();
        let allowed = if names.is_empty() {
            "no step of this FMU is ever pending".to_owned()
        } else {
            format!("allowed in: {}", names.join(", "))
        };
        let level = if phase == Phase::Fatal { Level::Fatal } else { Level::Error };
        let message = format!("{function} is not allowed in the state '{}'; {allowed}", phase.name());
        Err(Refusal { level, message })
    }

    /// `fmi2SetupExperiment`; the tolerance has no meaning for a sampled estimator.
    pub fn setup(&mut self, start: f64, stop: Option<f64>) -> Answer<()> {
        if !start.is_finite() {
            return Err(Refusal::error(format!("startTime = {start} s is not finite")));
        }
        if let Some(stop) = stop
            && (stop.is_nan() || stop < start)
        {
            return Err(Refusal::error(format!("stopTime = {stop} s is before startTime = {start} s")));
        }
        self.core.clock = Clock::new(start);
        self.core.stop = stop;
        Ok(())
    }

    /// `fmi2EnterInitializationMode`
    pub fn enter_initialization(&mut self) {
        self.core.phase = Phase::Initialization;
    }

    /// `fmi2ExitInitializationMode`: builds the estimator, whose checks go beyond single ranges.
    pub fn exit_initialization(&mut self) -> Answer<()> {
        self.refresh()?;
        self.core.phase = Phase::Stepping;
        Ok(())
    }

    /// `fmi2Terminate`
    pub fn terminate(&mut self) {
        self.core.phase = Phase::Terminated;
    }

    /// `fmi2Reset`: as freshly instantiated. States that the host holds stay valid.
    pub fn reset(&mut self) {
        let snapshots = std::mem::take(&mut self.snapshots);
        *self = Self::new(self.model.clone(), std::mem::take(&mut self.guid));
        self.snapshots = snapshots;
    }

    /// During initialisation: an estimator of the present parameters and its outputs.
    fn refresh(&mut self) -> Answer<()> {
        if self.core.stale {
            self.machine.build(&self.core.parameters).map_err(|error| Refusal::error(error.to_string()))?;
            self.period = self.machine.sample_period();
            self.core.stale = false;
            self.hold(0.0);
            self.machine.predict(0.0);
            self.unread = true;
            self.settle();
        }
        Ok(())
    }

    /// Hands the machine the inputs as they are `after` seconds from the beginning of the step.
    fn hold(&mut self, after: f64) {
        let core = &mut self.core;
        if !core.sloped && !self.screen.is_active() {
            return self.machine.hold(&core.inputs);
        }
        for ((held, input), slope) in core.held.iter_mut().zip(&core.inputs).zip(&core.slopes) {
            *held = input + slope * after;
        }
        self.screen.apply(&self.model, &core.inputs, &mut core.held);
        self.machine.hold(&core.held);
    }

    /// Brings the values of the outputs up to date; a step alone leaves that to the first reader.
    fn settle(&mut self) {
        if self.unread {
            self.machine.outputs(&mut self.fresh);
            keep_finite(&self.model, &mut self.core.outputs, &self.fresh);
            self.unread = false;
        }
    }

    #[cold]
    fn unknown(&self, reference: u32) -> Refusal {
        Refusal::error(format!("value reference {reference} belongs to no variable of {}", self.model.name))
    }

    /// Reads variables of one FMI type; `put(i, value)` receives them.
    pub fn get(&mut self, class: Type, references: &[u32], mut put: impl FnMut(usize, f64)) -> Answer<()> {
        if self.core.phase == Phase::Initialization {
            self.refresh()?;
        }
        self.settle();
        let core = &self.core;
        for (i, &reference) in references.iter().enumerate() {
            let Some((place, access)) = self.model.access(reference) else { return Err(self.unknown(reference)) };
            if access.class != class {
                return Err(wrong_type(self.name(reference)?, access.class, class));
            }
            let value = match place {
                Place::Parameter(index) => core.parameters[index],
                Place::Input(index) if !core.given[index] => shown_start(&self.model.inputs[index]),
                Place::Input(index) => core.inputs[index],
                Place::Output(index) => core.outputs[index],
            };
            put(i, access.to_fmi(value));
        }
        Ok(())
    }

    /// Writes variables of one FMI type, all or none; `value(i)` gives them.
    pub fn set(&mut self, class: Type, references: &[u32], value: impl Fn(usize) -> f64) -> Answer<()> {
        let mut retune = false;
        for (i, &reference) in references.iter().enumerate() {
            let Some((place, access)) = self.model.access(reference) else { return Err(self.unknown(reference)) };
            match place {
                Place::Input(_) if access.any_number && class == Type::Real => {}
                Place::Input(index) => self.check_input(class, index, access, value(i))?,
                Place::Parameter(index) => {
                    self.check_parameter(class, index, access, value(i))?;
                    retune = true;
                }
                Place::Output(index) => {
                    let name = &self.model.outputs[index].name;
                    return Err(Refusal::error(format!("{name} has causality output and cannot be set")));
                }
            }
        }
        let before = (retune && self.core.phase == Phase::Stepping).then(|| self.core.parameters.clone());
        let core = &mut self.core;
        for (i, &reference) in references.iter().enumerate() {
            let Some((place, access)) = self.model.access(reference) else { continue };
            let value = access.from_fmi(value(i));
            match place {
                Place::Parameter(index) => core.parameters[index] = value,
                Place::Input(index) => {
                    core.inputs[index] = value;
                    core.given[index] = true;
                    core.slopes[index] = 0.0;
                }
                Place::Output(_) => {}
            }
        }
        match before {
            Some(before) => {
                if let Err(error) = self.machine.retune(&self.core.parameters) {
                    self.core.parameters = before;
                    return Err(Refusal::error(error.to_string()));
                }
            }
            None => self.core.stale |= retune,
        }
        if retune {
            self.screen.update(&self.model, &self.core.parameters);
        }
        Ok(())
    }

    fn check_parameter(&self, class: Type, index: usize, access: Access, value: f64) -> Answer<()> {
        let variable = &self.model.parameters[index];
        let name = &variable.name;
        if access.class != class {
            return Err(wrong_type(name, access.class, class));
        }
        if self.core.phase == Phase::Stepping && !variable.tunable {
            let text = format!("{name} is a fixed parameter and can be set only before fmi2ExitInitializationMode");
            return Err(Refusal::error(text));
        }
        check_parameter(variable, access.from_fmi(value)).map_err(Refusal::error)
    }

    /// Inputs that may be missing take any number, for the estimator judges each sample; others must be finite.
    fn check_input(&self, class: Type, index: usize, access: Access, value: f64) -> Answer<()> {
        let variable = &self.model.inputs[index];
        match access.class {
            kind if kind != class => Err(wrong_type(&variable.name, kind, class)),
            Type::Real if access.any_number || value.is_finite() => Ok(()),
            Type::Real => Err(Refusal::error(format!(
                "{} = {value} is not finite, and this input cannot be missing; give a number in {}",
                variable.name, variable.unit
            ))),
            _ => check_parameter(variable, access.from_fmi(value)).map_err(Refusal::error),
        }
    }

    /// `fmi2SetRealInputDerivatives`: first time derivatives, valid for the next step only.
    pub fn set_input_derivatives(&mut self, references: &[u32], orders: &[i32], values: &[f64]) -> Answer<()> {
        let mut indices = Vec::with_capacity(references.len());
        for ((&reference, &order), &value) in references.iter().zip(orders).zip(values) {
            let name = self.name(reference)?;
            let Some(Place::Input(index)) = self.model.place(reference) else {
                return Err(Refusal::error(format!("{name} is not an input and takes no input derivative")));
            };
            if Type::of(self.model.inputs[index].kind) != Type::Real {
                return Err(Refusal::error(format!("{name} is not Real and takes no input derivative")));
            }
            if order != 1 {
                return Err(Refusal::error(format!(
                    "input derivative of order {order} for {name}; only order 1 is used"
                )));
            }
            if !value.is_finite() && !self.model.inputs[index].may_be_missing() {
                return Err(Refusal::error(format!("input derivative {value} for {name} is not finite")));
            }
            indices.push(index);
        }
        for (index, &value) in indices.into_iter().zip(values) {
            // the difference to or from a sample that is missing says nothing
            self.core.slopes[index] = if value.is_finite() { value } else { 0.0 };
            self.core.sloped = true;
        }
        Ok(())
    }

    /// `fmi2GetRealOutputDerivatives`: the rate at which the model carries the outputs forward at
    /// the communication point, as a difference over a thousandth of a sample.
    pub fn output_derivatives(&mut self, references: &[u32], orders: &[i32], values: &mut [f64]) -> Answer<()> {
        for (&reference, &order) in references.iter().zip(orders) {
            let name = self.name(reference)?;
            let real = match self.model.place(reference) {
                Some(Place::Output(index)) => Type::of(self.model.outputs[index].kind) == Type::Real,
                _ => false,
            };
            if !real {
                return Err(Refusal::error(format!("{name} is not a Real output and has no output derivative")));
            }
            if order != 1 {
                return Err(Refusal::error(format!(
                    "output derivative of order {order} for {name}; only order 1 is given"
                )));
            }
        }
        self.settle();
        let horizon = self.core.clock.horizon(self.period);
        let half = 0.5e-3 * self.period;
        let (early, late) = ((horizon - half).max(0.0), horizon + half);
        let (mut low, mut high) = (self.core.outputs.clone(), self.core.outputs.clone());
        self.machine.predict(early);
        self.machine.outputs(&mut low);
        self.machine.predict(late);
        self.machine.outputs(&mut high);
        for (&reference, value) in references.iter().zip(values) {
            if let Some(Place::Output(index)) = self.model.place(reference) {
                let rate = (high[index] - low[index]) / (late - early);
                *value = if rate.is_finite() { rate } else { 0.0 };
            }
        }
        Ok(())
    }

    fn name(&self, reference: u32) -> Answer<&str> {
        Ok(match self.model.place(reference).ok_or_else(|| self.unknown(reference))? {
            Place::Parameter(index) => &self.model.parameters[index].name,
            Place::Input(index) => &self.model.inputs[index].name,
            Place::Output(index) => &self.model.outputs[index].name,
        })
    }

    /// `fmi2DoStep`: every sample instant in `[point, point + size)` in order, then the outputs at
    /// the end.
    pub fn do_step(&mut self, point: f64, size: f64) -> Answer<()> {
        self.check_step(point, size)?;
        let until = self.core.clock.advance(point, size, self.period);
        while self.core.clock.samples() < until {
            let after = self.core.clock.tick(self.period);
            self.hold(after);
            self.machine.step();
        }
        if self.core.sloped {
            self.core.slopes.fill(0.0);
            self.core.sloped = false;
        }
        self.machine.predict(self.core.clock.horizon(self.period));
        self.unread = true;
        Ok(())
    }

    /// `fmi2GetFMUstate`; overwrites the state of `handle` unless that is 0.
    pub fn get_state(&mut self, handle: usize) -> Answer<usize> {
        self.settle();
        self.machine.held(&mut self.core.held);
        self.snapshots.copy(handle, &self.core, &*self.machine)
    }

    /// `fmi2SetFMUstate`
    pub fn set_state(&mut self, handle: usize) -> Answer<()> {
        let (core, state) = self.snapshots.find(handle)?;
        // a stale estimator is built anew from the parameters
        if let Some(state) = state.filter(|_| !core.stale) {
            // parameters that differ call for an estimator of their own; the present one is kept until it stands
            if self.period == 0.0 || self.core.stale || self.core.parameters != core.parameters {
                let mut machine = self.model.machine();
                machine.build(&core.parameters).map_err(|error| Refusal::error(error.to_string()))?;
                machine.load(state).map_err(|error| Refusal::error(error.to_string()))?;
                self.period = machine.sample_period();
                self.machine = machine;
            } else {
                self.machine.load(state).map_err(|error| Refusal::error(error.to_string()))?;
            }
        }
        self.core.clone_from(core);
        self.unread = false;
        self.machine.hold(&core.held);
        self.screen.update(&self.model, &self.core.parameters);
        Ok(())
    }

    /// `fmi2FreeFMUstate`
    pub fn free_state(&mut self, handle: usize) -> Answer<()> {
        self.snapshots.free(handle)
    }

    /// `fmi2SerializeFMUstate`
    pub fn serialize_state(&self, handle: usize) -> Answer<Vec<u8>> {
        self.snapshots.serialize(handle, &self.guid, &*self.machine)
    }

    /// `fmi2DeSerializeFMUstate`; overwrites the state of `handle` unless that is 0. What it accepts
    /// can be set without any further check.
    pub fn deserialize_state(&mut self, bytes: &[u8], handle: usize) -> Answer<usize> {
        self.snapshots.deserialize(bytes, handle, &self.model, &self.guid, &*self.machine)
    }

    fn check_step(&self, point: f64, size: f64) -> Answer<()> {
        let now = self.core.clock.now();
        if !(size > 0.0 && size.is_finite()) {
            return Err(Refusal::error(format!("communicationStepSize = {size} s must be positive and finite")));
        }
        if size > MOST_SAMPLES * self.period {
            let (most, period) = (MOST_SAMPLES * self.period, self.period);
            let text = format!(
                "communicationStepSize = {size} s would take more than {MOST_SAMPLES} samples of {period} s; allowed: at most {most} s"
            );
            return Err(Refusal::error(text));
        }
        if point == now && self.core.stop.is_none() {
            return Ok(());
        }
        let tolerance = self.core.clock.tolerance(self.period);
        if point.is_nan() || (point - now).abs() > tolerance {
            let text = format!("currentCommunicationPoint = {point} s, but the last step ended at {now} s");
            return Err(Refusal::error(text));
        }
        if let Some(stop) = self.core.stop
            && point + size > stop + tolerance
        {
            let text = format!("the step from {point} s over {size} s goes beyond stopTime = {stop} s");
            return Err(Refusal::error(text));
        }
        Ok(())
    }
}

/// Takes over outputs. An estimator gives finite numbers only; should it ever not, the last value stands, `healthy` is
/// false and `status` says that numbers were repaired.
fn keep_finite(model: &Model, outputs: &mut [f64], fresh: &[f64]) {
    let mut sound = true;
    for (output, &value) in outputs.iter_mut().zip(fresh) {
        if value.is_finite() {
            *output = value;
        } else {
            sound = false;
        }
    }
    if !sound {
        for (variable, output) in model.outputs.iter().zip(outputs) {
            match variable.name.as_str() {
                "healthy" => *output = 0.0,
                "status" => *output = f64::from(*output as u32 | Status::RECOVERED.bits()),
                _ => {}
            }
        }
    }
}

fn wrong_type(name: &str, is: Type, asked: Type) -> Refusal {
    Refusal::error(format!("{name} is of type {is:?}, not {asked:?}"))
}
