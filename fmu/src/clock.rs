//! The sampling clock of an instance.

pub use wheelstate::clock::Clock;

/// Samples that one step may take: enough for a quarter of an hour at 100 Hz, and a host never waits long for it.
pub const MOST_SAMPLES: f64 = 1e5;
