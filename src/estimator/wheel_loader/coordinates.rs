//! The unknowns `[K, h, lambda]` and the coordinates `theta` in which the filter works.

use super::parameters::{Coordinates, Start};
use crate::model::wheel_loader::Unknowns;
use nalgebra::Vector3;

/// Lower limits of `[K, h, lambda]`.
const LOW: [f64; 3] = [2.0, 0.3, 0.1];
/// Upper limits of `[K, h, lambda]`.
const HIGH: [f64; 3] = [80.0, 2.5, 0.9];

/// `p = lo + (hi - lo) / (1 + exp(-theta))`, or `p = theta` clipped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map {
    direct: bool,
    /// What one logit unit is worth in this map's coordinates at the start values.
    pub unit: Vector3<f64>,
}

impl Map {
    /// The map for the chosen coordinates; `start` scales the logit units of direct coordinates.
    pub fn new(coordinates: Coordinates, start: &Start) -> Self {
        let direct = coordinates == Coordinates::Direct;
        let logit = Self { direct: false, unit: Vector3::repeat(1.0) };
        let slope = logit.slope(&logit.coordinates(&unknowns(start)));
        Self { direct, unit: if direct { slope } else { logit.unit } }
    }

    /// The unknowns at `theta`.
    pub fn unknowns(&self, theta: &Vector3<f64>) -> Unknowns {
        Vector3::from_fn(|i, _| {
            if self.direct {
                theta[i].clamp(LOW[i], HIGH[i])
            } else {
                LOW[i] + (HIGH[i] - LOW[i]) / (1.0 + (-theta[i]).exp())
            }
        })
    }

    /// `theta` of the unknowns, which lie inside the limits.
    pub fn coordinates(&self, unknowns: &Unknowns) -> Vector3<f64> {
        if self.direct {
            return *unknowns;
        }
        Vector3::from_fn(|i, _| ((unknowns[i] - LOW[i]) / (HIGH[i] - unknowns[i])).ln())
    }

    /// `d p / d theta`, the factor from standard deviations of `theta` to those of the unknowns.
    pub fn slope(&self, theta: &Vector3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.slope_of(i, theta[i]))
    }

    /// The slope of one unknown.
    pub fn slope_of(&self, i: usize, theta: f64) -> f64 {
        if self.direct {
            return 1.0;
        }
        let e = (-theta).exp();
        let slope = (HIGH[i] - LOW[i]) * e / ((1.0 + e) * (1.0 + e));
        if slope.is_finite() { slope } else { 0.0 }
    }

    /// Puts direct coordinates back into their limits.
    pub fn clip(&self, theta: &mut Vector3<f64>) {
        if self.direct {
            *theta = self.unknowns(theta);
        }
    }

    /// The largest slip stiffness at `deviations` standard deviations above `theta`.
    pub fn largest_stiffness(&self, theta: f64, deviation: f64) -> f64 {
        self.unknowns(&Vector3::new(theta + deviation, 0.0, 0.0))[0]
    }

    /// Whether an unknown is within 1 % of its range's ends.
    pub fn at_bound(&self, unknowns: &Unknowns) -> bool {
        (0..3).any(|i| {
            let share = (unknowns[i] - LOW[i]) / (HIGH[i] - LOW[i]);
            !(0.01..=0.99).contains(&share)
        })
    }
}

/// The start values as unknowns.
pub fn unknowns(start: &Start) -> Unknowns {
    Vector3::new(start.slip_stiffness, start.cg_height, start.cg_ratio)
}
