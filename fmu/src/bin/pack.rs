//! `pack`: writes FMUs.

use std::process::ExitCode;
use wheelstate_fmu::pack::command;
use wheelstate_fmu::pack::library::Library;

fn main() -> ExitCode {
    ExitCode::from(command::main("pack", std::env::args_os(), || Ok(vec![Library::own()?])))
}
