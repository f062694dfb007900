//! Forces on an axle that neither the model nor the errors of its constants explain: a steering angle that is commanded and comes
//! late, tyres far beyond their peak, a kerb.
//!
//! They show in the yaw rate, which the gyro measures far better than tyres tell the lateral speed: over a sample of `dt` its
//! innovation `v` of variance `S` contains the yaw acceleration `n` that is not explained,
//!
//! ```text
//! E v^2 = S + E n^2 dt^2
//! ```
//!
//! (covariance matching; Mehra, *Approaches to adaptive filtering*, IEEE Trans. Automatic Control 17, 1972, 693-698). Where the
//! considered errors explain the innovations there is no difference, and nothing is added. The force that turns the vehicle by
//! `n` pushes it sideways as well, by `a = n Iz/(m l)` if it acts `l` before or behind the centre of gravity. Lasting for `T` it
//! leaves, beside tyres that take a lateral speed away at the rate `d`, the variance `s^2`, and `r vy` carries its error into the
//! speed `vx`, of which the wheels' measurement leaves the share `q`:
//!
//! ```text
//! (s^2)' = 2 T E a^2 - 2 d s^2
//! s_x    <- q (s_x + |r| s dt)
//! ```
//!
//! Both are added to the deviations only. In the gain they would let the lateral speed follow an acceleration that the tyres, as far
//! as they are understood, contradict.

use crate::filter::bounded;
use crate::model::wheeled_robot::Vehicle;
use serde::{Deserialize, Serialize};

/// Time over which the innovations are averaged, s.
const TIME: f64 = 0.3;
/// Time for which such a force lasts, s: that which a steering servo takes, or a driver who counters.
const LASTS: f64 = 0.2;

/// What is remembered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Unmodelled {
    /// Mean square of the yaw acceleration that nothing explains, rad²/s⁴.
    turning: f64,
    /// Variance of the lateral speed that such forces have caused, m²/s².
    pushed: f64,
    /// Standard deviation of the speed that this has caused, m/s.
    carried: f64,
}

/// Lateral acceleration per yaw acceleration of a force on the axle that is nearer to the centre of gravity, m.
pub(super) fn reach(v: &Vehicle) -> f64 {
    v.yaw_inertia / (v.mass * v.cg_to_front.min(v.cg_to_rear))
}

impl Unmodelled {
    /// Takes the innovation of the yaw rate with its variance, `dt` seconds after the sample before.
    pub fn match_innovation(&mut self, residual: f64, variance: f64, dt: f64) {
        let share = (dt / TIME).min(1.0);
        let excess = (residual * residual - variance) / (dt * dt);
        self.turning = (self.turning + share * (excess - self.turning)).max(0.0);
    }

    /// Takes `dt` seconds of motion at a yaw rate: such forces push by `reach`, tyres take the lateral speed away at the rate
    /// `damping`, 1/s, and of the speed's error the share `left` is left.
    pub fn push(&mut self, reach: f64, damping: f64, yaw_rate: f64, left: f64, dt: f64) {
        let pushed = 2.0 * LASTS * reach * reach * self.turning * dt;
        self.pushed = (self.pushed + pushed) / (1.0 + 2.0 * damping * dt);
        self.carried = (self.carried + yaw_rate.abs() * self.pushed.sqrt() * dt) * left;
    }

    /// Standard deviations of the forward and the lateral speed that they have caused, m/s.
    pub fn speed_std(&self) -> [f64; 2] {
        [self.carried, self.pushed.sqrt()]
    }

    /// Standard deviation of the lateral acceleration that they cause, m/s².
    pub fn acceleration_std(&self, reach: f64) -> f64 {
        reach * self.turning.sqrt()
    }

    /// Whether the numbers can have come from [`push`](Self::push).
    pub fn is_valid(&self) -> bool {
        [self.turning, self.pushed, self.carried].into_iter().all(|value| bounded(value) && value >= 0.0)
    }
}
