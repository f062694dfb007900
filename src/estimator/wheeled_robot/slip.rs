//! Wheels that spin or lock, whose speed says nothing of the vehicle's.
//!
//! The slip that a force needs is an error of a constant ([`super::wheel_speed`]). Beyond the friction no force tells the slip.
//! It shows beside the accelerometer, with which Imsland et al. (*Vehicle velocity estimation using nonlinear observers*,
//! Automatica 42, 2006, 2091-2103) carry the speed on while a slipping wheel's speed has little gain: over a window `T` the wheels gain on the
//! vehicle what the acceleration `a` does not explain,
//!
//! ```text
//! g' = w' - a - g/T,        g = 0 but for chance where the wheels roll
//! ```
//!
//! `w`, the wheels' speed, has the noise `s` per sample, and `a` a constant error `b`, a slope of the road or of the sensor,
//! besides its white noise `n` in samples of `dt`. Both ends of the window have the wheels' noise, so that rolling wheels show
//!
//! ```text
//! var g = 2 s^2 + (b T)^2 + n^2 dt T
//! ```
//!
//! The window is as long as the constant error adds no more than the wheels' noise, `T = sqrt(2) s/b`. The smallest gain per time
//! that it shows, `CHANCE sqrt(2 s²/T² + b²)`, is then `sqrt(2)` times that of a window without end, and a shorter one shows less.
//! Beyond [`CHANCE`] deviations the wheels' speed counts as wrong by what they have gained, until it agrees again with what the
//! vehicle can have done meanwhile.

use crate::estimator::sampled::LONG_AGO;
use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Deviations that a normal number exceeds on either side once in 16 000 times: in windows of 0.35 s, those of the defaults, less
/// than once in an hour.
const CHANCE: f64 = 4.0;
/// Deviations beyond which the speed counts as uncertain by what the wheels have gained: seldom chance.
const SUSPECT: f64 = 2.0;
/// Time over which the error of a slipping wheel's speed is correlated, that for which drivers and controllers let wheels slip, s:
/// chosen. No window is longer.
const CORRELATED: f64 = 1.0;
/// Wheels that have neither gained nor lost for so long roll: a twentieth is left of such an error, s.
const CALM: f64 = 3.0 * CORRELATED;

/// What is remembered of the wheels' slip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Slip {
    /// What the wheels have gained on the vehicle over the last fraction of a second, m/s.
    gained: f64,
    /// Speed from the wheels at the sample before, m/s.
    before: Option<f64>,
    /// By how much the wheels' speed is taken to be wrong, m/s.
    error: f64,
    /// Time since it was last taken to be right, and since the wheels last gained or lost, s.
    age: f64,
    calm: f64,
    /// Standard deviation that the speed has at least beside wheels that disagree or may slip, m/s.
    doubt: f64,
}

/// The speed that the wheels show, beside what is expected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expectation {
    /// Speed from the wheels and what the filter expects of it, m/s.
    pub speed: f64,
    pub expected: f64,
    /// Variance of their difference without slip, m²/s².
    pub variance: f64,
    /// Standard deviation of the measurement alone, m/s.
    pub noise: f64,
    /// Rate of change of the vehicle's speed with the standard deviation of its white noise, m/s², if it is known.
    pub acceleration: Option<(f64, f64)>,
    /// Standard deviation of its constant error, m/s².
    pub bias: f64,
}

impl Slip {
    /// Takes a sample `dt` seconds after the one before. Where the wheels are first seen to slip, or taken to roll again
    /// at another speed than expected, it returns by how much the estimate may be wrong, m/s.
    pub fn update(&mut self, sample: &Expectation, dt: f64) -> Option<f64> {
        let ends = std::f64::consts::SQRT_2 * sample.noise;
        let window = (ends / sample.bias.max(ends / CORRELATED)).max(2.0 * dt);
        let change = self.before.zip(sample.acceleration).filter(|_| dt < CORRELATED);
        self.gained = match change {
            Some((before, (acceleration, _))) => {
                (1.0 - dt / window) * self.gained + sample.speed - before - acceleration * dt
            }
            None => 0.0,
        };
        self.before = Some(sample.speed);
        let accelerated = sample.acceleration.map_or(0.0, |(_, std)| std * std * dt * window);
        let chance = ends * ends + (sample.bias * window).powi(2) + accelerated;
        let gained = self.gained.abs();
        let spins = gained > CHANCE * chance.sqrt();
        let was_right = self.is_right(sample.noise);
        self.calm = if spins || was_right { 0.0 } else { (self.calm + dt).min(LONG_AGO) };
        let off = (sample.speed - sample.expected).abs();
        // where the wheels only differ and do not gain, either of both speeds may be right
        let either = if self.calm > window { 0.5 * off } else { 0.0 };
        let suspected = if gained > SUSPECT * chance.sqrt() { gained } else { 0.0 };
        self.doubt = either.max(suspected);
        // a speed that has not gained on the vehicle is no slip, whatever the model expects
        let far = !was_right && off > CHANCE * (sample.variance.sqrt() + sample.bias * self.age);
        let rolls_again = far && self.calm > CALM;
        // what slipped is trusted again by and by
        let fading = if was_right { 0.0 } else { self.error * (1.0 - (dt / CORRELATED).min(1.0)) };
        let seen = if far { off } else { 0.0 };
        self.error = fading.max(seen).max(if spins { gained } else { 0.0 });
        if rolls_again {
            self.age = 0.0;
            return Some(off);
        }
        self.age = if self.is_right(sample.noise) { 0.0 } else { (self.age + dt).min(LONG_AGO) };
        (was_right && spins).then_some(gained)
    }

    /// Without a speed from the wheels.
    pub fn skip(&mut self) {
        (self.before, self.gained, self.doubt) = (None, 0.0, 0.0);
    }

    /// Whether the wheels' speed can be taken for the vehicle's, with a noise of this standard deviation, m/s.
    pub fn is_right(&self, noise: f64) -> bool {
        self.error <= noise
    }

    /// Standard deviation that the speed has at least, m/s.
    pub fn doubt(&self) -> f64 {
        self.doubt
    }

    /// Standard deviation of white noise, one sample every `dt` seconds, that spoils a speed as much as its own `noise` and
    /// the slip do, m/s.
    pub fn noise(&self, noise: f64, dt: f64) -> f64 {
        if self.error == 0.0 {
            return noise;
        }
        (noise * noise + self.error * self.error * (CORRELATED / dt).max(1.0)).sqrt()
    }

    /// Whether the numbers can have come from [`update`](Self::update).
    pub fn is_valid(&self) -> bool {
        [self.gained, self.error, self.age, self.calm, self.doubt, self.before.unwrap_or_default()]
            .into_iter()
            .all(bounded)
    }
}
