//! A speed that comes late and a slope that is none.

use super::bend::{RIGID, rigid};
use super::runs::{begun, drive, lively, run};
use wheelstate::Status;
use wheelstate::estimator::wheel_loader::*;

/// Accelerates and brakes between about 1 and 5 m/s.
fn changing(t: f64, v: f64) -> f64 {
    380.0 + 1500.0 * (0.9 * t).sin() + 300.0 * (3.0 - v)
}

fn late(samples: &[Inputs], by: usize) -> Vec<Inputs> {
    let at = |k: usize| Inputs { speed: samples[k.saturating_sub(by)].speed, ..samples[k].clone() };
    (0..samples.len()).map(at).collect()
}

/// A delay adds `tau v'` to the slip: 50 ms make the tyres three times as soft.
#[test]
fn a_speed_that_comes_late_contradicts() {
    for seed in 0..4 {
        for (by, within) in [(5, 20.0), (3, 30.0), (10, 20.0)] {
            let outs = run(&mut begun(&Parameters::default()), &late(&drive(40.0, 3.0, 40 + seed, changing), by));
            let raised = outs.iter().position(|out| out.diagnostics.status.contains(Status::CONTRADICTED));
            println!("seed {seed}, {by} samples late: {raised:?}");
            assert!(raised.is_some_and(|raised| 0.01 * raised as f64 <= within), "seed {seed}, {by}: {raised:?}");
            for out in &outs[raised.unwrap()..] {
                assert!(out.hold && out.slip_inconsistent && !out.diagnostics.healthy);
            }
        }
    }
}

/// Until a delay is proved, if it ever is, the standard deviations contain it: also those of a machine written by other
/// equations, and in the first seconds.
#[test]
fn what_a_late_speed_spoils_is_within_its_standard_deviation_or_not_healthy() {
    let own = |seed: u64| (Parameters::default(), drive(30.0, 3.0, 80 + seed, changing), [19.0, 0.95, 0.45]);
    let other = |seed: u64| {
        let (parameters, inputs) = rigid(30.0, 90 + seed);
        (parameters, inputs, RIGID)
    };
    for by in [0, 1, 2, 3, 5, 10] {
        let counted = |runs: &dyn Fn(u64) -> (Parameters, Vec<Inputs>, [f64; 3])| {
            let (mut beyond, mut within, mut samples) = ([0.0; 3], [0.0; 3], 0.0);
            for seed in 0..4 {
                let (parameters, inputs, truth) = runs(seed);
                for out in &run(&mut begun(&parameters), &late(&inputs, by))[50..] {
                    samples += 1.0;
                    for (i, estimate) in [out.slip_stiffness, out.cg_height, out.cg_ratio].iter().enumerate() {
                        let off = (estimate.value - truth[i]).abs() / estimate.std;
                        beyond[i] += f64::from(u8::from(out.diagnostics.healthy && off > 3.0));
                        within[i] += f64::from(u8::from(off < 2.0));
                    }
                }
            }
            [beyond, within].map(|counts| counts.map(|count| count / samples))
        };
        for (machine, [beyond, within]) in [("own", counted(&own)), ("other", counted(&other))] {
            println!("{machine}, {by} samples late: healthy and beyond 3 std {beyond:.4?}, within 2 std {within:.3?}");
            assert!(beyond.iter().all(|share| *share <= 0.01), "{machine}, {by}: {beyond:?}");
            assert!(within[0] >= 0.85 && within[1..].iter().all(|share| *share >= 0.95), "{machine}, {by}: {within:?}");
        }
    }
}

/// What is learnt of the delay is kept while it lasts: then load transfer shows the height, although the speed may be late.
#[test]
fn two_minutes_of_strong_accelerating_and_braking_show_the_height() {
    for seed in 0..4 {
        let strong = |t: f64, v: f64| 380.0 + 3300.0 * (0.9 * t).sin() + 300.0 * (4.0 - v);
        let outs = run(&mut begun(&Parameters::default()), &drive(120.0, 4.0, 80 + seed, strong));
        let last = &outs[outs.len() - 1];
        println!("seed {seed}: {:?}", last.cg_height);
        assert!(last.cg_height_observable && (last.cg_height.value - 0.95).abs() < 2.0 * last.cg_height.std);
    }
}

/// Forces say what the speed gains; what gravity should take and does not is no slope.
#[test]
fn a_slope_in_degrees_or_with_the_other_sign_contradicts() {
    let hills = |t: f64| 0.03 * (0.4 * t).sin();
    for seed in 0..4 {
        for factor in [1.0_f64.to_degrees(), -1.0] {
            let against = |t: f64, v: f64| lively(t, v) + 0.5 * 0.55 * 4700.0 * 9.80665 * hills(t).sin();
            let mut samples =
                drive(40.0, 2.5, 50 + seed, |t, v| against(t, v) - 0.5 * 0.55 * 4700.0 * 9.80665 * hills(t));
            for (k, inputs) in samples.iter_mut().enumerate() {
                // The drive is on a flat road with the force that the hill takes added: the same motion.
                let more = 0.5 * 0.55 * 4700.0 * 9.80665 * hills(0.01 * k as f64).sin();
                inputs.torque_front += more;
                inputs.torque_rear += more;
                inputs.slope = factor * (inputs.slope + hills(0.01 * k as f64));
            }
            let outs = run(&mut begun(&Parameters::default()), &samples);
            let raised = outs.iter().position(|out| out.diagnostics.status.contains(Status::CONTRADICTED));
            println!("seed {seed}, slope times {factor:.1}: {raised:?}");
            assert!(raised.is_some_and(|raised| raised < 2000), "seed {seed}: {raised:?}");
            assert!(!outs[outs.len() - 1].diagnostics.healthy);
        }
    }
}

/// The noise of a level sensor in degrees, on the flat.
#[test]
fn a_level_sensor_in_degrees_contradicts_on_the_flat() {
    for seed in 0..4 {
        let mut samples = drive(40.0, 2.5, 60 + seed, lively);
        samples.iter_mut().for_each(|inputs| inputs.slope = inputs.slope.to_degrees());
        let outs = run(&mut begun(&Parameters::default()), &samples);
        assert!(outs.iter().any(|out| out.diagnostics.status.contains(Status::CONTRADICTED)), "{seed}");
    }
}

#[test]
fn sound_speeds_and_slopes_do_not_contradict() {
    for seed in 0..6 {
        for torque in [changing, lively] {
            let samples = drive(60.0, 3.0, 70 + seed, torque);
            let outs = run(&mut begun(&Parameters::default()), &samples);
            assert!(outs.iter().all(|out| !out.slip_inconsistent && !out.bend), "{seed}");
            let last = &outs[outs.len() - 1];
            assert!(
                last.diagnostics.healthy && (last.slip_stiffness.value - 19.0).abs() < 3.0 * last.slip_stiffness.std
            );
        }
    }
}
