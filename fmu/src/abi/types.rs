//! The C types of FMI 2.0. Enumerations and booleans stay integers, for a host may pass any value.

use std::ffi::{c_char, c_int, c_uint, c_void};

/// `fmi2Component`
pub type Component = *mut c_void;
/// `fmi2Status`
pub type Status = c_uint;
/// `fmi2Boolean`
pub type Boolean = c_int;
/// `fmi2FMUstate`
pub type State = *mut c_void;

/// `fmi2OK`
pub const OK: Status = 0;
/// `fmi2Warning`
pub const WARNING: Status = 1;
/// `fmi2Discard`
pub const DISCARD: Status = 2;
/// `fmi2Error`
pub const ERROR: Status = 3;
/// `fmi2Fatal`
pub const FATAL: Status = 4;

/// `fmi2CallbackLogger`
pub type LoggerCallback = unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char, ...);

/// `fmi2CallbackFunctions`; only the logger is ever called.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Callbacks {
    /// Receives messages.
    pub logger: Option<LoggerCallback>,
    /// Not used.
    pub allocate_memory: Option<unsafe extern "C" fn(usize, usize) -> *mut c_void>,
    /// Not used.
    pub free_memory: Option<unsafe extern "C" fn(*mut c_void)>,
    /// Not used: steps are synchronous.
    pub step_finished: Option<unsafe extern "C" fn(*mut c_void, Status)>,
    /// Handed to the logger.
    pub environment: *mut c_void,
}
