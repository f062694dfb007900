//! Recursive least squares: what it says about its own error.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::filter::rls::{Config, Forgetting, Rls};

const DT: f64 = 0.01;

/// A filter whose covariance is held at 1, so that its variance is that of the residual.
fn config() -> Config {
    Config {
        forgetting: Forgetting::Fixed(1.0),
        initial_forgetting: 1.0,
        covariance: (1.0, 1.0),
        bounds: (-1e6, 1e6),
        gate: 1e6,
        pooled: 1,
        persistence: 0.0,
        expected_residual: 1.0,
    }
}

/// Feeds residuals: with so small a regressor the measurement is noise alone.
struct Noisy {
    config: Config,
    rls: Rls<0>,
}

impl Noisy {
    fn new() -> Self {
        let config = config();
        let mut rls = Rls::new(&config, 0.0);
        rls.correct(&config, 1.0, 0.0, &[], DT);
        Self { config, rls }
    }

    /// Takes a residual; returns the variance that is reported then.
    fn take(&mut self, residual: f64) -> f64 {
        self.rls.correct(&self.config, 1e-9, residual, &[], DT);
        self.rls.variance(&[])
    }
}

/// A mass that is weighed on a rough floor after a smooth one (or the other way round) must soon be reported as
/// less (or more) certain: some seconds at 100 Hz, after which the floor before no longer counts.
#[test]
fn the_reported_noise_follows_the_noise_within_some_hundred_samples() {
    for (before, after) in [(1.0, 3.0), (3.0, 1.0)] {
        let mut noisy = Noisy::new();
        // Alternating signs: as little correlation as white noise, without its chance.
        let size = |k: i32| if k % 2 == 0 { 1.0 } else { -1.0 };
        let mut reported = 0.0;
        (0..5000).for_each(|k| reported = noisy.take(before * size(k)));
        assert!((reported / (before * before) - 1.0).abs() < 1e-3, "{reported}");
        let share = |reported: f64| (reported - before * before) / (after * after - before * before);
        let shares: Vec<f64> = (0..1500).map(|k| share(noisy.take(after * size(k)))).collect();
        assert!(shares[99] < 0.4, "a second says little: {}", shares[99]);
        assert!((0.5..0.75).contains(&shares[299]), "three seconds count most: {}", shares[299]);
        assert!(shares[1199] > 0.97, "what is older than ten seconds is forgotten: {}", shares[1199]);
    }
}

/// The shorter the memory the more the reported variance scatters about the true one.
#[test]
fn the_reported_noise_of_white_residuals_scatters_by_some_per_cent() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut noisy = Noisy::new();
    let reported: Vec<f64> = (0..200_000).map(|_| noisy.take(StandardNormal.sample(&mut rng))).skip(5000).collect();
    let mean = reported.iter().sum::<f64>() / reported.len() as f64;
    let scatter = (reported.iter().map(|x| (x / mean - 1.0).powi(2)).sum::<f64>() / reported.len() as f64).sqrt();
    println!("mean {mean:.3}, scatter {scatter:.3}");
    assert!((1.0..1.1).contains(&mean), "{mean}");
    assert!(scatter < 0.12, "{scatter}");
}

#[test]
fn a_stored_filter_with_an_impossible_number_is_not_valid() {
    let filter = Noisy::new().rls;
    assert!(filter.is_valid());
    let stored = serde_json::to_value(filter).unwrap();
    for (group, name, value) in [
        ("", "/covariance", 0.0),
        ("", "/covariance", -1.0),
        ("", "/forgetting", 0.0),
        ("", "/forgetting", -0.5),
        ("/noise", "/weight", 0.0),
        ("/noise", "/weight", -1.0),
        ("/noise", "/power", -1e-9),
    ] {
        let mut spoilt = stored.clone();
        *spoilt.pointer_mut(&format!("{group}{name}")).unwrap() = value.into();
        let spoilt: Rls<0> = serde_json::from_value(spoilt).unwrap();
        assert!(!spoilt.is_valid(), "{group}{name} = {value}");
    }
}

/// With a memory for the error only one that keeps its sign relative to the regressor is forgotten fast: the estimate is
/// wrong then, and the sample is not merely noisy.
#[test]
fn an_error_that_persists_is_forgotten_fast_and_noise_of_the_same_size_is_not() {
    let config = Config {
        forgetting: Forgetting::Threshold { fast: 0.9, slow: 0.999, low: 0.2, high: 1.0 },
        covariance: (1e-6, 1e6),
        persistence: 0.5,
        ..config()
    };
    let run = |residual: &dyn Fn(usize, f64) -> f64| {
        let mut rls: Rls<0> = Rls::new(&config, 0.0);
        rls.correct(&config, 1.0, 0.0, &[], DT);
        let mut least = 1.0_f64;
        for k in 0..400 {
            let regressor = if k % 2 == 0 { 1e-3 } else { -1e-3 };
            rls.correct(&config, regressor, residual(k, regressor), &[], DT);
            least = least.min(rls.forgetting);
        }
        least
    };
    let persistent = run(&|_, regressor| 1.5 * regressor.signum());
    let noisy = run(&|k, _| if k % 4 < 2 { 1.5 } else { -1.5 });
    assert!(persistent < 0.91, "a wrong estimate: {persistent}");
    assert!(noisy > 0.998, "noise: {noisy}");
}
