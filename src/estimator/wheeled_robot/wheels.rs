//! Longitudinal forces and speed from the wheels: torques and wheel speeds through the observers, or
//! the accelerometer where no torque was ever measured.

use super::parameters::{Axle, Inputs, Parameters};
use super::{Sample, sample};
use crate::Status;
use crate::filter::sliding_mode::{Adaptation, ForcedMotion, Knowledge, SlidingMode, SlidingModeState};
use crate::model::wheeled_robot::{Drive, Driven, Motion, Wheel, WheeledRobot, Wheels, wheel_torque};
use serde::{Deserialize, Serialize};

/// Time constant of the accelerometer's low-pass where it gives the forces, s.
const ACCELERATION_LAG: f64 = 0.03;

impl ForcedMotion for Wheel {
    fn acceleration(&self, torque: f64, force: f64) -> f64 {
        Wheel::acceleration(self, torque, force)
    }
    fn balance(&self, torque: f64) -> f64 {
        self.steady_force(torque)
    }
    fn force_per_acceleration(&self) -> f64 {
        self.inertia_force()
    }
}

/// What the wheels' part of a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WheelStates {
    /// One observer per wheel.
    pub observers: [SlidingModeState; 4],
    /// Last drive torques, N m.
    pub drive_torque: Wheels,
    /// Last brake torques, N m.
    pub brake_torque: Wheels,
    /// Whether any torque was ever measured.
    pub torque_seen: bool,
    /// Low-passed longitudinal acceleration, m/s².
    pub acceleration: f64,
    /// Whether the acceleration was ever measured.
    pub acceleration_seen: bool,
    /// Last wheel speeds, rad/s, NaN-free: 0 before the first.
    pub speeds: Wheels,
    /// Whether the wheel had a speed in the last sample.
    pub measured: [bool; 4],
    /// Longitudinal forces, N.
    pub force: Wheels,
    /// Their standard deviations, N.
    pub force_std: Wheels,
}

/// Settings of the wheels' part.
#[derive(Clone, Debug)]
pub struct WheelObservers {
    pub observer: SlidingMode,
    knowledge: Knowledge,
    stop_speed: f64,
    rolling: f64,
    wheel: Wheel,
    axle: Axle,
    accel_std: f64,
}

impl WheelObservers {
    pub fn new(p: &Parameters) -> Self {
        let o = &p.observer;
        let adaptation = o.adaptive.then_some(Adaptation {
            rate: o.adaptation_rate,
            dead_zone: o.dead_zone,
            least: o.amplitude_min,
            greatest: o.amplitude_max,
        });
        Self {
            observer: SlidingMode {
                gain: o.gain,
                amplitude: o.amplitude,
                width: o.width,
                nominal_rate: o.nominal_rate,
                force_limit: o.force_limit,
                feedforward: o.feedforward,
                adaptation,
            },
            knowledge: Knowledge {
                speed_noise: o.wheel_speed_std,
                torque_noise: o.torque_std,
                torque_bias: o.torque_bias_std,
                inertia_error: o.inertia_error,
            },
            stop_speed: o.stop_speed,
            rolling: p.rolling.coefficient * p.wheel.radius,
            wheel: p.wheel.clone(),
            axle: p.filter.speed_axle,
            accel_std: p.filter.measurement_std.accel_x,
        }
    }

    pub fn start(&self) -> WheelStates {
        WheelStates {
            observers: [self.observer.start(); 4],
            drive_torque: [0.0; 4],
            brake_torque: [0.0; 4],
            torque_seen: false,
            acceleration: 0.0,
            acceleration_seen: false,
            speeds: [0.0; 4],
            measured: [false; 4],
            force: [0.0; 4],
            force_std: [0.0; 4],
        }
    }

    /// Forces of one sample, `steps` observer steps of `h` seconds after the one before; only the last
    /// of them has a measurement.
    pub fn step(
        &self,
        state: &mut WheelStates,
        inputs: &Inputs,
        model: &WheeledRobot,
        now: &Now,
        (steps, h): (u32, f64),
        status: &mut Status,
    ) {
        let drive = [inputs.drive_torque_fl, inputs.drive_torque_fr, inputs.drive_torque_rl, inputs.drive_torque_rr];
        let brake = [inputs.brake_torque_fl, inputs.brake_torque_fr, inputs.brake_torque_rl, inputs.brake_torque_rr];
        let speed = [inputs.wheel_speed_fl, inputs.wheel_speed_fr, inputs.wheel_speed_rl, inputs.wheel_speed_rr];
        let drive = drive.map(|torque| sample(torque, 1e6, status));
        let brake = brake.map(|torque| sample(torque, 1e6, status));
        let speed = speed.map(|speed| sample(speed, 1e5, status));
        state.torque_seen |= drive.iter().chain(&brake).any(Option::is_some);
        for i in 0..4 {
            let held = drive[i].is_none() || brake[i].is_none();
            status.raise_if(held && state.torque_seen, Status::HELD_INPUT);
            state.drive_torque[i] = drive[i].unwrap_or(state.drive_torque[i]);
            state.brake_torque[i] = brake[i].unwrap_or(state.brake_torque[i]);
            state.measured[i] = speed[i].is_some();
            state.speeds[i] = speed[i].unwrap_or(state.speeds[i]);
        }
        if let Some(accel_x) = now.accel_x {
            let share = if state.acceleration_seen { (f64::from(steps) * h / ACCELERATION_LAG).min(1.0) } else { 1.0 };
            state.acceleration += share * (accel_x - state.acceleration);
            state.acceleration_seen = true;
        }
        if state.torque_seen {
            for (i, speed) in speed.into_iter().enumerate() {
                self.force_from_torque(state, i, speed, now, steps, h);
            }
        } else {
            self.forces_from_acceleration(state, model, now);
        }
    }

    fn force_from_torque(&self, state: &mut WheelStates, i: usize, speed: Sample, now: &Now, steps: u32, h: f64) {
        let turning = speed.unwrap_or(state.observers[i].speed);
        let rolling = self.rolling * now.load[i];
        let (drive, brake) = (state.drive_torque[i], state.brake_torque[i]);
        if speed.is_none() && !state.observers[i].started {
            // No speed at all: the wheel is taken to roll with the vehicle.
            let rolled = now.x[0] / self.wheel.radius;
            let torque = wheel_torque(drive, brake, rolled, self.stop_speed, rolling);
            let inertial = self.wheel.inertia_force() * state.acceleration;
            state.force[i] = (torque - inertial) / self.wheel.radius;
            let (bias, noise) = (self.knowledge.torque_bias, self.knowledge.torque_noise);
            state.force_std[i] = (noise * noise + bias * bias + inertial * inertial).sqrt() / self.wheel.radius;
            return;
        }
        let torque = wheel_torque(drive, brake, turning, self.stop_speed, rolling);
        let observer = &mut state.observers[i];
        for _ in 1..steps {
            self.observer.step(&self.wheel, observer, f64::NAN, torque, h);
        }
        state.force[i] = self.observer.step(&self.wheel, observer, speed.unwrap_or(f64::NAN), torque, h);
        state.force_std[i] = self.observer.force_std(&self.wheel, observer, &self.knowledge, h);
    }

    /// Without any torque the forces are those that explain the longitudinal acceleration, shared in
    /// proportion to the loads.
    fn forces_from_acceleration(&self, state: &mut WheelStates, model: &WheeledRobot, now: &Now) {
        let weight: f64 = now.load.iter().sum();
        let sideways = (now.lateral[0] + now.lateral[1]) * now.drive.steering_sin();
        let whole = if state.acceleration_seen { model.vehicle.mass * state.acceleration + sideways } else { 0.0 };
        for i in 0..4 {
            let share = now.load[i] / weight;
            state.force[i] = share * whole;
            // how the force is shared among the wheels is not known
            state.force_std[i] = share * (whole.abs() + model.vehicle.mass * self.accel_std);
        }
    }

    /// Longitudinal speed of the centre of gravity from the wheels that have a sample, m/s.
    pub fn speed(&self, state: &WheelStates, model: &WheeledRobot, now: &Now) -> Sample {
        let (rear, front) = (self.axle_speed(state, model, now, 2), self.axle_speed(state, model, now, 0));
        match self.axle {
            Axle::Rear => rear.or(front),
            Axle::Front => front.or(rear),
        }
    }

    fn axle_speed(&self, state: &WheelStates, model: &WheeledRobot, now: &Now, left: usize) -> Sample {
        let [_, vy, r] = now.x;
        let (half_track, uy, s) = if left == 0 {
            (0.5 * model.vehicle.track_front, vy + model.vehicle.cg_to_front * r, now.drive.steering_sin())
        } else {
            (0.5 * model.vehicle.track_rear, 0.0, 0.0)
        };
        let c = (1.0 - s * s).sqrt().max(0.1);
        let one = |i: usize, offset: f64| {
            state.measured[i].then(|| {
                let slip = if self.wheel.slip_stiffness > 0.0 && now.load[i] > 0.0 {
                    (state.force[i] / (self.wheel.slip_stiffness * now.load[i])).clamp(-0.5, 0.5)
                } else {
                    0.0
                };
                (self.wheel.radius * state.speeds[i] / (1.0 + slip) - uy * s) / c + offset
            })
        };
        match (one(left, half_track * r), one(left + 1, -half_track * r)) {
            (Some(a), Some(b)) => Some(0.5 * (a + b)),
            (a, b) => a.or(b),
        }
    }

    /// Whether all wheels that have a sample stand, or none has one.
    pub fn standing(&self, state: &WheelStates) -> Option<bool> {
        let least = (5.0 * self.knowledge.speed_noise * self.wheel.radius).max(0.01);
        let mut measured = (0..4).filter(|i| state.measured[*i]).peekable();
        measured.peek()?;
        Some(measured.all(|i| (state.speeds[i] * self.wheel.radius).abs() < least))
    }

    /// Whether the speed of a wheel with a sample is far from that of the ground under it.
    pub fn slipping(&self, state: &WheelStates, driven: &Driven, x: &Motion) -> bool {
        let (along, _) = driven.hub_velocities(x);
        (0..4).any(|i| {
            let rim = self.wheel.radius * state.speeds[i];
            state.measured[i] && (rim - along[i]).abs() > 0.2 * rim.abs().max(along[i].abs()).max(1.0)
        })
    }
}

/// What the wheels need to know of the vehicle at this instant.
pub struct Now {
    /// Predicted motion.
    pub x: Motion,
    /// Steering, with the forces of the sample before.
    pub drive: Drive,
    /// Last wheel loads, N.
    pub load: Wheels,
    /// Last lateral wheel forces, N.
    pub lateral: Wheels,
    /// Longitudinal acceleration of this sample, m/s².
    pub accel_x: Sample,
}
