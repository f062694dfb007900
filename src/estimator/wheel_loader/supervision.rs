//! When the unknowns are held.

use super::parameters::Hold;
use crate::Status;
use crate::estimator::standstill::Standstill;
use crate::model::wheel_loader::WheelLoader;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Last part of the settling time, s. Held motion walks at random, so that its slip is known ten times
/// worse than slip can differ from its law; a bilinear model would read a slip stiffness from that.
/// In this time the motion follows the model and recovers the slip's law, the unknowns still held.
const SETTLING: f64 = 0.2;

/// What a sample may change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// The unknowns are held and the motion walks at random from measurement to measurement.
    #[default]
    Held,
    /// The unknowns are held, but the motion already follows the model: see [`SETTLING`].
    Settling,
    /// Motion and unknowns follow the model.
    Active,
}

/// The supervision's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Supervision {
    /// What the last sample might change.
    pub mode: Mode,
    standstill: Standstill,
    /// Samples in a row without any measurement.
    lost: u32,
    /// Samples in a row with an old value in the drive.
    stale: u32,
    /// Time since the machine could have been estimated, s.
    settled: f64,
    /// A wheel spins and has not gripped again.
    spinning: bool,
    /// The unknowns have been updated since the start.
    begun: bool,
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
    /// Whether the unknowns are held.
    pub fn holds(&self) -> bool {
        self.mode != Mode::Active
    }

    /// Counts the samples without measurements and with old inputs.
    pub fn count(&mut self, screened: Status) {
        let next = |count: u32, status| if screened.contains(status) { count.saturating_add(1) } else { 0 };
        (self.lost, self.stale) = (next(self.lost, Status::NO_MEASUREMENT), next(self.stale, Status::HELD_INPUT));
    }

    /// Whether the drive is older than the estimates can do with.
    pub fn is_stale(&self, hold: &Hold) -> bool {
        self.stale > hold.samples.max(0) as u32
    }

    /// Whether a hold was so lately that tyres may still settle.
    pub fn is_settling(&self, hold: &Hold) -> bool {
        self.settled <= hold.settle_time - SETTLING
    }

    /// Holds as at the start, what was counted aside.
    pub fn reset(&mut self) {
        *self = Self { lost: self.lost, stale: self.stale, begun: self.begun, ..Self::default() };
    }

    /// Decides what the coming sample may change. `y` is NaN where nothing was measured, `motion` the estimate before
    /// the sample, `contradicted` whether slip and torque contradict each other.
    pub fn decide(
        &mut self,
        hold: &Hold,
        machine: &WheelLoader,
        y: &Vector3<f64>,
        motion: &Vector3<f64>,
        contradicted: bool,
        dt: f64,
    ) -> Reasons {
        let seen = |i: usize| if y[i].is_finite() { y[i] } else { motion[i] };
        let threshold = if self.holds() { hold.resume_speed } else { hold.stop_speed };
        let slow = seen(0).abs().min(motion[0].abs()) < threshold;
        let radius = machine.loader.wheel_radius();
        let largest = if self.spinning { 0.7 * hold.slip } else { hold.slip };
        self.spinning = (0..2).any(|i| machine.tire.slip(seen(0), seen(i + 1), radius[i]).abs() > largest);
        let reasons = Reasons {
            standstill: self.standstill.update(Some(slow), 0.0, dt),
            spin: self.spinning,
            lost: self.lost > hold.samples.max(0) as u32 || self.is_stale(hold),
        };
        let unfit = reasons.standstill || reasons.spin || reasons.lost;
        self.settled = if unfit { 0.0 } else { self.settled + dt };
        let time = if self.begun { hold.resume_time.min(hold.settle_time) } else { hold.settle_time };
        self.mode = if !unfit && !contradicted && self.settled > time {
            Mode::Active
        } else if !unfit && !contradicted && self.settled > time - SETTLING {
            Mode::Settling
        } else {
            Mode::Held
        };
        self.begun |= self.mode == Mode::Active;
        reasons
    }
}
