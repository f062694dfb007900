//! All tests of logs in one program, which links once.

mod csv;
mod damaged;
mod fuzz;
mod log;
mod maps;
mod measurement;
mod mf4;
mod selection;
mod table;
