//! `identify`: fits, tunes, simulates and estimates from logs.
fn main() {}
