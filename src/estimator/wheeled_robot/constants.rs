//! Constants that are known with an error, considered in the covariance ([`crate::filter::srckf`]): stiffness and friction
//! of each axle's tyres and the direction in which it rolls, rolling radius and slip, the bias of the lateral accelerometer.

use super::parameters::{Axle, Parameters};
use super::speed_knowledge::is_measured;
use super::wheel_speed::COMPLIANCE;
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::square_root::product;
use crate::model::tire::Tire;
use crate::model::wheeled_robot::{Drive, Forces, Motion, Vehicle, WheeledRobot, Wheels};
use nalgebra::{Matrix3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// Number of constants: relative errors of stiffness, front and rear, of friction likewise, of the radius; the lateral bias; the
/// directions, front and rear; the yaw inertia; the place of the centre of gravity; the longitudinal bias; the slip.
const COUNT: usize = 12;
const RADIUS: usize = 4;
const BIAS: usize = 5;
const STEERING: usize = 6;
const INERTIA: usize = 8;
const PLACE: usize = 9;
const LONGITUDINAL: usize = 10;
const SLIP: usize = 11;

/// Slip angle of the brush model over that of the linear tyre, where a wheel's force uses this share of the friction: 3 where the
/// tyre begins to slide whole. `F = K a (1 - s + s²/3)` with `s = K a/(3 mu Fz)` (Pacejka, *Tire and Vehicle Dynamics*, 2012,
/// section 3.2) is `u = 1 - (1 - s)³` with `u = F/(mu Fz)`, and `a` over `F/K` is `3 s/u`.
fn brush(used: f64) -> f64 {
    if used < 1e-3 { 1.0 } else { 3.0 * (1.0 - (1.0 - used.min(1.0)).cbrt()) / used.min(1.0) }
}

/// Up to this share of the friction [`brush`], which is convex, rises by less than this per share.
const GENTLE: (f64, f64) = (0.5, 0.7);

/// The slip of a tyre as soft as its cornering stiffness may be over the slip of [`COMPLIANCE`]. Tread that yields alike in all
/// directions has one stiffness for slip and slip angle (Pacejka, the brush model); carcasses yield more to the side, so that it
/// is the least that the stiffness for slip can be. The gain is that of usual tyres: only the deviations have to contain this.
fn softer(tire: &Tire) -> f64 {
    (1.0 + tire.stiffness_std) * tire.nominal_load / (tire.stiffness * COMPLIANCE)
}

/// Largest error of the rolling radius that the gain is made for, relative. With a larger one the filter would rather take the speed
/// from `ay/r`, of which the roll of the body takes a tenth: only the deviations contain the rest.
const RADIUS_OF_GAIN: f64 = 0.01;

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
    /// What one standard deviation of the friction makes of the lateral forces, N.
    pub by_friction: Wheels,
}

impl Grip {
    /// At rest.
    pub fn at_rest(model: &WheeledRobot) -> Self {
        let load = model.loads(0.0, 0.0);
        let stiffness = model.cornering_stiffness([0.0; 4], load, &Drive::new(0.0, [0.0; 4]));
        Self { load, lateral: [0.0; 4], slip_angle: [0.0; 4], stiffness, by_friction: [0.0; 4] }
    }
}

/// How the specific forces at the centre of gravity and the yaw acceleration follow the motion and the constants'
/// errors.
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    by_motion: Matrix3<f64>,
    by_error: Cross,
    /// What the inertial sensor adds where the centre of gravity lies further forward, m/s².
    displaced: [f64; 2],
}

impl Slopes {
    /// Rate at which the tyres' forces take a lateral speed away, 1/s; 0 beyond their peak.
    pub fn damping(&self) -> f64 {
        (-self.by_motion[(1, 1)]).max(0.0)
    }
}

/// The constants' standard deviations.
#[derive(Clone, Debug)]
pub(super) struct Constants {
    /// Relative, of stiffness and friction: front, rear.
    tire: [[f64; 2]; 2],
    /// Relative, of the rolling radius, as large as the gain is made for.
    radius: f64,
    /// The whole error of the rolling radius over that one.
    radius_of_whole: f64,
    /// Of the accelerometer's bias along and across the vehicle, m/s².
    bias: [f64; 2],
    /// Of the direction in which the wheels of an axle roll, rad.
    steering: f64,
    /// Relative, of the yaw inertia.
    inertia: f64,
    /// Of the place of the centre of gravity, forward, m.
    place: f64,
    /// 1 if errors are considered at all, else 0.
    considered: f64,
    /// Place of the inertial sensor, m.
    imu: [f64; 2],
    /// Stiffness over load of the tyres in front and at the rear, 1/rad, and their friction.
    tires: [[f64; 2]; 2],
    /// Standard deviation of the slip over the one that the gain is made for ([`softer`]).
    softer: f64,
    /// The same factor where the axle that gives the speed may drive alone.
    alone: f64,
}

impl Constants {
    /// Where no speed is measured nothing is considered: around a speed that may be far off no first order holds.
    pub fn new(p: &Parameters) -> Self {
        let considered = if is_measured(&p.filter) { 1.0 } else { 0.0 };
        let axles = [&p.tire.front, &p.tire.rear];
        Self {
            tire: axles.map(|tire| [considered * tire.stiffness_std, considered * tire.friction_std]),
            radius: considered * p.wheel.radius_std.min(RADIUS_OF_GAIN),
            radius_of_whole: (p.wheel.radius_std / RADIUS_OF_GAIN).max(1.0),
            bias: [p.imu.accel_x_bias_std, p.imu.accel_y_bias_std].map(|std| considered * std),
            steering: considered * p.filter.measurement_std.steering_angle_bias,
            inertia: considered * p.vehicle.yaw_inertia_std,
            place: considered * p.vehicle.cg_std * p.vehicle.wheelbase(),
            considered,
            imu: [p.imu.x, p.imu.y],
            tires: axles.map(|tire| [tire.stiffness / tire.nominal_load, tire.friction]),
            alone: p.vehicle.wheelbase()
                / if p.filter.speed_axle == Axle::Rear { p.vehicle.cg_to_front } else { p.vehicle.cg_to_rear },
            softer: if p.wheel.slip_stiffness > 0.0 { 1.0 } else { axles.map(softer).into_iter().fold(1.0, f64::max) },
        }
    }

    /// In first order, with the forces of an axle at its middle.
    /// `acceleration_std` is that of an error that all longitudinal forces share, m/s².
    pub fn slopes(
        &self,
        model: &WheeledRobot,
        x: &Motion,
        (drive, acceleration_std): (&Drive, f64),
        grip: &Grip,
    ) -> Slopes {
        let v = &model.vehicle;
        let slip = model.slip_derivatives(x, drive);
        let (s, c) = (drive.steering_sin(), drive.steering_cos());
        let per_force = [
            Vector3::new(-s / v.mass, c / v.mass, v.cg_to_front * c / v.yaw_inertia),
            Vector3::new(0.0, 1.0 / v.mass, -v.cg_to_rear / v.yaw_inertia),
        ];
        let (mut by_motion, mut by_error) = (Matrix3::zeros(), Cross::zeros());
        let [_, ay, turn] = model.accelerations(&grip.lateral, drive);
        by_error[(0, LONGITUDINAL)] = -self.considered * acceleration_std;
        by_error[(2, INERTIA)] = self.inertia * turn;
        // the axles' forces turn the vehicle about a point further forward
        by_error[(2, PLACE)] = -self.place * ay * v.mass / v.yaw_inertia;
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
            let moved = [left, right].map(|i| self.displaced(v, x[2], slip[i], grip, i));
            let displaced = by_error.column(PLACE) + per_force * (moved[0] + moved[1]);
            by_error.set_column(PLACE, &displaced);
        }
        Slopes { by_motion, by_error, displaced: [self.place * x[2] * x[2], -self.place * turn] }
    }

    /// What a centre of gravity that lies one standard deviation further forward makes of a wheel's lateral force, N: both axles
    /// run more towards the outside, `r/v` rad per metre, and the front axle carries more load, to which its force is
    /// proportional.
    fn displaced(&self, v: &Vehicle, yaw_rate: f64, slip: [f64; 3], grip: &Grip, wheel: usize) -> f64 {
        let lever = if wheel < 2 { v.cg_to_rear } else { -v.cg_to_front };
        self.place * (-slip[1] * yaw_rate * grip.stiffness[wheel] + grip.lateral[wheel] / lever)
    }

    /// The tyres' forces with what an error of the friction makes of them: in first order, or, where the model lacks the friction
    /// ellipse and it is more, by the slip angle that the longitudinal force costs the brush model's tyre.
    pub fn grip(&self, model: &WheeledRobot, forces: &Forces, drive: &Drive) -> Grip {
        let Forces { slip_angle, load, lateral, .. } = *forces;
        let stiffness = model.cornering_stiffness(slip_angle, load, drive);
        let longitudinal = drive.longitudinal();
        let by_friction = std::array::from_fn(|i| {
            let (std, [per_load, friction]) = (self.tire[i / 2][1], self.tires[i / 2]);
            let first_order = (lateral[i] - slip_angle[i] * stiffness[i]) * std;
            if std == 0.0 || load[i] <= 0.0 || model.tire.combined {
                return first_order;
            }
            let whole = (longitudinal[i] * longitudinal[i] + lateral[i] * lateral[i]).sqrt();
            let [driven, free] = [whole, lateral[i].abs()].map(|force| force / (friction * load[i]));
            let costs = |more: f64| lateral[i] / (per_load * load[i]) * more * stiffness[i];
            // most wheels are far from the friction: two cube roots less
            if driven < GENTLE.0 && costs(GENTLE.1 * (driven - free)).abs() < first_order.abs() {
                return first_order;
            }
            let costs = costs(brush(driven) - brush(free));
            if costs.abs() > first_order.abs() { costs } else { first_order }
        });
        Grip { load, lateral, slip_angle, stiffness, by_friction }
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
        let [displaced_x, displaced_y] = slopes.displaced;
        let [forward, left] = self.imu;
        let mut shown = Shown::zeros();
        for k in 0..COUNT {
            let [ax, ay, turn] = acceleration.data.0[k];
            let [vx, _, r] = cross.data.0[k];
            let spin = 2.0 * x[2] * r;
            shown.data.0[k] = [ax - spin * forward - turn * left, ay - spin * left + turn * forward, r, vx];
        }
        shown[(0, LONGITUDINAL)] += self.bias[0];
        shown[(1, BIAS)] += self.bias[1];
        shown[(0, PLACE)] += displaced_x;
        shown[(1, PLACE)] += displaced_y;
        (shown[(3, RADIUS)], shown[(3, SLIP)]) = (shown[(3, RADIUS)] + rolled[0], shown[(3, SLIP)] + rolled[1]);
        shown
    }

    /// Takes `dt` seconds in which the accelerometer carried the speed on.
    pub fn carried_on(&self, cross: &mut Cross, dt: f64) {
        cross[(0, LONGITUDINAL)] -= self.bias[0] * dt;
    }

    /// What the errors of radius and slip, of which the standard deviation is given (m/s), add to a speed from the
    /// wheels, m/s.
    pub fn rolled(&self, speed: f64, slip_std: f64) -> [f64; 2] {
        [self.radius * speed, slip_std]
    }

    /// What the whole errors of radius and slip have made of the motion, where the gain is made for smaller ones.
    /// Without torques, `by_torque`, nobody knows which axle drives.
    pub fn whole(&self, cross: &Cross, by_torque: bool) -> Cross {
        let mut whole = *cross;
        whole.column_mut(RADIUS).scale_mut(self.radius_of_whole);
        whole.column_mut(SLIP).scale_mut(self.softer * if by_torque { 1.0 } else { self.alone });
        whole
    }

    /// Standard deviation of a wheel's lateral force from that of its slip angle, which follows the motion by `slope`,
    /// and the errors of its tyre, N.
    pub fn lateral_std(
        &self,
        belief: &FactoredGaussian<3>,
        cross: &Cross,
        slope: [f64; 3],
        grip: &Grip,
        (vehicle, wheel): (&Vehicle, usize),
    ) -> f64 {
        let gradient = Vector3::from(slope) * grip.stiffness[wheel];
        let mut variance = belief.variance_along(&gradient);
        let mut by_error = cross.transpose() * gradient;
        let axle = wheel / 2;
        let [stiffness, friction] = wheel_errors(grip, wheel, &self.tire[axle]);
        by_error[axle] += stiffness;
        by_error[2 + axle] += friction;
        by_error[STEERING + axle] += self.steering * grip.stiffness[wheel];
        by_error[PLACE] += self.displaced(vehicle, belief.mean[2], slope, grip, wheel);
        variance += by_error.norm_squared();
        variance.sqrt()
    }
}

/// What the errors of stiffness, of which the standard deviation is given, and friction make of a wheel's force, N.
fn wheel_errors(grip: &Grip, wheel: usize, [stiffness, _]: &[f64; 2]) -> [f64; 2] {
    [grip.slip_angle[wheel] * grip.stiffness[wheel] * stiffness, grip.by_friction[wheel]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_brush_models_curve_is_convex_and_gentle_far_from_the_friction() {
        let (gentle, steepest) = GENTLE;
        let slopes: Vec<f64> =
            (0..1000).map(|k| 1e-3 * f64::from(k)).map(|u| (brush(u + 1e-3) - brush(u)) * 1e3).collect();
        assert!(slopes[1..].is_sorted());
        assert!(slopes[(gentle * 1e3) as usize - 1] < steepest && (brush(1.0) - 3.0).abs() < 1e-12);
    }
}
