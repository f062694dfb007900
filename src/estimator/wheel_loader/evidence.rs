//! Whether slip and torque can both be true.

use super::belief::Belief;
use super::coordinates::Map;
use super::parameters::{Parameters, Radii};
use crate::model::wheel_loader::{Drive, GRAVITY, WheelLoader};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Torque share `|T|/(r m g)` from which an axle must slip measurably.
const TORQUE_SHARE: f64 = 0.005;
/// Time before a verdict, s: under torque, or with a wheel that spins without it.
const VERDICT_TIME: f64 = 5.0;
/// Memory of the slip statistic, s.
const MEMORY: f64 = 10.0;
/// Standard errors between the measured slip and the least that a tyre must show.
const CONFIDENCE: f64 = 2.5;
/// A wheel that spins takes at least this share of the friction by which the model's tyre would hold it on its axle's
/// share of the standing load.
const SPINNING_SHARE: f64 = 0.5;

/// What the initial values say about slip and torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlipLimits {
    /// The smallest and the largest slip stiffness that they allow.
    stiffness: [f64; 2],
    /// Standing load on each axle, N.
    load: [f64; 2],
    /// Relative standard deviation of the radii; 0 if they are taken as given.
    radius_std: f64,
    /// Slip beyond which a wheel spins or locks.
    spin: f64,
}

impl SlipLimits {
    /// Two standard deviations around the initial slip stiffness.
    pub fn new(p: &Parameters, map: &Map, initial: &Belief) -> Self {
        let (theta, std) = (initial.mean[3], initial.factor[(3, 3)]);
        let (weight, ratio) = (p.loader.mass * GRAVITY, p.initial.cg_ratio);
        Self {
            stiffness: [theta - 2.0 * std, theta + 2.0 * std].map(|theta| map.stiffness(theta)),
            load: [weight * ratio, weight * (1.0 - ratio)],
            radius_std: if p.filter.radii == Radii::Estimated { p.initial.wheel_radius_std } else { 0.0 },
            spin: p.hold.slip,
        }
    }
}

/// Two contradictions between slip and torque.
///
/// *Too little slip.* Slip must be at least the friction that the torque demands over the largest slip stiffness that
/// the tyre can have. The mean of `|slip|` cannot tell: at usual torques it is smaller than its own noise. The coefficient of
/// a regression over some seconds, with fading memory, can: its standard error falls with the square root of the
/// samples.
///
/// *Too little torque.* A wheel that spins or locks takes about its tyre's friction. One that does so for seconds while
/// its torque is a fraction of that, or acts the other way, is not turning as the sensor says: that is what a wrong unit
/// or sign of a speed looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SlipEvidence {
    samples: f64,
    slip_demand: f64,
    demand_demand: f64,
    slip_slip: f64,
    demand: f64,
    time: f64,
    too_little_slip: bool,
    /// Time in a row of a wheel that spins without the torque for it, s.
    unexplained: f64,
}

impl SlipEvidence {
    /// Whether slip and torque contradict each other.
    pub fn contradicts(&self) -> bool {
        self.too_little_slip || self.unexplained >= VERDICT_TIME
    }

    /// Takes the measurements `y` of a moving machine; returns true at the sample that first shows too little slip: the
    /// unknowns have been estimated from those before. A wheel that spins contributes nothing.
    pub fn update(
        &mut self,
        machine: &WheelLoader,
        drive: &Drive,
        y: &Vector3<f64>,
        limits: &SlipLimits,
        dt: f64,
    ) -> bool {
        if !y.iter().all(|value| value.is_finite()) {
            return false;
        }
        let (before, radius) = (self.too_little_slip, machine.loader.wheel_radius());
        let force = [0, 1].map(|i| (drive.torque[i] - drive.brake[i] * y[i + 1].signum()) / radius[i]);
        let slip = [0, 1].map(|i| machine.tire.slip(y[0], y[i + 1], radius[i]));
        if slip.iter().any(|slip| slip.abs() > limits.spin) {
            self.take_spinning(machine, force, slip, limits, dt);
        } else {
            self.unexplained = 0.0;
            self.take_rolling(force, slip, limits, dt);
        }
        self.too_little_slip && !before
    }

    /// A wheel spins: does its torque explain that?
    fn take_spinning(&mut self, machine: &WheelLoader, force: [f64; 2], slip: [f64; 2], limits: &SlipLimits, dt: f64) {
        let unexplained = (0..2).any(|i| {
            let held = machine.tire.friction_demand(limits.stiffness[0] * slip[i].abs()) * limits.load[i];
            slip[i].abs() > limits.spin && force[i] * slip[i].signum() < SPINNING_SHARE * held
        });
        self.unexplained = if unexplained { (self.unexplained + dt).min(1e9) } else { 0.0 };
    }

    /// No wheel spins: is there the slip that the torque takes?
    fn take_rolling(&mut self, force: [f64; 2], slip: [f64; 2], limits: &SlipLimits, dt: f64) {
        // exp(-dt / MEMORY) to all digits that matter for a memory.
        let fading = 1.0 / (1.0 + dt / MEMORY);
        let mut torque_acts = false;
        for i in 0..2 {
            if force[i].abs() <= TORQUE_SHARE * (limits.load[0] + limits.load[1]) {
                continue;
            }
            if !torque_acts {
                torque_acts = true;
                self.samples *= fading;
                self.slip_demand *= fading;
                self.demand_demand *= fading;
                self.slip_slip *= fading;
                self.demand *= fading;
            }
            let demand = force[i] / limits.load[i];
            self.samples += 1.0;
            self.slip_demand += slip[i] * demand;
            self.demand_demand += demand * demand;
            self.slip_slip += slip[i] * slip[i];
            self.demand += demand;
        }
        if !torque_acts {
            return;
        }
        self.time = (self.time + dt).min(1e9);
        if self.time < VERDICT_TIME {
            return;
        }
        let slope = self.slip_demand / self.demand_demand;
        let residual = (self.slip_slip - slope * self.slip_demand).max(0.0) / self.samples;
        // A radius that is wrong by up to one of its standard deviations looks like constant slip.
        let radius = limits.radius_std / 3f64.sqrt() * self.demand / self.demand_demand;
        let error = (residual / self.demand_demand + radius * radius).sqrt();
        let least = 1.0 / limits.stiffness[1];
        if !self.too_little_slip && slope + CONFIDENCE * error < least {
            self.too_little_slip = true;
        } else if self.too_little_slip && slope - error > least {
            self.too_little_slip = false;
        }
    }
}
