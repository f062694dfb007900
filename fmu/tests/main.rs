//! All tests of the FMU in one program, which links once. Logs and counters of `support` are kept thread by thread,
//! so tests that run side by side do not see one another.

#[path = "../../tests/support/counting.rs"]
mod counting;
mod support;

mod abi;
mod contract;
#[cfg(feature = "import")]
mod import;
mod library;
mod no_allocation;
mod pages;
mod random_calls;
mod sampling;
mod state;
mod table;
mod variables;
