//! Online estimators for wheeled machines that carry people and loads.
//!
//! # The map
//!
//! ```text
//!                    model/   what moves: f, h and their Jacobians, in the sources' notation
//! estimator/  <                                                                             plant/  truth to test with
//!                    filter/  how to estimate: Kalman, sigma points, least squares, observers
//!
//! fmu/       the FMI 2.0 layer over any `Estimator`, `pack`, `replay`       (package wheelstate-fmu)
//! identify/  parameters and noise from logs, simulation, reports            (package wheelstate-identify)
//!   log/     readers of CSV, Parquet, MDF4 and robots' logs                 (package wheelstate-log)
//!   python/  the Python package, thin over `identify` and `fmu`             (package wheelstate-python)
//! tests/     what all packages are tested with: vectors, plants, other programs
//! ```
//!
//! [`estimator`] has one folder per machine, whose `mod.rs` joins one model with one filter as a
//! [`Machine`](estimator::Machine); [`model`] has the equations with their numbers in the source and its errata. The page
//! of a machine links to its equations; a sample reaches them in two or three files after `mod.rs`:
//!
//! | machine | the way of a sample |
//! |---|---|
//! | [`nursing_robot`](estimator::nursing_robot) | mass: `mass.rs`, `model/nursing_robot`; sway: `sway/filter.rs`, `sway/motion.rs`, `model/nursing_robot` |
//! | [`wheeled_robot`](estimator::wheeled_robot) | forces: `forces.rs`, `filter/sliding_mode.rs`; motion: `motion.rs`, `integration.rs`, `model/wheeled_robot` |
//! | [`wheel_loader`](estimator::wheel_loader) | `filter.rs`, `prediction.rs`, `model/wheel_loader` |
//! | [`human_dynamics`](estimator::human_dynamics) | `whole_body.rs`, `model/multibody/equations.rs` |
//! | [`wheelchair`](estimator::wheelchair) | `ekf.rs`, `forms.rs`, `model/wheelchair` |
//!
//! [`estimator::sampled`] wraps every machine in the rules that all share: first sample, time steps and
//! gaps, missing, held and implausible inputs, `status`, `healthy`, `contradicted`. [`variable`] declares each variable
//! once; the declaration is the struct, the FMU's XML, the schema, the tables and the range checks.
//!
//! # Who may import whom
//!
//! `model`, `filter` and `plant` never import one another, so that an error in a model cannot hide behind the same error
//! in the plant, and a filter serves any machine. `estimator` joins model and filter. `fmu` and `identify` never import
//! each other: `fit.json` and the FMU are all that passes between them; the Python package joins both. The whole list stands in
//! `tests/walls/arrows.rs`, and a test names file and line of every import that is not in it.
//!
//! # How to add a machine
//!
//! 1. `src/model/NAME`: its physical parameters, declared with [`variables!`], and its equations.
//! 2. `src/estimator/NAME`: inputs, outputs, parameters and an `impl Machine`; one line in
//!    [`visit_all`](estimator::visit_all). It is an FMU now, and `tests/contract` tries on it what all promise.
//! 3. `src/plant/NAME`: a richer machine to test with, its equations written anew.
//! 4. `identify/src/vehicles/NAME`: its regression, scenarios and record; one line in `vehicles::ALL`.
//! 5. The page of `src/estimator/NAME/mod.rs`, with the headings of the others: with the pages that it links to it is the
//!    documentation of the FMU as well. `fmu/assets/pictures/NAME.png`: the picture that tools show.
//! 6. `examples/NAME.rs` and `examples/NAME.py`.
//!
//! # Decisions and their reasons
//!
//! - **Inputs are discrete in the FMU.** A host that interpolates a measured input would smear a missing sample over
//!   its neighbours.
//! - **No time of day, files, threads, random numbers or printing in this crate.** Same inputs, same bytes: a master may
//!   roll back, and a test may repeat.
//! - **A state is plain data**, stored and restored with `serde`; a stored number that is not finite is refused.
//! - **A sparse LDL of our own** ([`filter::sparse_ldl`]): the pattern of the body's equations is fixed at construction,
//!   so that a step allocates nothing and the variances of all estimates come from the same factor (Takahashi's
//!   recursion), which no crate offers.
//! - **Small matrices by hand in hot loops** ([`filter::ekf`], [`filter::square_root`]): Jacobians are mostly zeros, and
//!   general products of this size cost more in set-up than in arithmetic.
//! - **Kernels are compiled for AVX as well**, which a processor that has it uses (`multiversion`). The results are the same
//!   to the last bit everywhere: each number comes from the same operations in the same order, none of them fused.
//! - **Square roots instead of covariances** for loader and robot: factors cannot lose definiteness.
//! - **`f64` only, no `unsafe` written** here (`multiversion` writes the choice of a kernel); the FMU's C boundary has the
//!   only unsafe code of ours.
//!
//! # Conventions
//!
//! SI units and radians everywhere. Frames are right-handed with x forward, y left and z up (ISO 8855); each model's
//! page states its angles and signs. A NaN sample is a missing sample. Noise does not depend on the sample period:
//! `process_psd` are power spectral densities (unit^2/s), `measurement_std` standard deviations of one sample,
//! `initial.X` and `initial.X_std` what is known of a state at the start. After construction no step allocates, panics
//! or returns a value that is not finite.

#[macro_use]
pub mod variable;
pub mod clock;
pub mod parameter_set;
pub mod status;
pub mod unit;

pub mod estimator;
pub mod filter;
pub mod model;
pub mod plant;

pub use estimator::Estimator;
pub use status::Status;
pub use variable::{ParameterError, Variable, Variables};
