//! The nursing robot.

mod accuracy;
mod drive;
mod fit;
mod fit_accuracy;
mod inputs;
mod recordings;
mod vectors;
