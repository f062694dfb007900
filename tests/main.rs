//! All tests of the core in one program, which links once. Every machine has a folder and in it, where there is
//! something to say, the same names:
//!
//! | module | what it proves |
//! |---|---|
//! | `model` | the equations: reference points, another derivation, mechanics by hand |
//! | `vectors` | filter and estimator, sample by sample, against reference runs |
//! | `accuracy` | how close the estimates come to the truth of a plant |
//! | `consistency` | whether reported standard deviations, NIS and NEES are those that the errors show |
//! | `inputs` | bad, missing and strange samples, steps, parameters and stored states |
//!
//! `contract` tries what every estimator promises on all of them. Beside them `recordings` (real machines, whose logs
//! are not part of the repository) and what only one machine has. Studies that need the simulations of `identify` are
//! in `identify/tests`, under the same names.

#[path = "support/counting.rs"]
mod counting;
mod support;

mod contract;
mod filter;
mod walls;

mod human_dynamics;
mod nursing_robot;
mod wheel_loader;
mod wheelchair;
mod wheeled_robot;
