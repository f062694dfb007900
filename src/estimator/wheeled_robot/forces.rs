//! Longitudinal forces of the wheels: from torques and wheel speeds through the observers, or from the accelerometer
//! where no torque was ever measured.

use super::parameters::Parameters;
use super::start::UNSEEN_ACCELERATION;
use super::variables::Inputs;
use crate::ParameterError;
use crate::filter::signal_noise::{LONGEST, SignalNoise};
use crate::filter::sliding_mode::{Adaptation, ForcedMotion, Knowledge, SlidingMode, SlidingModeState};
use crate::model::wheeled_robot::{Drive, Motion, Wheel, WheeledRobot, Wheels, wheel_torque};
use crate::variable::root_sum_square;
use serde::{Deserialize, Serialize};

/// Time constant of the accelerometer's low-pass where it gives the forces, s.
const ACCELERATION_LAG: f64 = 0.03;
/// What a wheel's speed changes in bends beside the vehicle's, over the lateral acceleration (one standard deviation): half a track times the yaw
/// acceleration, and yaw rate times lateral speed.
const IN_BENDS: f64 = 1.0 / 3.0;
/// Slope, rad, on which a vehicle is held by its brakes (one standard deviation).
const HELD_ON: f64 = 0.1;

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

/// What one sample says about the wheels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Readings {
    /// Drive torques, N m; 0 where none was ever measured.
    pub drive_torque: Wheels,
    /// Brake torques, N m, likewise.
    pub brake_torque: Wheels,
    /// Whether any drive torque was ever measured: without one a brake's says nothing of what drives.
    pub torque_is_known: bool,
    /// Wheel speeds, rad/s.
    pub speed: [Option<f64>; 4],
    /// Longitudinal acceleration, m/s².
    pub accel_x: Option<f64>,
}

impl Readings {
    /// The torque that drives a vehicle of this speed, N m: all wheels' without their brakes'; NaN if none was measured.
    pub fn whole_torque(&self, speed: f64) -> f64 {
        let sum = |wheels: &Wheels| wheels.iter().sum::<f64>();
        if self.torque_is_known { sum(&self.drive_torque) - sum(&self.brake_torque).copysign(speed) } else { f64::NAN }
    }
}

/// A sample, if there is one.
pub(super) fn sampled(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

impl From<&Inputs> for Readings {
    fn from(i: &Inputs) -> Self {
        let drive = [i.drive_torque_fl, i.drive_torque_fr, i.drive_torque_rl, i.drive_torque_rr].map(sampled);
        let brake = [i.brake_torque_fl, i.brake_torque_fr, i.brake_torque_rl, i.brake_torque_rr].map(sampled);
        Self {
            drive_torque: drive.map(Option::unwrap_or_default),
            brake_torque: brake.map(Option::unwrap_or_default),
            torque_is_known: drive.iter().any(Option::is_some),
            speed: [i.wheel_speed_fl, i.wheel_speed_fr, i.wheel_speed_rl, i.wheel_speed_rr].map(sampled),
            accel_x: sampled(i.accel_x),
        }
    }
}

/// What the wheels need to know of the vehicle at the instant of a sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Predicted {
    /// Motion.
    pub x: Motion,
    /// Steering, with the forces of the sample before.
    pub drive: Drive,
    /// Wheel loads of the sample before, N.
    pub load: Wheels,
    /// Lateral wheel forces of the sample before, N.
    pub lateral: Wheels,
}

/// The longitudinal forces, and what a sample changes to find them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WheelForces {
    /// One observer per wheel.
    pub observers: [SlidingModeState; 4],
    /// Low-passed longitudinal acceleration, m/s², if there was a sample of it.
    acceleration: Option<f64>,
    /// Longitudinal forces, N.
    pub force: Wheels,
    /// Their standard deviations, N.
    pub force_std: Wheels,
    /// Standard deviation of the constant error that all of them share where the accelerometer gives them, m/s².
    pub acceleration_std: f64,
    /// Whether they come from torques, else from the acceleration.
    pub by_torque: bool,
    /// Noise of the wheels' speeds over the declared one.
    noise: SignalNoise<4>,
}

/// Settings of the observers.
#[derive(Clone, Debug)]
pub(super) struct ForceObservers {
    pub observer: SlidingMode,
    knowledge: Knowledge,
    /// Whether wheel speeds count as noisier than declared while they are.
    adaptive: bool,
    stop_speed: f64,
    rolling: f64,
    rolling_std: f64,
    wheel: Wheel,
    accel_std: f64,
    accel_bias: f64,
}

impl ForceObservers {
    /// Refuses gains that do not converge.
    pub fn new(p: &Parameters) -> Result<Self, ParameterError> {
        let o = &p.observer;
        let adaptation = o.adaptive.then_some(Adaptation {
            rate: o.adaptation_rate,
            dead_zone: o.dead_zone,
            least: o.amplitude_min,
            greatest: o.amplitude_max,
        });
        let observers = Self {
            observer: SlidingMode {
                gain: o.gain,
                amplitude: o.amplitude,
                steepness: o.steepness,
                nominal_rate: o.nominal_rate,
                force_limit: o.force_limit,
                feedforward: o.feedforward,
                adaptation,
            },
            knowledge: Knowledge {
                speed_noise: o.measurement_std.wheel_speed,
                torque_noise: o.measurement_std.torque,
                torque_bias: o.torque_bias_std,
                inertia_error: o.inertia_error,
            },
            adaptive: p.filter.adaptive && p.sample_period <= LONGEST && o.measurement_std.wheel_speed > 0.0,
            stop_speed: o.stop_speed,
            rolling: p.rolling.coefficient * p.wheel.radius,
            rolling_std: p.rolling.coefficient_std,
            wheel: p.wheel.clone(),
            accel_std: p.filter.measurement_std.accel_x,
            accel_bias: p.imu.accel_x_bias_std,
        };
        observers.check(p)?;
        Ok(observers)
    }

    /// Sampled, the observer needs `kappa dt < 2`; above 1 it is useless.
    fn check(&self, p: &Parameters) -> Result<(), ParameterError> {
        let o = &p.observer;
        let refuse = |name: &str, value, unit, reason| {
            Err(ParameterError { name: format!("observer.{name}"), value, unit, reason })
        };
        if o.adaptive && o.amplitude_min > o.amplitude_max {
            let reason = format!("is above observer.amplitude_max = {}", o.amplitude_max);
            return refuse("amplitude_min", o.amplitude_min, "rad/s2", reason);
        }
        let kappa = self.observer.greatest_layer_gain();
        let product = kappa * p.sample_period;
        if kappa <= 0.0 {
            return refuse("gain", o.gain, "1/s", "leaves the observer without any gain".to_owned());
        }
        if product > 1.0 {
            let reason = format!(
                "makes (gain + amplitude * steepness) * sample_period = {product:.3}; it must not exceed 1, and 0.5 is \
                 the advised limit"
            );
            return match o.gain * p.sample_period > 1.0 {
                true => refuse("gain", o.gain, "1/s", reason),
                false => refuse("steepness", o.steepness, "s/rad", reason),
            };
        }
        Ok(())
    }

    /// Before the first sample.
    pub fn start(&self) -> WheelForces {
        WheelForces {
            observers: [self.observer.start(); 4],
            acceleration: None,
            force: [0.0; 4],
            force_std: [0.0; 4],
            acceleration_std: 0.0,
            by_torque: false,
            noise: SignalNoise::default(),
        }
    }

    /// Forces of one sample, `steps` observer steps of `h` seconds after the one before; only the last
    /// of them has a measurement.
    pub fn step(
        &self,
        state: &mut WheelForces,
        readings: &Readings,
        model: &WheeledRobot,
        predicted: &Predicted,
        (steps, h): (u32, f64),
    ) {
        if let Some(accel_x) = readings.accel_x {
            let share = (f64::from(steps) * h / ACCELERATION_LAG).min(1.0);
            state.acceleration = Some(state.acceleration.map_or(accel_x, |last| last + share * (accel_x - last)));
        }
        if self.adaptive {
            let speeds = readings.speed.map(|speed| speed.unwrap_or(f64::NAN) / self.knowledge.speed_noise);
            state.noise.update(&speeds.into(), f64::from(steps) * h);
        }
        state.by_torque = readings.torque_is_known;
        if readings.torque_is_known {
            state.acceleration_std = 0.0;
            for i in 0..4 {
                self.force_from_torque(state, i, readings, predicted, steps, h);
            }
        } else {
            self.forces_from_acceleration(state, model, predicted);
        }
    }

    fn force_from_torque(
        &self,
        state: &mut WheelForces,
        i: usize,
        readings: &Readings,
        predicted: &Predicted,
        steps: u32,
        h: f64,
    ) {
        let (drive, brake, speed) = (readings.drive_torque[i], readings.brake_torque[i], readings.speed[i]);
        let load = predicted.load[i];
        let rolling = self.rolling * load;
        // a wheel without a speed is taken to roll with the vehicle: what its observer follows meanwhile may have turned back
        let turning = speed.unwrap_or(predicted.x[0] / self.wheel.radius);
        let torque = wheel_torque(drive, brake, turning, self.stop_speed, rolling);
        let unsaid = root_sum_square([self.rolling_std * load, self.holding(brake, turning, load)]);
        if speed.is_none() && !state.observers[i].started {
            let inertia = self.wheel.inertia_force();
            let inertial = inertia * state.acceleration.unwrap_or(0.0);
            state.force[i] = (torque - inertial) / self.wheel.radius;
            let [vx, _, r] = predicted.x;
            let unseen = if state.acceleration.is_none() { UNSEEN_ACCELERATION } else { 0.0 };
            let unknown = inertia * root_sum_square([unseen, IN_BENDS * r * vx]);
            let (bias, noise) = (self.knowledge.torque_bias, self.knowledge.torque_noise);
            let variance = noise * noise + bias * bias + inertial * inertial + unknown * unknown;
            state.force_std[i] = root_sum_square([variance.sqrt() / self.wheel.radius, unsaid]);
            return;
        }
        let observer = &mut state.observers[i];
        for _ in 1..steps {
            self.observer.step(&self.wheel, observer, f64::NAN, torque, h);
        }
        state.force[i] = self.observer.step(&self.wheel, observer, speed.unwrap_or(f64::NAN), torque, h);
        let speed_noise = self.knowledge.speed_noise * state.noise.inflation(i).sqrt();
        let known = Knowledge { speed_noise, ..self.knowledge };
        let by_observer = self.observer.force_std(&self.wheel, observer, &known, h);
        state.force_std[i] = root_sum_square([by_observer, unsaid]);
    }

    /// What a wheel's brake may hold, N (one standard deviation): at rest its torque is anything up to what is said, as a
    /// slope asks for, of which no measurement tells.
    fn holding(&self, brake: f64, speed: f64, load: f64) -> f64 {
        let fades = (1.0 - speed.abs() / self.stop_speed.max(f64::MIN_POSITIVE)).max(0.0);
        fades * (brake.abs() / (3f64.sqrt() * self.wheel.radius)).min(HELD_ON * load)
    }

    /// Without any torque the forces are those that explain the longitudinal acceleration, shared in
    /// proportion to the loads. Without this as well they are none, and wrong by what a vehicle usually does.
    fn forces_from_acceleration(&self, state: &mut WheelForces, model: &WheeledRobot, predicted: &Predicted) {
        let weight: f64 = predicted.load.iter().sum();
        let sideways = (predicted.lateral[0] + predicted.lateral[1]) * predicted.drive.steering_sin();
        let whole = state.acceleration.map_or(0.0, |acceleration| model.vehicle.mass * acceleration + sideways);
        let (error, bias) = match state.acceleration {
            Some(_) => (root_sum_square([self.accel_std, self.accel_bias]), self.accel_bias),
            None => (UNSEEN_ACCELERATION, UNSEEN_ACCELERATION),
        };
        state.acceleration_std = bias;
        for i in 0..4 {
            let share = predicted.load[i] / weight;
            state.force[i] = share * whole;
            // how the force is shared among the wheels is not known
            state.force_std[i] = share * (whole.abs() + model.vehicle.mass * error);
        }
    }
}
