//! `fmi2DoStep` allocates nothing; an instance is small.
#![allow(unsafe_code)]

use crate::counting::{allocations, held_bytes};
use crate::support::Lag;
use wheelstate::variable::Kind;
use wheelstate_fmu::instance::Instance;
use wheelstate_fmu::model::{Model, Place, Type, models};

fn all() -> Vec<Model> {
    let mut list = models(&|_| true);
    list.push(Model::of::<Lag>());
    list
}

#[test]
fn a_running_instance_allocates_nothing() {
    for model in all() {
        let name = model.name;
        let reals: Vec<_> = (0..model.inputs.len()).filter(|i| model.inputs[*i].kind == Kind::Real).collect();
        let measured: Vec<_> = reals.iter().map(|i| model.inputs[*i].measured).collect();
        let references: Vec<_> = reals.iter().map(|i| Place::Input(*i).reference()).collect();
        let outputs: Vec<_> = (0..model.outputs.len())
            .filter(|i| model.outputs[*i].kind == Kind::Real)
            .map(|i| Place::Output(i).reference())
            .collect();
        let period = model.sample_period();
        let mut values = vec![0.0; outputs.len()];
        let mut instance = Instance::new(model, "guid");
        instance.setup(3.0, None).unwrap();
        instance.enter_initialization();
        instance.exit_initialization().unwrap();
        let mut t = 3.0;
        for k in 0..300 {
            let before = allocations();
            let input = |i: usize| {
                if measured[i] && (k + i).is_multiple_of(11) { f64::NAN } else { (0.1 * k as f64 + i as f64).sin() }
            };
            instance.set(Type::Real, &references, input).unwrap();
            let size = period * [1.0, 0.3, 2.7][k % 3];
            instance.do_step(t, size).unwrap();
            instance.get(Type::Real, &outputs, |i, value| values[i] = value).unwrap();
            t += size;
            assert_eq!(allocations(), before, "{name}, step {k}");
            assert!(values.iter().all(|value| value.is_finite()), "{name}, step {k}: {values:?}");
        }
    }
}

#[test]
fn an_instance_takes_well_under_a_megabyte() {
    for model in models(&|_| true) {
        let before = held_bytes();
        let name = model.name;
        let mut instance = Instance::new(model.clone(), "guid");
        instance.enter_initialization();
        instance.exit_initialization().unwrap();
        let bytes = held_bytes() - before;
        println!("{name}: {bytes} bytes");
        // the whole body's sparse factorisation is the one large thing
        let bound = if name == "HumanDynamics" { 1_000_000 } else { 100_000 };
        assert!(bytes < bound, "{name}: {bytes} bytes");
    }
}
