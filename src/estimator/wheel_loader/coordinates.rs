//! What the filter's states mean: coordinates `theta` of the unknowns `[K, h, lambda]`, and relative errors of the
//! rolling radii.

use super::parameters::{Coordinates, Initial, Parameters};
use crate::model::wheel_loader::{Loader, Unknowns, WheelLoader};
use nalgebra::{SVector, Vector3};

/// Lower limits of `[K, h, lambda]`.
const LOW: [f64; 3] = [2.0, 0.3, 0.1];
/// Upper limits of `[K, h, lambda]`.
const HIGH: [f64; 3] = [80.0, 2.5, 0.9];

/// `p = lo + (hi - lo) / (1 + exp(-theta))`, or `p = theta` clipped, and `r = (1 + d) r_given`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map {
    /// The machine with the radii as given.
    pub machine: WheelLoader,
    direct: bool,
    /// What one logit unit is worth in this map's coordinates at the initial values.
    pub unit: Vector3<f64>,
}

impl Map {
    /// The map for the chosen coordinates; the initial values scale the logit units of direct coordinates.
    pub fn new(parameters: &Parameters) -> Self {
        let direct = parameters.filter.parameters == Coordinates::Direct;
        let logit = Self { machine: parameters.machine(), direct: false, unit: Vector3::repeat(1.0) };
        let unit = if direct { logit.derivative(&initial_unknowns(&parameters.initial)) } else { logit.unit };
        Self { direct, unit, ..logit }
    }

    /// The rolling radii with these relative errors.
    pub fn radius(&self, errors: [f64; 2]) -> [f64; 2] {
        let given = self.machine.loader.wheel_radius();
        [given[0] * (1.0 + errors[0]), given[1] * (1.0 + errors[1])]
    }

    /// The machine with the radii of a belief's mean.
    pub fn corrected(&self, mean: &SVector<f64, 8>) -> WheelLoader {
        let [wheel_radius_front, wheel_radius_rear] = self.radius([mean[6], mean[7]]);
        let loader = Loader { wheel_radius_front, wheel_radius_rear, ..self.machine.loader };
        WheelLoader { loader, ..self.machine }
    }

    /// The unknowns of a belief's mean.
    pub fn unknowns_of(&self, mean: &SVector<f64, 8>) -> Unknowns {
        self.unknowns(&Vector3::new(mean[3], mean[4], mean[5]))
    }

    /// The unknowns at `theta`.
    pub fn unknowns(&self, theta: &Vector3<f64>) -> Unknowns {
        self.centre(theta).unknowns
    }

    /// `theta` of the unknowns, which lie inside the limits.
    pub fn coordinates(&self, unknowns: &Unknowns) -> Vector3<f64> {
        if self.direct {
            return *unknowns;
        }
        Vector3::from_fn(|i, _| ((unknowns[i] - LOW[i]) / (HIGH[i] - unknowns[i])).ln())
    }

    /// The unknowns at `theta` and a way to those nearby.
    pub fn centre(&self, theta: &Vector3<f64>) -> Centre {
        let e = if self.direct { Vector3::zeros() } else { theta.map(|theta| (-theta).exp()) };
        let unknowns = Vector3::from_fn(|i, _| {
            if self.direct { theta[i].clamp(LOW[i], HIGH[i]) } else { LOW[i] + (HIGH[i] - LOW[i]) / (1.0 + e[i]) }
        });
        Centre { direct: self.direct, theta: *theta, e, unknowns }
    }

    /// `d p / d theta` at these unknowns, the factor from standard deviations of `theta` to those of
    /// the unknowns.
    pub fn derivative(&self, unknowns: &Unknowns) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.derivative_of(i, unknowns[i]))
    }

    /// The derivative of one unknown.
    pub fn derivative_of(&self, i: usize, unknown: f64) -> f64 {
        if self.direct { 1.0 } else { (unknown - LOW[i]) * (HIGH[i] - unknown) / (HIGH[i] - LOW[i]) }
    }

    /// Puts direct coordinates back into their limits.
    pub fn clip(&self, theta: &mut Vector3<f64>) {
        if self.direct {
            *theta = self.unknowns(theta);
        }
    }

    /// The slip stiffness at this `theta`.
    pub fn stiffness(&self, theta: f64) -> f64 {
        self.unknowns(&Vector3::new(theta, 0.0, 0.0))[0]
    }

    /// Whether an unknown is within 1 % of its range's ends.
    pub fn at_bound(&self, unknowns: &Unknowns) -> bool {
        (0..3).any(|i| self.at_end(i, unknowns[i]))
    }

    /// Whether this unknown is.
    pub fn at_end(&self, i: usize, unknown: f64) -> bool {
        !(0.01..=0.99).contains(&((unknown - LOW[i]) / (HIGH[i] - LOW[i])))
    }
}

/// The unknowns at one `theta`, for many others around it.
#[derive(Clone, Copy, Debug)]
pub struct Centre {
    direct: bool,
    theta: Vector3<f64>,
    /// `exp(-theta)`
    e: Vector3<f64>,
    /// The unknowns.
    pub unknowns: Unknowns,
}

impl Centre {
    /// The unknowns at `theta + offset` and at `theta - offset`: two opposite logits share one
    /// exponential, and an offset of 0 needs none.
    pub fn pair(&self, offset: &Vector3<f64>) -> [Unknowns; 2] {
        let mut pair = [self.unknowns; 2];
        for i in 0..3 {
            if offset[i] == 0.0 {
                continue;
            }
            let (low, range) = (LOW[i], HIGH[i] - LOW[i]);
            if self.direct {
                pair[0][i] = (self.theta[i] + offset[i]).clamp(low, HIGH[i]);
                pair[1][i] = (self.theta[i] - offset[i]).clamp(low, HIGH[i]);
            } else {
                // Bounded so that neither the exponential nor its reciprocal leaves the numbers.
                let a = (-offset[i]).clamp(-300.0, 300.0).exp();
                pair[0][i] = low + range / (1.0 + self.e[i] * a);
                pair[1][i] = low + range * a / (a + self.e[i]);
            }
        }
        pair
    }
}

/// The initial values as unknowns.
pub fn initial_unknowns(initial: &Initial) -> Unknowns {
    Vector3::new(initial.slip_stiffness, initial.cg_height, initial.cg_ratio)
}
