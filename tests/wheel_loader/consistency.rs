//! What the loader's estimator says about its own errors.

use super::runs::{drive, out};
use wheelstate::Estimator;
use wheelstate::estimator::wheel_loader::*;
use wheelstate::variable::Estimate;

#[test]
fn no_standard_deviation_grows_beyond_its_limit_however_strong_the_process_noise() {
    let (mut p, limit) = (Parameters::default(), 0.6);
    p.filter.process_psd.slip_stiffness = 100.0;
    p.filter.maximum_std.slip_stiffness = limit;
    let mut estimator = WheelLoader::new(&p).unwrap();
    let mut largest = 0.0_f64;
    for (k, inputs) in drive(20.0, 3.0, 1, |t, _| 4000.0 * (0.8 * t).sin()).iter().enumerate() {
        estimator.step(inputs, 0.01);
        if k == 0 {
            continue; // nothing but the motion begins with the first sample
        }
        largest = largest.max(estimator.state().machine.belief.std(3));
    }
    assert!((largest / limit - 1.0).abs() < 1e-12, "{largest} in logit units, at most {limit} and at times as much");
}

/// What the model leaves out adds its own variance, as far as the data and not the initial values made the estimate.
#[test]
fn soft_tyres_and_a_rough_tyre_model_widen_the_unknowns_by_what_they_can_do() {
    let inputs = drive(30.0, 3.0, 2, |t, _| 6000.0 * (1.5 * t).sin());
    let run = |error: &dyn Fn(&mut ModelError)| {
        let mut p = Parameters::default();
        (p.model_error.slip_stiffness, p.model_error.cg_height, p.model_error.radius_softness) = (0.0, 0.0, 0.0);
        error(&mut p.model_error);
        let mut estimator = WheelLoader::new(&p).unwrap();
        let before = estimator.state().machine.belief;
        inputs.iter().for_each(|inputs| {
            estimator.step(inputs, 0.01);
        });
        let after = estimator.state().machine.belief;
        let learnt = [3, 4, 5].map(|i| 1.0 - (after.std(i) / before.std(i)).powi(2));
        (out(&estimator, inputs.last().unwrap()), learnt, p)
    };
    let (exact, learnt, _) = run(&|_| {});
    let added = |with: Estimate, without: Estimate| with.std.powi(2) - without.std.powi(2);
    let close = |name: &str, added: f64, learnt: f64, std: f64| {
        let expected = learnt * std * std;
        assert!(learnt > 0.0 && (added / expected - 1.0).abs() < 1e-6, "{name}: {added} instead of {expected}");
    };
    let (rough, ..) = run(&|error| (error.slip_stiffness, error.cg_height) = (0.2, 0.1));
    let (stiffness, height) = (exact.slip_stiffness, exact.cg_height);
    close("K", added(rough.slip_stiffness, stiffness), learnt[0], 0.2 * stiffness.value);
    close("h", added(rough.cg_height, height), learnt[1], 0.1 * height.value);
    let (soft, _, p) = run(&|error| error.radius_softness = 0.5);
    let (loader, ratio) = (&p.loader, exact.cg_ratio);
    let radius = 0.5 * (loader.wheel_radius_front + loader.wheel_radius_rear);
    let transfer = 2.0 * 0.5 * stiffness.value * loader.mass * 9.80665 * height.value
        / (loader.wheelbase * p.model_error.tire_stiffness * radius);
    close("lambda", added(soft.cg_ratio, ratio), learnt[2], ratio.value * (1.0 - ratio.value) * transfer);
}

#[test]
fn without_data_no_standard_deviation_falls_below_its_least_one() {
    let mut p = Parameters::default();
    let initial = &mut p.initial;
    (initial.slip_stiffness_std, initial.cg_height_std, initial.cg_ratio_std) = (0.1, 0.005, 0.002);
    let least = &mut p.filter.minimum_std;
    (least.slip_stiffness, least.cg_height, least.cg_ratio) = (0.2, 0.2, 0.2);
    for radii in [Radii::Estimated, Radii::Fixed] {
        p.filter.radii = radii;
        let mut estimator = WheelLoader::new(&p).unwrap();
        let std = |estimator: &WheelLoader| [3, 4, 5].map(|i| estimator.state().machine.belief.std(i));
        assert!(std(&estimator).iter().all(|std| *std < 0.02), "far below at the start: {:?}", std(&estimator));
        for inputs in drive(5.0, 3.0, 3, |_, _| 0.0) {
            estimator.step(&inputs, 0.01);
        }
        assert!(std(&estimator).iter().all(|std| (0.18..0.35).contains(std)), "logit units: {:?}", std(&estimator));
    }
}

/// The load ratio is that of the forces that act now, not that of a machine at rest.
#[test]
fn accelerating_takes_load_off_the_front_axle() {
    let inputs = drive(4.0, 2.0, 4, |_, _| 3000.0);
    let (mut estimator, mut seen) = (WheelLoader::new(&Parameters::default()).unwrap(), Vec::new());
    for inputs in &inputs {
        estimator.step(inputs, 0.01);
        seen.push(out(&estimator, inputs));
    }
    let last = seen.last().unwrap();
    let acceleration = (inputs[399].speed - inputs[299].speed) / 1.0;
    let Parameters { loader, .. } = Parameters::default();
    let shift = acceleration / 9.80665 * last.cg_height.value / loader.wheelbase;
    let lost = last.cg_ratio.value - last.load_ratio.value;
    assert!(shift > 0.02 && (lost / shift - 1.0).abs() < 0.2, "{lost} of the load instead of {shift}");
}
