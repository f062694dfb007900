//! `wheelstate._native`: what the Python package `wheelstate` is thin over.
//!
//! ```text
//! wheelstate/*.py --> log      logs from files, tables and Arrow streams, and back without a copy
//!                     fit      check, fit, tune
//!                     design   what to drive next
//!                     fleet    blocks that travel, two fits beside each other
//!                     run      logs through an estimator
//!                     machine  simulate, pack
//!                     command  the command line, the same code as the programs `identify` and `pack`
//!                     work     long work beside the interpreter: Ctrl-C, progress, no lock held
//! ```
//!
//! Nothing is computed here: every function says in Python what a function of the Rust packages does. Values pass as
//! numbers and texts; results with many fields as the JSON that the programs write.

mod arrow;
mod command;
mod design;
mod error;
mod fit;
mod fleet;
mod log;
mod machine;
mod names;
mod run;
mod work;

use pyo3::prelude::*;

/// What the Python package is thin over.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::command::command;
    #[pymodule_export]
    use crate::design::design;
    #[pymodule_export]
    use crate::error::{Error, LogError, Refused};
    #[pymodule_export]
    use crate::fit::{Fit, check, fit, tune};
    #[pymodule_export]
    use crate::fleet::{compare, compress, merge};
    #[pymodule_export]
    use crate::log::{Log, Samples, from_arrow, from_columns, read};
    #[pymodule_export]
    use crate::machine::{machines, pack, scenarios, simulate};
    #[pymodule_export]
    use crate::run::run;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<PyModule>) -> PyResult<()> {
        wheelstate_identify::log::guard::quiet();
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
