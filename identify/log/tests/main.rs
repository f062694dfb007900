//! All tests of logs in one program, which links once.

mod damaged;
mod log;
