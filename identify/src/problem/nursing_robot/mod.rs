//! The nursing robot and road vehicles.
pub mod rows;
