//! The wheeled robot.

mod accuracy;
mod fit;
mod recordings;
mod tune;
