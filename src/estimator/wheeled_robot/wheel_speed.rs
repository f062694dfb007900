//! What the speeds of the wheels say about the motion: the longitudinal speed, standstill, slip.

use super::forces::{Predicted, Readings, WheelForces};
use super::parameters::{Axle, Parameters};
use crate::model::wheeled_robot::{Driven, Motion, Vehicle, Wheel};

/// Rim speed over this many deviations of its noise is motion.
const MOVING: f64 = 5.0;
/// Rim speed below which a wheel stands in any case, m/s.
const STANDING: f64 = 0.01;
/// Slip beyond which a wheel is said to slip.
const SLIPPING: f64 = 0.2;
/// Slip per longitudinal force over load where no slip stiffness is given (one standard deviation): that of a stiffness of
/// 15, at the lower end of what tyres have.
pub(super) const COMPLIANCE: f64 = 1.0 / 15.0;
/// Largest standard deviation of the slip that a force lets expect.
const LARGEST_SLIP: f64 = 0.5;
/// Share of the friction beyond which a tyre slides.
const SLIDING: f64 = 0.98;
/// Difference of an axle's wheels, in deviations of the speed's noise, beyond which one of them slips.
const APART: f64 = 4.0;

/// The longitudinal speed that the wheels show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rolled {
    /// Of the centre of gravity, m/s.
    pub speed: f64,
    /// Standard deviation of the error by the slip that the forces need, as much as they are not corrected for, m/s. With the
    /// sign of the slip: a tyre that is softer than said gains while it drives and loses while it brakes.
    pub slip_std: f64,
}

/// The wheels as sensors of the speed.
#[derive(Clone, Debug)]
pub(super) struct WheelSpeed {
    vehicle: Vehicle,
    wheel: Wheel,
    axle: Axle,
    /// Rim speed below which a wheel stands, m/s.
    standing: f64,
    /// Slip per longitudinal force over load (one standard deviation).
    compliance: f64,
    /// Friction that the tyres in front and at the rear have at least.
    friction: [f64; 2],
    /// Difference between the wheels of an axle beyond which one slips, m/s.
    apart: f64,
}

impl WheelSpeed {
    pub fn new(p: &Parameters) -> Self {
        let noise = p.observer.measurement_std.wheel_speed * p.wheel.radius;
        let standing = (MOVING * noise).max(STANDING);
        let compliance = match p.wheel.slip_stiffness {
            0.0 => COMPLIANCE,
            stiffness => p.wheel.slip_stiffness_std / stiffness,
        };
        let friction = [&p.tire.front, &p.tire.rear].map(|tire| tire.friction * (1.0 - tire.friction_std).max(0.1));
        let apart = APART * std::f64::consts::SQRT_2 * p.filter.measurement_std.speed;
        let (vehicle, wheel, axle) = (p.vehicle.clone(), p.wheel.clone(), p.filter.speed_axle);
        Self { vehicle, wheel, axle, standing, compliance, friction, apart }
    }

    /// What the wheels that have a sample say of the longitudinal speed.
    pub fn speed(&self, readings: &Readings, forces: &WheelForces, predicted: &Predicted) -> Option<Rolled> {
        let axle = |left: usize| self.axle_speed(readings, forces, predicted, left);
        match self.axle {
            Axle::Rear => axle(2).or_else(|| axle(0)),
            Axle::Front => axle(0).or_else(|| axle(2)),
        }
    }

    /// The same from the axle whose left wheel has this number: the mean of its wheels, each without its slip and
    /// without what turning adds to it. Of wheels that are far apart the one is taken that is nearer to what is predicted.
    fn axle_speed(
        &self,
        readings: &Readings,
        forces: &WheelForces,
        predicted: &Predicted,
        left: usize,
    ) -> Option<Rolled> {
        let [vx, vy, r] = predicted.x;
        let (half_track, across, s) = if left == 0 {
            (0.5 * self.vehicle.track_front, vy + self.vehicle.cg_to_front * r, predicted.drive.steering_sin())
        } else {
            (0.5 * self.vehicle.track_rear, 0.0, 0.0)
        };
        let c = (1.0 - s * s).sqrt().max(0.1);
        let one = |i: usize, offset: f64| {
            readings.speed[i].map(|speed| {
                let slip = if self.wheel.slip_stiffness > 0.0 && predicted.load[i] > 0.0 {
                    (forces.force[i] / (self.wheel.slip_stiffness * predicted.load[i])).clamp(-0.5, 0.5)
                } else {
                    0.0
                };
                let speed = (self.wheel.radius * speed / (1.0 + slip) - across * s) / c + offset;
                Rolled { speed, slip_std: self.slip_std(forces, predicted, i) * speed.abs().max(vx.abs()) }
            })
        };
        // the very same speed is that of the shaft before a differential, the mean of both
        let apart = |a: f64, b: f64| (a - b).abs() > self.apart && readings.speed[left] != readings.speed[left + 1];
        match (one(left, half_track * r), one(left + 1, -half_track * r)) {
            (Some(a), Some(b)) if apart(a.speed, b.speed) => {
                Some(if (a.speed - vx).abs() < (b.speed - vx).abs() { a } else { b })
            }
            (Some(a), Some(b)) => {
                Some(Rolled { speed: 0.5 * (a.speed + b.speed), slip_std: 0.5 * (a.slip_std + b.slip_std) })
            }
            (a, b) => a.or(b),
        }
    }

    /// Standard deviation of a wheel's slip, with the slip's sign. With the share `u` of the least friction that the wheel's whole
    /// force uses, Dugoff's tyre (*An analysis of tire traction properties*, 1970) has the linear slip for `u < 1/2` and
    /// `1/(4 u (1 - u))` times this beyond.
    fn slip_std(&self, forces: &WheelForces, predicted: &Predicted, i: usize) -> f64 {
        let load = predicted.load[i];
        if load <= 0.0 {
            return LARGEST_SLIP;
        }
        let (force, std, lateral) = (forces.force[i], forces.force_std[i], predicted.lateral[i]);
        let along = force * force + std * std;
        let used = ((along + lateral * lateral).sqrt() / (self.friction[i / 2] * load)).min(SLIDING);
        let growth = if used > 0.5 { 0.25 / (used * (1.0 - used)) } else { 1.0 };
        (self.compliance * along.sqrt() / load * growth).min(LARGEST_SLIP).copysign(force)
    }

    /// The yaw rate, rad/s, that the difference of the rear wheels shows, NaN if there is none: slip and radii are in it. The very same
    /// speed of both is that of the shaft before a differential.
    pub fn yaw_rate(&self, readings: &Readings) -> f64 {
        match readings.speed {
            [_, _, Some(left), Some(right)] if left != right => {
                self.wheel.radius * (right - left) / self.vehicle.track_rear
            }
            _ => f64::NAN,
        }
    }

    /// Whether all wheels that have a sample stand; nothing if none has one.
    pub fn all_stand(&self, readings: &Readings) -> Option<bool> {
        let mut speeds = readings.speed.iter().flatten().peekable();
        speeds.peek()?;
        Some(speeds.all(|speed| (speed * self.wheel.radius).abs() < self.standing))
    }

    /// Whether the speed of a wheel with a sample is far from that of the ground under it.
    pub fn any_slips(&self, readings: &Readings, driven: &Driven, x: &Motion) -> bool {
        let (along, _) = driven.hub_velocities(x);
        readings.speed.iter().zip(along).any(|(speed, along)| {
            speed.is_some_and(|speed| {
                let rim = self.wheel.radius * speed;
                (rim - along).abs() > SLIPPING * rim.abs().max(along.abs()).max(1.0)
            })
        })
    }
}
