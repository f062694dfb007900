//! Outputs from the state: the estimates carried forward, and their standard deviations.

use super::{Inputs, Outputs, WheeledRobot};
use crate::Status;
use crate::model::wheeled_robot::{Drive, Driven, Wheels};

impl WheeledRobot {
    pub(super) fn write_outputs(&self, inputs: &Inputs, ahead: f64, out: &mut Outputs) {
        let s = &self.state;
        let mut x = s.x;
        let (mut load, mut lateral) = (s.load, s.lateral);
        let steering = if inputs.steering_angle.abs() <= 1.6 { inputs.steering_angle } else { s.steering };
        let drive = Drive::new(steering, s.wheels.force);
        let driven = self.model.driven(&drive);
        if ahead > 0.0 && ahead.is_finite() && s.samples > 0 {
            // the model is held to where it can be trusted: a second without any measurement
            let period = self.parameters.sample_period;
            let carried = ahead.min(super::LONGEST_GAP.max(period));
            let steps = (carried / period).ceil().max(1.0);
            for _ in 0..steps as u32 {
                x = self.advance(&x, &driven, carried / steps);
            }
            let [forces] = driven.forces_of(&[x]);
            (load, lateral) = (forces.load, forces.lateral);
        }

        let [vx, vy, r] = x;
        let row = |i: usize| s.factor[i];
        let spread = |direction: [f64; 3]| {
            let along = |j: usize| (0..3).map(|i| direction[i] * row(i)[j]).sum::<f64>();
            (0..3).map(|j| along(j).powi(2)).sum::<f64>().sqrt()
        };
        out.speed_x = vx;
        out.speed_y = vy;
        out.yaw_rate = r;
        out.speed_x_std = spread([1.0, 0.0, 0.0]).max(s.speed_doubt);
        out.speed_y_std = spread([0.0, 1.0, 0.0]);
        out.yaw_rate_std = spread([0.0, 0.0, 1.0]);
        let square = vx * vx + vy * vy;
        let moving = square > self.parameters.filter.minimum_speed.powi(2);
        out.sideslip = if moving { vy.atan2(vx) } else { 0.0 };
        out.sideslip_std = if moving {
            spread([-vy / square, vx / square, 0.0])
        } else {
            // at rest the direction of motion is anything
            std::f64::consts::PI / 3f64.sqrt()
        };

        let lateral_std = self.lateral_std(&x, &drive, &driven, &load, spread);
        let load_std = self.load_std(&lateral_std);
        let (force, force_std) = (s.wheels.force, s.wheels.force_std);
        [out.wheel_force_x_fl, out.wheel_force_x_fr, out.wheel_force_x_rl, out.wheel_force_x_rr] = force;
        [out.wheel_force_x_fl_std, out.wheel_force_x_fr_std, out.wheel_force_x_rl_std, out.wheel_force_x_rr_std] =
            force_std;
        [out.wheel_force_y_fl, out.wheel_force_y_fr, out.wheel_force_y_rl, out.wheel_force_y_rr] = lateral;
        [out.wheel_force_y_fl_std, out.wheel_force_y_fr_std, out.wheel_force_y_rl_std, out.wheel_force_y_rr_std] =
            lateral_std;
        [out.wheel_load_fl, out.wheel_load_fr, out.wheel_load_rl, out.wheel_load_rr] = load;
        [out.wheel_load_fl_std, out.wheel_load_fr_std, out.wheel_load_rl_std, out.wheel_load_rr_std] = load_std;

        out.nis = s.nis;
        [out.nis_accel_x, out.nis_accel_y, out.nis_gyro_z, out.nis_speed] = s.nis_channels;
        out.log_likelihood = s.log_likelihood;
        out.output_error = s.output_error;
        out.status = s.status;
        let unusable = [Status::UNOBSERVABLE, Status::NO_MEASUREMENT, Status::RESTARTED, Status::BAD_STEP];
        out.healthy = s.samples > 0 && !unusable.iter().any(|bit| s.status.contains(*bit));
    }

    /// Standard deviations of the lateral forces from that of the slip angles, through the
    /// tyres' cornering stiffness, N.
    fn lateral_std(
        &self,
        x: &[f64; 3],
        drive: &Drive,
        driven: &Driven,
        load: &Wheels,
        spread: impl Fn([f64; 3]) -> f64,
    ) -> Wheels {
        let slip = driven.slip_angles(x);
        let stiffness = self.model.cornering_stiffness(slip, *load, drive);
        let derivatives = self.model.slip_derivatives(x, drive);
        std::array::from_fn(|i| stiffness[i].abs() * spread(derivatives[i]))
    }

    /// Standard deviations of the wheel loads from those of the forces that shift them, N.
    fn load_std(&self, lateral_std: &Wheels) -> Wheels {
        let vehicle = &self.model.vehicle;
        let sum = |list: &Wheels| list.iter().sum::<f64>() / vehicle.mass;
        // errors of the wheels of one vehicle share their causes, so they are added whole
        let (ax_std, ay_std) = (sum(&self.state.wheels.force_std), sum(lateral_std));
        let [pitch, front, rear] = vehicle.load_transfer();
        let (pitch, front, rear) = (pitch * ax_std, front * ay_std, rear * ay_std);
        [pitch.hypot(front), pitch.hypot(front), pitch.hypot(rear), pitch.hypot(rear)]
    }
}
