//! FMI 2.0 co-simulation around the estimators of `wheelstate`.
//!
//! ```text
//! host --C--> abi --> instance --> machine --> wheelstate::Estimator
//!             |       |  clock: which samples fall into a step
//!             |       |  phase: which call is allowed when
//!             |       |  snapshot: get, set and serialise the state
//!             |       model: the declared variables, one table for everything
//!             logger  describe: modelDescription.xml, GUID, documentation
//! ```
//!
//! One shared library serves every model: the GUID given to `fmi2Instantiate` tells which. All code
//! here works on declared [`Variables`](wheelstate::Variables) and knows no vehicle; a new estimator
//! in [`wheelstate::estimator::visit_all`] is a new FMU. Values travel as flat `f64` in the order of
//! their declarations.
//!
//! [`pack`] writes the `.fmu` archives; the binaries `pack` and `replay` are thin over this library.

pub mod abi;
mod clock;
pub mod describe;
pub mod instance;
pub mod machine;
pub mod model;
pub mod pack;
pub mod phase;
pub mod snapshot;
