//! What crosses the C boundary: types, pointers, panics and the host's logger.
//!
//! C enumerations and booleans stay integers, for a host may pass any value.

use super::logger::Logger;
use crate::instance::{Answer, Instance, Level, Refusal};
use crate::phase::Call;
use std::cell::Cell;
use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

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

/// What a component points at.
#[repr(C)]
pub(super) struct Slave {
    magic: u64,
    pub instance: Instance,
    pub logger: Logger,
}

const MAGIC: u64 = u64::from_le_bytes(*b"wheelst8");

/// Gives an instance to the host.
pub(super) fn release(instance: Instance, logger: Logger) -> Component {
    Box::into_raw(Box::new(Slave { magic: MAGIC, instance, logger })).cast()
}

/// Takes an instance back; nothing for anything but a live component.
pub(super) fn retake(component: Component) -> Option<Box<Slave>> {
    let slave = live(component)?;
    // so that a second free of memory not yet reused is noticed
    slave.magic = 0;
    // SAFETY: `live` found our mark, so this is a pointer that `release` gave out and that was not
    // retaken; no reference to it is left here.
    Some(unsafe { Box::from_raw(std::ptr::from_mut(slave)) })
}

fn live<'a>(component: Component) -> Option<&'a mut Slave> {
    let slave = component.cast::<Slave>();
    if slave.is_null() || !slave.is_aligned() {
        return None;
    }
    // SAFETY: a host passes components that fmi2Instantiate gave out and uses each from one thread
    // at a time (FMI 2.0, 2.1.5). Only the mark is read before anything else is believed.
    let magic = unsafe { (&raw const (*slave).magic).read() };
    // SAFETY: the mark says that this is one of ours and alive.
    (magic == MAGIC).then(|| unsafe { &mut *slave })
}

/// Runs one call of the host: checks the component and the phase, stops panics, reports refusals.
pub(super) fn enter(
    component: Component,
    call: Call,
    function: &str,
    body: impl FnOnce(&mut Slave) -> Answer<()>,
) -> Status {
    let Some(slave) = live(component) else { return ERROR };
    let answer = guarded(|| {
        slave.instance.allow(call, function)?;
        body(slave)
    });
    match answer {
        Ok(Ok(())) => OK,
        Ok(Err(refusal)) => slave.logger.refuse(function, &refusal),
        Err(panic) => {
            slave.instance.fail();
            let message = format!("internal error, the instance is lost: {panic}");
            slave.logger.refuse(function, &Refusal { level: Level::Fatal, message })
        }
    }
}

thread_local! {
    // No destructor: one would keep the library from being unloaded.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
    static PANIC_LINE: Cell<u32> = const { Cell::new(0) };
}

/// Runs `body`; a panic becomes its message and does not print to the host's stderr.
pub(super) fn guarded<T>(body: impl FnOnce() -> T) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let other = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if GUARDED.get() {
                PANIC_LINE.set(info.location().map_or(0, std::panic::Location::line));
            } else {
                other(info);
            }
        }));
    });
    let outer = GUARDED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(body));
    GUARDED.set(outer);
    result.map_err(|payload| {
        let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
        // a payload whose own drop panics must not take the host down
        std::mem::forget(payload);
        format!("{} (line {})", text.unwrap_or_else(|| "panic".to_owned()), PANIC_LINE.get())
    })
}

/// `count` values that the host passes.
///
/// # Safety
/// Unless `count` is 0 or `pointer` is NULL, `count` values stand at `pointer`.
pub(super) unsafe fn list<'a, T>(pointer: *const T, count: usize) -> Answer<&'a [T]> {
    if count == 0 {
        return Ok(&[]);
    }
    check(pointer, count)?;
    // SAFETY: not NULL, aligned, of possible size, and `count` long by the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// Room for `count` values that the host wants.
///
/// # Safety
/// Unless `count` is 0 or `pointer` is NULL, there is initialised room for `count` values.
pub(super) unsafe fn room<'a, T>(pointer: *mut T, count: usize) -> Answer<&'a mut [T]> {
    if count == 0 {
        return Ok(&mut []);
    }
    check(pointer, count)?;
    // SAFETY: not NULL, aligned, of possible size, and `count` long by the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, count) })
}

fn check<T>(pointer: *const T, count: usize) -> Answer<()> {
    if pointer.is_null() || !pointer.is_aligned() {
        let what = if pointer.is_null() { "NULL" } else { "a misaligned pointer" };
        return Err(Refusal::error(format!("{what} was passed for {count} values")));
    }
    if count > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(Refusal::error(format!("{count} values are more than memory can hold")));
    }
    Ok(())
}

/// One value that the host wants.
///
/// # Safety
/// Unless `pointer` is NULL, there is initialised room for one value.
pub(super) unsafe fn place<'a, T>(pointer: *mut T) -> Answer<&'a mut T> {
    // SAFETY: passed on from the caller.
    let one = unsafe { room(pointer, 1) }?;
    Ok(&mut one[0])
}

/// A string that the host passes; NULL is `None`.
///
/// # Safety
/// Unless NULL, `pointer` leads to a text that ends with NUL.
pub(super) unsafe fn text<'a>(pointer: *const c_char) -> Option<&'a CStr> {
    // SAFETY: not NULL, and ended by the caller's promise.
    (!pointer.is_null()).then(|| unsafe { CStr::from_ptr(pointer) })
}
