//! What crosses the C boundary: pointers and panics.

use super::table::{self, Slave};
use super::types::{Component, ERROR, OK, Status};
use crate::handle;
use crate::phase::Call;
use crate::refusal::{Answer, Level, Refusal};
use std::cell::Cell;
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::sync::{Once, OnceLock};

/// Runs one call of the host: checks the component and the phase, stops panics, reports refusals.
pub(super) fn enter(
    component: Component,
    call: Call,
    function: &str,
    body: impl FnOnce(&mut Slave) -> Answer<()>,
) -> Status {
    let called = table::with(component, |slave| {
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
    });
    // there is no instance with a logger to report to
    called.unwrap_or(ERROR)
}

thread_local! {
    // No destructor: one would keep the library from being unloaded.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
    static PANIC_LINE: Cell<u32> = const { Cell::new(0) };
}

/// The panic hook from before, which still reports the panics that are not ours.
type Hook = Box<dyn Fn(&PanicHookInfo<'_>) + Send + Sync>;
static OTHER: OnceLock<Hook> = OnceLock::new();

fn hook(info: &PanicHookInfo<'_>) {
    if GUARDED.get() {
        PANIC_LINE.set(info.location().map_or(0, std::panic::Location::line));
    } else if let Some(other) = OTHER.get() {
        other(info);
    }
}

/// Runs `body`; a panic becomes its message and does not print to the host's stderr.
pub(super) fn guarded<T>(body: impl FnOnce() -> T) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        // a hook that captures nothing takes no memory that unloading the library would lose
        let _ = OTHER.set(std::panic::take_hook());
        std::panic::set_hook(Box::new(hook));
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

/// No system maps the first page of memory.
const PAGE: usize = 4096;

fn check<T>(pointer: *const T, count: usize) -> Answer<()> {
    let wrong = match pointer.addr() {
        0 => Some("NULL"),
        1..PAGE => Some("a number that is not an address"),
        address if handle::is_handle(address) => Some("a handle instead of an address"),
        _ if !pointer.is_aligned() => Some("a misaligned pointer"),
        _ => None,
    };
    if let Some(wrong) = wrong {
        return Err(Refusal::error(format!("{wrong} was passed for {count} values")));
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

/// A string that the host passes; NULL and what cannot be an address is `None`.
///
/// # Safety
/// Unless NULL, `pointer` leads to a text that ends with NUL.
pub(super) unsafe fn text<'a>(pointer: *const c_char) -> Option<&'a CStr> {
    // SAFETY: may be an address, and ended by the caller's promise.
    check(pointer, 1).is_ok().then(|| unsafe { CStr::from_ptr(pointer) })
}
