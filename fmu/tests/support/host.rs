//! A host in Rust: calls the exported C functions as a simulator would and collects the log.

use super::catalogue;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_uint, c_void};
use std::ptr::{null, null_mut};
use wheelstate_fmu::abi::*;
use wheelstate_fmu::describe::guid;
use wheelstate_fmu::model::{Model, Place};

/// One message: status, category, text.
pub type Message = (Status, String, String);

thread_local! {
    pub static LOG: RefCell<Vec<Message>> = const { RefCell::new(Vec::new()) };
}

/// A C logger cannot be defined as variadic in stable Rust; one that ignores the variable arguments
/// is called alike by the C convention of every platform that the tests run on.
unsafe extern "C" fn logger(
    _: *mut c_void,
    _: *const c_char,
    status: Status,
    category: *const c_char,
    text: *const c_char,
) {
    // SAFETY: the library passes strings that end with NUL.
    let (category, text) = unsafe { (CStr::from_ptr(category), CStr::from_ptr(text)) };
    let (category, text) = (category.to_str().unwrap().to_owned(), text.to_str().unwrap().to_owned());
    LOG.with_borrow_mut(|log| log.push((status, category, text)));
}

pub fn callbacks() -> Callbacks {
    type Fixed = unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char);
    // SAFETY: see `logger`.
    let logger = unsafe { std::mem::transmute::<Fixed, LoggerCallback>(logger) };
    Callbacks {
        logger: Some(logger),
        allocate_memory: None,
        free_memory: None,
        step_finished: None,
        environment: null_mut(),
    }
}

/// The messages so far, which are then forgotten.
pub fn messages() -> Vec<Message> {
    LOG.with_borrow_mut(std::mem::take)
}

/// The text of the last message.
pub fn last_message() -> String {
    LOG.with_borrow(|log| log.last().map(|(_, _, text)| text.clone()).unwrap_or_default())
}

pub fn model() -> Model {
    catalogue(&|_| true).remove(0)
}

/// An instance of the test model.
pub struct Host {
    pub c: Component,
    model: Model,
}

impl Drop for Host {
    fn drop(&mut self) {
        unsafe { fmi2FreeInstance(self.c) }
    }
}

pub fn instantiate(name: *const c_char, kind: c_uint, guid: *const c_char, logging: bool) -> Component {
    let callbacks = callbacks();
    unsafe { instantiate_from(catalogue, name, kind, guid, null(), &callbacks, 0, c_int::from(logging)) }
}

impl Host {
    pub fn new() -> Self {
        Self::with_logging(false)
    }

    pub fn with_logging(logging: bool) -> Self {
        let model = model();
        let guid = CString::new(guid::of(&model)).unwrap();
        let c = instantiate(c"one".as_ptr(), 1, guid.as_ptr(), logging);
        assert!(!c.is_null(), "{}", last_message());
        Self { c, model }
    }

    /// An instance at its first communication point.
    pub fn started(start: f64) -> Self {
        let host = Self::new();
        host.start(start);
        host
    }

    pub fn start(&self, start: f64) {
        assert_eq!(self.setup(start, None), OK);
        assert_eq!(self.enter(), OK);
        assert_eq!(self.exit(), OK, "{}", last_message());
    }

    pub fn setup(&self, start: f64, stop: Option<f64>) -> Status {
        unsafe { fmi2SetupExperiment(self.c, 1, 1e-6, start, c_int::from(stop.is_some()), stop.unwrap_or(0.0)) }
    }

    pub fn enter(&self) -> Status {
        unsafe { fmi2EnterInitializationMode(self.c) }
    }

    pub fn exit(&self) -> Status {
        unsafe { fmi2ExitInitializationMode(self.c) }
    }

    pub fn reset(&self) -> Status {
        unsafe { fmi2Reset(self.c) }
    }

    pub fn time(&self) -> f64 {
        let mut value = f64::NAN;
        // kind 2 is the last successful time
        assert_eq!(unsafe { fmi2GetRealStatus(self.c, 2, &mut value) }, OK);
        value
    }

    /// The first derivative of an output.
    pub fn rate(&self, name: &str) -> f64 {
        let mut value = f64::NAN;
        let status = unsafe { fmi2GetRealOutputDerivatives(self.c, &self.vr(name), 1, &1, &mut value) };
        assert_eq!(status, OK, "{}", last_message());
        value
    }

    pub fn vr(&self, name: &str) -> c_uint {
        let index = |list: &[wheelstate::Variable]| list.iter().position(|variable| variable.name == name);
        let place = index(&self.model.parameters).map(Place::Parameter);
        let place = place.or_else(|| index(&self.model.inputs).map(Place::Input));
        let place = place.or_else(|| index(&self.model.outputs).map(Place::Output));
        place.unwrap_or_else(|| panic!("no variable {name}")).reference()
    }

    pub fn set(&self, name: &str, value: f64) -> Status {
        unsafe { fmi2SetReal(self.c, &self.vr(name), 1, &value) }
    }

    pub fn set_integer(&self, name: &str, value: c_int) -> Status {
        unsafe { fmi2SetInteger(self.c, &self.vr(name), 1, &value) }
    }

    pub fn set_boolean(&self, name: &str, value: c_int) -> Status {
        unsafe { fmi2SetBoolean(self.c, &self.vr(name), 1, &value) }
    }

    pub fn get(&self, name: &str) -> f64 {
        let mut value = f64::NAN;
        let status = unsafe { fmi2GetReal(self.c, &self.vr(name), 1, &mut value) };
        assert_eq!(status, OK, "{}", last_message());
        value
    }

    pub fn get_integer(&self, name: &str) -> c_int {
        let mut value = 0;
        let status = unsafe { fmi2GetInteger(self.c, &self.vr(name), 1, &mut value) };
        assert_eq!(status, OK, "{}", last_message());
        value
    }

    pub fn get_boolean(&self, name: &str) -> c_int {
        let mut value = 7;
        let status = unsafe { fmi2GetBoolean(self.c, &self.vr(name), 1, &mut value) };
        assert_eq!(status, OK, "{}", last_message());
        value
    }

    pub fn slope(&self, name: &str, value: f64) -> Status {
        unsafe { fmi2SetRealInputDerivatives(self.c, &self.vr(name), 1, &1, &value) }
    }

    pub fn step(&self, point: f64, size: f64) -> Status {
        unsafe { fmi2DoStep(self.c, point, size, 1) }
    }

    pub fn get_state(&self, state: &mut State) -> Status {
        unsafe { fmi2GetFMUstate(self.c, state) }
    }

    pub fn serialize(&self, state: State) -> Vec<u8> {
        unsafe {
            let mut size = 0;
            assert_eq!(fmi2SerializedFMUstateSize(self.c, state, &mut size), OK, "{}", last_message());
            let mut bytes = vec![0; size];
            assert_eq!(fmi2SerializeFMUstate(self.c, state, bytes.as_mut_ptr(), size), OK);
            bytes
        }
    }

    pub fn deserialize(&self, bytes: &[u8], state: &mut State) -> Status {
        unsafe { fmi2DeSerializeFMUstate(self.c, bytes.as_ptr(), bytes.len(), state) }
    }
}
