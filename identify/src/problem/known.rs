//! Parameters that a fit takes as known: defaults, start values and settings by FMU name.

use crate::result::Delay;
use std::collections::{BTreeMap, BTreeSet};
use wheelstate::variable::find;
use wheelstate::{ParameterError, Variable, Variables};

/// Values by FMU name.
#[derive(Clone, Debug, Default)]
pub struct Known {
    values: BTreeMap<String, f64>,
    set: BTreeSet<String>,
    declared: Vec<Variable>,
    /// How late a channel of a log is, s, by the log's file and the channel.
    delays: BTreeMap<(String, String), f64>,
}

impl Known {
    /// The defaults of the declarations.
    pub fn new(declared: Vec<Variable>) -> Self {
        let values = declared.iter().map(|variable| (variable.name.clone(), variable.start)).collect();
        Self { values, set: BTreeSet::new(), declared, delays: BTreeMap::new() }
    }

    /// Sets a declared parameter, checked against its declaration.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        find(&self.declared, name, value)?;
        self.values.insert(name.to_owned(), value);
        self.set.insert(name.to_owned());
        Ok(())
    }

    /// Takes over a value without a check: an estimate, for the validation.
    pub fn assume(&mut self, name: &str, value: f64) {
        self.values.insert(name.to_owned(), value);
    }

    /// The same with such values.
    pub fn with<'n>(&self, values: impl Iterator<Item = (&'n str, f64)>) -> Self {
        let mut known = self.clone();
        values.for_each(|(name, value)| known.assume(name, value));
        known
    }

    /// The same with delays that were fitted.
    pub fn with_delays(&self, delays: &[Delay]) -> Self {
        let mut known = self.clone();
        delays.iter().for_each(|delay| known.assume_delay(&delay.log, &delay.channel, delay.value));
        known
    }

    /// Takes over how late a channel of a log is, s: an estimate, for the validation.
    fn assume_delay(&mut self, log: &str, channel: &str, value: f64) {
        self.delays.insert((log.to_owned(), channel.to_owned()), value);
    }

    /// How late a channel of a log is, s; of another log the mean of those that were fitted, 0 without any.
    pub fn delay(&self, log: &str, channel: &str) -> f64 {
        if let Some(delay) = self.delays.get(&(log.to_owned(), channel.to_owned())) {
            return *delay;
        }
        let of = self.delays.iter().filter(|((_, other), _)| other == channel).map(|(_, delay)| *delay);
        let (sum, count) = of.fold((0.0, 0.0), |(sum, count), delay| (sum + delay, count + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// The value of a declared parameter.
    ///
    /// # Panics
    /// If the problem's own declaration has no such name: a mistake in the program, not in the data.
    pub fn get(&self, name: &str) -> f64 {
        *self.values.get(name).unwrap_or_else(|| panic!("parameter {name} is not declared by this problem"))
    }

    /// The value of a parameter that may be undeclared.
    pub fn find(&self, name: &str) -> Option<f64> {
        self.values.get(name).copied()
    }

    /// The declaration of a parameter.
    pub fn declared(&self, name: &str) -> Option<&Variable> {
        self.declared.iter().find(|variable| variable.name == name)
    }

    /// All values as the parameters of an estimator; those that this problem does not declare have their start values.
    pub fn parameters<P: Variables + Default>(&self) -> P {
        let mut parameters = P::default();
        let flat: Vec<f64> = P::declare().iter().map(|v| self.find(&v.name).unwrap_or(v.start)).collect();
        parameters.read(&flat);
        parameters
    }

    /// Whether the user gave the value.
    pub fn is_set(&self, name: &str) -> bool {
        self.set.contains(name)
    }
}
