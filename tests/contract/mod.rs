//! What every estimator promises, tried on all of them through the one list, without knowing any machine.

use crate::counting::allocations;
use proptest::prelude::*;
use serde_json::Value;
use std::collections::BTreeMap;
use wheelstate::estimator::{Diagnostics, Visitor, visit_all};
use wheelstate::variable::Kind;
use wheelstate::{Estimator, Status, Variable, Variables, unit};

/// A short drive in no particular machine: every input waves slowly within its range.
fn wave<I: Variables + Default>(declared: &[Variable], k: usize) -> I {
    let mut inputs = I::default();
    let flat: Vec<f64> = declared
        .iter()
        .enumerate()
        .map(|(i, input)| {
            let (low, high) = input.range;
            let size = 0.2 * high.min(-low).min(5.0);
            size * (0.02 * k as f64 * (1.0 + 0.1 * i as f64) + i as f64).sin()
        })
        .collect();
    inputs.read(&flat);
    inputs
}

/// An estimator after `count` samples of [`wave`].
fn warm<E: Estimator>(count: usize) -> E {
    let (mut estimator, declared) = (new::<E>(), E::Inputs::declare());
    let dt = estimator.sample_period();
    for k in 0..count {
        estimator.step(&wave(&declared, k), dt);
    }
    estimator
}

fn new<E: Estimator>() -> E {
    E::new(&E::Parameters::default()).unwrap()
}

/// With every sensor that a parameter `use.*` can switch on.
fn with_all_sensors<E: Estimator>() -> E {
    let mut parameters = E::Parameters::default();
    for parameter in E::Parameters::declare().iter().filter(|parameter| parameter.name.starts_with("use.")) {
        parameters.set(&parameter.name, 1.0).unwrap();
    }
    E::new(&parameters).unwrap()
}

fn set<I: Variables>(inputs: &I, index: usize, value: f64) -> I {
    let (mut flat, mut changed) = (inputs.to_vec(), inputs.clone());
    flat[index] = value;
    changed.read(&flat);
    changed
}

fn bytes<E: Estimator>(estimator: &E) -> Value {
    serde_json::to_value(estimator.state()).unwrap()
}

/// The machine's part of the state, without what the shell says about the sample.
fn machine<E: Estimator>(estimator: &E) -> Value {
    bytes(estimator)["machine"].clone()
}

fn outputs<E: Estimator>(estimator: &E, inputs: &E::Inputs, horizon: f64) -> BTreeMap<String, f64> {
    let mut outputs = E::Outputs::default();
    estimator.outputs(inputs, horizon, &mut outputs);
    let declared = E::Outputs::declare();
    for (variable, value) in declared.iter().zip(outputs.to_vec()) {
        assert!(value.is_finite(), "{}: {} = {value}", E::NAME, variable.name);
        variable.check(value).unwrap_or_else(|error| panic!("{}: {error}", E::NAME));
    }
    declared.into_iter().map(|variable| variable.name).zip(outputs.to_vec()).collect()
}

fn healthy(outputs: &BTreeMap<String, f64>) -> bool {
    outputs["healthy"] == 1.0
}

/// Runs one test with every estimator.
macro_rules! for_all {
    ($(#[$meta:meta])* fn $name:ident<$e:ident>() $body:block) => {
        $(#[$meta])*
        #[test]
        fn $name() {
            struct Test;
            impl Visitor for Test {
                fn visit<$e: Estimator + 'static>(&mut self) $body
            }
            visit_all(&mut Test);
        }
    };
}

for_all! {
    fn a_step_that_is_not_positive_and_finite_changes_nothing<E>() {
        let mut estimator = warm::<E>(80);
        let inputs = wave(&E::Inputs::declare(), 80);
        let before = bytes(&estimator);
        let known = outputs(&estimator, &inputs, 0.0);
        for dt in [0.0, -0.01, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let status = estimator.step(&inputs, dt);
            assert_eq!(status, Status::BAD_STEP | Status::SKIPPED, "{} {dt}: {status}", E::NAME);
            assert_eq!(bytes(&estimator), before, "{} {dt}", E::NAME);
            assert_eq!(outputs(&estimator, &inputs, 0.0), known, "{} {dt}", E::NAME);
        }
    }
}

for_all! {
    fn the_first_sample_takes_no_time<E>() {
        let inputs = wave(&E::Inputs::declare(), 0);
        let first = |dt: f64| {
            let mut estimator = new::<E>();
            let status = estimator.step(&inputs, dt);
            assert!(!status.intersects(Status::BAD_STEP | Status::RESTARTED), "{} {dt}: {status}", E::NAME);
            bytes(&estimator)
        };
        let expected = first(new::<E>().sample_period());
        for dt in [1e-9, 1e9, 0.0, f64::NAN] {
            assert_eq!(first(dt), expected, "{} {dt}", E::NAME);
        }
    }
}

for_all! {
    fn a_gap_that_is_too_long_to_bridge_is_said_and_survived<E>() {
        let mut estimator = warm::<E>(80);
        let declared = E::Inputs::declare();
        let inputs = wave(&declared, 81);
        let status = estimator.step(&inputs, 1e4);
        let after = outputs(&estimator, &inputs, 0.0);
        if status.contains(Status::BAD_STEP) {
            assert!(status.contains(Status::RESTARTED), "{}: {status}", E::NAME);
            assert!(!healthy(&after), "{}", E::NAME);
        }
        assert_eq!(after["status"], f64::from(status.bits()), "{}", E::NAME);
        let dt = estimator.sample_period();
        let next = estimator.step(&wave(&declared, 82), dt);
        assert!(!next.contains(Status::BAD_STEP), "{}: {next}", E::NAME);
    }
}

for_all! {
    fn every_input_is_measured_or_held_and_starts_unset<E>() {
        for input in E::Inputs::declare() {
            assert!(input.measured != input.held, "{} {}", E::NAME, input.name);
            assert!(input.start.is_nan(), "{} {} starts at {}", E::NAME, input.name, input.start);
            assert!(input.range.0 <= 0.0 && input.range.1 >= 0.0, "{} {}", E::NAME, input.name);
        }
    }
}

for_all! {
    fn inputs_that_were_never_set_are_missing_and_said<E>() {
        let mut estimator = new::<E>();
        let nothing = E::Inputs::default();
        let (before, dt) = (outputs(&estimator, &nothing, 0.0), estimator.sample_period());
        assert!(!healthy(&before), "{} before the first sample", E::NAME);
        let acts = |input: &Variable| input.held || (matches!(input.unit, "N" | "N.m") && input.measured);
        let mut said = false;
        for _ in 0..200 {
            let status = estimator.step(&nothing, dt);
            assert!(status.contains(Status::NO_MEASUREMENT | Status::MISSING), "{}: {status}", E::NAME);
            assert!(!status.intersects(Status::HELD_INPUT | Status::INFINITE | Status::IMPLAUSIBLE), "{}: {status}", E::NAME);
            said |= status.contains(Status::NEVER_SET);
            let after = outputs(&estimator, &nothing, 0.0);
            assert!(!healthy(&after), "{}", E::NAME);
            assert_eq!((after["nis_channels"], after["nis"]), (0.0, 0.0), "{}", E::NAME);
        }
        // a force that the default parameters do not use need not be set
        assert!(said || !E::Inputs::declare().iter().any(|input| input.held), "{}", E::NAME);
        let forces: Vec<_> = E::Inputs::declare().into_iter().filter(acts).map(|input| input.name).collect();
        assert!(said || forces.iter().all(|name| name.contains("hand") || name.contains("foot") || name.contains("seat")), "{}: {forces:?}", E::NAME);
    }
}

for_all! {
    /// Infinite and implausible samples are missing samples that say one more word.
    fn what_is_no_sample_is_left_out_whatever_it_is<E>() {
        let start = warm::<E>(80);
        let declared = E::Inputs::declare();
        let inputs = wave::<E::Inputs>(&declared, 80);
        let dt = start.sample_period();
        for (index, input) in declared.iter().enumerate() {
            let with = |value: f64| {
                let mut estimator = start.clone();
                let status = estimator.step(&set(&inputs, index, value), dt);
                let mut estimates = outputs(&estimator, &inputs, 0.0);
                estimates.remove("status");
                (status, machine(&estimator), estimates)
            };
            let (status, expected, estimates) = with(f64::NAN);
            let used = status.intersects(Status::MISSING | Status::HELD_INPUT);
            if input.held {
                let last = wave::<E::Inputs>(&declared, 79).to_vec()[index];
                assert_eq!(with(last).2, estimates, "{} {}: the last value holds", E::NAME, input.name);
            }
            for (value, bit) in [
                (f64::INFINITY, Status::INFINITE),
                (f64::NEG_INFINITY, Status::INFINITE),
                (2.0 * input.range.1.min(1e300), Status::IMPLAUSIBLE),
                (2.0 * input.range.0.max(-1e300), Status::IMPLAUSIBLE),
            ] {
                let (status, state, _) = with(value);
                assert!(status.contains(bit) || (!used && bit != Status::INFINITE), "{} {} = {value}: {status}", E::NAME, input.name);
                assert_eq!(state, expected, "{} {} = {value}", E::NAME, input.name);
            }
        }
    }
}

/// [`wave`] with noise on every input.
fn noisy_wave<I: Variables + Default>(declared: &[Variable], k: usize, random: &mut impl FnMut() -> f64) -> I {
    let mut inputs: I = wave(declared, k);
    let flat: Vec<f64> = declared
        .iter()
        .zip(inputs.to_vec())
        .map(|(input, value)| value + 0.1 * random() * input.range.1.min(-input.range.0).min(5.0))
        .collect();
    inputs.read(&flat);
    inputs
}

for_all! {
    /// Each input by itself, beside others that go on: what noise turned until then and repeats now is no sample; what had no noise may repeat.
    fn a_noisy_reading_that_repeats_is_no_sample<E>() {
        let declared = E::Inputs::declare();
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        for noisy in [true, false] {
            let mut inputs = |k: usize| match noisy {
                true => noisy_wave::<E::Inputs>(&declared, k, &mut random),
                false => wave(&declared, k),
            };
            let mut estimator = new::<E>();
            let dt = estimator.sample_period();
            (0..100).for_each(|k| _ = estimator.step(&inputs(k), dt));
            let last = inputs(100);
            estimator.step(&last, dt);
            for (index, value) in last.to_vec().into_iter().enumerate() {
                let mut frozen = estimator.clone();
                (101..140).for_each(|k| _ = frozen.step(&set(&inputs(k), index, value), dt));
                let (mut missing, next) = (frozen.clone(), inputs(140));
                let status = frozen.step(&set(&next, index, value), dt);
                let same = status == missing.step(&set(&next, index, f64::NAN), dt) && machine(&frozen) == machine(&missing);
                // of some sensors without noise another one tells that they are old
                let alone = noisy || matches!(declared[index].unit, "N" | "N.m" | "m/s2");
                // an input that is not used is never missed
                let used = status.intersects(Status::MISSING | Status::HELD_INPUT) || !same;
                assert!(!(used && alone) || same == noisy, "{} {}, noisy: {noisy}: {status}", E::NAME, declared[index].name);
            }
        }
    }
}

for_all! {
    /// Sensors that jump about within their ranges contradict any model; no machine may call that healthy.
    fn absurd_measurements_contradict_and_are_not_healthy<E>() {
        let declared = E::Inputs::declare();
        let mut estimator = with_all_sensors::<E>();
        let dt = estimator.sample_period();
        let (mut seed, mut seen, mut sound) = (1_u64, 0, 0);
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let samples = (20.0 / dt) as usize;
        for k in 0..samples {
            let flat: Vec<f64> = declared.iter().map(|input| random() * 0.5 * input.range.1.min(50.0)).collect();
            let mut inputs = E::Inputs::default();
            inputs.read(&flat);
            let status = estimator.step(&inputs, dt);
            let now = outputs(&estimator, &inputs, 0.0);
            if status.contains(Status::CONTRADICTED) {
                assert!(!healthy(&now), "{} sample {k}", E::NAME);
                seen += 1;
            }
            sound += usize::from(k > samples / 2 && healthy(&now));
        }
        println!("{}: contradicted in {seen} of {samples} samples, healthy in {sound} late ones", E::NAME);
        assert!(seen > 0, "{}: nothing contradicts it", E::NAME);
        assert!(sound == 0, "{}: {sound} samples healthy", E::NAME);
    }
}

for_all! {
    /// As if it had been built with the new parameters and had lived through the same samples with the old ones.
    fn retuning_takes_over_the_parameters_and_keeps_the_state<E>() {
        let (mut one, declared) = (warm::<E>(60), E::Inputs::declare());
        let state = bytes(&one);
        let mut parameters = E::Parameters::default();
        for parameter in E::Parameters::declare().iter().filter(|parameter| parameter.tunable) {
            if parameter.kind == Kind::Real && parameter.start > 0.0 {
                let _ = parameters.set(&parameter.name, (1.2 * parameter.start).min(parameter.range.1));
            }
        }
        let Ok(mut other) = E::new(&parameters) else { return };
        other.restore(one.state()).unwrap();
        one.retune(&parameters).unwrap();
        assert_eq!(bytes(&one), state, "{}", E::NAME);
        let dt = one.sample_period();
        for k in 60..120 {
            let inputs = wave(&declared, k);
            assert_eq!(one.step(&inputs, dt), other.step(&inputs, dt), "{}", E::NAME);
            assert_eq!(outputs(&one, &inputs, 0.0), outputs(&other, &inputs, 0.0), "{}", E::NAME);
        }
        assert_eq!(bytes(&one), bytes(&other), "{}", E::NAME);
    }
}

for_all! {
    /// Whatever an estimator keeps of the inputs of its last sample, one that was restored keeps nothing.
    fn outputs_follow_from_the_state_and_the_inputs_alone<E>() {
        let (one, declared) = (warm::<E>(60), E::Inputs::declare());
        let dt = one.sample_period();
        let last = wave::<E::Inputs>(&declared, 59);
        let every = [f64::NAN, f64::INFINITY, 1e300, 0.0].into_iter();
        let others = every.flat_map(|value| (0..E::Inputs::COUNT).map(move |index| (index, value)));
        for inputs in [last.clone(), wave(&declared, 90)].into_iter().chain(others.map(|(i, x)| set(&last, i, x))) {
            let mut other = warm::<E>(61);
            other.restore(one.state()).unwrap();
            for horizon in [0.0, 0.5 * dt] {
                assert_eq!(outputs(&one, &inputs, horizon), outputs(&other, &inputs, horizon), "{}", E::NAME);
            }
        }
    }
}

for_all! {
    fn a_restored_state_repeats_the_bytes<E>() {
        let declared = E::Inputs::declare();
        for count in [0, 1, 7, 60] {
            let mut one = warm::<E>(count);
            let stored = serde_json::to_string(one.state()).unwrap();
            let mut other = new::<E>();
            other.restore(&serde_json::from_str(&stored).unwrap()).unwrap();
            let dt = one.sample_period();
            for k in count..count + 40 {
                let mut inputs = wave::<E::Inputs>(&declared, k);
                if k % 9 == 4 {
                    inputs = set(&inputs, k % E::Inputs::COUNT, f64::NAN);
                }
                assert_eq!(one.step(&inputs, dt), other.step(&inputs, dt), "{}", E::NAME);
                assert_eq!(outputs(&one, &inputs, 0.3 * dt), outputs(&other, &inputs, 0.3 * dt), "{}", E::NAME);
            }
            assert_eq!(bytes(&one), bytes(&other), "{}", E::NAME);
        }
    }
}

/// Every number with a fraction in a JSON tree, one after the other, through `visit`.
fn numbers(value: &mut Value, visit: &mut impl FnMut(&mut Value)) {
    match value {
        Value::Number(number) if number.is_f64() => visit(value),
        Value::Array(list) => list.iter_mut().for_each(|item| numbers(item, visit)),
        Value::Object(map) => map.values_mut().for_each(|item| numbers(item, visit)),
        _ => {}
    }
}

for_all! {
    fn a_state_with_a_number_that_cannot_be_is_refused_and_nothing_changes<E>() {
        let mut estimator = warm::<E>(30);
        let before = bytes(&estimator);
        let mut count = 0;
        numbers(&mut before.clone(), &mut |_| count += 1);
        assert!(count > 10, "{}: {count} numbers", E::NAME);
        for broken in (0..count).step_by(1 + count / 60) {
            let (mut stored, mut at) = (before.clone(), 0);
            numbers(&mut stored, &mut |number| {
                if at == broken {
                    *number = 1e200.into();
                }
                at += 1;
            });
            let state: E::State = serde_json::from_value(stored).unwrap();
            assert!(estimator.restore(&state).is_err(), "{}: number {broken} of {count}", E::NAME);
            assert_eq!(bytes(&estimator), before, "{}", E::NAME);
        }
    }
}

for_all! {
    fn the_horizon_changes_no_state_and_is_bounded<E>() {
        let estimator = warm::<E>(80);
        let inputs = wave(&E::Inputs::declare(), 80);
        let (before, now) = (bytes(&estimator), outputs(&estimator, &inputs, 0.0));
        for horizon in [-1.0, f64::NAN] {
            assert_eq!(outputs(&estimator, &inputs, horizon), now, "{} {horizon}", E::NAME);
        }
        for horizon in [1e-6, 0.02, 1e3, 1e300, f64::INFINITY] {
            outputs(&estimator, &inputs, horizon);
        }
        assert_eq!(bytes(&estimator), before, "{}", E::NAME);
    }
}

/// The default parameters, and those with one or two of their choices and switches at another value.
fn variants<P: Variables + Default>() -> Vec<P> {
    let mut others = Vec::new();
    for parameter in P::declare() {
        let count = match parameter.kind {
            Kind::Boolean => 2,
            Kind::Choice(names) => names.len(),
            Kind::Real | Kind::Integer | Kind::Code(_) => 0,
        };
        let values = (0..count).map(|value| value as f64).filter(|value| *value != parameter.start);
        others.extend(values.map(|value| (parameter.name.clone(), value)));
    }
    let with = |changes: &[&(String, f64)]| {
        let mut parameters = P::default();
        changes.iter().for_each(|(name, value)| parameters.set(name, *value).unwrap());
        parameters
    };
    let mut all = vec![with(&[])];
    for (k, one) in others.iter().enumerate() {
        all.push(with(&[one]));
        all.extend(others[..k].iter().filter(|other| other.0 != one.0).map(|other| with(&[one, other])));
    }
    all
}

for_all! {
    fn nothing_is_allocated_after_construction_whatever_is_chosen<E>() {
        let declared = E::Inputs::declare();
        let mut samples: Vec<E::Inputs> = (0..120).map(|k| wave(&declared, k)).collect();
        for (k, sample) in samples.iter_mut().enumerate() {
            if (30..60).contains(&k) {
                sample.read(&vec![0.0; E::Inputs::COUNT]); // the machine stands still
            }
            if k % 5 == 3 {
                let value = [f64::NAN, f64::INFINITY, 1e300][k % 3];
                *sample = set(sample, k % E::Inputs::COUNT, value);
            }
        }
        for parameters in variants::<E::Parameters>() {
            // some choices exclude one another
            let Ok(mut estimator) = E::new(&parameters) else { continue };
            let mut saved = estimator.state().clone();
            let (mut out, dt) = (E::Outputs::default(), estimator.sample_period());
            let before = allocations();
            for (k, sample) in samples.iter().enumerate() {
                estimator.step(sample, [dt, 0.3, f64::NAN, 1e4][if k % 10 == 9 { k / 10 % 4 } else { 0 }]);
                estimator.outputs(sample, 0.4 * dt, &mut out);
                if k == 40 {
                    saved.clone_from(estimator.state());
                }
                if k == 90 {
                    estimator.restore(&saved).unwrap();
                }
            }
            assert_eq!(allocations(), before, "{}", E::NAME);
        }
    }
}

for_all! {
    fn units_can_be_read_and_fit_each_other<E>() {
        let lists = [E::Parameters::declare(), E::Inputs::declare(), E::Outputs::declare()];
        let mut units = BTreeMap::new();
        for variable in lists.iter().flatten() {
            if variable.unit == "1" {
                continue;
            }
            assert_eq!(variable.kind, Kind::Real, "{} {}", E::NAME, variable.name);
            let unit = unit::parse(variable.unit).unwrap_or_else(|| panic!("{} {}: {}", E::NAME, variable.name, variable.unit));
            assert_eq!(unit.factor, 1.0, "{} {}: {} is not SI", E::NAME, variable.name, variable.unit);
            units.insert(variable.name.clone(), unit.exponents);
        }
        for (name, exponents) in &units {
            if let Some(estimate) = name.strip_suffix("_std").and_then(|estimate| units.get(estimate)) {
                assert_eq!(estimate, exponents, "{} {name}", E::NAME);
            }
            // the density of a state's random walk is the square of its unit per time
            if let Some((_, state)) = name.split_once("process_psd.")
                && let Some(driven) = units.get(&format!("initial.{state}_std"))
            {
                let density = |of: [i32; 8]| std::array::from_fn::<i32, 8, _>(|k| 2 * of[k] - i32::from(k == 2));
                // the loader's unknowns walk in coordinates without a unit
                let allowed = [density(*driven), density([0; 8])];
                assert!(allowed.contains(exponents), "{} {name}: {exponents:?}", E::NAME);
            }
        }
    }
}

for_all! {
    fn names_and_flags_follow_the_rules<E>() {
        for parameter in E::Parameters::declare() {
            let density = parameter.name.contains("process_psd.");
            assert!(parameter.process_noise || !density, "{} {} has no role", E::NAME, parameter.name);
            let named = density || parameter.name.contains("measurement_std.") || parameter.name.contains("variance.");
            let flagged = parameter.process_noise || parameter.measurement_noise;
            assert!(named || !flagged, "{} {}", E::NAME, parameter.name);
            for old in ["start.", "start_", "process_std", "_noise"] {
                assert!(!parameter.name.contains(old), "{} {}", E::NAME, parameter.name);
            }
        }
        let (outputs, said) = (E::Outputs::declare(), Diagnostics::declare());
        assert_eq!(outputs[outputs.len() - said.len()..], said[..], "{}: the diagnostics come last", E::NAME);
        for output in &outputs {
            if let Kind::Code(codes) = output.kind {
                assert!(codes.iter().all(|(number, ..)| output.description.contains(&format!("{number} = "))));
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// Whatever arrives, in whatever time: outputs are finite and within their declared ranges.
    #[test]
    fn anything_is_survived(seed in any::<u64>()) {
        struct Test(u64);
        impl Visitor for Test {
            fn visit<E: Estimator + 'static>(&mut self) {
                let seed = &mut self.0;
                let mut random = || {
                    *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (*seed >> 11) as f64 / (1_u64 << 53) as f64
                };
                let declared = E::Inputs::declare();
                let mut estimator = new::<E>();
                for _ in 0..150 {
                    let flat: Vec<f64> = declared
                        .iter()
                        .map(|input| match (random() * 8.0) as u32 {
                            0 => f64::NAN,
                            1 => f64::INFINITY,
                            2 => -1e300,
                            3 => input.range.1,
                            4 => 0.0,
                            _ => (2.0 * random() - 1.0) * input.range.1.min(10.0),
                        })
                        .collect();
                    let mut inputs = E::Inputs::default();
                    inputs.read(&flat);
                    let dt = [0.01, 0.01, 0.01, 1e-6, 0.3, 0.9, 1e5][(random() * 7.0) as usize];
                    estimator.step(&inputs, dt);
                    outputs(&estimator, &inputs, [0.0, 0.01, 1e9][(random() * 3.0) as usize]);
                }
            }
        }
        visit_all(&mut Test(seed));
    }
}
