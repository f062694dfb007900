//! Time: which samples a step takes, with which inputs, and what the outputs then are.

use crate::support::host::{Host, last_message};
use crate::support::{Inputs, Lag, Outputs, Parameters, random};
use wheelstate::{Estimator, Status};
use wheelstate_fmu::abi::{ERROR, OK};

const PERIOD: f64 = 0.01;

fn signal(t: f64) -> f64 {
    if (t * 10.0).fract() < 0.2 { f64::NAN } else { (3.0 * t).sin() }
}

fn drive(t: f64) -> f64 {
    0.3 * (2.0 * t).cos()
}

/// The estimator itself over `count` samples; what it gives `ahead` of the last one.
fn native(count: usize, ahead: f64) -> Outputs {
    let mut lag = Lag::new(&Parameters::default()).unwrap();
    let mut inputs = Inputs::default();
    for k in 0..count {
        let t = k as f64 * PERIOD;
        inputs = Inputs { signal: signal(t), drive: drive(t), ..Inputs::default() };
        lag.step(&inputs, PERIOD);
    }
    let mut outputs = Outputs::default();
    lag.outputs(&inputs, ahead, &mut outputs);
    outputs
}

#[test]
fn one_sample_per_step_is_the_native_estimator_bit_for_bit() {
    for start in [0.0, 1000.05] {
        let host = Host::started(start);
        for k in 0..500 {
            let t = k as f64 * PERIOD;
            assert_eq!(host.set("signal", signal(t)), OK);
            assert_eq!(host.set("drive", drive(t)), OK);
            assert_eq!(host.step(start + t, PERIOD), OK, "{}", last_message());
            let expected = native(k + 1, PERIOD);
            assert_eq!(host.get("position"), expected.position, "start {start}, sample {k}");
            assert_eq!(host.get("position_std"), expected.position_std);
            assert_eq!(host.get_integer("count"), expected.count);
            assert_eq!(host.get_integer("status"), expected.status.bits() as i32);
        }
    }
}

#[test]
fn a_third_of_a_period_takes_the_same_samples() {
    for start in [0.0, 1000.05] {
        let host = Host::started(start);
        for i in 0..900 {
            let t = i as f64 * PERIOD / 3.0;
            // what is set between the samples must not matter
            let given = if i % 3 == 0 {
                (signal(i as f64 / 3.0 * PERIOD), drive(i as f64 / 3.0 * PERIOD))
            } else {
                (99.0, 99.0)
            };
            host.set("signal", given.0);
            host.set("drive", given.1);
            assert_eq!(host.step(start + t, PERIOD / 3.0), OK, "{}", last_message());
            let expected = native(i / 3 + 1, (i % 3 + 1) as f64 * PERIOD / 3.0);
            assert_eq!(host.get_integer("count"), expected.count);
            assert_eq!(host.get("position_std"), expected.position_std);
            assert!((host.get("position") - expected.position).abs() < 1e-12, "start {start}, step {i}");
        }
    }
}

#[test]
fn long_steps_take_every_sample_with_the_inputs_held() {
    let (host, size) = (Host::started(1000.05), 7.3 * PERIOD);
    let mut lag = Lag::new(&Parameters::default()).unwrap();
    let mut taken = 0;
    for i in 0..200 {
        let t = i as f64 * size;
        host.set("signal", signal(t));
        host.set("drive", drive(t));
        assert_eq!(host.step(1000.05 + t, size), OK);
        let inputs = Inputs { signal: signal(t), drive: drive(t), ..Inputs::default() };
        // sample k lies in this step if 10 k < 73 (i + 1), in tenths of a period
        while 10 * taken < 73 * (i + 1) {
            lag.step(&inputs, PERIOD);
            taken += 1;
        }
        let mut expected = Outputs::default();
        lag.outputs(&inputs, (i + 1) as f64 * size - (taken - 1) as f64 * PERIOD, &mut expected);
        assert_eq!(host.get_integer("count"), expected.count, "step {i}");
        assert!((host.get("position") - expected.position).abs() < 1e-12, "step {i}");
    }
}

#[test]
fn a_ramp_given_by_its_derivative_is_sampled_exactly() {
    // 25 periods per step; the input is u = 2 + 0.5 t, its sum over the samples is known in closed form
    let (host, size) = (Host::started(5.0), 25.0 * PERIOD);
    for i in 0..4 {
        let t = i as f64 * size;
        assert_eq!(host.set("drive", 2.0 + 0.5 * t), OK);
        assert_eq!(host.slope("drive", 0.5), OK);
        assert_eq!(host.step(5.0 + t, size), OK);
    }
    let n = 100.0;
    let expected = 2.0 * n + 0.5 * PERIOD * n * (n - 1.0) / 2.0;
    assert!((host.get("drive_sum") - expected).abs() < 1e-10, "{} instead of {expected}", host.get("drive_sum"));
}

#[test]
fn a_derivative_lasts_one_step_and_a_new_value_clears_it() {
    let host = Host::started(0.0);
    host.set("drive", 1.0);
    host.slope("drive", 100.0);
    host.set("drive", 1.0);
    host.step(0.0, 10.0 * PERIOD);
    assert_eq!(host.get("drive_sum"), 10.0);
    host.slope("drive", 100.0);
    host.step(10.0 * PERIOD, PERIOD); // the only sample lies at the beginning
    assert_eq!(host.get("drive_sum"), 11.0);
    host.step(11.0 * PERIOD, 10.0 * PERIOD); // and is gone
    assert_eq!(host.get("drive_sum"), 21.0);
}

#[test]
fn a_million_accumulated_steps_lose_no_sample() {
    let host = Host::started(0.0);
    let mut t = 0.0;
    for i in 0..1_000_000 {
        assert_eq!(host.step(t, PERIOD), OK);
        t += PERIOD;
        if i % 100_000 == 0 {
            assert_eq!(host.get_integer("count"), i + 1);
        }
    }
    assert!((t - 1e4).abs() > 1e-7, "the accumulated time should have drifted, else this proves nothing");
    assert_eq!(host.get_integer("count"), 1_000_000);
}

#[test]
fn random_step_sizes_take_every_sample_once() {
    let (host, mut seed, mut t) = (Host::started(-3.0), 7, -3.0);
    for _ in 0..20_000 {
        let size = PERIOD * 10_f64.powf(3.0 * random(&mut seed) - 2.0);
        assert_eq!(host.step(t, size), OK, "{}", last_message());
        t += size;
        let before_the_end = ((t + 3.0) / PERIOD).ceil();
        assert!((f64::from(host.get_integer("count")) - before_the_end).abs() < 0.5, "at {t}");
    }
}

#[test]
fn the_outputs_before_the_first_step_are_the_initial_state() {
    let host = Host::new();
    host.set("initial_angle", 0.5);
    host.set("drive", 3.0);
    host.start(0.0);
    assert_eq!((host.get("position"), host.get("position_std")), (0.5, 1.0));
    assert_eq!(host.get_boolean("healthy"), 0);
}

#[test]
fn output_derivatives_are_the_rate_of_the_models_prediction() {
    let host = Host::started(0.0);
    host.set("signal", 1.0);
    host.set("drive", -2.0);
    for step in [PERIOD, PERIOD / 3.0, PERIOD / 3.0, 2.2 * PERIOD] {
        host.step(host.time(), step);
        let rate = host.rate("position");
        // x' = (gain drive - x) / T
        let expected = (-2.0 - host.get("position")) / 0.2;
        assert!((rate - expected).abs() < 1e-6 * expected.abs(), "{rate} instead of {expected}");
    }
}

#[test]
fn a_wrong_communication_point_or_step_is_refused_and_changes_nothing() {
    let host = Host::new();
    assert_eq!((host.setup(1.0, Some(1.05)), host.enter(), host.exit()), (OK, OK, OK));
    for (point, size, word) in [
        (2.0, 0.01, "currentCommunicationPoint = 2 s"),
        (f64::NAN, 0.01, "currentCommunicationPoint"),
        (1.0, 0.0, "communicationStepSize = 0 s"),
        (1.0, -0.01, "communicationStepSize"),
        (1.0, f64::NAN, "communicationStepSize"),
        (1.0, f64::INFINITY, "communicationStepSize"),
        (1.0, 0.0512, "stopTime = 1.05 s"),
    ] {
        assert_eq!(host.step(point, size), ERROR, "{point} {size}");
        assert!(last_message().contains(word), "{}", last_message());
    }
    // rounding of the host's own is none of these
    assert_eq!(host.step(1.0 + 1e-12, 0.02), OK);
    assert_eq!(host.step(1.02 - 3e-15, 0.03 + 1e-9), OK, "{}", last_message());
    assert_eq!(host.get_integer("count"), 5);
}

/// What a host can see of the estimate after some steps.
fn estimate(host: &Host) -> (u64, u64, i32) {
    (host.get("position").to_bits(), host.get("position_std").to_bits(), host.get_integer("status"))
}

#[test]
fn an_input_is_missing_until_the_host_sets_it_and_reads_as_its_start() {
    let (unset, missing) = (Host::started(0.0), Host::started(0.0));
    missing.set("signal", f64::NAN);
    for host in [&unset, &missing] {
        assert_eq!(host.step(0.0, 0.05), OK);
    }
    assert_eq!(estimate(&unset), estimate(&missing));
    assert_eq!(unset.get("signal"), 0.0);
    assert!(missing.get("signal").is_nan());
    assert_eq!(missing.reset(), OK);
    missing.start(0.0);
    assert_eq!(missing.get("signal"), 0.0);
}

#[test]
fn missing_value_and_a_switch_are_as_good_as_nan() {
    let (nan, number, off) = (Host::started(0.0), Host::started(0.0), Host::new());
    assert_eq!(number.set("missing_value", -999.0), OK);
    assert_eq!(off.set_boolean("use.signal", 0), OK);
    off.start(0.0);
    for k in 0..40 {
        let (t, missing) = (f64::from(k) * 0.01, k % 3 == 0);
        nan.set("signal", if missing { f64::NAN } else { 0.3 });
        number.set("signal", if missing { -999.0 } else { 0.3 });
        off.set("signal", 0.3);
        // tunable, so it may change while the host steps
        off.set_boolean("use.signal", i32::from(!missing));
        for host in [&nan, &number, &off] {
            // the derivative that a host forms over a gap is no number; that of a missing sample has no effect
            assert_eq!(host.slope("signal", if missing { f64::NAN } else { 0.0 }), OK);
            assert_eq!(host.step(t, 0.01), OK);
        }
        assert_eq!(estimate(&nan), estimate(&number), "step {k}");
        assert_eq!(estimate(&nan), estimate(&off), "step {k}");
    }
    assert_eq!(number.slope("drive", f64::NAN), ERROR, "a force is not a sample");
    assert_eq!(number.set("missing_value", f64::NAN), ERROR);
}

#[test]
fn no_output_is_ever_infinite() {
    let host = Host::started(0.0);
    host.set("drive", 1e308);
    assert_eq!(host.step(0.0, 0.01), OK);
    assert_eq!((host.get("drive_sum"), host.get_boolean("healthy")), (1e308, 1));
    host.set_integer("gear", 4);
    assert_eq!(host.step(0.01, 0.01), OK);
    // four times that, and what was before, has no number
    assert_eq!((host.get("drive_sum"), host.get_boolean("healthy")), (1e308, 0));
    assert_eq!(host.get_integer("status") as u32 & Status::RECOVERED.bits(), Status::RECOVERED.bits());
    assert!(host.rate("drive_sum").is_finite());
}
