//! The live instances. A component is the number of a place in this table, never an address, so that NULL, foreign,
//! stale and concurrently used components are recognised without touching memory.

use super::logger::Logger;
use super::types::Component;
use crate::handle;
use crate::instance::Instance;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError, TryLockError};

/// What a component stands for.
pub(super) struct Slave {
    pub instance: Instance,
    pub logger: Logger,
}

/// A place of the table.
struct Slot(Mutex<Occupant>);

struct Occupant {
    /// Counts who was here, so that a component of one who left fits no other.
    generation: usize,
    slave: Option<Box<Slave>>,
}

impl Slot {
    const fn new() -> Self {
        Self(Mutex::new(Occupant { generation: 0, slave: None }))
    }
}

// Places are reached without a lock common to all instances, and never move: there are as many in the first list as
// most hosts need, and each further list, made when it is needed, has twice as many as the one before.
const FIRST: usize = 64;
static SLOTS: [Slot; FIRST] = [const { Slot::new() }; FIRST];
static MORE: [OnceLock<Box<[Slot]>>; 14] = [const { OnceLock::new() }; 14];

/// Bits of a component's number that tell the place.
const INDEX_BITS: u32 = 20;
const GENERATIONS: usize = 1 << (handle::BITS - 1 - INDEX_BITS);
/// Set in the numbers of components, so that none is that of a state.
const COMPONENT: usize = 1 << (handle::BITS - 1);

/// Which places are vacant.
struct Vacant {
    left: Vec<usize>,
    /// The places from here on were never used.
    untouched: usize,
    occupied: usize,
}

static VACANT: Mutex<Vacant> = Mutex::new(Vacant { left: Vec::new(), untouched: 0, occupied: 0 });

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // no panic can leave the data half written: they are changed by single assignments
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The place of an index; further lists are made only if `make`.
fn slot(index: usize, make: bool) -> Option<&'static Slot> {
    if let Some(slot) = SLOTS.get(index) {
        return Some(slot);
    }
    let doublings = (index / FIRST + 1).ilog2() as usize;
    let size = FIRST << doublings;
    let list = MORE.get(doublings - 1)?;
    let list = match list.get() {
        None if make => list.get_or_init(|| (0..size).map(|_| Slot::new()).collect()),
        list => list?,
    };
    list.get(index - (size - FIRST))
}

/// Takes in an instance; nothing if there are too many.
pub(super) fn insert(slave: Slave) -> Option<Component> {
    let slave = Box::new(slave);
    let index = {
        let mut vacant = locked(&VACANT);
        let index = vacant.left.pop().unwrap_or(vacant.untouched);
        slot(index, true)?;
        vacant.untouched = vacant.untouched.max(index + 1);
        vacant.occupied += 1;
        index
    };
    let mut occupant = locked(&slot(index, false)?.0);
    occupant.slave = Some(slave);
    let number = COMPONENT | (occupant.generation << INDEX_BITS) | index;
    Some(std::ptr::without_provenance_mut(handle::of(number)))
}

fn locate(component: Component) -> Option<(usize, usize, &'static Slot)> {
    let number = handle::number(component.addr())?;
    let number = number.checked_sub(COMPONENT)?;
    let (generation, index) = (number >> INDEX_BITS, number & ((1 << INDEX_BITS) - 1));
    Some((generation, index, slot(index, false)?))
}

/// The place, unless it is in use: by another thread, or by the call whose logger calls again.
fn reach(slot: &Slot) -> Option<MutexGuard<'_, Occupant>> {
    match slot.0.try_lock() {
        Ok(occupant) => Some(occupant),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

/// Lets `body` work on a live instance; nothing for any other component.
pub(super) fn with<T>(component: Component, body: impl FnOnce(&mut Slave) -> T) -> Option<T> {
    let (generation, _, slot) = locate(component)?;
    let mut occupant = reach(slot)?;
    if occupant.generation != generation {
        return None;
    }
    occupant.slave.as_deref_mut().map(body)
}

/// Takes a live instance out.
pub(super) fn remove(component: Component) -> Option<Box<Slave>> {
    let (generation, index, slot) = locate(component)?;
    let slave = {
        let mut occupant = reach(slot)?;
        if occupant.generation != generation {
            return None;
        }
        let slave = occupant.slave.take()?;
        occupant.generation = (generation + 1) % GENERATIONS;
        slave
    };
    let mut vacant = locked(&VACANT);
    vacant.occupied -= 1;
    if vacant.occupied == 0 {
        // a library that is about to be unloaded leaves no memory behind
        *vacant = Vacant { left: Vec::new(), untouched: 0, occupied: 0 };
    } else {
        vacant.left.push(index);
    }
    Some(slave)
}
