//! Long logs, which are looked at in blocks, beside the same logs in one piece.

use super::VEHICLE;
use crate::check::{Finding, Subject, check_from};
use crate::log::{Log, Store};
use crate::problem::{Declared, FitRequest, Known, fit_from};
use crate::progress::Progress;
use crate::result::FitReport;
use crate::simulate::Request;
use std::ops::Range;

/// Samples from which a log is long in these tests, and from which none is.
const SOME: usize = 20_000;
const NONE: usize = usize::MAX;

/// A quarter of an hour of stop and go at 100 Hz with what these channels are, in a file.
fn ride(keep: &[&str]) -> Log {
    let settings = vec![("plant.duration".to_owned(), 900.0)];
    let log = VEHICLE.simulate(&Request { scenario: "identification".into(), seed: 3, settings }).unwrap();
    log.slice(0..log.len(), |name| keep.contains(&name) || matches!(name, "speed" | "torque_left" | "torque_right"))
}

const ALL: [&str; 6] = ["tilt", "tilt_rate", "roll", "roll_rate", "yaw_rate", "accel_x"];

fn put_away(mut log: Log) -> Log {
    log.put_away(&Store::new().unwrap()).unwrap();
    log
}

fn fit(long: usize, logs: &[Log], request: &FitRequest) -> FitReport {
    let declared = Declared { parameters: VEHICLE.parameters(), inputs: VEHICLE.inputs() };
    fit_from(long, &VEHICLE.problem, VEHICLE.name, &declared, logs, request, &Progress::none()).unwrap()
}

/// In blocks each estimate moves by no more than a twentieth of the standard error that noise alone makes.
fn assert_alike(whole: &FitReport, blocks: &FitReport) {
    assert_eq!(whole.warnings, blocks.warnings);
    // the errors that the estimator counts are standard errors themselves
    for (name, of_whole) in whole.parameters.iter().filter(|(_, of_whole)| of_whole.std_error != 0.0) {
        let of_blocks = &blocks.parameters[name];
        let moved = (of_whole.value - of_blocks.value).abs() / of_whole.sampling_std;
        let ratio = of_blocks.std_error / of_whole.std_error;
        println!("{name}: {} moves by {moved:.1e} standard errors, which change to {ratio}", of_whole.value);
        assert_eq!(of_whole.verdict, of_blocks.verdict, "{name}");
        if of_whole.value.is_nan() && of_blocks.value.is_nan() {
            continue;
        }
        assert!(of_whole.value == of_blocks.value || moved < 0.05, "{name}");
        assert!(of_whole.std_error == of_blocks.std_error || (ratio - 1.0).abs() < 0.02, "{name}");
    }
    for (of_whole, of_blocks) in whole.validation.signals.iter().zip(&blocks.validation.signals) {
        println!("{of_whole:?}\n{of_blocks:?}");
        assert_eq!(of_whole.name, of_blocks.name);
        assert!((of_whole.samples as f64 / of_blocks.samples as f64 - 1.0).abs() < 0.02);
        assert!((of_whole.rmse / of_blocks.rmse - 1.0).abs() < 0.05);
        assert!((of_whole.rmse_training / of_blocks.rmse_training - 1.0).abs() < 0.05);
    }
    assert_eq!(whole.validation.signals.len(), blocks.validation.signals.len());
}

#[test]
fn a_fit_in_blocks_is_the_fit_in_one_piece() {
    let request = FitRequest::default();
    let mass = FitRequest { only: ["robot.mass", "rolling.coefficient"].map(String::from).into(), ..request.clone() };
    for (channels, request) in [(&ALL[..], &request), (&ALL[..1], &request), (&ALL[..], &mass)] {
        let log = ride(channels);
        let whole = fit(NONE, std::slice::from_ref(&log), request);
        let blocks = fit(SOME, &[put_away(log)], request);
        assert_alike(&whole, &blocks);
    }
}

#[test]
fn a_block_in_which_a_sensor_is_dead_and_another_that_lacks_samples_lose_nothing_else() {
    let mut log = ride(&ALL);
    let tilt = log.channels.iter_mut().find(|channel| channel.name == "tilt").unwrap();
    tilt.values[20_000..45_000].fill(f64::NAN);
    // Of two seconds nothing is there, so that steps are not even.
    let keep: Vec<usize> = (0..log.len()).filter(|k| !(70_000..70_200).contains(k)).collect();
    log.time = keep.iter().map(|k| log.time[*k]).collect();
    for channel in &mut log.channels {
        channel.values = keep.iter().map(|k| channel.values[*k]).collect();
    }
    let whole = fit(NONE, std::slice::from_ref(&log), &FitRequest::default());
    assert_alike(&whole, &fit(SOME, &[put_away(log)], &FitRequest::default()));
}

#[test]
fn several_logs_of_which_one_is_long_are_one_fit() {
    let log = ride(&ALL);
    let named = |samples: Range<usize>, source: &str| Log { source: source.into(), ..log.slice(samples, |_| true) };
    let logs = [named(0..8000, "short"), named(8000..90_000, "long")];
    let whole = fit(NONE, &logs, &FitRequest::default());
    assert_alike(&whole, &fit(SOME, &logs.map(put_away), &FitRequest::default()));
}

fn found(long: usize, log: &Log) -> Vec<Finding> {
    let (inputs, known) = (VEHICLE.inputs(), Known::new(VEHICLE.parameters()));
    let mut all = check_from(long, &Subject { inputs: &inputs, known: &known, checks: &VEHICLE.checks }, log);
    all.retain(|finding| finding.code != "optional-channel-missing");
    all
}

/// Nine tenths of the ride are as they should be.
#[test]
fn a_fault_late_in_a_long_log_is_one_finding_with_its_time() {
    type Fault = fn(&mut [f64]);
    let stuck: Fault = |tilt| {
        let value = tilt[81_000];
        tilt[81_000..84_000].fill(value);
    };
    let degrees: Fault = |tilt| tilt[81_000..].iter_mut().for_each(|value| *value = 57.3 * *value + 200.0);
    for (fault, code) in [(stuck, "stuck-channel"), (degrees, "out-of-range")] {
        let mut log = ride(&ALL);
        fault(&mut log.channels.iter_mut().find(|channel| channel.name == "tilt").unwrap().values);
        let found = found(SOME, &put_away(log));
        let those: Vec<&Finding> = found.iter().filter(|finding| finding.channel == "tilt").collect();
        assert!(those.len() == 1 && those[0].code == code && those[0].time == Some(810.0), "{found:?}");
    }
    let mut log = ride(&ALL);
    log.time[85_000..].iter_mut().for_each(|time| *time += 4.0);
    let found = found(SOME, &put_away(log));
    let gap = found.iter().filter(|finding| finding.code == "time-gap").collect::<Vec<_>>();
    assert!(gap.len() == 1 && gap[0].time == Some(849.99), "{found:?}");
}

#[test]
fn what_holds_for_all_of_a_long_log_is_one_finding() {
    assert!(found(SOME, &put_away(ride(&ALL))).is_empty());
    let shift = |values: &mut [f64], samples: usize| {
        let before = values.to_vec();
        values[samples..].copy_from_slice(&before[..before.len() - samples]);
    };
    let late = |values: &mut [f64]| shift(values, 8);
    let degrees = |values: &mut [f64]| values.iter_mut().for_each(|value| *value *= 57.3);
    let reversed = |values: &mut [f64]| values.iter_mut().for_each(|value| *value = -*value);
    let held = |values: &mut [f64]| (0..values.len()).for_each(|k| values[k] = values[k - k % 10]);
    type Fault<'a> = (&'a str, &'a dyn Fn(&mut [f64]), &'a str);
    let faults: [Fault; 4] = [
        ("accel_x", &late, "delayed-channel"),
        ("tilt_rate", &degrees, "unit-mismatch"),
        ("roll_rate", &reversed, "sign-mismatch"),
        ("roll_rate", &held, "held-channel"),
    ];
    for (channel, fault, code) in faults {
        let mut log = ride(&ALL);
        fault(&mut log.channels.iter_mut().find(|other| other.name == channel).unwrap().values);
        let found = found(SOME, &put_away(log));
        let those = found.iter().filter(|finding| finding.channel.contains(channel)).collect::<Vec<_>>();
        assert!(those.len() == 1 && those[0].code == code, "{code}: {found:?}");
    }
}

/// The simulation of the sway, which no linear relation stands for, looks at parts of a long log.
#[test]
fn a_tilt_that_is_late_is_found_in_a_long_log() {
    let mut log = ride(&ALL);
    for name in ["tilt", "tilt_rate"] {
        let values = &mut log.channels.iter_mut().find(|channel| channel.name == name).unwrap().values;
        let before = values.to_vec();
        values[6..].copy_from_slice(&before[..before.len() - 6]);
    }
    let found = found(SOME, &put_away(log));
    let late = found.iter().find(|finding| finding.code == "delayed-channel" && finding.channel.contains("tilt"));
    assert!(late.is_some_and(|late| late.message.contains("arrives 6")), "{found:?}");
}
