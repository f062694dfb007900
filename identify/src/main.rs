//! `identify`: fits, tunes, simulates and estimates from logs.

use std::process::ExitCode;

fn main() -> ExitCode {
    wheelstate_identify::cli::main()
}
