//! Tuning: the optimiser, and what it finds on the machines.

mod dung_beetle;
mod machines;
