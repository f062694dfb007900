//! One model: its declared variables, their value references and their start values.
//!
//! Value references: `10000 + i` are the parameters, `20000 + i` the inputs and `30000 + i` the
//! outputs, `i` counting in the order of declaration from 0. After the parameters of the estimator
//! stand those that every FMU has for its host: [`missing_value`](NO_VALUE) and a switch per sensor.

use crate::machine::{Machine, Typed};
use std::borrow::Cow;
use wheelstate::estimator::{Visitor, visit_all};
use wheelstate::parameter_set::number;
use wheelstate::variable::Kind;
use wheelstate::{Estimator, Variable, Variables};

const GROUP: u32 = 10_000;

/// Where the value of a value reference lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Parameter number.
    Parameter(usize),
    /// Input number.
    Input(usize),
    /// Output number.
    Output(usize),
}

impl Place {
    /// The value reference of this place.
    pub fn reference(self) -> u32 {
        let (group, index) = match self {
            Self::Parameter(index) => (1, index),
            Self::Input(index) => (2, index),
            Self::Output(index) => (3, index),
        };
        group * GROUP + index as u32
    }
}

/// The FMI type through whose functions a variable is read and written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// `fmi2GetReal`, `fmi2SetReal`.
    Real,
    /// `fmi2GetInteger`, `fmi2SetInteger`; also enumerations, whose values count from 1.
    Integer,
    /// `fmi2GetBoolean`, `fmi2SetBoolean`.
    Boolean,
}

impl Type {
    /// The FMI type of a kind of variable.
    pub fn of(kind: Kind) -> Self {
        match kind {
            Kind::Real => Self::Real,
            Kind::Integer | Kind::Choice(_) | Kind::Code(_) => Self::Integer,
            Kind::Boolean => Self::Boolean,
        }
    }
}

/// What the functions that read and write values must know of a variable, side by side in memory.
#[derive(Clone, Copy, Debug)]
pub struct Access {
    /// The functions that serve it.
    pub class: Type,
    /// Its number as FMI knows it is one more than the value.
    pub counts_from_one: bool,
    /// An input that takes every number, for the estimator judges each sample.
    pub any_number: bool,
}

impl Access {
    /// How a declared variable is read and written.
    pub fn of(variable: &Variable) -> Self {
        let class = Type::of(variable.kind);
        Self {
            class,
            counts_from_one: matches!(variable.kind, Kind::Choice(_)),
            any_number: class == Type::Real && variable.may_be_missing(),
        }
    }

    /// A value as FMI numbers it. All but enumerations keep every bit, so that -0.0 does.
    #[inline]
    pub fn to_fmi(self, value: f64) -> f64 {
        if self.counts_from_one { value + 1.0 } else { value }
    }

    /// The value behind a number of FMI, the inverse of [`to_fmi`](Self::to_fmi).
    #[inline]
    pub fn from_fmi(self, number: f64) -> f64 {
        if self.counts_from_one { number - 1.0 } else { number }
    }
}

/// A model: what its FMU consists of.
#[derive(Clone)]
pub struct Model {
    /// Model identifier, the stem of the FMU's file name.
    pub name: &'static str,
    /// What it estimates.
    pub description: &'static str,
    /// Parameters; their start values may have been replaced by identified ones.
    pub parameters: Vec<Variable>,
    /// Inputs.
    pub inputs: Vec<Variable>,
    /// Outputs.
    pub outputs: Vec<Variable>,
    /// How parameters, inputs and outputs are read and written.
    access: [Vec<Access>; 3],
    /// Number of the parameter `missing_value`; those before it are the estimator's own.
    pub(crate) missing_value: usize,
    /// Parameter and input of each switch `use.<input>`.
    pub(crate) switches: Vec<(usize, usize)>,
    machine: fn() -> Box<dyn Machine>,
}

/// The start of `missing_value`: no number means "no sample".
pub const NO_VALUE: f64 = 1e300;

/// The start value as the XML states it. What begins as NaN, missing until the host sets it, is shown as 0 or the
/// number of its range nearest to that: FMI 2.0 knows finite starts only.
pub fn shown_start(variable: &Variable) -> f64 {
    let (low, high) = variable.range;
    if variable.start.is_nan() { 0.0_f64.clamp(low, high) } else { variable.start }
}

/// What every FMU adds for its host to the parameters of its estimator, with the inputs that the switches belong to.
/// A model that declares switches of its own, `use.<sensor>`, gets no others.
fn host_parameters(own: &[Variable], inputs: &[Variable]) -> (Vec<Variable>, Vec<usize>) {
    let parameter = |name: String, description: Cow<'static, str>, kind, start, range| Variable {
        start,
        tunable: true,
        ..Variable::new(name, description, "1", kind, range)
    };
    let about =
        "Number that means \"no sample\" in an input that may be missing, for hosts without NaN; 1e300: there is none.";
    let any = (f64::NEG_INFINITY, f64::INFINITY);
    let mut list = vec![parameter("missing_value".to_owned(), about.into(), Kind::Real, NO_VALUE, any)];
    let mut switched = Vec::new();
    if !own.iter().any(|variable| variable.name.starts_with("use.")) {
        for (index, input) in inputs.iter().enumerate().filter(|(_, input)| input.may_be_missing()) {
            let name = &input.name;
            let about = format!("Whether samples of {name} are used; if not, it is missing whatever the host sets.");
            list.push(parameter(format!("use.{name}"), about.into(), Kind::Boolean, 1.0, (0.0, 1.0)));
            switched.push(index);
        }
    }
    (list, switched)
}

impl Model {
    /// The model of an estimator.
    pub fn of<E: Estimator + 'static>() -> Self {
        let (mut parameters, inputs) = (E::Parameters::declare(), E::Inputs::declare());
        let (more, switched) = host_parameters(&parameters, &inputs);
        let missing_value = parameters.len();
        parameters.extend(more);
        let switches = (missing_value + 1..).zip(switched).collect();
        let outputs = E::Outputs::declare();
        let access = [&parameters, &inputs, &outputs].map(|list| list.iter().map(Access::of).collect());
        Self {
            name: E::NAME,
            description: E::DESCRIPTION,
            parameters,
            inputs,
            outputs,
            access,
            missing_value,
            switches,
            machine: || Box::new(Typed::<E>::default()),
        }
    }

    /// A number that only models of the same estimator have in this process.
    pub(crate) fn type_key(&self) -> usize {
        self.machine as usize
    }

    /// An estimator without parameters yet.
    pub fn machine(&self) -> Box<dyn Machine> {
        (self.machine)()
    }

    /// The place of a value reference.
    pub fn place(&self, reference: u32) -> Option<Place> {
        self.access(reference).map(|(place, _)| place)
    }

    /// The place of a value reference, and how it is read and written.
    #[inline]
    pub fn access(&self, reference: u32) -> Option<(Place, Access)> {
        let index = (reference % GROUP) as usize;
        let [parameters, inputs, outputs] = &self.access;
        match reference / GROUP {
            1 => parameters.get(index).map(|access| (Place::Parameter(index), *access)),
            2 => inputs.get(index).map(|access| (Place::Input(index), *access)),
            3 => outputs.get(index).map(|access| (Place::Output(index), *access)),
            _ => None,
        }
    }

    /// The start values of a list of variables.
    pub fn starts(list: &[Variable]) -> Vec<f64> {
        list.iter().map(|variable| variable.start).collect()
    }

    /// The parameter of this name with its number.
    pub fn parameter(&self, name: &str) -> Option<(usize, &Variable)> {
        self.parameters.iter().enumerate().find(|(_, variable)| variable.name == name)
    }

    /// Replaces start values of parameters, all or none; the estimator must accept the result.
    pub fn bake(&mut self, values: &[(usize, f64)]) -> Result<(), String> {
        let mut baked = Self::starts(&self.parameters);
        for &(index, value) in values {
            check_parameter(&self.parameters[index], value)?;
            baked[index] = value;
        }
        self.machine().build(&baked).map_err(|error| error.to_string())?;
        for (variable, value) in self.parameters.iter_mut().zip(baked) {
            variable.start = value;
        }
        Ok(())
    }

    /// Default time between two samples, s.
    pub fn sample_period(&self) -> f64 {
        self.sample_period_among(&Self::starts(&self.parameters))
    }

    /// Time between two samples with these parameters, s.
    pub fn sample_period_among(&self, parameters: &[f64]) -> f64 {
        self.parameter("sample_period").map_or(0.01, |(index, _)| parameters[index])
    }

    /// Name in lower case with dashes, as commands and files of the tools spell the vehicle.
    pub fn command_name(&self) -> String {
        let mut text = String::new();
        for (i, letter) in self.name.char_indices() {
            if letter.is_uppercase() && i > 0 {
                text.push('-');
            }
            text.extend(letter.to_lowercase());
        }
        text
    }
}

/// Models by name; lets a caller leave out those it does not want.
pub type Catalogue = fn(wanted: &dyn Fn(&str) -> bool) -> Vec<Model>;

/// The models of this library whose names are `wanted`.
pub fn models(wanted: &dyn Fn(&str) -> bool) -> Vec<Model> {
    struct Collect<'a>(&'a dyn Fn(&str) -> bool, Vec<Model>);
    impl Visitor for Collect<'_> {
        fn visit<E: Estimator + 'static>(&mut self) {
            if (self.0)(E::NAME) {
                self.1.push(Model::of::<E>());
            }
        }
    }
    let mut collect = Collect(wanted, Vec::new());
    visit_all(&mut collect);
    collect.1
}

/// Checks a parameter's value; the message names the variable, the value and what is allowed.
pub fn check_parameter(variable: &Variable, value: f64) -> Result<(), String> {
    if variable.check(value).is_ok() {
        return Ok(());
    }
    let name = &variable.name;
    if let Kind::Choice(items) = variable.kind {
        let list: Vec<_> = items.iter().enumerate().map(|(i, item)| format!("{} = {item}", i + 1)).collect();
        return Err(format!("{name} = {} is not one of {}", value + 1.0, list.join(", ")));
    }
    let unit = if variable.unit == "1" { String::new() } else { format!(" {}", variable.unit) };
    let reason = if value.is_nan() {
        "is not a number"
    } else if variable.kind != Kind::Real && value.fract() != 0.0 {
        "is not a whole number"
    } else {
        "is outside the allowed range"
    };
    let value = number(value);
    Err(format!("{name} = {value}{unit} {reason}; allowed: {}", range_text(variable)))
}

/// The allowed values in words: `1..=100 kg`.
pub fn range_text(variable: &Variable) -> String {
    let unit = if variable.unit == "1" { String::new() } else { format!(" {}", variable.unit) };
    match (variable.kind, variable.range) {
        (Kind::Boolean, _) => "false or true".to_owned(),
        (Kind::Choice(items), _) => items.join(", "),
        (Kind::Integer, (low, high)) if low <= f64::from(i32::MIN) && high >= f64::from(i32::MAX) => {
            "any whole number".to_owned()
        }
        (_, (f64::NEG_INFINITY, f64::INFINITY)) => "any finite number".to_owned(),
        (_, (low, f64::INFINITY)) => format!("at least {}{unit}", number(low)),
        (_, (f64::NEG_INFINITY, high)) => format!("at most {}{unit}", number(high)),
        (_, (low, high)) => format!("{}..={}{unit}", number(low), number(high)),
    }
}
