//! Which parameters of a vehicle are noise settings, and what they can physically be.

use wheelstate::variable::Kind;
use wheelstate::{Variable, unit};

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
    let usable = |(index, variable): (usize, &Variable)| {
        let start = base[index];
        let measurement = noise(variable).filter(|_| variable.kind == Kind::Real && start > 0.0)?;
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

/// Whether a noise is given as a power (a variance, or one per time), not as a standard deviation: process noise always
/// is, and that of a measurement if its unit is a square.
fn is_power(variable: &Variable) -> bool {
    let square = |unit: unit::Unit| {
        unit.exponents.iter().all(|exponent| exponent % 2 == 0) && unit.exponents.iter().any(|exponent| *exponent != 0)
    };
    variable.process_noise || unit::parse(variable.unit).is_some_and(square)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wheelstate::{Estimator, Variables, estimator};

    struct Settings(Vec<(String, bool)>);

    impl estimator::Visitor for Settings {
        fn visit<E: Estimator + 'static>(&mut self) {
            let declared = E::Parameters::declare();
            let noises = declared.iter().filter(|variable| noise(variable).is_some());
            self.0.extend(noises.map(|variable| (format!("{} {}", E::NAME, variable.name), is_power(variable))));
        }
    }

    /// The names tell a reader the same: `*_psd` and `variance` are powers, `*_std` is none.
    #[test]
    fn powers_are_distinguished_from_standard_deviations() {
        let mut settings = Settings(Vec::new());
        estimator::visit_all(&mut settings);
        assert!(settings.0.len() > 40, "{}", settings.0.len());
        for (name, power) in settings.0 {
            assert_ne!(name.contains("_psd.") || name.contains(" variance."), name.contains("_std."), "{name}");
            assert_eq!(power, !name.contains("_std."), "{name}");
        }
    }
}
