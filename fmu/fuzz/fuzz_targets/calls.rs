//! Any sequence of FMI calls on any model: nothing crashes, hangs or lets a number that is not finite into an output.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use std::ffi::{CString, c_int};
use std::ptr::{null, null_mut};
use wheelstate_fmu::abi::*;
use wheelstate_fmu::describe::guid;
use wheelstate_fmu::model::{Model, Place, Type, models};

#[derive(Arbitrary, Debug)]
enum Call {
    Setup { start: f64, stop: Option<f64> },
    Enter,
    Exit,
    Terminate,
    Reset,
    Set { place: u16, value: f64 },
    SetTyped { class: u8, reference: u32, value: f64 },
    Slope { place: u16, order: i8, value: f64 },
    Rate { place: u16 },
    Step { share: u8, count: u8 },
    StepRaw { point: f64, size: f64 },
    GetState { slot: u8 },
    SetState { slot: u8 },
    FreeState { slot: u8, by_handle: bool },
    Serialize { slot: u8 },
    Deserialize { slot: u8, flip: Option<(u16, u8)>, cut: Option<u16> },
    Status { kind: u8 },
    Free,
}

#[derive(Arbitrary, Debug)]
struct Input {
    model: u8,
    calls: Vec<Call>,
}

const SHARES: [f64; 8] = [1.0, 0.37, 13.9, 1e-4, 1.0 / 3.0, 0.0, -1.0, 100.0];

fn place(model: &Model, number: u16) -> (u32, Type) {
    let (p, i, o) = (model.parameters.len(), model.inputs.len(), model.outputs.len());
    let k = usize::from(number) % (p + i + o);
    let (place, kind) = match k {
        k if k < p => (Place::Parameter(k), model.parameters[k].kind),
        k if k < p + i => (Place::Input(k - p), model.inputs[k - p].kind),
        k => (Place::Output(k - p - i), model.outputs[k - p - i].kind),
    };
    (place.reference(), Type::of(kind))
}

fn set(c: Component, class: Type, reference: u32, value: f64) -> Status {
    let whole = value as c_int;
    unsafe {
        match class {
            Type::Real => fmi2SetReal(c, &reference, 1, &value),
            Type::Integer => fmi2SetInteger(c, &reference, 1, &whole),
            Type::Boolean => fmi2SetBoolean(c, &reference, 1, &whole),
        }
    }
}

fn outputs_are_finite(c: Component, model: &Model) {
    for (i, variable) in model.outputs.iter().enumerate() {
        let (reference, mut value) = (Place::Output(i).reference(), 0.0);
        if Type::of(variable.kind) == Type::Real && unsafe { fmi2GetReal(c, &reference, 1, &mut value) } == OK {
            assert!(value.is_finite(), "{} = {value}", variable.name);
        }
    }
}

fuzz_target!(|input: Input| {
    let list = models(&|_| true);
    let model = &list[usize::from(input.model) % list.len()];
    let guid = CString::new(guid::of(model)).unwrap_or_default();
    let c = unsafe { fmi2Instantiate(c"fuzz".as_ptr(), 1, guid.as_ptr(), null(), null(), 0, 1) };
    assert!(!c.is_null());
    let period = model.sample_period();
    let mut states: [State; 4] = [null_mut(); 4];
    let mut bytes: Vec<u8> = Vec::new();
    for call in input.calls.iter().take(64) {
        let slot = |slot: u8| usize::from(slot) % 4;
        let status = unsafe {
            match *call {
                Call::Setup { start, stop } => {
                    fmi2SetupExperiment(c, 0, 0.0, start, c_int::from(stop.is_some()), stop.unwrap_or(0.0))
                }
                Call::Enter => fmi2EnterInitializationMode(c),
                Call::Exit => fmi2ExitInitializationMode(c),
                Call::Terminate => fmi2Terminate(c),
                Call::Reset => fmi2Reset(c),
                Call::Set { place: number, value } => {
                    let (reference, class) = place(model, number);
                    set(c, class, reference, value)
                }
                Call::SetTyped { class, reference, value } => {
                    set(c, [Type::Real, Type::Integer, Type::Boolean][usize::from(class) % 3], reference, value)
                }
                Call::Slope { place: number, order, value } => {
                    let (reference, _) = place(model, number);
                    fmi2SetRealInputDerivatives(c, &reference, 1, &c_int::from(order), &value)
                }
                Call::Rate { place: number } => {
                    let ((reference, _), mut value) = (place(model, number), 0.0);
                    let status = fmi2GetRealOutputDerivatives(c, &reference, 1, &1, &mut value);
                    assert!(value.is_finite());
                    status
                }
                Call::Step { share, count } => {
                    let size = SHARES[usize::from(share) % SHARES.len()] * period;
                    let mut status = OK;
                    for _ in 0..count % 16 {
                        let mut now = 0.0;
                        fmi2GetRealStatus(c, 2, &mut now);
                        status = fmi2DoStep(c, now, size, 1);
                    }
                    status
                }
                // what takes long is known and bounded; it would only slow the search
                Call::StepRaw { size, .. } if size > 1000.0 * period && size.is_finite() => OK,
                Call::StepRaw { point, size } => fmi2DoStep(c, point, size, 1),
                Call::GetState { slot: s } => fmi2GetFMUstate(c, &mut states[slot(s)]),
                Call::SetState { slot: s } => fmi2SetFMUstate(c, states[slot(s)]),
                Call::FreeState { slot: s, by_handle: false } => fmi2FreeFMUstate(c, &mut states[slot(s)]),
                Call::FreeState { slot: s, by_handle: true } => fmi2FreeFMUstate(c, states[slot(s)].cast()),
                Call::Serialize { slot: s } => {
                    let mut size = 0;
                    let status = fmi2SerializedFMUstateSize(c, states[slot(s)], &mut size);
                    bytes.resize(size, 0);
                    if status == OK {
                        fmi2SerializeFMUstate(c, states[slot(s)], bytes.as_mut_ptr(), size)
                    } else {
                        status
                    }
                }
                Call::Deserialize { slot: s, flip, cut } => {
                    let mut altered = bytes.clone();
                    if let (Some((at, bits)), false) = (flip, altered.is_empty()) {
                        let at = usize::from(at) % altered.len();
                        altered[at] ^= bits;
                    }
                    altered.truncate(cut.map_or(altered.len(), usize::from));
                    fmi2DeSerializeFMUstate(c, altered.as_ptr(), altered.len(), &mut states[slot(s)])
                }
                Call::Status { kind } => fmi2GetStatus(c, u32::from(kind), &mut 0),
                Call::Free => {
                    fmi2FreeInstance(c);
                    OK
                }
            }
        };
        // a panic inside would make the instance fatal: that is a fault to be found here
        assert_ne!(status, FATAL, "{call:?}");
        outputs_are_finite(c, model);
    }
    unsafe { fmi2FreeInstance(c) };
});
