//! The sliding-mode observer's account of its own error, against errors that are made one cause at a time.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::filter::sliding_mode::{Adaptation, ForcedMotion, Knowledge, SlidingMode, SlidingModeState};

/// `J w' = T - R F`
struct Wheel;

const INERTIA: f64 = 1.2;
const RADIUS: f64 = 0.3;
const DT: f64 = 0.005;

impl ForcedMotion for Wheel {
    fn acceleration(&self, torque: f64, force: f64) -> f64 {
        (torque - RADIUS * force) / INERTIA
    }
    fn balance(&self, torque: f64) -> f64 {
        torque / RADIUS
    }
    fn force_per_acceleration(&self) -> f64 {
        INERTIA / RADIUS
    }
}

/// Linear, so that its errors are those of a low-pass of rate `gain`.
fn observer(feedforward: bool) -> SlidingMode {
    SlidingMode {
        gain: 40.0,
        amplitude: 0.0,
        steepness: 1.0,
        nominal_rate: 0.0,
        force_limit: f64::INFINITY,
        feedforward,
        adaptation: None,
    }
}

const EXACT: Knowledge = Knowledge { speed_noise: 0.0, torque_noise: 0.0, torque_bias: 0.0, inertia_error: 0.0 };

/// Feeds `count` samples of speed and torque; the state after them.
fn fed(observer: &SlidingMode, count: usize, mut sample: impl FnMut(f64) -> (f64, f64)) -> SlidingModeState {
    let mut state = observer.start();
    for k in 0..count {
        let (speed, torque) = sample(k as f64 * DT);
        observer.step(&Wheel, &mut state, speed, torque, DT);
    }
    state
}

/// Noise that does not last has no lag.
fn std(observer: &SlidingMode, state: &SlidingModeState, known: Knowledge) -> f64 {
    observer.force_std(&Wheel, &SlidingModeState { lag: 0.0, swing: 0.0, torque_lag: 0.0, ..*state }, &known, DT)
}

#[test]
fn white_noise_of_speed_and_torque_scatters_the_force_as_the_error_budget_says() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut noise = |std: f64| -> f64 {
        let draw: f64 = StandardNormal.sample(&mut random);
        std * draw
    };
    for (feedforward, speed_noise, torque_noise) in [(false, 0.02, 0.0), (false, 0.0, 3.0), (true, 0.0, 3.0)] {
        let observer = observer(feedforward);
        let mut state = observer.start();
        let (mut square, count) = (0.0, 100_000);
        for _ in 0..count {
            let force = observer.step(&Wheel, &mut state, 10.0 + noise(speed_noise), noise(torque_noise), DT);
            square += force * force;
        }
        let (scatter, known) = ((square / f64::from(count)).sqrt(), Knowledge { speed_noise, torque_noise, ..EXACT });
        let reported = std(&observer, &state, known);
        assert!(
            (scatter / reported - 1.0).abs() < 0.03,
            "{feedforward} {speed_noise}: {scatter} N, reported {reported} N"
        );
    }
}

#[test]
fn a_wrong_torque_or_inertia_shifts_the_force_by_what_the_error_budget_says() {
    let observer = observer(false);
    let bias = 6.0;
    let state = fed(&observer, 1000, |_| (10.0, bias));
    let reported = std(&observer, &state, Knowledge { torque_bias: bias, ..EXACT });
    assert!((reported - state.force.abs()).abs() < 1e-6 * reported, "{reported} N for {} N", state.force);
    // a wheel of a tenth more inertia that nothing holds back
    let torque = 1.1 * INERTIA * 2.0;
    let state = fed(&observer, 1000, |t| (2.0 * t, torque));
    let reported = std(&observer, &state, Knowledge { inertia_error: 0.1, ..EXACT });
    assert!((reported - state.force.abs()).abs() < 1e-3 * reported, "{reported} N for {} N", state.force);
}

#[test]
fn a_force_that_changes_is_late_and_held_as_the_error_budget_says() {
    let observer = observer(false);
    let rate = 500.0; // N/s
    let wheel = |t: f64| (50.0 - RADIUS / INERTIA * 0.5 * rate * t * t, 0.0);
    let mut state = fed(&observer, 1000, wheel);
    let late = 999.0 * DT * rate - state.force;
    let reported = observer.force_std(&Wheel, &state, &EXACT, DT);
    // sampled, the lag is up to half a sample shorter
    assert!((1.0..1.15).contains(&(reported / late)), "{reported} N for {late} N");
    for _ in 0..20 {
        observer.step(&Wheel, &mut state, f64::NAN, 0.0, DT);
    }
    let held = 20.0 * DT * rate;
    let reported = observer.force_std(&Wheel, &state, &EXACT, DT);
    assert!((reported / late.hypot(held) - 1.0).abs() < 0.1, "{reported} N for {late} N late and {held} N held");
}

/// A wheel that rolls at constant speed: its force is the torque over the radius.
#[test]
fn a_force_that_steps_with_the_torque_is_never_further_off_than_reported() {
    let observer = SlidingMode { nominal_rate: 8.0, ..observer(false) };
    let mut state = fed(&observer, 500, |_| (10.0, 0.0));
    for (torque, count) in [(40.0, 300), (-90.0, 7), (15.0, 300)] {
        for k in 0..count {
            let force = observer.step(&Wheel, &mut state, 10.0, torque, DT);
            let (off, reported) = (force - torque / RADIUS, observer.force_std(&Wheel, &state, &EXACT, DT));
            assert!(
                off.abs() < 1.001 * reported + 1e-9,
                "{torque} N.m, sample {k}: {off} N off, reported {reported} N"
            );
        }
    }
}

#[test]
fn independent_causes_add_up_in_squares() {
    let observer = observer(false);
    let state = SlidingModeState { lag: 3.0, swing: 3.0, stale: 2, acceleration: -4.0, ..observer.start() };
    let all = Knowledge { speed_noise: 0.02, torque_noise: 3.0, torque_bias: 1.5, inertia_error: 0.2 };
    let of = |lag: f64, known: Knowledge| {
        observer.force_std(&Wheel, &SlidingModeState { lag, swing: lag, ..state }, &known, DT)
    };
    let parts = [
        of(3.0, EXACT),
        of(0.0, Knowledge { speed_noise: all.speed_noise, ..EXACT }),
        of(0.0, Knowledge { torque_noise: all.torque_noise, ..EXACT }),
        of(0.0, Knowledge { torque_bias: all.torque_bias, ..EXACT }),
        of(0.0, Knowledge { inertia_error: all.inertia_error, ..EXACT }),
    ];
    assert!(parts.iter().all(|part| *part > 0.0), "{parts:?}");
    let sum = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
    assert!((of(3.0, all) - sum).abs() < 1e-9 * sum);
}

/// `eps <- clip(eps + dt gamma |s| (+1 if |s| > dead zone else -1), least, greatest)`
#[test]
fn the_amplitude_grows_with_an_error_beyond_the_dead_zone_and_shrinks_within() {
    let law = Adaptation { rate: 50.0, dead_zone: 0.1, least: 1.0, greatest: 3.0 };
    let observer = SlidingMode { amplitude: 2.0, adaptation: Some(law), ..observer(false) };
    let after = |error: f64, amplitude: f64| {
        let mut state = SlidingModeState { speed: 10.0, started: true, amplitude, ..observer.start() };
        observer.step(&Wheel, &mut state, 10.0 + error, 0.0, DT);
        state.amplitude
    };
    for (error, expected) in
        [(0.4, 2.0 + DT * 50.0 * 0.4), (-0.4, 2.0 + DT * 50.0 * 0.4), (0.05, 2.0 - DT * 50.0 * 0.05)]
    {
        assert!((after(error, 2.0) - expected).abs() < 1e-12, "{error}: {}", after(error, 2.0));
    }
    assert_eq!((after(5.0, 2.95), after(0.09, 1.001)), (3.0, 1.0), "within its limits");
}
