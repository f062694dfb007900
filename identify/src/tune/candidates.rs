//! Which parameters of a vehicle are noise settings, and what they can physically be.

use wheelstate::Variable;
use wheelstate::variable::Kind;

/// Least share of a measurement's data-sheet noise (its start value).
const MEASUREMENT_SHARE: f64 = 0.7;
/// Least share of a process noise whose physics are not known here.
const PROCESS_SHARE: f64 = 0.1;

/// A noise setting.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Place among the parameters.
    pub index: usize,
    /// Start value.
    pub start: f64,
    /// Search interval.
    pub range: (f64, f64),
    /// Whether it is a power (a variance, or a variance per time), not a standard deviation.
    pub power: bool,
}

/// Whether a parameter is a noise setting, and then whether it is of a measurement.
fn noise(variable: &Variable) -> Option<bool> {
    (variable.measurement_noise || variable.process_noise).then_some(variable.measurement_noise)
}

/// The same for machines whose declarations do not say it: by the name.
fn noise_by_name(name: &str) -> Option<bool> {
    if name.starts_with("filter.measurement") {
        return Some(true);
    }
    if name.starts_with("filter.process") {
        return Some(false);
    }
    // the rest says how exactly the equations hold and what is known without sensors
    let own = name.strip_prefix("variance.")?;
    let of_model = ["equation", "prior", "no_contact"].iter().any(|word| own.starts_with(word));
    (!of_model).then_some(true)
}

/// The noise settings among an estimator's parameters with search intervals around their start values.
///
/// With `physical` floors no measurement is taken to be better than 0.7 of its start value and no model
/// better than its known causes of error, which these floors are; without, the intervals reach two decades down.
pub fn candidates(
    declared: &[Variable],
    base: &[f64],
    physical: Option<&[(String, f64)]>,
    own_floors: &[(String, f64)],
) -> Vec<Candidate> {
    let find = |list: &[(String, f64)], variable: &Variable| {
        list.iter().find(|(name, _)| *name == variable.name).map(|(_, value)| *value)
    };
    let declared_so = declared.iter().any(|variable| noise(variable).is_some());
    let role = |variable: &Variable| if declared_so { noise(variable) } else { noise_by_name(&variable.name) };
    let usable = |(index, variable): (usize, &Variable)| {
        let start = base[index];
        let measurement = role(variable).filter(|_| variable.kind == Kind::Real && start > 0.0)?;
        let power = is_power(variable);
        let square = if power { 2 } else { 1 };
        let usual = if measurement { MEASUREMENT_SHARE } else { PROCESS_SHARE }.powi(square) * start;
        let low = match find(own_floors, variable).or(find(physical.unwrap_or_default(), variable)) {
            Some(floor) => floor,
            None if physical.is_some() => usual,
            None => 0.01f64.powi(square) * start,
        };
        let high = (10f64.powi(square) * start).max(10.0 * low).min(variable.range.1);
        let low = low.max(variable.range.0).max(1e-12 * start).min(0.5 * high);
        Some(Candidate { index, start: start.clamp(low, high), range: (low, high), power })
    };
    declared.iter().enumerate().filter_map(usable).collect()
}

/// Whether a noise is given as a power (a variance rate), not as a standard deviation.
fn is_power(variable: &Variable) -> bool {
    !(variable.name.contains("_std"))
}
