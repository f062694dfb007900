//! What `pack --params` takes: the result of `identify`, or a parameter set.

use super::fit::{Baked, Fit};
use super::ssv::ParameterSet;
use super::{PackError, same_name};
use crate::model::Model;
use std::path::Path;

/// Values that become start values.
#[derive(Clone, Debug)]
pub enum Params {
    /// `fit.json` or `tune.json`
    Fit(Fit),
    /// `.ssv`
    Set(ParameterSet),
}

impl Params {
    /// Reads a file; its extension says which of the two it is.
    pub fn read(path: &Path) -> Result<Self, PackError> {
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ssv")) {
            ParameterSet::read(path).map(Self::Set)
        } else {
            Fit::read(path).map(Self::Fit)
        }
    }

    /// The model that the values say they are of.
    pub fn model(&self) -> Result<Model, PackError> {
        match self {
            Self::Fit(fit) => super::model(&fit.vehicle).map_err(|error| PackError(format!("{}: {error}", fit.source))),
            Self::Set(set) => super::model(&set.name).map_err(|_| {
                PackError(format!("{}: its name '{}' is not a model's; name the model", set.source, set.name))
            }),
        }
    }

    /// Whether they say that they are of this model.
    pub fn is_of(&self, model: &Model) -> bool {
        match self {
            Self::Fit(fit) => fit.is_of(model),
            Self::Set(set) => same_name(&set.name, model.name),
        }
    }

    /// Puts them into the model's start values; values that a fit did not identify only if `unidentified`.
    pub fn bake(&self, model: &mut Model, unidentified: bool) -> Result<Baked, PackError> {
        match self {
            Self::Fit(fit) => fit.bake(model, unidentified),
            Self::Set(set) => set.bake(model),
        }
    }
}
