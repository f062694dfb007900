//! What the FMU adds to the native step, and what an instance and its values cost.
//!
//! `native_*` is the estimator's own step and outputs; `fmu_*` is `fmi2DoStep` around the same; their
//! difference is the overhead. Run: `cargo bench -p wheelstate-fmu`.
#![allow(unsafe_code, missing_docs)]

use divan::{Bencher, black_box};
use std::ffi::{CStr, CString};
use std::ptr::null;
use wheelstate::Estimator;
use wheelstate::estimator::Visitor;
use wheelstate_fmu::abi::*;
use wheelstate_fmu::describe::guid;
use wheelstate_fmu::model::{Model, Place, Type, models};

#[path = "../support/mod.rs"]
mod support;

fn main() {
    divan::main();
}

const MODELS: [&str; 5] = ["NursingRobot", "WheeledRobot", "WheelLoader", "HumanDynamics", "Wheelchair"];

/// Those whose step is short enough for the wrapper to show.
const SHORT: [&str; 4] = ["NursingRobot", "WheeledRobot", "WheelLoader", "Wheelchair"];

/// The model of this name, unless the library has none.
fn model(name: &str) -> Option<Model> {
    models(&|known| known == name).pop()
}

struct Instance {
    c: Component,
}

impl Instance {
    fn of(catalogue: wheelstate_fmu::model::Catalogue, model: &Model) -> Self {
        Self::named(catalogue, &CString::new(guid::of(model)).unwrap())
    }

    fn named(catalogue: wheelstate_fmu::model::Catalogue, guid: &CStr) -> Self {
        let c = unsafe { instantiate_from(catalogue, c"bench".as_ptr(), 1, guid.as_ptr(), null(), null(), 0, 0) };
        assert!(!c.is_null());
        unsafe {
            fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
            fmi2EnterInitializationMode(c);
            assert_eq!(fmi2ExitInitializationMode(c), OK);
        }
        Self { c }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        unsafe { fmi2FreeInstance(self.c) }
    }
}

/// Benchmarks the native step of the visited estimator.
struct Native<'a, 'b> {
    name: &'a str,
    bencher: Option<Bencher<'a, 'b>>,
}

impl Visitor for Native<'_, '_> {
    fn visit<E: Estimator + 'static>(&mut self) {
        if E::NAME == self.name
            && let Some(bencher) = self.bencher.take()
        {
            native::<E>(bencher);
        }
    }
}

fn native<E: Estimator>(bencher: Bencher) {
    let mut estimator = E::new(&E::Parameters::default()).unwrap();
    let (inputs, mut outputs) = (E::Inputs::default(), E::Outputs::default());
    let period = estimator.sample_period();
    bencher.bench_local(move || {
        estimator.step(black_box(&inputs), period);
        estimator.outputs(black_box(&inputs), period, &mut outputs);
        black_box(&outputs);
    });
}

fn fmu(bencher: Bencher, instance: &Instance, period: f64) {
    let mut k = 0_u64;
    bencher.bench_local(|| {
        let status = unsafe { fmi2DoStep(black_box(instance.c), k as f64 * period, period, 1) };
        k += 1;
        assert_eq!(status, OK);
    });
}

/// The step of a machine that does next to nothing: what is left is the wrapper.
#[divan::bench(sample_size = 1000)]
fn native_lag(bencher: Bencher) {
    native::<support::Lag>(bencher);
}

#[divan::bench(sample_size = 1000)]
fn fmu_lag(bencher: Bencher) {
    let model = Model::of::<support::Lag>();
    fmu(bencher, &Instance::of(support::catalogue, &model), model.sample_period());
}

#[divan::bench(args = SHORT, sample_size = 100)]
fn native_step(bencher: Bencher, name: &str) {
    wheelstate::estimator::visit_all(&mut Native { name, bencher: Some(bencher) });
}

#[divan::bench(args = SHORT, sample_size = 100)]
fn fmu_step(bencher: Bencher, name: &str) {
    if let Some(model) = model(name) {
        fmu(bencher, &Instance::of(models, &model), model.sample_period());
    }
}

/// From nothing to the first communication point, and freeing.
#[divan::bench(args = MODELS)]
fn instantiate(bencher: Bencher, name: &str) {
    if let Some(model) = model(name) {
        let guid = CString::new(guid::of(&model)).unwrap();
        bencher.bench_local(|| Instance::named(models, &guid));
    }
}

/// Copying the state into a handle that exists.
#[divan::bench(args = MODELS, sample_size = 100)]
fn get_state(bencher: Bencher, name: &str) {
    if let Some(model) = model(name) {
        let instance = Instance::of(models, &model);
        let mut state = std::ptr::null_mut();
        bencher.bench_local(|| unsafe { fmi2GetFMUstate(instance.c, &mut state) });
    }
}

/// The Real inputs of a model, as one call of a host sets them.
fn real_inputs(model: &Model) -> Vec<u32> {
    let reals = model.inputs.iter().enumerate().filter(|(_, input)| Type::of(input.kind) == Type::Real);
    reals.map(|(i, _)| Place::Input(i).reference()).collect()
}

/// Setting all Real inputs by one call.
#[divan::bench(args = MODELS, sample_size = 1000)]
fn set_inputs(bencher: Bencher, name: &str) {
    if let Some(model) = model(name) {
        let (instance, references) = (Instance::of(models, &model), real_inputs(&model));
        let values = vec![0.5; references.len()];
        bencher.counter(divan::counter::ItemsCount::new(references.len())).bench_local(|| unsafe {
            fmi2SetReal(black_box(instance.c), references.as_ptr(), references.len(), black_box(values.as_ptr()))
        });
    }
}

/// Reading all Real inputs by one call.
#[divan::bench(args = MODELS, sample_size = 1000)]
fn get_inputs(bencher: Bencher, name: &str) {
    if let Some(model) = model(name) {
        let (instance, references) = (Instance::of(models, &model), real_inputs(&model));
        let mut values = vec![0.5; references.len()];
        bencher.counter(divan::counter::ItemsCount::new(references.len())).bench_local(|| unsafe {
            fmi2GetReal(black_box(instance.c), references.as_ptr(), references.len(), black_box(values.as_mut_ptr()))
        });
    }
}
