//! Machines that what is known so far allows: draws from the covariance of the present fit.
//!
//! What the present logs tell is drawn from the normal distribution with their estimates and covariance, cut off at the
//! range of each parameter and, for a quantity that has no sign, at a quarter and four times its estimate. What they do
//! not tell is drawn with a uniform logarithm from half to twice the value that is taken as known, or from the range that
//! the machine's record supposes. What only special manoeuvres show (a rolling radius, say) keeps its known value, as in
//! the fit, unless it is of interest or what is known of it is a guess to start from (`initial.*`).

use super::promise::told;
use crate::problem::Target;
use crate::result::{FitReport, Parameter};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Draws within the ranges until one is put to their ends.
const TRIES: usize = 100;
/// Range of a quantity without a sign, as multiples of its estimate.
const WITHIN: (f64, f64) = (0.25, 4.0);
/// Range of what nothing is known of, as multiples of the value that is taken as known.
const UNKNOWN: (f64, f64) = (0.5, 2.0);

/// What is known of the parameters that are to be fitted.
#[derive(Clone, Debug, Default)]
pub struct Supposed {
    names: Vec<String>,
    values: DVector<f64>,
    /// Square root `L` of the covariance, `C = L L'`.
    root: DMatrix<f64>,
    ranges: Vec<(f64, f64)>,
    /// What is not told, with the range that is supposed.
    pub unknown: Vec<(String, f64, f64)>,
    /// Its estimate all the same, if there is one within that range.
    estimates: Vec<Option<f64>>,
}

impl Supposed {
    /// From a fit, for these parameters, some of them of interest. `known` is the value that is taken as known of each,
    /// `supposed` has ranges of the machine's record.
    pub fn of(
        fit: Option<&FitReport>,
        targets: &[&Target],
        interest: &[String],
        known: &dyn Fn(&str) -> Option<f64>,
        supposed: &[(&str, f64, f64)],
    ) -> Self {
        let mut all = Self::default();
        let mut values = Vec::new();
        for target in targets {
            let parameter = fit.and_then(|fit| fit.parameters.get(&target.name));
            let (low, high) = target.range;
            // An angle or a bias may well be about zero; of a mass that says nothing.
            let sized = |p: &Parameter| low < 0.0 || p.std_error <= p.value.abs();
            match parameter.filter(|p| told(p) && (low..=high).contains(&p.value) && sized(p)) {
                Some(parameter) => {
                    let (a, b) = (WITHIN.0 * parameter.value, WITHIN.1 * parameter.value);
                    all.ranges.push(if low >= 0.0 { (a.max(low), b.min(high)) } else { (low, high) });
                    all.names.push(target.name.clone());
                    values.push(parameter.value);
                }
                None => {
                    let record = supposed.iter().find(|(name, ..)| *name == target.name).map(|(_, a, b)| (*a, *b));
                    let start = known(&target.name).filter(|value| value.is_finite() && *value != 0.0);
                    let guess = target.name.starts_with("initial.") || interest.contains(&target.name);
                    if target.optional && start.is_some() && !guess {
                        continue;
                    }
                    let (a, b) = match (start, record) {
                        (Some(value), _) if value > 0.0 => (UNKNOWN.0 * value, UNKNOWN.1 * value),
                        (Some(value), _) => (UNKNOWN.1 * value, UNKNOWN.0 * value),
                        (None, Some(range)) => range,
                        // Nothing is known of its size: it stays what the plant takes.
                        (None, None) => continue,
                    };
                    let (a, b) = (a.max(low), b.min(high));
                    let estimate = parameter.filter(|p| told(p)).map(|p| p.value);
                    all.estimates.push(estimate.filter(|value| (a..=b).contains(value)));
                    all.unknown.push((target.name.clone(), a, b));
                }
            }
        }
        all.values = DVector::from_vec(values);
        all.root = root(&all.covariance(fit));
        all
    }

    fn covariance(&self, fit: Option<&FitReport>) -> DMatrix<f64> {
        let n = self.names.len();
        let Some(fit) = fit else { return DMatrix::zeros(n, n) };
        let of = fit.covariance.as_ref();
        let place = |name: &String| of.and_then(|c| c.parameters.iter().position(|other| other == name));
        let places: Vec<Option<usize>> = self.names.iter().map(place).collect();
        DMatrix::from_fn(n, n, |i, j| {
            if i == j {
                return fit.parameters[&self.names[i]].std_error.powi(2);
            }
            match (of, places[i], places[j]) {
                (Some(of), Some(a), Some(b)) if of.matrix[a][b].is_finite() => of.matrix[a][b],
                _ => 0.0,
            }
        })
    }

    /// The estimates, and the geometric middle of what is unknown.
    pub fn middle(&self) -> Vec<(String, f64)> {
        let told = self.names.iter().cloned().zip(self.values.iter().copied());
        let middle = |(name, low, high): &(String, f64, f64)| (name.clone(), between(*low, *high, 0.5));
        told.chain(self.unknown.iter().map(middle)).collect()
    }

    /// A machine, with errors of what is told that are `scale` times those of the fit; with 0 all that has an estimate keeps
    /// it. The same seed gives the same.
    pub fn draw(&self, seed: u64, scale: f64) -> Vec<(String, f64)> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let n = self.names.len();
        let mut drawn = self.values.clone();
        for _ in 0..TRIES {
            let normal = DVector::from_fn(n, |_, _| StandardNormal.sample(&mut rng));
            drawn = &self.values + &self.root * normal * scale;
            if self.ranges.iter().zip(drawn.iter()).all(|((low, high), value)| (low..=high).contains(&value)) {
                break;
            }
        }
        let within = drawn.iter().zip(&self.ranges).map(|(value, (low, high))| value.clamp(*low, *high));
        let mut all: Vec<(String, f64)> = self.names.iter().cloned().zip(within).collect();
        for ((name, low, high), estimate) in self.unknown.iter().zip(&self.estimates) {
            let drawn = between(*low, *high, rng.random::<f64>());
            all.push((name.clone(), estimate.filter(|_| scale == 0.0).unwrap_or(drawn)));
        }
        all
    }
}

/// From `low` to `high`, evenly in the logarithm where both have one sign.
fn between(low: f64, high: f64, share: f64) -> f64 {
    if low * high > 0.0 { low * (high / low).powf(share) } else { low + share * (high - low) }
}

/// `L` with `C = L L'` by the eigenvalues of the correlations; negative ones, which rounding makes, count as zero.
fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let n = covariance.nrows();
    if n == 0 {
        return DMatrix::zeros(0, 0);
    }
    let std = DVector::from_fn(n, |i, _| covariance[(i, i)].sqrt());
    let scaled = DMatrix::from_fn(n, n, |i, j| covariance[(i, j)] / (std[i] * std[j]));
    let eigen = scaled.symmetric_eigen();
    DMatrix::from_fn(n, n, |i, j| std[i] * eigen.eigenvectors[(i, j)] * eigen.eigenvalues[j].max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::Covariance;

    fn target(name: &str) -> Target {
        Target {
            name: name.into(),
            unit: "1".into(),
            range: (0.0, 100.0),
            usual: true,
            optional: false,
            contested: false,
        }
    }

    #[test]
    fn draws_have_mean_and_covariance_of_the_fit_and_the_unknown_its_range() {
        let parameter = |value: f64, std_error: f64| Parameter { value, std_error, ..Parameter::default() };
        let fit = FitReport {
            parameters: [("a".to_owned(), parameter(10.0, 1.0)), ("b".to_owned(), parameter(20.0, 2.0))].into(),
            covariance: Some(Covariance {
                parameters: vec!["a".into(), "b".into()],
                matrix: vec![vec![1.0, -1.2], vec![-1.2, 4.0]],
            }),
            ..FitReport::default()
        };
        let targets = ["a", "b", "c", "d", "e"].map(target);
        let known = |name: &str| (name == "c").then_some(3.0);
        let ranges = [("c", 0.0, 1.0), ("d", 0.0, 0.02)];
        let supposed = Supposed::of(Some(&fit), &targets.each_ref(), &[], &known, &ranges);
        let unknown = [("c".to_owned(), 1.5, 6.0), ("d".to_owned(), 0.0, 0.02)];
        assert_eq!(supposed.unknown, unknown);
        let draws: Vec<Vec<f64>> =
            (0..4000).map(|seed| supposed.draw(seed, 1.0).into_iter().map(|(_, value)| value).collect()).collect();
        let mean = |f: &dyn Fn(&[f64]) -> f64| draws.iter().map(|draw| f(draw)).sum::<f64>() / 4000.0;
        assert!((mean(&|d| d[0]) - 10.0).abs() < 0.06 && (mean(&|d| d[1]) - 20.0).abs() < 0.12);
        assert!((mean(&|d| (d[0] - 10.0) * (d[1] - 20.0)) + 1.2).abs() < 0.15);
        assert!(supposed.draw(1, 0.0)[..2] == [("a".to_owned(), 10.0), ("b".to_owned(), 20.0)]);
        assert!(draws.iter().all(|d| (1.5..=6.0).contains(&d[2]) && (0.0..=0.02).contains(&d[3]) && d.len() == 4));
    }
}
