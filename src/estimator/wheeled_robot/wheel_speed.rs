//! What the speeds of the wheels say about the motion: the longitudinal speed, standstill, slip.

use super::forces::{Predicted, Readings};
use super::parameters::{Axle, Parameters};
use crate::model::wheeled_robot::{Driven, Motion, Vehicle, Wheel, Wheels};

/// Rim speed over this many deviations of its noise is motion.
const MOVING: f64 = 5.0;
/// Rim speed below which a wheel stands in any case, m/s.
const STANDING: f64 = 0.01;
/// Slip beyond which a wheel is said to slip.
const SLIPPING: f64 = 0.2;

/// The wheels as sensors of the speed.
#[derive(Clone, Debug)]
pub(super) struct WheelSpeed {
    vehicle: Vehicle,
    wheel: Wheel,
    axle: Axle,
    /// Rim speed below which a wheel stands, m/s.
    standing: f64,
}

impl WheelSpeed {
    pub fn new(p: &Parameters) -> Self {
        let noise = p.observer.measurement_std.wheel_speed * p.wheel.radius;
        let standing = (MOVING * noise).max(STANDING);
        Self { vehicle: p.vehicle.clone(), wheel: p.wheel.clone(), axle: p.filter.speed_axle, standing }
    }

    /// Longitudinal speed of the centre of gravity from the wheels that have a sample, m/s.
    pub fn speed(&self, readings: &Readings, force: &Wheels, predicted: &Predicted) -> Option<f64> {
        let axle = |left: usize| self.axle_speed(readings, force, predicted, left);
        let (rear, front) = (axle(2), axle(0));
        match self.axle {
            Axle::Rear => rear.or(front),
            Axle::Front => front.or(rear),
        }
    }

    /// The same from the axle whose left wheel has this number: the mean of its wheels, each without its slip and
    /// without what turning adds to it.
    fn axle_speed(&self, readings: &Readings, force: &Wheels, predicted: &Predicted, left: usize) -> Option<f64> {
        let [_, vy, r] = predicted.x;
        let (half_track, across, s) = if left == 0 {
            (0.5 * self.vehicle.track_front, vy + self.vehicle.cg_to_front * r, predicted.drive.steering_sin())
        } else {
            (0.5 * self.vehicle.track_rear, 0.0, 0.0)
        };
        let c = (1.0 - s * s).sqrt().max(0.1);
        let one = |i: usize, offset: f64| {
            readings.speed[i].map(|speed| {
                let slip = if self.wheel.slip_stiffness > 0.0 && predicted.load[i] > 0.0 {
                    (force[i] / (self.wheel.slip_stiffness * predicted.load[i])).clamp(-0.5, 0.5)
                } else {
                    0.0
                };
                (self.wheel.radius * speed / (1.0 + slip) - across * s) / c + offset
            })
        };
        match (one(left, half_track * r), one(left + 1, -half_track * r)) {
            (Some(a), Some(b)) => Some(0.5 * (a + b)),
            (a, b) => a.or(b),
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
