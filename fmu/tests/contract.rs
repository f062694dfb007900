//! What every model of the library keeps, whichever machine it is of: no model is named here.

use crate::support::random;
use wheelstate::Status;
use wheelstate::variable::Kind;
use wheelstate_fmu::instance::Instance;
use wheelstate_fmu::model::{Access, Model, Place, Type, models};

fn index(list: &[wheelstate::Variable], name: &str) -> usize {
    list.iter().position(|variable| variable.name == name).unwrap()
}

fn output(instance: &mut Instance, i: usize) -> f64 {
    let (class, mut got) = (Type::of(instance.model().outputs[i].kind), f64::NAN);
    instance.get(class, &[Place::Output(i).reference()], |_, value| got = value).unwrap();
    got
}

fn outputs(instance: &mut Instance) -> Vec<f64> {
    (0..instance.model().outputs.len()).map(|i| output(instance, i)).collect()
}

fn status(instance: &mut Instance) -> Status {
    let i = index(&instance.model().outputs, "status");
    <Status as wheelstate::variable::Value>::from_number(output(instance, i))
}

fn is_healthy(instance: &mut Instance) -> bool {
    let i = index(&instance.model().outputs, "healthy");
    output(instance, i) != 0.0
}

/// Every output is a finite number that its declaration allows.
fn assert_sound(instance: &mut Instance, what: &str) {
    let values = outputs(instance);
    let model = instance.model();
    for (variable, value) in model.outputs.iter().zip(values) {
        let value = Access::of(variable).from_fmi(value);
        assert!(value.is_finite(), "{} {what}: {} = {value}", model.name, variable.name);
        if variable.kind != Kind::Real {
            let (low, high) = variable.range;
            assert!((low..=high).contains(&value), "{} {what}: {} = {value}", model.name, variable.name);
        }
        if variable.name.ends_with("_std") {
            assert!(value >= 0.0, "{} {what}: {} = {value}", model.name, variable.name);
        }
    }
}

/// An instance at its first communication point, unless the model refuses these parameters together.
fn started(model: &Model, parameters: &[(usize, f64)]) -> Option<Instance> {
    let mut instance = Instance::new(model.clone(), "guid");
    for &(i, value) in parameters {
        let access = Access::of(&model.parameters[i]);
        instance.set(access.class, &[Place::Parameter(i).reference()], |_| access.to_fmi(value)).unwrap();
    }
    instance.enter_initialization();
    instance.exit_initialization().ok().map(|()| instance)
}

/// Sets every Real input that takes it.
fn feed(instance: &mut Instance, value: impl Fn(usize) -> f64) {
    for i in 0..instance.model().inputs.len() {
        if Type::of(instance.model().inputs[i].kind) == Type::Real {
            // what an input cannot take is refused and changes nothing
            let _ = instance.set(Type::Real, &[Place::Input(i).reference()], |_| value(i));
        }
    }
}

fn step(instance: &mut Instance, periods: f64) {
    let (now, period) = (instance.time(), instance.model().sample_period());
    instance.do_step(now, periods * period).unwrap();
}

#[test]
fn whatever_a_sensor_says_the_outputs_are_sound() {
    for model in models(&|_| true) {
        let mut instance = started(&model, &[]).unwrap();
        let mut seed = 3;
        for (round, size) in [0.0, 1.0, f64::NAN, 1e3, f64::INFINITY, 1e100, -1e100, 1e300, f64::MAX, 1e-300, 0.1]
            .into_iter()
            .enumerate()
        {
            for k in 0..12 {
                let sign = |i: usize| if (i + k).is_multiple_of(2) { 1.0 } else { -1.0 };
                let shares: Vec<_> = model.inputs.iter().map(|_| random(&mut seed)).collect();
                // now all sensors, now every third one alone
                feed(&mut instance, |i| {
                    if round % 2 == 0 || i % 3 == k % 3 { size * sign(i) * (0.5 + 0.5 * shares[i]) } else { 0.1 }
                });
                step(&mut instance, if k % 5 == 4 { 3.7 } else { 1.0 });
                assert_sound(&mut instance, &format!("after {size:e}"));
            }
        }
    }
}

#[test]
fn with_any_parameter_at_the_end_of_its_range_the_outputs_are_sound() {
    for model in models(&|_| true) {
        let (mut tried, mut accepted) = (0, 0);
        for (i, variable) in model.parameters.iter().enumerate() {
            let (low, high) = variable.range;
            for bound in [low, high].into_iter().filter(|bound| bound.is_finite() && variable.name != "sample_period") {
                tried += 1;
                let Some(mut instance) = started(&model, &[(i, bound)]) else { continue };
                accepted += 1;
                for k in 0..6 {
                    feed(&mut instance, |i| 0.2 * (0.3 * f64::from(k) + i as f64).sin());
                    step(&mut instance, 1.0);
                    assert_sound(&mut instance, &format!("{} = {bound}", variable.name));
                }
            }
        }
        assert!(2 * accepted > tried, "{}: {accepted} of {tried}", model.name);
    }
}

#[test]
fn an_input_that_was_never_set_is_missing_and_nothing_measured_is_not_healthy() {
    for model in models(&|_| true) {
        let (mut unset, mut set_to_nan) = (started(&model, &[]).unwrap(), started(&model, &[]).unwrap());
        for _ in 0..200 {
            feed(&mut set_to_nan, |i| if model.inputs[i].may_be_missing() { f64::NAN } else { 0.0 });
            step(&mut unset, 1.0);
            step(&mut set_to_nan, 1.0);
        }
        assert_eq!(outputs(&mut unset), outputs(&mut set_to_nan), "{}", model.name);
        assert!(!is_healthy(&mut unset), "{}", model.name);
        assert_ne!(status(&mut unset), Status::OK, "{}", model.name);
        assert_sound(&mut unset, "never set");
    }
}

#[test]
fn every_bit_of_the_status_has_a_meaning() {
    let known = (1_u32 << Status::ALL.len()) - 1;
    for model in models(&|_| true) {
        let mut instance = started(&model, &[]).unwrap();
        let mut seed = 9;
        for _ in 0..100 {
            let values: Vec<_> = model.inputs.iter().map(|_| 20.0 * random(&mut seed) - 10.0).collect();
            feed(&mut instance, |i| values[i]);
            step(&mut instance, 1.0 + 5.0 * random(&mut seed));
            assert_eq!(status(&mut instance).bits() & !known, 0, "{}", model.name);
        }
    }
}

#[test]
fn a_state_from_any_step_repeats_every_bit_also_through_bytes() {
    for model in models(&|_| true) {
        let mut seed = 17;
        let mut instance = started(&model, &[]).unwrap();
        let mut other = Instance::new(model.clone(), "guid");
        for _ in 0..12 {
            let rows: Vec<Vec<f64>> = (0..10)
                .map(|_| {
                    let one = |_| if random(&mut seed) < 0.1 { f64::NAN } else { random(&mut seed) - 0.5 };
                    model.inputs.iter().map(one).collect()
                })
                .collect();
            let handle = instance.get_state(0).unwrap();
            let bytes = instance.serialize_state(handle).unwrap();
            let run = |instance: &mut Instance| {
                let mut seen = Vec::new();
                for (k, row) in rows.iter().enumerate() {
                    feed(instance, |i| row[i]);
                    step(instance, if k % 4 == 3 { 2.3 } else { 1.0 });
                    seen.extend(outputs(instance).into_iter().map(f64::to_bits));
                }
                seen
            };
            let first = run(&mut instance);
            instance.set_state(handle).unwrap();
            assert_eq!(run(&mut instance), first, "{}", model.name);
            let copy = other.deserialize_state(&bytes, 0).unwrap();
            other.set_state(copy).unwrap();
            assert_eq!(run(&mut other), first, "{}", model.name);
            instance.free_state(handle).unwrap();
        }
    }
}

#[test]
fn instances_in_many_threads_do_not_touch_each_other() {
    for model in models(&|_| true) {
        let run = |phase: usize| {
            let mut instance = started(&model, &[]).unwrap();
            for k in 0..15 {
                feed(&mut instance, |i| 0.2 * (0.3 * k as f64 + (i + phase) as f64).sin());
                step(&mut instance, 1.0);
            }
            outputs(&mut instance)
        };
        let alone: Vec<_> = (0..4).map(run).collect();
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..32).map(|i| scope.spawn(move || (i, run(i % 4)))).collect();
            for thread in threads {
                let (i, seen) = thread.join().unwrap();
                assert_eq!(seen, alone[i % 4], "{} thread {i}", model.name);
            }
        });
    }
}
