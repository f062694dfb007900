//! What a log must carry at least before a filter is tuned on it. Everything else may be missing.

use super::Subject;
use crate::log::columns::fits;
use crate::log::{Log, LogError};
use wheelstate::Variable;

/// Refuses a log that cannot be of this machine.
pub(super) fn check(subject: &Subject, inputs: &[Variable], log: &Log) -> Result<(), LogError> {
    let sampled = |pattern: &&str| inputs.iter().any(|input| fits(pattern, &input.name) && has_samples(log, input));
    match subject.needed.iter().find(|group| !group.iter().any(sampled)) {
        None => Ok(()),
        Some(group) => {
            let what =
                format!("no channel with samples among {}; {} needs one of them", group.join(", "), subject.vehicle);
            Err(LogError::file(&log.source, what))
        }
    }
}

/// The measured inputs of which no log has a sample.
pub(super) fn lacking(inputs: &[Variable], logs: &[Log]) -> Vec<String> {
    let lacks = |input: &&Variable| input.measured && !logs.iter().any(|log| has_samples(log, input));
    inputs.iter().filter(lacks).map(|input| input.name.clone()).collect()
}

fn has_samples(log: &Log, input: &Variable) -> bool {
    log.channel(&input.name).is_some_and(|values| values.iter().any(|value| value.is_finite()))
}
