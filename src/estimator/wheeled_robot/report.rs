//! Outputs from the state: the estimates carried forward, and their standard deviations.

use super::speed_knowledge::is_measured;
use super::start::UNSEEN_ACCELERATION;
use super::variables::Outputs;
use super::{RobotMachine, State, UNREACHABLE};
use crate::estimator::sampled::HELD_BRIEFLY;
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::square_root::{absorb, absorb_diagonal};
use crate::model::wheeled_robot::{Drive, Motion, Wheels};
use crate::variable::{Estimate, root_sum_square};
use nalgebra::Vector3;
use std::f64::consts::PI;

/// The yaw rate and the speed among what may be late, after the four wheels' forces.
const YAW_RATE: usize = 4;
const SPEED: usize = 5;
/// What the roll of the body, of which the accelerometer feels a part of gravity, makes of a lateral acceleration (one standard deviation):
/// cars roll by 0.05 to 0.1 rad per g.
const ROLL: f64 = 0.1;
/// Time after [`HELD_BRIEFLY`] in which an input that is not sampled may become any, s.
const FORGOTTEN: f64 = 0.5;

/// How much of what is known of an input is lost so long after its last sample, s: from 0 to 1.
fn forgotten(age: f64) -> f64 {
    ((age - HELD_BRIEFLY) / FORGOTTEN).clamp(0.0, 1.0)
}

fn std_along(belief: &FactoredGaussian<3>, gradient: [f64; 3]) -> f64 {
    belief.variance_along(&Vector3::from(gradient)).sqrt()
}

fn estimates(value: &Wheels, std: &Wheels) -> [Estimate; 4] {
    std::array::from_fn(|i| Estimate::new(value[i], std[i]))
}

impl RobotMachine {
    pub(super) fn report(&self, state: &State, steering: f64, horizon: f64, out: &mut Outputs) {
        let State { forces, .. } = state;
        let [carried, pushed] = state.unmodelled.speed_std();
        let mut uncertain = state.belief;
        absorb_diagonal(
            &mut uncertain.factor,
            &Vector3::new(root_sum_square([carried, state.slip.doubt()]), pushed, 0.0),
        );
        let cross = self.constants.whole(&state.cross, forces.by_torque);
        let mut belief = uncertain;
        absorb(&mut belief.factor, cross);
        let drive = Drive::new(steering, forces.force);
        let mut x = Motion::from(belief.mean);
        let mut grip = state.grip;
        if horizon > 0.0 {
            let driven = self.model.driven(&drive);
            let steps = (horizon / self.parameters.sample_period).ceil().max(1.0);
            let moved = (0..steps as u32).fold(x, |x, _| {
                let [x] = self.integration.advance(&driven, [x], horizon / steps, x[0]);
                x
            });
            // forces that no machine has would carry it anywhere
            if moved.iter().all(|value| value.abs() < UNREACHABLE) {
                x = moved;
                let [carried] = driven.forces_of(&[x]);
                grip = self.constants.grip(&self.model, &carried, &drive);
            }
        }

        let [vx, vy, r] = x;
        out.speed_x = Estimate::new(vx, belief.std(0).max(state.speed.std()));
        // Where no speed is measured it is that at which the lateral acceleration goes with the yaw rate, and the sideslip that at which
        // the tyres have its force.
        let filter = &self.parameters.filter;
        let (by_roll, by_tires) = if is_measured(filter) {
            (0.0, 0.0)
        } else {
            (ROLL, root_sum_square([ROLL, self.parameters.tire.rear.stiffness_std]))
        };
        let late = if filter.use_speed { state.lateness.std(SPEED, filter.measurement_std.speed_delay) } else { 0.0 };
        out.speed_x.widen(root_sum_square([by_roll * vx, late]));
        let slip = 0.5 * (grip.slip_angle[2] + grip.slip_angle[3]);
        let slides =
            root_sum_square([forgotten(state.blind_for) * self.unseen_lateral_speed(vx), by_tires * slip * vx]);
        out.speed_y = Estimate::new(vy, root_sum_square([belief.std(1), slides]));
        out.yaw_rate = Estimate::new(r, root_sum_square([belief.std(2), self.unfiltered_yaw_rate_std(state, r)]));
        let square = vx * vx + vy * vy;
        out.sideslip = if square > self.parameters.filter.minimum_speed.powi(2) {
            let by_motion = std_along(&belief, [-vy / square, vx / square, 0.0]);
            Estimate::new(vy.atan2(vx), root_sum_square([by_motion, slides * vx / square]))
        } else {
            // at rest the direction of motion is anything
            Estimate::new(0.0, PI / 3f64.sqrt())
        };

        let slopes = self.model.slip_derivatives(&x, &drive);
        // a torque makes its force on the radius
        let by_radius = if forces.by_torque { self.parameters.wheel.radius_std } else { 0.0 };
        // torques that nobody samples may have become any that vehicles usually have
        let any = 0.25 * self.model.vehicle.mass * UNSEEN_ACCELERATION;
        let by_held = if forces.by_torque { any * forgotten(state.held_for) } else { 0.0 };
        let late = root_sum_square([state.unchanged.seconds(), state.torque_delay.shown()]);
        let longitudinal_std: Wheels = std::array::from_fn(|i| {
            root_sum_square([forces.force_std[i], by_radius * forces.force[i], by_held, state.lateness.std(i, late)])
        });
        // an axle's force is that of two wheels
        let unmodelled = 0.5 * self.model.vehicle.mass * state.unmodelled.acceleration_std(self.reach);
        let lateral_std = std::array::from_fn(|i| {
            let wheel = (&self.model.vehicle, i);
            let known = self.constants.lateral_std(&uncertain, &cross, slopes[i], &grip, wheel);
            let by_angle = if i < 2 { self.model.vehicle.ackermann(steering) * grip.stiffness[i] } else { 0.0 };
            root_sum_square([known, unmodelled, by_angle, by_tires * grip.lateral[i]])
        });
        // without torques nobody knows whether wheels pull against one another, of which the acceleration shows the sum alone
        let apart = if forces.by_torque { 0.0 } else { any };
        [out.wheel_force_x_fl, out.wheel_force_x_fr, out.wheel_force_x_rl, out.wheel_force_x_rr] =
            estimates(&forces.force, &longitudinal_std.map(|std| root_sum_square([std, apart])));
        [out.wheel_force_y_fl, out.wheel_force_y_fr, out.wheel_force_y_rl, out.wheel_force_y_rr] =
            estimates(&grip.lateral, &lateral_std);
        [out.wheel_load_fl, out.wheel_load_fr, out.wheel_load_rl, out.wheel_load_rr] =
            estimates(&grip.load, &self.load_std(&grip.load, &longitudinal_std, &lateral_std));
        [out.nis_accel_x, out.nis_accel_y, out.nis_gyro_z, out.nis_speed] = state.nis;
        out.output_error = state.output_error;
    }

    /// Standard deviation of the yaw rate beyond the filter's, rad/s: by the gyro's errors, and by what vehicles usually do
    /// where neither gyro nor steering are sampled.
    fn unfiltered_yaw_rate_std(&self, state: &State, yaw_rate: f64) -> f64 {
        let imu = &self.parameters.imu;
        let blind = forgotten(state.blind_for) * self.unseen_yaw_rate(state.belief.mean[0]);
        let delay = root_sum_square([state.gyro_delay.delay_std(imu.gyro_z_delay_std), state.unchanged.seconds()]);
        let late = state.lateness.std(YAW_RATE, delay);
        root_sum_square([imu.gyro_z_bias_std, imu.gyro_z_scale_std * yaw_rate, late, blind])
    }

    /// Standard deviations of these wheel loads from the mass's and from those of the forces that shift them, N.
    fn load_std(&self, load: &Wheels, longitudinal_std: &Wheels, lateral_std: &Wheels) -> Wheels {
        let vehicle = &self.model.vehicle;
        let sum = |list: &Wheels| list.iter().sum::<f64>() / vehicle.mass;
        // errors of the wheels of one vehicle share their causes, so they are added whole
        let (ax_std, ay_std) = (sum(longitudinal_std), sum(lateral_std));
        let [pitch, front, rear] = vehicle.load_transfer();
        let (pitch, front, rear) = (pitch * ax_std, front * ay_std, rear * ay_std);
        std::array::from_fn(|i| {
            let roll = if i < 2 { front } else { rear };
            root_sum_square([pitch, roll, vehicle.mass_std * load[i]])
        })
    }
}
