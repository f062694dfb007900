//! Whether steering, lateral acceleration, yaw rate and speed agree with one another.
//!
//! `ay = vy' + r vx` holds for every vehicle, whatever its tyres. Over seconds `vy'` averages out, so that the regression
//! of the lateral acceleration on `r vx` has a coefficient near 1. A turned sign, degrees for radians, g for m/s², km/h or rpm
//! make it another one. And a vehicle turns to the side to which it is steered: the regression of `r` on
//! `vx tan(delta)/L` has a positive coefficient, unless it is steered against a slide. The filter itself may notice neither: in
//! gentle driving its process noise can follow such measurements.

use crate::filter::bounded;
use serde::{Deserialize, Serialize};

/// Memory, s.
const TIME: f64 = 2.0;
/// Deviations of chance that are allowed, of noise and of the bias.
const CHANCE: f64 = 4.0;

/// A regression through the origin over the last seconds, of `y` on `x`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Mean square of `x` without what its noise adds.
    square: f64,
    /// Mean of `x y`.
    product: f64,
    /// Mean of `x`.
    mean: f64,
    /// Variance of the difference of product and square, the samples being independent.
    variance: f64,
    /// Mean square of the noise of `x`.
    noise: f64,
    contradicted: bool,
}

/// What is allowed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Least and greatest coefficient.
    pub coefficients: [f64; 2],
    /// Root mean square of `x` that determines a coefficient.
    pub least: f64,
}

/// Lateral acceleration over yaw rate times speed: roll adds up to a tenth and quick steering takes away a third.
pub(super) const ACCELERATION: Limits = Limits { coefficients: [0.5, 2.0], least: 0.15 };
/// Yaw rate over that of wheels that roll without slip: any understeer, hardly any oversteer.
pub(super) const STEERING: Limits = Limits { coefficients: [-0.3, 10.0], least: 0.03 };

/// A number with the standard deviation of its noise.
type Noisy = (f64, f64);

impl Agreement {
    /// Takes a sample `dt` seconds after the one before; nothing if either is NaN. `bias` is the standard deviation of a
    /// constant error of `y`.
    pub fn update(&mut self, limits: &Limits, (x, x_std): Noisy, (y, y_std): Noisy, bias: f64, dt: f64) {
        let product = x * y;
        if !product.is_finite() {
            return;
        }
        let share = (dt / TIME).min(0.5);
        let (noise, other) = (x_std * x_std, y_std * y_std);
        self.square += share * (x * x - noise - self.square);
        self.product += share * (product - self.product);
        self.mean += share * (x - self.mean);
        self.noise += share * (noise - self.noise);
        let one = x * x * (other + 4.0 * noise) + noise * (other + 2.0 * noise);
        self.variance += share * (share * one - (2.0 - share) * self.variance);
        let chance = CHANCE * (self.variance.max(0.0).sqrt() + bias * self.mean.abs());
        let [low, high] = limits.coefficients;
        let shown = self.square > limits.least * limits.least && self.square > self.noise;
        let off = self.product + chance < low * self.square || self.product - chance > high * self.square;
        // once contradicted, only a coefficient that agrees clears it
        let agrees = shown && self.product > low * self.square && self.product < high * self.square;
        self.contradicted = (shown && off) || (self.contradicted && !agrees);
    }

    /// Whether the numbers can have come from [`update`](Self::update).
    pub fn is_valid(&self) -> bool {
        [self.square, self.product, self.mean, self.variance, self.noise].into_iter().all(bounded)
    }

    /// Whether the coefficient is one that no vehicle has.
    pub fn contradicted(&self) -> bool {
        self.contradicted
    }
}
