//! Where the motion starts: at the first sample, and anew after a gap.

use super::constants::Cross;
use super::{RobotMachine, State};
use crate::estimator::Elapsed;
use crate::filter::gaussian::FactoredGaussian;
use crate::variable::root_sum_square;
use nalgebra::Vector3;

/// A measured speed that is this many deviations from that at the start takes its place.
const FAR: f64 = 3.0;
/// What vehicles usually do while nobody looks: acceleration, m/s², sideslip, rad, and curvature of the path times
/// wheelbase (one standard deviation).
pub(super) const UNSEEN_ACCELERATION: f64 = 2.0;
const UNSEEN_SIDESLIP: f64 = 0.1;
const UNSEEN_CURVATURE: f64 = 0.3;
/// Largest standard deviation of the speed after a gap, m/s.
const UNKNOWN_SPEED: f64 = 50.0;

impl RobotMachine {
    /// After a gap: what the vehicle did meanwhile nobody saw. It is taken to have kept about its speed.
    pub(super) fn bridge_gap(&self, state: &mut State, gap: f64) {
        let std = UNSEEN_ACCELERATION * gap;
        let initial = self.parameters.initial.speed_x_std;
        // The filter's points must still go forward: those in reverse say nothing about this motion.
        let bounded = root_sum_square([initial, std.min(self.guarded(state.belief.mean[0]) / 3f64.sqrt())]);
        state.belief = self.unseen_motion(state.belief.mean[0], bounded);
        state.speed.reset(root_sum_square([initial, std]).min(UNKNOWN_SPEED), gap);
        state.forces = self.initial.forces.clone();
        state.grip = self.initial.grip;
        (state.cross, state.noise) = (Cross::zeros(), self.initial.noise);
        state.rejections = 0;
        (state.agreement, state.slip) = (self.initial.agreement, self.initial.slip);
        state.unmodelled = self.initial.unmodelled;
    }

    /// Motion of which only the speed is known: it goes about straight on, and slides and turns as vehicles do.
    pub(super) fn unseen_motion(&self, speed: f64, speed_std: f64) -> FactoredGaussian<3> {
        let (initial, turning) = (&self.parameters.initial, self.unseen_yaw_rate(speed));
        let lateral = root_sum_square([initial.speed_y_std, self.unseen_lateral_speed(speed)]);
        let std = Vector3::new(speed_std, lateral, root_sum_square([initial.yaw_rate_std, turning]));
        FactoredGaussian::independent(Vector3::new(speed, 0.0, 0.0), &std)
    }

    /// Standard deviation of the yaw rate of a vehicle at which nobody looks, rad/s.
    pub(super) fn unseen_yaw_rate(&self, speed: f64) -> f64 {
        let fast = self.guarded(speed);
        (UNSEEN_CURVATURE / self.model.vehicle.wheelbase() * fast).min(UNSEEN_ACCELERATION / fast)
    }

    /// The same of its lateral speed, m/s.
    pub(super) fn unseen_lateral_speed(&self, speed: f64) -> f64 {
        UNSEEN_SIDESLIP * self.guarded(speed)
    }

    /// Magnitude of a speed, at least the minimum speed, m/s.
    fn guarded(&self, speed: f64) -> f64 {
        speed.abs().max(self.parameters.filter.minimum_speed)
    }

    /// A measured speed takes the place of one that is not known, which would only bend the first samples.
    pub(super) fn start_at(&self, state: &mut State, speed: f64, elapsed: Elapsed) {
        let (std, belief) = (self.parameters.initial.speed_x_std, &mut state.belief);
        let far = (speed - belief.mean[0]).abs() > FAR * std;
        match elapsed {
            Elapsed::First if far => belief.mean[0] = speed,
            // Before it nobody knew how the vehicle moves.
            Elapsed::Step(_) if far && state.speed.is_from_the_start() => *belief = self.unseen_motion(speed, std),
            Elapsed::Gap(_) => *belief = self.unseen_motion(speed, std),
            Elapsed::First | Elapsed::Step(_) => {}
        }
    }
}
