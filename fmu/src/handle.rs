//! Numbers that hosts hold as handles of instances and of their states.
//!
//! They are never addresses, and none can be mistaken for one: their upper 16 bits belong to no address that a
//! 64-bit system gives a program. So a handle that a host passes where an address is due is recognised, too.

use std::sync::atomic::{AtomicUsize, Ordering};

const _: () = assert!(usize::BITS == 64, "handles need 64 bits");

/// In the upper 16 bits of every handle.
const MARK: usize = 0x8f5a;
/// Handles look aligned to a host that checks this.
const STEP_BITS: u32 = 4;
/// Bits of a handle that tell it from others.
pub const BITS: u32 = 48 - STEP_BITS;

/// The handle of a number below 2^[`BITS`].
pub fn of(number: usize) -> usize {
    (MARK << 48) | ((number << STEP_BITS) & ((1 << 48) - 1))
}

/// Whether it is, or once was, a handle of this library.
pub fn is_handle(address: usize) -> bool {
    address >> 48 == MARK
}

/// The number behind a handle.
pub fn number(handle: usize) -> Option<usize> {
    let low = handle & ((1 << 48) - 1);
    (is_handle(handle) && low.is_multiple_of(1 << STEP_BITS)).then_some(low >> STEP_BITS)
}

/// A handle that no other call in this process gives.
pub fn unique() -> usize {
    static LAST: AtomicUsize = AtomicUsize::new(0);
    of(LAST.fetch_add(1, Ordering::Relaxed) + 1)
}
