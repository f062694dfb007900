//! Constants that are known with an error, considered in the covariance ([`crate::filter::srckf`]): stiffness and friction
//! of each axle's tyres and the direction in which it rolls, rolling radius and slip, the bias of the lateral accelerometer.

use super::parameters::Parameters;
use super::speed_knowledge::is_measured;
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::square_root::{absorb, product};
use crate::model::wheeled_robot::{Drive, Motion, WheeledRobot, Wheels};
use nalgebra::{Matrix3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// Number of constants: relative errors of stiffness, front and rear, of friction likewise, of the radius; the bias; the
/// directions, front and rear; the slip.
const COUNT: usize = 9;
const RADIUS: usize = 4;
const BIAS: usize = 5;
const STEERING: usize = 6;
const SLIP: usize = 8;

/// How far the motion is off per standard deviation of each constant.
pub(super) type Cross = SMatrix<f64, 3, COUNT>;
/// How the channels `(accel_x, accel_y, gyro_z, speed)` are off.
pub(super) type Shown = SMatrix<f64, 4, COUNT>;

/// The tyres at the last sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grip {
    /// Vertical loads, N.
    pub load: Wheels,
    /// Lateral forces, N.
    pub lateral: Wheels,
    /// Slip angles, rad.
    pub slip_angle: Wheels,
    /// Derivatives of the lateral forces by the slip angles, N/rad.
    pub stiffness: Wheels,
}

impl Grip {
    /// At rest.
    pub fn at_rest(model: &WheeledRobot) -> Self {
        let load = model.loads(0.0, 0.0);
        let stiffness = model.cornering_stiffness([0.0; 4], load, &Drive::new(0.0, [0.0; 4]));
        Self { load, lateral: [0.0; 4], slip_angle: [0.0; 4], stiffness }
    }
}

/// How the specific forces at the centre of gravity and the yaw acceleration follow the motion and the constants'
/// errors.
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    by_motion: Matrix3<f64>,
    by_error: Cross,
}

/// The constants' standard deviations.
#[derive(Clone, Debug)]
pub(super) struct Constants {
    /// Relative, of stiffness and friction: front, rear.
    tire: [[f64; 2]; 2],
    /// Relative, of the rolling radius.
    radius: f64,
    /// Of the lateral accelerometer's bias, m/s².
    bias: f64,
    /// Of the direction in which the wheels of an axle roll, rad.
    steering: f64,
    /// Place of the inertial sensor, m.
    imu: [f64; 2],
}

impl Constants {
    /// Where no speed is measured nothing is considered: around a speed that may be far off no first order holds.
    pub fn new(p: &Parameters) -> Self {
        if !is_measured(&p.filter) {
            return Self { tire: [[0.0; 2]; 2], radius: 0.0, bias: 0.0, steering: 0.0, imu: [p.imu.x, p.imu.y] };
        }
        let tire = [&p.tire.front, &p.tire.rear].map(|tire| [tire.stiffness_std, tire.friction_std]);
        Self {
            tire,
            radius: p.wheel.radius_std,
            bias: p.imu.accel_y_bias_std,
            steering: p.filter.measurement_std.steering_angle_bias,
            imu: [p.imu.x, p.imu.y],
        }
    }

    /// In first order, with the forces of an axle at its middle.
    pub fn slopes(&self, model: &WheeledRobot, x: &Motion, drive: &Drive, grip: &Grip) -> Slopes {
        let v = &model.vehicle;
        let slip = model.slip_derivatives(x, drive);
        let (s, c) = (drive.steering_sin(), drive.steering_cos());
        let per_force = [
            Vector3::new(-s / v.mass, c / v.mass, v.cg_to_front * c / v.yaw_inertia),
            Vector3::new(0.0, 1.0 / v.mass, -v.cg_to_rear / v.yaw_inertia),
        ];
        let (mut by_motion, mut by_error) = (Matrix3::zeros(), Cross::zeros());
        for (axle, per_force) in per_force.iter().enumerate() {
            let (left, right) = (2 * axle, 2 * axle + 1);
            let force = [left, right].map(|i| Vector3::from(slip[i]) * grip.stiffness[i]);
            by_motion += per_force * (force[0] + force[1]).transpose();
            let [stiffness, friction] = [left, right]
                .map(|i| wheel_errors(grip, i, &self.tire[axle]))
                .into_iter()
                .fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
            by_error.set_column(axle, &(per_force * stiffness));
            by_error.set_column(2 + axle, &(per_force * friction));
            let turned = self.steering * (grip.stiffness[left] + grip.stiffness[right]);
            by_error.set_column(STEERING + axle, &(per_force * turned));
        }
        Slopes { by_motion, by_error }
    }

    /// Time update over `steps` steps of `h` seconds, implicit: stable however fast the lateral dynamics are.
    pub fn predict(&self, cross: &mut Cross, slopes: &Slopes, x: &Motion, (steps, h): (u32, f64)) {
        let [vx, vy, r] = *x;
        let motion = slopes.by_motion + Matrix3::new(0.0, r, vy, -r, 0.0, -vx, 0.0, 0.0, 0.0);
        let Some(transition) = (Matrix3::identity() - motion * h).try_inverse() else { return };
        for _ in 0..steps {
            *cross = product(&transition, &(*cross + slopes.by_error * h));
        }
    }

    /// What the channels are off by; `rolled` are the standard deviations of the errors of a speed from the wheels
    /// ([`rolled`](Self::rolled)), m/s.
    pub fn shown(&self, cross: &Cross, slopes: &Slopes, x: &Motion, rolled: [f64; 2]) -> Shown {
        let acceleration = product(&slopes.by_motion, cross) + slopes.by_error;
        let [forward, left] = self.imu;
        let mut shown = Shown::zeros();
        for k in 0..COUNT {
            let [ax, ay, turn] = acceleration.data.0[k];
            let [vx, _, r] = cross.data.0[k];
            let spin = 2.0 * x[2] * r;
            shown.data.0[k] = [ax - spin * forward - turn * left, ay - spin * left + turn * forward, r, vx];
        }
        shown[(1, BIAS)] += self.bias;
        (shown[(3, RADIUS)], shown[(3, SLIP)]) = (shown[(3, RADIUS)] + rolled[0], shown[(3, SLIP)] + rolled[1]);
        shown
    }

    /// What the errors of radius and slip, of which the standard deviation is given (m/s), add to a speed from the
    /// wheels, m/s.
    pub fn rolled(&self, speed: f64, slip_std: f64) -> [f64; 2] {
        [self.radius * speed, slip_std]
    }

    /// What is known of the motion, the constants' errors counted.
    pub fn counted(&self, belief: &FactoredGaussian<3>, cross: &Cross) -> FactoredGaussian<3> {
        let mut counted = *belief;
        absorb(&mut counted.factor, *cross);
        counted
    }

    /// Standard deviation of a wheel's lateral force from that of its slip angle, which follows the motion by `slope`,
    /// and the errors of its tyre, N.
    pub fn lateral_std(
        &self,
        belief: &FactoredGaussian<3>,
        cross: &Cross,
        slope: [f64; 3],
        grip: &Grip,
        wheel: usize,
    ) -> f64 {
        let gradient = Vector3::from(slope) * grip.stiffness[wheel];
        let mut variance = belief.variance_along(&gradient);
        let mut by_error = cross.transpose() * gradient;
        let axle = wheel / 2;
        let [stiffness, friction] = wheel_errors(grip, wheel, &self.tire[axle]);
        by_error[axle] += stiffness;
        by_error[2 + axle] += friction;
        by_error[STEERING + axle] += self.steering * grip.stiffness[wheel];
        variance += by_error.norm_squared();
        variance.sqrt()
    }
}

/// What the errors of stiffness and friction, of which the standard deviations are given, make of a wheel's force, N.
fn wheel_errors(grip: &Grip, wheel: usize, [stiffness, friction]: &[f64; 2]) -> [f64; 2] {
    let straight = grip.slip_angle[wheel] * grip.stiffness[wheel];
    [straight * stiffness, (grip.lateral[wheel] - straight) * friction]
}
