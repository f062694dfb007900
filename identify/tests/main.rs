//! All tests of identification in one program, which links once. Every machine has a folder with the names that the
//! core's tests have (see `tests/main.rs` of the core): `vectors`, `accuracy` and `inputs` of the online estimates on
//! simulated logs, `recordings` of real machines; beside them `fit`, what identification finds.

#[path = "../../tests/support/mod.rs"]
mod support;

mod check;
mod cli;
mod convert;
mod coverage;
mod design;
mod messages;
mod profile;
mod ranges;
mod report;
mod run;
mod sixth_machine;
mod solve;
mod tune;

mod human_dynamics;
mod nursing_robot;
mod wheel_loader;
mod wheelchair;
mod wheeled_robot;
