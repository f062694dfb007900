//! The nursing robot: mass and sway of the person on board.

mod changes;
mod consistency;
mod inputs;
mod mass;
mod model;
mod recordings;
mod vectors;
