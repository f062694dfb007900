//! Samples that a host takes away by parameters: for hosts without NaN, or that set every input.

use crate::model::{Model, NO_VALUE};

/// What the parameters `missing_value` and `use.<input>` say at present.
#[derive(Clone, Debug, Default)]
pub struct Screen {
    missing_value: f64,
    off: Vec<bool>,
    active: bool,
}

impl Screen {
    /// Reads the parameters.
    pub fn update(&mut self, model: &Model, parameters: &[f64]) {
        self.missing_value = parameters[model.missing_value];
        self.off.clear();
        self.off.resize(model.inputs.len(), false);
        for &(parameter, input) in &model.switches {
            self.off[input] = parameters[parameter] == 0.0;
        }
        self.active = self.missing_value != NO_VALUE || self.off.contains(&true);
    }

    /// Whether any sample may be taken away.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Makes samples NaN that are switched off or that the host set to the missing value.
    pub fn apply(&self, model: &Model, set: &[f64], samples: &mut [f64]) {
        let variables = model.inputs.iter().zip(&self.off);
        for ((variable, &off), (&set, sample)) in variables.zip(set.iter().zip(samples)) {
            if off || (variable.may_be_missing() && set == self.missing_value) {
                *sample = f64::NAN;
            }
        }
    }
}
