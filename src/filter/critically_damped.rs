//! Critically damped second-order low-pass filter that also gives the derivative of its output.

use serde::{Deserialize, Serialize};

/// State of one filtered signal: the filtered value and its rate of change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CriticallyDamped {
    /// Filtered signal.
    pub value: f64,
    /// Time derivative of the filtered signal, 1/s.
    pub rate: f64,
}

/// Transition over one time step, shared by all signals that must be filtered alike.
///
/// Signals that pass through the same transition are delayed alike, so that an equation which holds
/// between the raw signals also holds between the filtered ones.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    decay: f64,
    w_dt: f64,
    w: f64,
    dt: f64,
}

impl Transition {
    /// Exact solution of `x'' = w^2 (u - x) - 2 w x'` for an input `u` held over `dt` seconds, with
    /// `w = 2 pi cutoff` and the corner frequency `cutoff` in Hz.
    pub fn new(cutoff: f64, dt: f64) -> Self {
        let w = std::f64::consts::TAU * cutoff;
        Self { decay: (-w * dt).exp(), w_dt: w * dt, w, dt }
    }
}

impl CriticallyDamped {
    /// At rest at `value`.
    pub fn at(value: f64) -> Self {
        Self { value, rate: 0.0 }
    }

    /// Goes on by one transition with the input held.
    pub fn step(&mut self, transition: &Transition, input: f64) {
        let Transition { decay: e, w_dt, w, dt } = *transition;
        let distance = self.value - input;
        let rate = self.rate;
        self.value = input + e * (1.0 + w_dt) * distance + e * dt * rate;
        self.rate = -w * w_dt * e * distance + e * (1.0 - w_dt) * rate;
    }
}
