//! Bad, missing and strange inputs of the loader's estimator, and its state.

use super::runs::{begun, drive, finite, lively, out, run};
use crate::support::assert_close;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use wheelstate::estimator::wheel_loader::*;
use wheelstate::{Estimator, Status};

#[test]
fn dropped_samples_are_bridged_and_long_gaps_hold() {
    let clean = drive(20.0, 2.5, 8, lively);
    let mut samples = clean.clone();
    for (k, inputs) in samples.iter_mut().enumerate() {
        match k {
            300..330 => inputs.wheel_speed_front = f64::NAN,
            500..530 | 1000..1150 => {
                (inputs.speed, inputs.wheel_speed_front, inputs.wheel_speed_rear) = (f64::NAN, f64::INFINITY, f64::NAN);
            }
            _ => {}
        }
    }
    // A speed that might be late is not healthy before it is known not to be.
    let mut parameters = Parameters::default();
    parameters.filter.measurement_std.speed_delay = 0.0;
    let mut estimator = begun(&parameters);
    let outs = run(&mut estimator, &samples);
    assert!(outs[310].diagnostics.status.contains(Status::MISSING) && !outs[310].hold);
    assert!(outs[510].diagnostics.status.contains(Status::NO_MEASUREMENT | Status::INFINITE) && !outs[510].hold);
    assert!(!outs[1045].hold && outs[1060].hold, "50 samples are bridged, not more");
    assert!(outs[1090].diagnostics.healthy && !outs[1110].diagnostics.healthy, "and a second later nothing is usable");
    assert_close("prediction", outs[529].speed_estimate.value, clean[529].speed, 0.0, 0.3);
    assert!(!outs[1400].hold, "estimation goes on");
    assert!((outs[1999].cg_ratio.value - 0.45).abs() < 3.0 * outs[1999].cg_ratio.std);
}

#[test]
fn a_bad_drive_input_is_replaced_for_fifty_samples_then_held() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        let mut samples = drive(15.0, 2.5, 9, lively);
        for inputs in &mut samples[600..700] {
            inputs.torque_front = bad;
        }
        samples[900].slope = bad;
        samples[901].spading_force_z = bad;
        let mut estimator = begun(&Parameters::default());
        let outs = run(&mut estimator, &samples);
        assert!(outs[620].diagnostics.status.contains(Status::HELD_INPUT) && !outs[620].hold);
        assert!(outs[660].hold && !outs[660].diagnostics.healthy);
        assert_eq!(outs[660].diagnostics.status.contains(Status::INFINITE), bad.is_infinite());
        assert_eq!(outs[660].diagnostics.status.contains(Status::IMPLAUSIBLE), bad == 1e300);
        assert!(!outs[800].hold && outs[900].diagnostics.status.contains(Status::HELD_INPUT) && !outs[902].hold);
        assert!((outs[1499].cg_ratio.value - 0.45).abs() < 3.0 * outs[1499].cg_ratio.std);
    }
}

/// Neither brakes nor slope nor bucket have a sensor here: they are 0 for good, and old values of nothing.
#[test]
fn an_input_that_was_never_connected_does_not_hold() {
    let mut estimator = begun(&Parameters::default());
    let mut samples = drive(15.0, 2.5, 18, lively);
    samples.iter_mut().for_each(|inputs| inputs.slope = f64::NAN);
    let outs = run(&mut estimator, &samples);
    for out in &outs {
        assert!(out.diagnostics.status.contains(Status::NEVER_SET));
        assert!(!out.diagnostics.status.contains(Status::HELD_INPUT));
    }
    assert!(outs[100..].iter().all(|out| !out.hold));
    assert!(outs[1499].diagnostics.healthy && (outs[1499].cg_ratio.value - 0.45).abs() < 3.0 * outs[1499].cg_ratio.std);
}

/// At the start as after a gap the motion is unknown, and said to be, until something is measured: then it is what was
/// measured, however fast.
#[test]
fn the_motion_begins_with_the_first_measurement() {
    let samples = drive(12.0, 8.0, 19, |_, v| 380.0 + 500.0 * (8.0 - v));
    let nothing =
        Inputs { speed: f64::NAN, wheel_speed_front: f64::NAN, wheel_speed_rear: f64::NAN, ..samples[0].clone() };
    let mut estimator = begun(&Parameters::default());
    for (gap, settling) in [(0.01, 48..60), (20.0, 15..20)] {
        let status = estimator.step(&nothing, gap);
        assert!(status.contains(Status::HOLD | Status::NO_MEASUREMENT));
        for inputs in [&nothing; 3] {
            estimator.step(inputs, 0.01);
            let out = out(&estimator, inputs);
            assert!(out.speed_estimate.std >= 1.0 && out.hold && !out.diagnostics.healthy, "{out:?}");
        }
        estimator.step(&samples[0], 0.01);
        assert_close("speed", out(&estimator, &samples[0]).speed_estimate.value, samples[0].speed, 0.0, 1e-12);
        let outs = run(&mut estimator, &samples[1..]);
        assert!(outs.iter().all(|out| !out.diagnostics.status.intersects(Status::GATED | Status::RESTARTED)));
        let held = outs.iter().take_while(|out| out.hold).count();
        assert!(settling.contains(&held), "{held}");
    }
}

#[test]
fn a_jump_of_all_sensors_is_rejected_then_followed_and_changes_no_unknown() {
    let mut samples = drive(12.0, 2.5, 10, lively);
    for inputs in &mut samples[600..] {
        inputs.speed += 1.0;
        inputs.wheel_speed_front += 1.0 / 0.55;
        inputs.wheel_speed_rear += 1.0 / 0.55;
    }
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &samples);
    let rejected = outs[600..].iter().take_while(|out| out.diagnostics.status.contains(Status::GATED)).count();
    assert!(rejected <= 20, "{rejected}");
    assert!(
        outs[600].diagnostics.status.contains(Status::GATED)
            && outs[600 + rejected].diagnostics.status.contains(Status::RESTARTED)
    );
    assert_close("speed", outs[680].speed_estimate.value, samples[680].speed, 0.0, 0.1);
    let (before, after) = (&outs[599], &outs[1199]);
    assert!((after.cg_ratio.value - before.cg_ratio.value).abs() < 2.0 * before.cg_ratio.std, "{before:?} {after:?}");
}

#[test]
fn one_outlier_is_rejected() {
    let mut samples = drive(8.0, 2.5, 11, lively);
    samples[500].wheel_speed_rear += 0.5;
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &samples);
    assert!(
        outs[500].diagnostics.status.contains(Status::GATED) && !outs[501].diagnostics.status.contains(Status::GATED)
    );
}

#[test]
fn parameters_are_refused_before_the_first_sample() {
    use wheelstate::Variables;
    for (name, value) in [
        ("loader.mass", 0.0),
        ("loader.mass", -1.0),
        ("loader.wheelbase", 0.0),
        ("loader.wheel_radius_front", 0.0),
        ("loader.axle_inertia_rear", -3.0),
        ("rolling.coefficient", -0.01),
        ("filter.measurement_std.speed", 0.0),
        ("filter.substeps", 0.0),
        ("filter.beta", 0.5),
        ("initial.cg_ratio", 0.95),
        ("initial.cg_height", 0.2),
        ("initial.slip_stiffness", 100.0),
        ("sample_period", 0.0),
        ("sample_period", f64::NAN),
    ] {
        let mut p = Parameters::default();
        let error = p.set(name, value).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
    let mut p = Parameters::default();
    p.loader.mass = f64::NAN;
    assert!(WheelLoader::new(&p).unwrap_err().to_string().contains("loader.mass"));
    let mut p = Parameters::default();
    (p.filter.alpha, p.filter.beta) = (2.0, 3.9);
    assert!(WheelLoader::new(&p).unwrap_err().to_string().contains("filter.beta"));
    let mut p = Parameters::default();
    p.hold.resume_speed = 0.1;
    assert!(WheelLoader::new(&p).unwrap_err().to_string().contains("hold.resume_speed"));
}

#[test]
fn bad_steps_change_nothing_and_long_ones_are_subdivided() {
    let samples = drive(6.0, 2.5, 12, lively);
    let mut estimator = begun(&Parameters::default());
    run(&mut estimator, &samples);
    let before = estimator.state().clone();
    for dt in [0.0, -0.01, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let status = estimator.step(&samples[599], dt);
        assert!(status.contains(Status::BAD_STEP | Status::SKIPPED), "{dt}");
        assert_eq!(estimator.state().machine.belief, before.machine.belief, "{dt}");
    }
    // A gap of seconds: the motion begins anew, the unknowns stay.
    let mut gap = estimator.clone();
    let status = gap.step(&samples[599], 5.0);
    assert!(status.contains(Status::BAD_STEP | Status::RESTARTED));
    let (a, b) = (out(&gap, &samples[599]), out(&estimator, &samples[599]));
    assert_eq!((a.cg_ratio.value, a.cg_ratio.std), (b.cg_ratio.value, b.cg_ratio.std));
    // A log at 12.5 Hz: 80 ms steps.
    let mut slow = begun(&Parameters { sample_period: 0.08, ..Parameters::default() });
    let samples = drive(60.0, 2.5, 13, lively);
    for inputs in samples.iter().step_by(8) {
        assert!(!slow.step(inputs, 0.08).contains(Status::BAD_STEP));
        finite(&out(&slow, inputs));
    }
    let last = out(&slow, &samples[0]);
    assert!((last.cg_ratio.value - 0.45).abs() < 3.0 * last.cg_ratio.std, "{last:?}");
}

#[test]
fn a_stored_state_continues_with_the_same_bytes() {
    let samples = drive(8.0, 2.5, 16, lively);
    let mut estimator = begun(&Parameters::default());
    run(&mut estimator, &samples[..400]);
    let mut other = begun(&Parameters::default());
    other.restore(estimator.state()).unwrap();
    for inputs in &samples[400..] {
        assert_eq!(estimator.step(inputs, 0.01), other.step(inputs, 0.01));
    }
    assert_eq!(serde_json::to_string(estimator.state()).unwrap(), serde_json::to_string(other.state()).unwrap());
    let mut fixed = Parameters::default();
    fixed.filter.radii = Radii::Fixed;
    assert!(begun(&fixed).restore(estimator.state()).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever comes in, what goes out is finite and within the physical limits.
    #[test]
    fn nothing_makes_an_estimate_infinite(
        seed in any::<u64>(), kind in prop::bool::ANY, radii in prop::bool::ANY, wild in 0.0..1.0f64
    ) {
        use rand::RngExt;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut p = Parameters::default();
        p.filter.kind = if kind { Kind::Extended } else { Kind::SquareRootUnscented };
        p.filter.radii = if radii { Radii::Estimated } else { Radii::Fixed };
        let mut estimator = begun(&p);
        let base = Inputs { torque_front: 1000.0, torque_rear: 900.0, speed: 2.0, wheel_speed_front: 3.65, wheel_speed_rear: 3.66, ..Inputs::default() };
        use wheelstate::Variables;
        for _ in 0..300 {
            let mut flat = base.to_vec();
            for value in &mut flat {
                if random.random::<f64>() < wild * 0.3 {
                    *value = match random.random_range(0..6) {
                        0 => f64::NAN,
                        1 => f64::INFINITY,
                        2 => -1e30,
                        3 => 1e7 * (random.random::<f64>() - 0.5),
                        4 => 0.0,
                        _ => 20.0 * (random.random::<f64>() - 0.5),
                    };
                }
            }
            let mut inputs = Inputs::default();
            inputs.read(&flat);
            let dt = match random.random_range(0..20) { 0 => f64::NAN, 1 => 0.3, 2 => 2.0, 3 => 0.0, _ => 0.01 };
            estimator.step(&inputs, dt);
            let mut out = Outputs::default();
            estimator.outputs(&inputs, 0.02 * random.random::<f64>(), &mut out);
            finite(&out);
            prop_assert!((0.1..=0.9).contains(&out.cg_ratio.value) && (0.3..=2.5).contains(&out.cg_height.value));
            prop_assert!(out.cg_ratio.std >= 0.0 && (0.0..=1.0).contains(&out.load_ratio.value));
        }
    }
}
