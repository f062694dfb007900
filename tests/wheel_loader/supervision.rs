//! The loader's estimator where data say nothing or contradict each other.

use super::runs::{begun, drive, lively, out, run, unknowns};
use crate::support::assert_close;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::wheel_loader::*;
use wheelstate::{Estimator, Status};

#[test]
fn standstill_changes_nothing() {
    let mut estimator = begun(&Parameters::default());
    let before = unknowns(&out(&estimator, &Inputs::default()));
    for out in run(&mut estimator, &drive(60.0, 0.0, 1, |_, _| 0.0)) {
        assert!(out.hold && out.diagnostics.status.contains(Status::HOLD));
        for (now, before) in unknowns(&out).iter().zip(before) {
            assert_close("held", *now, before, 1e-10, 0.0);
        }
        assert!((out.load_ratio.value - 0.45).abs() < 0.02, "the load ratio of a standing machine is its static one");
    }
}

#[test]
fn coasting_moves_the_unknowns_only_within_their_std() {
    let mut p = Parameters::default();
    // The radii are those of the speed, whose scale would hide what coasting says of them.
    p.filter.measurement_std.speed_scale = 0.0;
    let mut estimator = begun(&p);
    let before = unknowns(&out(&estimator, &Inputs::default()));
    let outs = run(&mut estimator, &drive(10.0, 5.0, 2, |_, _| 0.0));
    let after = unknowns(&outs[outs.len() - 1]);
    for i in 0..3 {
        assert!((after[i] - before[i]).abs() < after[3 + i], "{before:?} {after:?}");
    }
    // Coasting is what the radii are known from.
    let last = &outs[outs.len() - 1];
    assert!(
        last.wheel_radius_front.std < 0.9 * 0.55 * Initial::default().wheel_radius_std,
        "{}",
        last.wheel_radius_front.std
    );
}

#[test]
fn torque_without_slip_is_called_inconsistent_and_resets_the_unknowns() {
    for (seed, noise) in [(3, 0.0), (4, 0.02)] {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noisy = |value: f64| {
            let draw: f64 = StandardNormal.sample(&mut random);
            value + noise * draw
        };
        let mut contradiction = |k: usize| {
            let v = 2.0 + 0.001 * k as f64;
            Inputs {
                torque_front: 1000.0,
                torque_rear: 1000.0,
                speed: noisy(v),
                wheel_speed_front: noisy(v / 0.55),
                wheel_speed_rear: noisy(v / 0.55),
                ..Inputs::default()
            }
        };
        let mut estimator = begun(&Parameters::default());
        let start = unknowns(&out(&estimator, &Inputs::default()));
        let samples: Vec<Inputs> = (0..1200).map(&mut contradiction).collect();
        let outs = run(&mut estimator, &samples);
        let raised = outs.iter().position(|out| out.slip_inconsistent).expect("never noticed");
        println!("noise {noise}: noticed after {:.2} s", 0.01 * raised as f64);
        assert!((500..=900).contains(&raised), "{raised}");
        for out in &outs[raised..] {
            assert!(out.hold && out.slip_inconsistent && !out.diagnostics.healthy);
            assert!(out.diagnostics.status.contains(Status::SLIP | Status::HOLD));
            for (now, start) in unknowns(out).iter().zip(start) {
                assert_close("what contradictory data taught", *now, start, 1e-9, 0.0);
            }
        }
        // Sound data clear the flag.
        let outs = run(&mut estimator, &drive(40.0, 2.5, 5, lively));
        let last = &outs[outs.len() - 1];
        assert!(!last.slip_inconsistent && !last.hold && (last.cg_ratio.value - 0.45).abs() < 2.0 * last.cg_ratio.std);
    }
}

/// What sets a channel to another unit or turns its sign, within seconds of driving; while it lasts nothing is learnt
/// from it and nothing is healthy. Sound data clear it.
#[test]
fn wrong_units_and_signs_contradict() {
    let per_minute = 60.0 / std::f64::consts::TAU;
    type Change = fn(&mut Inputs, f64);
    let wrongs: [(&str, Change, f64); 9] = [
        ("front wheel in rpm", |inputs, factor| inputs.wheel_speed_front *= factor, per_minute),
        ("rear wheel in rpm", |inputs, factor| inputs.wheel_speed_rear *= factor, per_minute),
        (
            "wheels in rpm",
            |inputs, factor| {
                inputs.wheel_speed_front *= factor;
                inputs.wheel_speed_rear *= factor;
            },
            per_minute,
        ),
        ("front wheel turned", |inputs, factor| inputs.wheel_speed_front *= factor, -1.0),
        ("speed in km/h", |inputs, factor| inputs.speed *= factor, 3.6),
        ("speed in mile/h", |inputs, factor| inputs.speed *= factor, 2.237),
        ("speed turned", |inputs, factor| inputs.speed *= factor, -1.0),
        (
            "torques turned",
            |inputs, factor| {
                inputs.torque_front *= factor;
                inputs.torque_rear *= factor;
            },
            -1.0,
        ),
        ("front torque turned", |inputs, factor| inputs.torque_front *= factor, -1.0),
    ];
    let sound = drive(30.0, 2.5, 20, lively);
    for (what, wrong, factor) in wrongs {
        let mut samples = sound.clone();
        samples.iter_mut().for_each(|inputs| wrong(inputs, factor));
        let mut estimator = begun(&Parameters::default());
        let outs = run(&mut estimator, &samples);
        let raised = outs.iter().position(|out| out.diagnostics.status.contains(Status::CONTRADICTED));
        println!("{what}: after {raised:?} samples");
        assert!(raised.is_some_and(|raised| (500..2000).contains(&raised)), "{what}: {raised:?}");
        for out in &outs[raised.unwrap()..] {
            assert!(out.hold && out.slip_inconsistent && !out.diagnostics.healthy, "{what} {out:?}");
        }
        let outs = run(&mut estimator, &drive(40.0, 2.5, 21, lively));
        let last = &outs[outs.len() - 1];
        assert!(!last.diagnostics.status.contains(Status::CONTRADICTED) && last.diagnostics.healthy, "{what}");
        assert!((last.cg_ratio.value - 0.45).abs() < 2.0 * last.cg_ratio.std, "{what}");
    }
}

/// 16 kN at one axle is about what its tyres hold; a tenth of that spins no wheel for seconds.
#[test]
fn a_wheel_spins_under_full_torque_and_not_without() {
    for (torque, contradicts) in [(9000.0, false), (900.0, true)] {
        let mut samples = drive(12.0, 2.5, 22, lively);
        for inputs in &mut samples[400..] {
            inputs.torque_front = torque;
            inputs.wheel_speed_front *= 1.4;
        }
        let outs = run(&mut begun(&Parameters::default()), &samples);
        assert!(outs[410..].iter().all(|out| out.hold && out.diagnostics.status.contains(Status::SLIP)));
        let contradicted = outs.iter().any(|out| out.diagnostics.status.contains(Status::CONTRADICTED));
        assert_eq!(contradicted, contradicts, "{torque} N.m");
    }
}

#[test]
fn slip_against_the_torque_is_inconsistent_too() {
    let mut samples = drive(15.0, 2.5, 6, lively);
    for inputs in &mut samples {
        inputs.torque_front = -inputs.torque_front;
        inputs.torque_rear = -inputs.torque_rear;
    }
    let mut estimator = begun(&Parameters::default());
    assert!(run(&mut estimator, &samples).iter().any(|out| out.slip_inconsistent));
}

#[test]
fn a_spinning_wheel_holds_while_it_spins() {
    let mut samples = drive(12.0, 2.5, 7, lively);
    for inputs in &mut samples[400..500] {
        inputs.wheel_speed_front *= 1.4;
    }
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &samples);
    let before = unknowns(&outs[399]);
    for out in &outs[400..500] {
        assert!(out.hold && out.diagnostics.status.contains(Status::SLIP));
        for (now, before) in unknowns(out).iter().zip(before) {
            assert_close("held", *now, before, 1e-10, 0.0);
        }
    }
    assert!(outs[520..].iter().all(|out| !out.hold), "0.2 s after the wheel grips again");
    assert!((outs[1199].cg_ratio.value - 0.45).abs() < 0.05);
}

#[test]
fn long_cruising_does_not_collapse_the_covariance() {
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &drive(200.0, 2.0, 14, |_, v| 380.0 + 500.0 * (2.0 - v)));
    let last = &outs[outs.len() - 1];
    println!("{:?}", unknowns(last));
    assert!(last.cg_height.std > 0.12, "cruising says nothing about the height");
    assert!(!last.cg_height_observable && last.diagnostics.status.contains(Status::UNOBSERVABLE));
    assert!(last.cg_ratio.std > 0.01 && (last.cg_ratio.value - 0.45).abs() < 2.0 * last.cg_ratio.std);
}

/// Where the speed is known to be sampled with the wheel speeds: a few milliseconds more or less would be as much.
#[test]
fn lively_driving_reveals_the_height() {
    let mut p = Parameters {
        initial: Initial { cg_height: 1.1, cg_height_std: 0.2, ..Initial::default() },
        ..Parameters::default()
    };
    p.filter.measurement_std.speed_delay = 0.0;
    let mut estimator = begun(&p);
    let outs = run(&mut estimator, &drive(240.0, 2.5, 15, |t, v| lively(t, v) + 1500.0 * (1.3 * t).sin()));
    let last = &outs[outs.len() - 1];
    println!("{:?}", unknowns(last));
    assert!(last.cg_height_observable && !last.diagnostics.status.contains(Status::UNOBSERVABLE));
    assert!((last.cg_height.value - 0.95).abs() < 2.5 * last.cg_height.std, "{last:?}");
    assert!(last.diagnostics.healthy);
}

#[test]
fn outputs_at_a_horizon_follow_the_model() {
    let samples = drive(6.0, 2.5, 17, |_, _| 1200.0);
    let mut estimator = begun(&Parameters::default());
    run(&mut estimator, &samples);
    let state = estimator.state().clone();
    let (mut now, mut later) = (Outputs::default(), Outputs::default());
    estimator.outputs(&samples[599], 0.0, &mut now);
    estimator.outputs(&samples[599], 0.1, &mut later);
    let acceleration = (2400.0 / 0.55 - 0.03 * 4700.0 * 9.80665) / (4700.0 + 72.0 / 0.55f64.powi(2));
    assert_close(
        "speed in a tenth of a second",
        later.speed_estimate.value - now.speed_estimate.value,
        0.1 * acceleration,
        0.1,
        0.0,
    );
    assert_eq!(now.cg_ratio.value, later.cg_ratio.value);
    assert_eq!(estimator.state(), &state);
}

/// Neither missing samples nor a gap in time bar the estimation for longer than a fifth of a second.
#[test]
fn estimation_goes_on_a_fifth_of_a_second_after_three_seconds_without_samples() {
    for seed in 30..33 {
        let samples = drive(20.0, 2.5, seed, lively);
        let mut missing = samples.clone();
        for inputs in &mut missing[600..900] {
            (inputs.speed, inputs.wheel_speed_front, inputs.wheel_speed_rear) = (f64::NAN, f64::NAN, f64::NAN);
        }
        let outs = run(&mut begun(&Parameters::default()), &missing);
        assert!(outs[899].hold && outs[920..].iter().all(|out| !out.hold), "{seed}");
        assert!(outs[1999].diagnostics.healthy, "{seed}");

        let mut estimator = begun(&Parameters::default());
        run(&mut estimator, &samples[..600]);
        estimator.step(&samples[900], 3.0);
        let outs = run(&mut estimator, &samples[901..]);
        assert!(outs[20..].iter().all(|out| !out.hold), "{seed}");
        let last = &outs[outs.len() - 1];
        assert!((last.cg_ratio.value - 0.45).abs() < 2.0 * last.cg_ratio.std, "{seed}");
    }
}

/// At 0.6 m/s estimation may go on; at 1 m/s, a fifth of a second later or more, it does.
#[test]
fn after_a_stop_estimation_goes_on_by_one_metre_per_second() {
    for seed in 33..36 {
        let stop = |t: f64, v: f64| {
            if t < 8.0 {
                lively(t, v)
            } else if t < 14.0 {
                -2500.0 * v
            } else {
                1500.0
            }
        };
        let samples = drive(20.0, 2.5, seed, stop);
        let outs = run(&mut begun(&Parameters::default()), &samples);
        assert!(outs[1390].hold && outs[1390].diagnostics.status.contains(Status::STANDSTILL), "{seed}");
        let fast = (1400..2000).find(|&k| samples[k].speed > 1.0).unwrap();
        // The sensor's noise may be ahead of the machine by a few samples.
        assert!(outs[fast + 5..].iter().all(|out| !out.hold), "{seed}");
    }
}
