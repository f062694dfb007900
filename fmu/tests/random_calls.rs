//! Random calls with random arguments: no sequence crashes, hangs, leaks, loses an instance, answers
//! with anything but a legal status, or lets NaN or infinity into an output.
#![allow(unsafe_code)]

use crate::counting::held_bytes;
use crate::support::host::{callbacks, last_message, messages};
use std::ffi::{CString, c_char, c_int, c_uint};
use std::ptr::{null, null_mut};
use wheelstate_fmu::abi::*;
use wheelstate_fmu::describe::guid;
use wheelstate_fmu::model::{Model, Place, Type, models};

/// Numbers from a seed (xorshift64*).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    fn below(&mut self, bound: usize) -> usize {
        (self.next() >> 33) as usize % bound
    }

    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }

    /// Mostly usual numbers, now and then the worst there are.
    fn value(&mut self) -> f64 {
        const WORST: [f64; 11] =
            [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, 5e-324, -0.0, 1e18, -1e18, 1e-300, 0.0];
        match self.below(4) {
            0 => self.of(&WORST),
            1 => self.below(5) as f64,
            scale => (self.below(2001) as f64 - 1000.0) * if scale == 2 { 1e-3 } else { 0.1 },
        }
    }
}

/// One instance with what a host would remember of it.
struct Fuzzed {
    c: Component,
    random: Random,
    known: Vec<(c_uint, Type)>,
    outputs: Vec<c_uint>,
    period: f64,
    states: Vec<State>,
    bytes: Vec<u8>,
}

impl Fuzzed {
    fn new(model: &Model, seed: u64) -> Self {
        let guid = CString::new(guid::of(model)).unwrap();
        let callbacks = callbacks();
        let c =
            unsafe { fmi2Instantiate(c"fuzz".as_ptr(), 1, guid.as_ptr(), null(), &callbacks, 0, (seed % 2) as c_int) };
        assert!(!c.is_null(), "{}", last_message());
        let places = (0..model.parameters.len()).map(|i| (Place::Parameter(i), model.parameters[i].kind));
        let places = places.chain((0..model.inputs.len()).map(|i| (Place::Input(i), model.inputs[i].kind)));
        let places = places.chain((0..model.outputs.len()).map(|i| (Place::Output(i), model.outputs[i].kind)));
        let known = places.map(|(place, kind)| (place.reference(), Type::of(kind))).collect();
        let real = |i: &usize| Type::of(model.outputs[*i].kind) == Type::Real;
        let outputs = (0..model.outputs.len()).filter(real).map(|i| Place::Output(i).reference()).collect();
        let random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        let period = model.sample_period();
        Self { c, random, known, outputs, period, states: vec![], bytes: vec![0; 64] }
    }

    /// Up to five references, mostly of one type, now and then one that does not exist.
    fn references(&mut self, class: Type) -> Vec<c_uint> {
        let any = self.random.below(12) == 0;
        let fitting: Vec<_> = self.known.iter().filter(|(_, of)| any || *of == class).map(|(vr, _)| *vr).collect();
        let count = self.random.of(&[0, 1, 1, 1, 2, 5]);
        let one =
            |random: &mut Random| if random.below(50) == 0 { random.next() as c_uint } else { random.of(&fitting) };
        (0..count).map(|_| one(&mut self.random)).collect()
    }

    fn handle(&mut self) -> State {
        match self.random.below(8) {
            0 => null_mut(),
            1 => self.random.next() as State,
            _ if self.states.is_empty() => null_mut(),
            _ => self.random.of(&self.states),
        }
    }

    fn call(&mut self) -> Status {
        let function = self.random.below(30);
        let class = match function {
            8 | 11 => Type::Integer,
            9 | 12 => Type::Boolean,
            _ => Type::Real,
        };
        let (c, references) = (self.c, self.references(class));
        let (vr, n) = (references.as_ptr(), references.len());
        let values: Vec<f64> = references.iter().map(|_| self.random.value()).collect();
        let whole: Vec<c_int> = values.iter().map(|value| *value as c_int).collect();
        let (mut reals, mut integers) = (vec![0.0; n], vec![0; n]);
        let kind = self.random.below(5) as c_uint;
        unsafe {
            match function {
                0 => fmi2SetDebugLogging(c, (kind % 2) as c_int, 0, null()),
                1 => fmi2SetupExperiment(c, 0, 0.0, self.random.of(&[0.0, -5.0, 1e6 + 0.05]), 0, 0.0),
                2 => fmi2EnterInitializationMode(c),
                3 => fmi2ExitInitializationMode(c),
                4 if self.random.below(8) == 0 => fmi2Terminate(c),
                5 if self.random.below(4) == 0 => fmi2Reset(c),
                6 | 7 => fmi2SetReal(c, vr, n, values.as_ptr()),
                8 => fmi2SetInteger(c, vr, n, whole.as_ptr()),
                9 => fmi2SetBoolean(c, vr, n, whole.as_ptr()),
                10 => fmi2GetReal(c, vr, n, reals.as_mut_ptr()),
                11 => fmi2GetInteger(c, vr, n, integers.as_mut_ptr()),
                12 => fmi2GetBoolean(c, vr, n, integers.as_mut_ptr()),
                13 => fmi2SetRealInputDerivatives(c, vr, n, vec![1; n].as_ptr(), values.as_ptr()),
                14 => fmi2GetRealOutputDerivatives(c, vr, n, vec![1; n].as_ptr(), reals.as_mut_ptr()),
                15 => self.state(),
                16 => fmi2SetFMUstate(c, self.handle()),
                17 => {
                    let mut state = self.handle();
                    fmi2FreeFMUstate(c, &mut state)
                }
                18 => self.serialize(),
                19 => self.deserialize(),
                20 => fmi2GetRealStatus(c, kind, reals.first_mut().map_or(null_mut(), |slot| slot)),
                21 => fmi2GetBooleanStatus(c, kind, integers.first_mut().map_or(null_mut(), |slot| slot)),
                22 => fmi2GetStatus(c, kind, &mut 0),
                23 => fmi2GetString(c, vr, n, vec![null::<c_char>(); n].as_mut_ptr()),
                24 => fmi2GetReal(c, null(), n, null_mut()),
                _ => self.step(),
            }
        }
    }

    fn step(&mut self) -> Status {
        let share = self.random.of(&[1.0, 0.37, 13.9, 1e-4, 1.0 / 3.0, 0.0, -1.0, f64::NAN, f64::INFINITY, 1e300]);
        let mut now = 0.0;
        unsafe { fmi2GetRealStatus(self.c, 2, &mut now) };
        let point = if self.random.below(12) == 0 { self.random.value() } else { now };
        unsafe { fmi2DoStep(self.c, point, share * self.period, 0) }
    }

    fn state(&mut self) -> Status {
        let mut state = if self.states.len() < 4 { null_mut() } else { self.handle() };
        let status = unsafe { fmi2GetFMUstate(self.c, &mut state) };
        if status == OK && !self.states.contains(&state) {
            self.states.push(state);
        }
        status
    }

    fn serialize(&mut self) -> Status {
        let state = self.handle();
        let mut size = 0;
        let status = unsafe { fmi2SerializedFMUstateSize(self.c, state, &mut size) };
        if status != OK {
            return status;
        }
        self.bytes = vec![0; size];
        unsafe { fmi2SerializeFMUstate(self.c, state, self.bytes.as_mut_ptr(), size) }
    }

    /// The bytes as they are, cut, or with one of them changed.
    fn deserialize(&mut self) -> Status {
        let mut bytes = self.bytes.clone();
        match self.random.below(3) {
            0 => bytes.truncate(self.random.below(bytes.len())),
            1 => {
                let place = self.random.below(bytes.len());
                bytes[place] ^= 1 << self.random.below(8);
            }
            _ => {}
        }
        let mut state = self.handle();
        let status = unsafe { fmi2DeSerializeFMUstate(self.c, bytes.as_ptr(), bytes.len(), &mut state) };
        if status == OK && !self.states.contains(&state) {
            self.states.push(state);
        }
        status
    }

    /// Every Real output, where they can be read, is a number.
    fn assert_finite(&self, what: &str) {
        let mut values = vec![0.0; self.outputs.len()];
        let status = unsafe { fmi2GetReal(self.c, self.outputs.as_ptr(), values.len(), values.as_mut_ptr()) };
        assert!(status != OK || values.iter().all(|value| value.is_finite()), "{what}: {values:?}");
    }
}

impl Drop for Fuzzed {
    fn drop(&mut self) {
        unsafe { fmi2FreeInstance(self.c) }
    }
}

/// Runs a sequence and gives how many calls were served.
fn sequence(model: &Model, seed: u64, calls: usize) -> usize {
    let mut fuzzed = Fuzzed::new(model, seed);
    if !seed.is_multiple_of(3) {
        // most of the calls make sense at a communication point only
        unsafe {
            assert_eq!(fmi2EnterInitializationMode(fuzzed.c), OK);
            assert_eq!(fmi2ExitInitializationMode(fuzzed.c), OK);
        }
    }
    let mut served = 0;
    for call in 0..calls {
        let status = fuzzed.call();
        assert!([OK, WARNING, DISCARD, ERROR].contains(&status), "{} seed {seed} call {call}: {status}", model.name);
        let log = messages();
        assert!(status == OK || !log.is_empty(), "{} seed {seed} call {call} is refused without a reason", model.name);
        served += usize::from(status == OK);
        fuzzed.assert_finite(&format!("{} seed {seed} call {call}", model.name));
        messages();
    }
    served
}

/// Sequences per model; WHEELSTATE_SEQUENCES=6700 makes a million calls of each.
fn sequences() -> u64 {
    std::env::var("WHEELSTATE_SEQUENCES").ok().and_then(|text| text.parse().ok()).unwrap_or(150)
}

#[test]
fn random_calls_are_answered() {
    for model in models(&|_| true) {
        let (calls, seeds) = (150, sequences());
        sequence(&model, 0, calls);
        let before = held_bytes();
        let served: usize = (1..=seeds).map(|seed| sequence(&model, seed, calls)).sum();
        // before anything is printed: the harness keeps what it captures
        let held = held_bytes();
        // neither everything nor nothing is refused
        let share = served as f64 / (seeds as usize * calls) as f64;
        println!("{}: {:.0} % of the calls served", model.name, 100.0 * share);
        assert!((0.2..0.95).contains(&share), "{}: {share}", model.name);
        // the list of vacant places, shared with the other tests, may have grown or shrunk
        assert!(held.abs_diff(before) < seeds as usize * 8, "{} leaks: {before} then {held} bytes", model.name);
    }
}

#[test]
fn a_step_that_would_never_end_is_refused() {
    let model = models(&|_| true).remove(0);
    let fuzzed = Fuzzed::new(&model, 1);
    unsafe {
        assert_eq!(fmi2EnterInitializationMode(fuzzed.c), OK);
        assert_eq!(fmi2ExitInitializationMode(fuzzed.c), OK);
        for size in [1e300, 1e12, 1e5] {
            assert_eq!(fmi2DoStep(fuzzed.c, 0.0, size, 0), ERROR);
            assert!(last_message().contains("more than 100000 samples"), "{}", last_message());
        }
        assert_eq!(fmi2DoStep(fuzzed.c, 0.0, 0.01, 0), OK);
    }
}
