//! FMI 2.0 co-simulation around the estimators of `wheelstate`.
//!
//! ```text
//! host --C--> abi --> instance --> snapshot --> machine --> wheelstate::Estimator
//!             |       |            clock        model: the declared variables, one table for everything
//!             |       |            phase
//!             |       describe: modelDescription.xml, GUID, documentation
//!             boundary: components, panics, the host's logger
//! ```
//!
//! [`instance`] is what the functions of the standard do; [`snapshot`] copies and serialises its state, `clock` tells
//! which samples fall into a step, `screen` which of them the host takes away, [`phase`] which call is allowed when. Every module uses only those to its right.
//!
//! One shared library serves every model: the GUID given to `fmi2Instantiate` tells which. All code
//! here works on declared [`Variables`](wheelstate::Variables) and has no code for any one machine; a new estimator
//! in [`wheelstate::estimator::visit_all`] is a new FMU. Values travel as flat `f64` in the order of
//! their declarations.
//!
//! [`pack`] writes the `.fmu` archives; the binaries `pack` and `replay` are thin over this library.

pub mod abi;
mod clock;
pub mod describe;
mod handle;
pub mod instance;
pub mod machine;
pub mod model;
pub mod pack;
pub mod phase;
pub mod refusal;
mod screen;
pub mod snapshot;
