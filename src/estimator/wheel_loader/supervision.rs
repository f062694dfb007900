//! When the unknowns are held, and whether slip and torque can both be true.

use super::parameters::{Adaptation, Hold};
use crate::model::wheel_loader::{Drive, GRAVITY, WheelLoader};
use serde::{Deserialize, Serialize};

/// Torque share `|T|/(r m g)` from which an axle must slip measurably.
const TORQUE_SHARE: f64 = 0.005;
/// Time under torque before a verdict, s.
const VERDICT_TIME: f64 = 5.0;
/// Memory of the slip statistic, s.
const MEMORY: f64 = 10.0;
/// Standard errors between the slip that was seen and the least that a tyre must show.
const CONFIDENCE: f64 = 2.5;

/// Last part of the settling time, s. Held motion walks at random, so that its slip is known ten times
/// worse than slip can differ from its law; a bilinear model would read a slip stiffness from that.
/// In this time the motion follows the model and finds back to the slip's law, the unknowns still held.
const SETTLING: f64 = 0.2;

/// The supervision's memory.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Supervision {
    /// The unknowns are held.
    pub held: bool,
    /// The unknowns are held, but the motion already follows the model: see [`SETTLING`].
    pub settling: bool,
    /// Successive rejections per channel.
    pub masked: [u32; 3],
    /// Successive samples without any measurement.
    pub lost: u32,
    /// Successive samples whose drive had to be replaced.
    pub stale: u32,
    /// Time since the machine could have been estimated, s.
    pub settled: f64,
    /// Slip against torque.
    pub evidence: SlipEvidence,
    /// Noise level of each axle.
    pub roughness: [Roughness; 2],
}

/// Noise of one axle's slip innovation against what the settings expect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Roughness {
    smooth: f64,
    excess: f64,
}

/// What a sample contributes to the averages of [`Roughness`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fading {
    /// The time between two samples, s.
    pub dt: f64,
    smoothing: f64,
    memory: f64,
}

impl Fading {
    /// For samples `dt` seconds apart.
    pub fn new(adaptation: &Adaptation, dt: f64) -> Self {
        let share = |time: f64| 1.0 - (-dt / time).exp();
        Self { dt, smoothing: share(adaptation.smoothing), memory: share(adaptation.memory) }
    }
}

impl Roughness {
    /// Takes the slip innovation `e` (m/s) with its variance by the sensors and by the belief.
    pub fn take(&mut self, e: f64, sensors: f64, belief: f64, adaptation: &Adaptation, fading: &Fading) {
        let (a, b) = (fading.smoothing, fading.memory);
        self.smooth += a * (e - self.smooth);
        let white = a / (2.0 - a) * sensors;
        let ratio = (self.smooth * self.smooth - belief) / white;
        let cap = adaptation.limit * adaptation.limit;
        self.excess += b * (ratio.clamp(0.0, 10.0 * cap) - self.excess);
    }

    /// Ratio by which the noise's standard deviation is raised.
    pub fn ratio(&self, adaptation: &Adaptation) -> f64 {
        self.excess.clamp(1.0, adaptation.limit * adaptation.limit).sqrt()
    }
}

impl Default for Supervision {
    fn default() -> Self {
        Self {
            held: true,
            settling: false,
            masked: [0; 3],
            lost: 0,
            stale: 0,
            evidence: SlipEvidence::default(),
            settled: 0.0,
            roughness: Default::default(),
        }
    }
}

/// Why the unknowns are held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reasons {
    /// Slower than the machine must be.
    pub standstill: bool,
    /// A wheel spins or locks.
    pub spin: bool,
    /// Neither measurements nor drive for too long.
    pub lost: bool,
}

impl Supervision {
    /// Decides whether the coming sample is held. `y` is NaN where nothing was measured and `motion`
    /// the estimate before the sample.
    pub fn decide(&mut self, hold: &Hold, machine: &WheelLoader, y: &[f64; 3], motion: &[f64; 3], dt: f64) -> Reasons {
        let seen = |i: usize| if y[i].is_finite() { y[i] } else { motion[i] };
        let speed = seen(0).abs().min(motion[0].abs());
        let threshold = if self.held { hold.resume_speed } else { hold.stop_speed };
        let limit = hold.samples.max(0) as u32;
        let radius = machine.loader.wheel_radius();
        let reasons = Reasons {
            standstill: speed < threshold,
            spin: (0..2).any(|i| machine.tire.slip(seen(0), seen(i + 1), radius[i]).abs() > hold.slip),
            lost: self.lost > limit || self.stale > limit,
        };
        let unfit = reasons.standstill || reasons.spin || reasons.lost;
        self.settled = if unfit { 0.0 } else { self.settled + dt };
        let early = unfit || self.evidence.contradicts;
        self.held = early || self.settled <= hold.settle_time;
        self.settling = self.held && !early && self.settled > hold.settle_time - SETTLING;
        reasons
    }
}

/// What the start values say about the slip that torque must cause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlipLimits {
    /// The largest slip stiffness that they leave room for.
    pub largest_stiffness: f64,
    /// Share of the load on the front axle.
    pub ratio: f64,
    /// Relative standard deviation of the radii; 0 if they are taken as given.
    pub radius_std: f64,
}

/// Regression of the measured slip on the friction that the torque demands, with fading memory.
///
/// Slip must be at least the demand over the largest slip stiffness that the tyre can have. The mean
/// of `|slip|` cannot tell: at usual torques it is smaller than its own noise. The regression's
/// slope over some seconds can: its standard error falls with the square root of the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SlipEvidence {
    samples: f64,
    slip_demand: f64,
    demand_demand: f64,
    slip_slip: f64,
    demand: f64,
    time: f64,
    /// Slip and torque contradict each other.
    pub contradicts: bool,
}

impl SlipEvidence {
    /// Takes the measured slip of a moving machine; returns true at the sample that raises the flag.
    pub fn take(&mut self, machine: &WheelLoader, drive: &Drive, y: &[f64; 3], limits: &SlipLimits, dt: f64) -> bool {
        if !y.iter().all(|value| value.is_finite()) {
            return false;
        }
        // exp(-dt / MEMORY) to all digits that matter for a memory.
        let forget = 1.0 / (1.0 + dt / MEMORY);
        let (weight, radius) = (machine.loader.mass * GRAVITY, machine.loader.wheel_radius());
        let mut torque_acts = false;
        for i in 0..2 {
            let force = (drive.torque[i] - drive.brake[i] * y[i + 1].signum()) / radius[i];
            if force.abs() <= TORQUE_SHARE * weight {
                continue;
            }
            if !torque_acts {
                torque_acts = true;
                self.samples *= forget;
                self.slip_demand *= forget;
                self.demand_demand *= forget;
                self.slip_slip *= forget;
                self.demand *= forget;
            }
            let demand = force / (weight * if i == 0 { limits.ratio } else { 1.0 - limits.ratio });
            let sigma = machine.tire.slip(y[0], y[i + 1], radius[i]);
            self.samples += 1.0;
            self.slip_demand += sigma * demand;
            self.demand_demand += demand * demand;
            self.slip_slip += sigma * sigma;
            self.demand += demand;
        }
        if !torque_acts {
            return false;
        }
        self.time += dt;
        if self.time < VERDICT_TIME {
            return false;
        }
        let slope = self.slip_demand / self.demand_demand;
        let residual = (self.slip_slip - slope * self.slip_demand).max(0.0) / self.samples;
        // A radius that is wrong by up to one of its standard deviations looks like constant slip.
        let radius = limits.radius_std / 3f64.sqrt() * self.demand / self.demand_demand;
        let error = (residual / self.demand_demand + radius * radius).sqrt();
        let least = 1.0 / limits.largest_stiffness;
        let raised = !self.contradicts && slope + CONFIDENCE * error < least;
        if raised {
            self.contradicts = true;
        } else if self.contradicts && slope - error > least {
            self.contradicts = false;
        }
        raised
    }
}
