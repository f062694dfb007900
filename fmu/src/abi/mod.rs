//! The 34 C functions of FMI 2.0 co-simulation: pointers in, safe calls out, no logic.
//!
//! The only unsafe code of the project. What a host must guarantee to every function here is what the FMI 2.0
//! standard says: components come from `fmi2Instantiate` and are used from one thread at a time,
//! arrays are as long as their counts, strings end with NUL. Components and states are handles, which are looked up
//! and never followed: NULL, foreign, stale and freed ones are refused, and so are a component in use by another
//! thread, NULL arrays and handles in the place of addresses. No panic leaves a function.
#![allow(unsafe_code, clippy::missing_safety_doc)] // the safety contract is the one above for all

mod boundary;
mod import;
mod logger;
mod table;
mod types;

use crate::describe::guid;
use crate::handle;
use crate::instance::Instance;
use crate::model::{Catalogue, Type, models};
use crate::phase::Call;
use crate::refusal::Refusal;
use boundary::{enter, guarded, list, place, room, text};
pub use import::Imported;
use logger::Logger;
use std::ffi::{CStr, c_char, c_int, c_uint};
use table::Slave;
pub use types::{Boolean, Callbacks, Component, DISCARD, ERROR, FATAL, LoggerCallback, OK, State, Status, WARNING};

const CO_SIMULATION: c_uint = 1;

/// Always `"default"`: the types of `fmi2TypesPlatform.h` as they are.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

/// Always `"2.0"`.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// Chooses the log categories.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetDebugLogging(
    c: Component,
    logging_on: Boolean,
    count: usize,
    categories: *const *const c_char,
) -> Status {
    enter(c, Call::SetDebugLogging, "fmi2SetDebugLogging", |slave| {
        // SAFETY: the host passes `count` strings.
        let names = unsafe { list(categories, count) }?;
        // SAFETY: as above; NULL among them is refused.
        let names: Option<Vec<&CStr>> = names.iter().map(|name| unsafe { text(*name) }).collect();
        let names = names.ok_or_else(|| Refusal::error("NULL was passed for a category"))?;
        slave.logger.choose(logging_on != 0, &names)
    })
}

/// Makes an instance of the model that has this GUID; NULL, with the reason logged, if there is none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_uint,
    guid: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    visible: Boolean,
    logging_on: Boolean,
) -> Component {
    // SAFETY: passed on as they are.
    unsafe { instantiate_from(models, name, kind, guid, resources, callbacks, visible, logging_on) }
}

/// [`fmi2Instantiate`] over any models, for tests with estimators of their own.
#[doc(hidden)]
#[allow(clippy::too_many_arguments)]
pub unsafe fn instantiate_from(
    catalogue: Catalogue,
    name: *const c_char,
    kind: c_uint,
    guid: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: Boolean,
    logging_on: Boolean,
) -> Component {
    const FUNCTION: &str = "fmi2Instantiate";
    // SAFETY: strings of the host; NULL gives None.
    let (name, guid, resources) = unsafe { (text(name), text(guid), text(resources)) };
    // SAFETY: NULL or the host's callbacks, which are copied here and not kept.
    let callbacks = unsafe { callbacks.as_ref() };
    let logger = Logger::new(callbacks, name.unwrap_or_default(), logging_on != 0);
    let made = guarded(|| {
        if name.is_none_or(CStr::is_empty) {
            return Err(Refusal::error("an instance needs a name"));
        }
        if kind != CO_SIMULATION {
            return Err(Refusal::error(format!("fmuType = {kind}; this FMU is for co-simulation (1) only")));
        }
        let guid = guid.ok_or_else(|| Refusal::error("NULL was passed for the GUID"))?.to_string_lossy();
        let resources = resources.map(CStr::to_string_lossy);
        let model = guid::find(catalogue, &guid, resources.as_deref()).map_err(Refusal::error)?;
        Ok(Instance::new(model, guid))
    });
    let refusal = match made {
        Ok(Ok(instance)) => match table::insert(Slave { instance, logger: logger.clone() }) {
            Some(component) => return component,
            None => Refusal::error("there are too many instances in this process"),
        },
        Ok(Err(refusal)) => refusal,
        Err(panic) => Refusal::error(format!("internal error: {panic}")),
    };
    logger.refuse(FUNCTION, &refusal);
    std::ptr::null_mut()
}

/// Frees an instance with all its states. NULL and freed components are ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(c: Component) {
    // a panic while dropping ends here; the memory is then lost, the host is not
    let _ = guarded(|| drop(table::remove(c)));
}

/// Sets start and stop time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetupExperiment(
    c: Component,
    _tolerance_defined: Boolean,
    _tolerance: f64,
    start: f64,
    stop_defined: Boolean,
    stop: f64,
) -> Status {
    enter(c, Call::SetupExperiment, "fmi2SetupExperiment", |slave| {
        slave.instance.setup(start, (stop_defined != 0).then_some(stop))
    })
}

/// Begins the initialisation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2EnterInitializationMode(c: Component) -> Status {
    enter(c, Call::EnterInitialization, "fmi2EnterInitializationMode", |slave| {
        slave.instance.enter_initialization();
        Ok(())
    })
}

/// Checks the parameters together and builds the estimator.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2ExitInitializationMode(c: Component) -> Status {
    enter(c, Call::ExitInitialization, "fmi2ExitInitializationMode", |slave| {
        slave.instance.exit_initialization()?;
        slave.logger.event(|| slave.instance.summary());
        Ok(())
    })
}

/// Ends the simulation; values can still be read.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Terminate(c: Component) -> Status {
    enter(c, Call::Terminate, "fmi2Terminate", |slave| {
        slave.instance.terminate();
        Ok(())
    })
}

/// Back to a fresh instance.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Reset(c: Component) -> Status {
    enter(c, Call::Reset, "fmi2Reset", |slave| {
        slave.instance.reset();
        slave.logger.event(|| "reset to the start values".to_owned());
        Ok(())
    })
}

/// Reads Real variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetReal(c: Component, vr: *const c_uint, count: usize, value: *mut f64) -> Status {
    enter(c, Call::Get, "fmi2GetReal", |slave| {
        // SAFETY: the host passes `count` references and room for as many values.
        let (references, values) = unsafe { (list(vr, count)?, room(value, count)?) };
        slave.instance.get(Type::Real, references, |i, value| values[i] = value)
    })
}

/// Reads Integer and Enumeration variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetInteger(c: Component, vr: *const c_uint, count: usize, value: *mut c_int) -> Status {
    enter(c, Call::Get, "fmi2GetInteger", |slave| {
        // SAFETY: the host passes `count` references and room for as many values.
        let (references, values) = unsafe { (list(vr, count)?, room(value, count)?) };
        slave.instance.get(Type::Integer, references, |i, value| values[i] = value as c_int)
    })
}

/// Reads Boolean variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetBoolean(c: Component, vr: *const c_uint, count: usize, value: *mut Boolean) -> Status {
    enter(c, Call::Get, "fmi2GetBoolean", |slave| {
        // SAFETY: the host passes `count` references and room for as many values.
        let (references, values) = unsafe { (list(vr, count)?, room(value, count)?) };
        slave.instance.get(Type::Boolean, references, |i, value| values[i] = Boolean::from(value != 0.0))
    })
}

/// No variable is a String: only an empty list is served.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetString(
    c: Component,
    _vr: *const c_uint,
    count: usize,
    _value: *mut *const c_char,
) -> Status {
    enter(c, Call::Get, "fmi2GetString", |_| no_strings(count))
}

/// Sets Real variables, all or none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetReal(c: Component, vr: *const c_uint, count: usize, value: *const f64) -> Status {
    enter(c, Call::Set, "fmi2SetReal", |slave| {
        // SAFETY: the host passes `count` references and as many values.
        let (references, values) = unsafe { (list(vr, count)?, list(value, count)?) };
        slave.instance.set(Type::Real, references, |i| values[i])
    })
}

/// Sets Integer and Enumeration variables, all or none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetInteger(c: Component, vr: *const c_uint, count: usize, value: *const c_int) -> Status {
    enter(c, Call::Set, "fmi2SetInteger", |slave| {
        // SAFETY: the host passes `count` references and as many values.
        let (references, values) = unsafe { (list(vr, count)?, list(value, count)?) };
        slave.instance.set(Type::Integer, references, |i| f64::from(values[i]))
    })
}

/// Sets Boolean variables, all or none; anything but 0 is true.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetBoolean(
    c: Component,
    vr: *const c_uint,
    count: usize,
    value: *const Boolean,
) -> Status {
    enter(c, Call::Set, "fmi2SetBoolean", |slave| {
        // SAFETY: the host passes `count` references and as many values.
        let (references, values) = unsafe { (list(vr, count)?, list(value, count)?) };
        slave.instance.set(Type::Boolean, references, |i| f64::from(u8::from(values[i] != 0)))
    })
}

/// No variable is a String: only an empty list is served.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetString(
    c: Component,
    _vr: *const c_uint,
    count: usize,
    _value: *const *const c_char,
) -> Status {
    enter(c, Call::Set, "fmi2SetString", |_| no_strings(count))
}

fn no_strings(count: usize) -> Result<(), Refusal> {
    if count == 0 { Ok(()) } else { Err(Refusal::error("no variable of this FMU is a String")) }
}

/// Copies the state; a handle that is not NULL is overwritten.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetFMUstate(c: Component, state: *mut State) -> Status {
    enter(c, Call::State, "fmi2GetFMUstate", |slave| {
        // SAFETY: the host passes the address of its handle.
        let handle = unsafe { place(state) }?;
        *handle = pointer(slave.instance.get_state(handle.addr())?);
        Ok(())
    })
}

/// Goes back to a copied state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetFMUstate(c: Component, state: State) -> Status {
    enter(c, Call::State, "fmi2SetFMUstate", |slave| {
        slave.instance.set_state(state.addr())?;
        slave.logger.event(|| "state restored".to_owned());
        Ok(())
    })
}

/// Frees a copied state and makes the handle NULL. Some hosts pass the handle instead of its address; they are
/// served, too.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeFMUstate(c: Component, state: *mut State) -> Status {
    enter(c, Call::State, "fmi2FreeFMUstate", |slave| {
        if state.is_null() {
            return Ok(());
        }
        if handle::is_handle(state.addr()) {
            return slave.instance.free_state(state.addr());
        }
        // SAFETY: the host passes the address of its handle.
        let handle = unsafe { place(state) }?;
        if !handle.is_null() {
            slave.instance.free_state(handle.addr())?;
            *handle = std::ptr::null_mut();
        }
        Ok(())
    })
}

fn pointer(handle: usize) -> State {
    std::ptr::without_provenance_mut(handle)
}

/// Size of a serialised state in bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SerializedFMUstateSize(c: Component, state: State, size: *mut usize) -> Status {
    enter(c, Call::State, "fmi2SerializedFMUstateSize", |slave| {
        // SAFETY: the host passes the address of a size.
        let size = unsafe { place(size) }?;
        *size = slave.instance.serialize_state(state.addr())?.len();
        Ok(())
    })
}

/// Writes a state as bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SerializeFMUstate(c: Component, state: State, bytes: *mut u8, size: usize) -> Status {
    enter(c, Call::State, "fmi2SerializeFMUstate", |slave| {
        let serialized = slave.instance.serialize_state(state.addr())?;
        if size < serialized.len() {
            let text = format!("the state takes {} bytes, there is room for {size}", serialized.len());
            return Err(Refusal::error(text));
        }
        // SAFETY: the host passes room for `size` bytes, of which only the needed ones are touched.
        unsafe { room(bytes, serialized.len()) }?.copy_from_slice(&serialized);
        Ok(())
    })
}

/// Reads a state from bytes, of this or another process.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DeSerializeFMUstate(
    c: Component,
    bytes: *const u8,
    size: usize,
    state: *mut State,
) -> Status {
    enter(c, Call::State, "fmi2DeSerializeFMUstate", |slave| {
        // SAFETY: the host passes `size` bytes and the address of its handle.
        let (bytes, handle) = unsafe { (list(bytes, size)?, place(state)?) };
        *handle = pointer(slave.instance.deserialize_state(bytes, handle.addr())?);
        Ok(())
    })
}

/// Not provided, as the XML says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetDirectionalDerivative(
    c: Component,
    _unknown: *const c_uint,
    _unknowns: usize,
    _known: *const c_uint,
    _knowns: usize,
    _known_change: *const f64,
    _unknown_change: *mut f64,
) -> Status {
    enter(c, Call::DirectionalDerivative, "fmi2GetDirectionalDerivative", |_| {
        Err(Refusal::error("this FMU provides no directional derivatives"))
    })
}

/// Sets first time derivatives of inputs for the next step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetRealInputDerivatives(
    c: Component,
    vr: *const c_uint,
    count: usize,
    order: *const c_int,
    value: *const f64,
) -> Status {
    enter(c, Call::SetInputDerivatives, "fmi2SetRealInputDerivatives", |slave| {
        // SAFETY: the host passes `count` references, orders and values.
        let (references, orders, values) = unsafe { (list(vr, count)?, list(order, count)?, list(value, count)?) };
        slave.instance.set_input_derivatives(references, orders, values)
    })
}

/// Reads first time derivatives of outputs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetRealOutputDerivatives(
    c: Component,
    vr: *const c_uint,
    count: usize,
    order: *const c_int,
    value: *mut f64,
) -> Status {
    enter(c, Call::GetOutputDerivatives, "fmi2GetRealOutputDerivatives", |slave| {
        // SAFETY: the host passes `count` references and orders and room for as many values.
        let (references, orders, values) = unsafe { (list(vr, count)?, list(order, count)?, room(value, count)?) };
        slave.instance.output_derivatives(references, orders, values)
    })
}

/// Takes the samples of a communication step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DoStep(c: Component, point: f64, size: f64, _no_set_state_before: Boolean) -> Status {
    enter(c, Call::DoStep, "fmi2DoStep", |slave| slave.instance.do_step(point, size))
}

/// No step is ever pending.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2CancelStep(c: Component) -> Status {
    enter(c, Call::CancelStep, "fmi2CancelStep", |_| Ok(()))
}

const LAST_SUCCESSFUL_TIME: c_uint = 2;
const TERMINATED: c_uint = 3;

fn no_status(kind: c_uint) -> Refusal {
    Refusal::discard(format!("status kind {kind} has no answer: no step is ever pending"))
}

/// No step is ever pending.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetStatus(c: Component, kind: c_uint, _value: *mut Status) -> Status {
    enter(c, Call::GetStatus, "fmi2GetStatus", |_| Err(no_status(kind)))
}

/// The last successful time, which is the communication point.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetRealStatus(c: Component, kind: c_uint, value: *mut f64) -> Status {
    enter(c, Call::GetStatus, "fmi2GetRealStatus", |slave| {
        if kind != LAST_SUCCESSFUL_TIME {
            return Err(no_status(kind));
        }
        // SAFETY: the host passes the address of a value.
        *unsafe { place(value) }? = slave.instance.time();
        Ok(())
    })
}

/// No Integer status is defined.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetIntegerStatus(c: Component, kind: c_uint, _value: *mut c_int) -> Status {
    enter(c, Call::GetStatus, "fmi2GetIntegerStatus", |_| Err(no_status(kind)))
}

/// Whether the FMU wants to end the simulation: never.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetBooleanStatus(c: Component, kind: c_uint, value: *mut Boolean) -> Status {
    enter(c, Call::GetStatus, "fmi2GetBooleanStatus", |_| {
        if kind != TERMINATED {
            return Err(no_status(kind));
        }
        // SAFETY: the host passes the address of a value.
        *unsafe { place(value) }? = 0;
        Ok(())
    })
}

/// No step is ever pending.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetStringStatus(c: Component, kind: c_uint, _value: *mut *const c_char) -> Status {
    enter(c, Call::GetStatus, "fmi2GetStringStatus", |_| Err(no_status(kind)))
}
