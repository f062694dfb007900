//! The words of the command line for machines and for choices of the numerics, which know no command line.

use crate::solve::Loss;
use crate::tune::Objective;
use crate::vehicle::Vehicle;
use crate::vehicles;
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Takes the name of a machine of the list.
pub(super) fn vehicle_parser() -> impl TypedValueParser<Value = &'static Vehicle> {
    let names = vehicles::ALL.map(|vehicle| PossibleValue::new(vehicle.name).help(vehicle.about));
    let find = |name: String| vehicles::ALL.into_iter().find(|vehicle| vehicle.name == name);
    PossibleValuesParser::new(names).try_map(move |name| find(name).ok_or("no machine of the list"))
}

impl ValueEnum for Loss {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::Ls, Self::Huber, Self::L1]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.word()).help(match self {
            Self::Ls => "Least squares",
            Self::Huber => "Huber: quadratic for small residuals, linear beyond 1.345 standard deviations",
            Self::L1 => "Least absolute values",
        }))
    }
}

impl ValueEnum for Objective {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::Nll, Self::Rmse]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.word()).help(match self {
            Self::Nll => "Negative log-likelihood of the innovations",
            Self::Rmse => {
                "Root mean square error: of the filtered outputs against the measured ones where the estimator \
                 reports it, the source's choice; else of the estimates against the log's true_* columns, each over \
                 its standard deviation. Degenerate: it does not know the scale of the noises, and the first pays for \
                 following noise"
            }
        }))
    }
}
