//! Speed of the solver and of whole fits. Run: `cargo bench -p wheelstate-identify --bench identify`.

use divan::{Bencher, black_box};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::solve::{Loss, Options, Regression, Rows, Scale, Unknown, solve};
use wheelstate_identify::vehicles::nursing_robot;

fn main() {
    divan::main();
}

/// Five unknowns, two of them at a bound, 2 % outliers.
fn bounded(rows: usize) -> Regression {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut normal =
        |std: f64| -> f64 { std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng) };
    let theta = [1.0, -0.5, 0.3, 2.0, 0.05];
    let mut group = Rows::new("rows", "1", 5);
    group.scale = Scale::Known(0.1);
    for i in 0..rows {
        let row: [f64; 5] = std::array::from_fn(|_| normal(1.0));
        let outlier = if i % 50 == 0 { 5.0 } else { 0.0 };
        let rhs = row.iter().zip(theta).map(|(a, b)| a * b).sum::<f64>() + normal(0.1) + outlier;
        group.push(&row, rhs, (i / 12) as u32);
    }
    let unknowns =
        (0..5).map(|j| if j == 4 { Unknown::within("x", 0.1, 5.0) } else { Unknown::within("x", -0.4, 5.0) });
    Regression { name: "bounded".into(), unknowns: unknowns.collect(), groups: vec![group], constraints: Vec::new() }
}

#[divan::bench(args = [Loss::Ls, Loss::Huber, Loss::L1])]
fn rows_20000(bencher: Bencher, loss: Loss) {
    let problem = bounded(20_000);
    bencher.bench_local(|| solve(black_box(&problem), &Options { loss, ..Options::default() }).unwrap());
}

/// Excitation of a nursing robot at 100 Hz.
fn drive(seconds: f64) -> Log {
    let settings = vec![("plant.duration".to_owned(), seconds)];
    nursing_robot::VEHICLE.simulate(&Request { scenario: "identification".into(), seed: 1, settings }).unwrap()
}

fn fit_of(bencher: Bencher, seconds: f64, refine: bool, wheels_only: bool) {
    let mut log = drive(seconds);
    if wheels_only {
        log.channels.retain(|channel| !channel.name.starts_with("tilt") && !channel.name.starts_with("roll"));
    }
    let logs = [log];
    let request = FitRequest { refine, ..FitRequest::default() };
    bencher.bench_local(|| nursing_robot::VEHICLE.fit(black_box(&logs), &request, &Progress::none()).unwrap());
}

#[divan::bench(sample_count = 10)]
fn fit_40_s(bencher: Bencher) {
    fit_of(bencher, 40.0, false, false);
}

#[divan::bench(sample_count = 5)]
fn fit_40_s_refined(bencher: Bencher) {
    fit_of(bencher, 40.0, true, false);
}

#[divan::bench(sample_count = 5)]
fn fit_40_s_wheels_only(bencher: Bencher) {
    fit_of(bencher, 40.0, false, true);
}

#[divan::bench(sample_count = 2, sample_size = 1)]
fn fit_hour(bencher: Bencher) {
    fit_of(bencher, 3600.0, false, false);
}
