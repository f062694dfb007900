//! What is promised of a standard error, and how uncertain that is.
//!
//! A manoeuvre is driven and fitted for `n` machines that the present logs allow. The drive that will really be made is one
//! more of them: whatever the distribution of its standard error is, it lies between the smallest and the largest of the
//! `n` with the probability
//!
//! ```text
//! (n - 1) / (n + 1)
//! ```
//!
//! (Wilks, Annals of Mathematical Statistics 12(1), 1941, 91-96, for one further observation), 0.9 with 19. Nothing normal
//! may be supposed: fits of a poor log either tell a parameter or do not, and have few standard errors in between. What
//! the built-in plant does not know of the real machine is added at both ends.

use crate::result::{FitReport, Parameter};
use serde::Serialize;

/// What a real machine's standard error differs by from that of the built-in plant with its values, as a factor: an
/// assumption. `identify/tests/design.rs` tries the ranges on plants with other tyres, drives and sensors.
const OF_PLANT: f64 = 1.2;

/// The standard error that a fit is expected to have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Promise {
    /// The median over the drawn machines, in the parameter's unit.
    pub std_error: f64,
    /// Lower end of the range that it lies in with the plan's `probability`; 0 where half of the fits or more do not identify
    /// the parameter: what little a drive tells then depends on values that the present logs do not, and may be much more.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// The part of it by noise, which more driving makes smaller.
    pub by_noise: f64,
    /// The largest cause of the rest, in words; none if there is no rest.
    pub limited_by: Option<String>,
    /// Share of the drawn machines whose fit identifies the parameter.
    pub identified: f64,
}

/// Whether a fit tells a parameter: nothing can be made of a bound, and what has no error is no estimate.
pub fn told(parameter: &Parameter) -> bool {
    parameter.std_error.is_finite() && parameter.std_error > 0.0 && !parameter.at_bound && parameter.per_log.is_empty()
}

/// The promise from the fits of as many drives as were `tried`; none unless more than half of them tell the parameter.
pub fn promise(name: &str, fits: &[FitReport], tried: usize) -> Option<Promise> {
    let all: Vec<&Parameter> = fits.iter().filter_map(|fit| fit.parameters.get(name)).filter(|p| told(p)).collect();
    let n = all.len();
    if n < 2 || 2 * n <= tried {
        return None;
    }
    let mut errors: Vec<f64> = all.iter().map(|p| p.std_error).collect();
    errors.sort_by(f64::total_cmp);
    let median = 0.5 * (errors[(n - 1) / 2] + errors[n / 2]);
    let shares = all.iter().map(|p| (p.sampling_std / p.std_error).min(1.0)).filter(|share| share.is_finite());
    let noise = shares.fold(0.0, |sum, share| sum + share) / n as f64;
    let identified = all.iter().filter(|p| p.identified).count() as f64 / tried as f64;
    Some(Promise {
        std_error: median,
        low: if identified > 0.5 { errors[0] / OF_PLANT } else { 0.0 },
        high: errors[n - 1] * OF_PLANT,
        by_noise: noise * median,
        limited_by: largest_cause(&all),
        identified,
    })
}

/// The cause beside noise with the largest part of the variances together.
fn largest_cause(all: &[&Parameter]) -> Option<String> {
    let mut sums: Vec<(&str, f64)> = Vec::new();
    for (parameter, part) in all.iter().flat_map(|p| p.contributions.iter().map(move |part| (p, part))) {
        let share = (part.std / parameter.std_error).powi(2);
        if part.cause == "noise" || !share.is_finite() {
            continue;
        }
        match sums.iter_mut().find(|(cause, _)| *cause == part.cause) {
            Some((_, sum)) => *sum += share,
            None => sums.push((&part.cause, share)),
        }
    }
    sums.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(cause, _)| cause.to_owned())
}

/// The probability that one further drive lies between the smallest and the largest of so many.
pub fn probability(draws: usize) -> f64 {
    (draws as f64 - 1.0) / (draws as f64 + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::Contribution;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn fit(std_error: f64) -> FitReport {
        let contributions = [("noise", 0.8), ("gain of force", 0.6)]
            .map(|(cause, share)| Contribution { cause: cause.into(), std: share * std_error });
        let parameter = Parameter {
            value: 1.0,
            std_error,
            sampling_std: 0.8 * std_error,
            identified: true,
            contributions: contributions.to_vec(),
            ..Parameter::default()
        };
        FitReport { parameters: [("a".to_owned(), parameter)].into(), ..FitReport::default() }
    }

    #[test]
    fn the_middle_is_the_median_and_the_range_holds_all_drives() {
        let fits = [8.0, 1.0, 2.0, 3.0].map(fit);
        let promise = promise("a", &fits, 4).unwrap();
        assert_eq!((promise.low, promise.std_error, promise.high), (1.0 / OF_PLANT, 2.5, 8.0 * OF_PLANT));
        assert!((promise.by_noise - 0.8 * 2.5).abs() < 1e-9);
        assert_eq!((promise.limited_by.as_deref(), promise.identified), (Some("gain of force"), 1.0));
    }

    /// Order statistics of a distribution with two humps, by counting.
    #[test]
    fn one_further_drive_lies_in_the_range_as_often_as_is_said() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut draw = || rng.random::<f64>() + if rng.random::<f64>() < 0.3 { 100.0 } else { 1.0 };
        let inside = (0..20000).filter(|_| {
            let some: Vec<f64> = (0..19).map(|_| draw()).collect();
            let ends = some.iter().fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(*x), high.max(*x)));
            (ends.0..=ends.1).contains(&draw())
        });
        assert!((inside.count() as f64 / 20000.0 - probability(19)).abs() < 0.01);
    }

    #[test]
    fn what_half_of_the_drives_do_not_tell_is_not_promised() {
        let fits = [fit(1.0), fit(1.1), FitReport::default(), FitReport::default()];
        assert_eq!(promise("a", &fits, 4), None);
        assert_eq!(promise("a", &fits, 3).map(|p| (p.identified, p.low > 0.0)), Some((2.0 / 3.0, true)));
    }
}
