//! Wheel forces, motion and sideslip of a four-wheeled robot or car: CN117406607B.
//!
//! A sliding-mode observer per wheel ([`crate::filter::sliding_mode`]) finds the longitudinal forces
//! from torque and wheel speed; with them and the steering angle as input a square-root cubature filter
//! ([`crate::filter::srckf`]) estimates longitudinal speed, lateral speed and yaw rate of the planar
//! model ([`crate::model::wheeled_robot`]).
//!
//! # What can be known
//! The source measures two accelerations (`filter.channels = patent`). With these, and also with the
//! gyroscope (`gyro`), the longitudinal speed is not observable on a straight: `status` then says so and
//! `speed_x_std` grows like the open loop's. With the wheels' or a reference speed it is.
//! A constant error of a torque cannot be seen: it goes into the force as `b/R`. Lateral speed rests
//! on the tyre's parameters; their errors are not in the standard deviations.
//!
//! The noise of the steering angle, which moves the lateral acceleration that the model expects, counts as noise of
//! `accel_y` (`filter.steering_std`; the source leaves it out, and the robot's `speed_y` then errs by 1.4 to 1.7
//! times its deviation). Slip of the wheels is an error of the measured speed: in hard braking a car's `speed_x` errs
//! by five times `speed_x_std` unless `wheel.slip_stiffness` or `filter.measurement_std.speed` says so.
//!
//! # Columns that are missing
//! Without any torque the forces are those that explain the longitudinal acceleration, which then is
//! no measurement any more. Without a wheel's speed its force is `(T - J ax/R)/R`. A missing
//! steering angle or torque is held.
//!
//! # Time
//! A step longer than the sample period is predicted in steps of about one period, up to one second;
//! after a longer gap the filter starts anew around its prediction (`restarted`).

mod outputs;
mod parameters;
mod wheels;

pub use parameters::{
    Axle, Channels, Filter, Imu, Initial, Inputs, MeasurementStd, Method, Observer, Outputs, Parameters, ProcessStd,
};
pub use wheels::WheelStates;

use super::{Estimator, StateError};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::innovation::Gate;
use crate::filter::srckf;
use crate::model::wheeled_robot::{
    Drive, Driven, Integrator, Motion, WheeledRobot as Model, Wheels, specific_force_at,
};
use crate::{ParameterError, Status, Variables};
use nalgebra::{SMatrix, SVector, Vector3, Vector4};
use serde::{Deserialize, Serialize};
use wheels::{Now, WheelObservers};

/// Longest gap that is predicted through, s.
const LONGEST_GAP: f64 = 1.0;
/// Time over which steering and turning are remembered when observability is judged, s.
const MEMORY: f64 = 0.5;
/// Rejections in a row after which the gate opens.
const MOST_REJECTIONS: u32 = 10;

type Sample = Option<f64>;

/// A measured input: nothing if it is missing, infinite or beyond `limit`, and the status says why.
fn sample(value: f64, limit: f64, status: &mut Status) -> Sample {
    let usable = value.abs() <= limit;
    status.raise_if(value.is_nan(), Status::MISSING);
    status.raise_if(value.is_infinite(), Status::INFINITE);
    status.raise_if(value.is_finite() && !usable, Status::IMPLAUSIBLE);
    usable.then_some(value)
}

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    x: [f64; 3],
    factor: [[f64; 3]; 3],
    wheels: WheelStates,
    steering: f64,
    load: Wheels,
    lateral: Wheels,
    samples: u64,
    steering_activity: f64,
    yaw_activity: f64,
    speed_doubt: f64,
    speed_age: f64,
    blind: bool,
    rejections: u32,
    nis: f64,
    nis_channels: [f64; 4],
    log_likelihood: f64,
    output_error: f64,
    status: Status,
}

/// Estimator of wheel forces and motion.
#[derive(Clone, Debug)]
pub struct WheeledRobot {
    parameters: Parameters,
    model: Model,
    wheels: WheelObservers,
    /// Rate of the lateral dynamics at the minimum speed, 1/s.
    rate: f64,
    start: State,
    state: State,
}

impl WheeledRobot {
    /// A remark about parameters that are allowed but unwise, if any.
    pub fn warning(&self) -> Option<String> {
        let product = self.wheels.observer.greatest_layer_gain() * self.parameters.sample_period;
        (product > 0.5).then(|| {
            format!(
                "observer: (gain + amplitude * width) * sample_period = {product:.3} is above 0.5; \
                 the forces lag and carry much noise"
            )
        })
    }

    fn advance(&self, x: &Motion, driven: &Driven, dt: f64) -> Motion {
        let [x] = driven.advance_of([*x], dt, self.integrator(), self.substeps(x[0], dt));
        x
    }

    fn integrator(&self) -> Integrator {
        match self.parameters.filter.integrator {
            Method::Euler => Integrator::Euler,
            Method::Rk4 => Integrator::Rk4,
        }
    }

    /// Steps of the integrator at a speed: what keeps it at half its limit of stability, but no more
    /// than the parameter allows. The lateral dynamics slow down with speed.
    fn substeps(&self, speed: f64, dt: f64) -> u32 {
        let least = self.parameters.filter.minimum_speed;
        let rate = self.rate * least / speed.abs().max(least);
        (2.0 * rate * dt / stable(&self.parameters)).ceil().clamp(1.0, f64::from(self.parameters.filter.substeps))
            as u32
    }

    fn speed_is_measured(&self) -> bool {
        self.parameters.filter.channels == Channels::WheelSpeed || self.parameters.filter.use_speed
    }

    /// One sample, after `steps` time steps of `h` seconds.
    fn sample(&mut self, inputs: &Inputs, steps: u32, h: f64, mut status: Status) -> Status {
        let p = &self.parameters;
        let mut filter = FactoredGaussian {
            mean: SVector::from(self.state.x),
            factor: SMatrix::<f64, 3, 3>::from(self.state.factor).transpose(),
        };

        // time update with the inputs of the sample before
        let drive = Drive::new(self.state.steering, self.state.wheels.force);
        let driven = self.model.driven(&drive);
        let scale = (h / p.sample_period).sqrt();
        let q = &p.filter.process_std;
        let process = Vector3::new(q.speed_x, q.speed_y, q.yaw_rate) * scale;
        if self.state.samples > 0 {
            for _ in 0..steps {
                let substeps = self.substeps(filter.mean[0], h);
                srckf::predict(&mut filter, &process, |x: &[Vector3<f64>; 6]| {
                    driven.advance_of(x.map(Motion::from), h, self.integrator(), substeps).map(Vector3::from)
                });
            }
        }

        // inputs of this sample
        let mut ignored = Status::OK;
        let speed_status = if p.filter.use_speed { &mut status } else { &mut ignored };
        let reference = sample(inputs.speed, 200.0, speed_status).filter(|_| p.filter.use_speed);
        status.raise_if(ignored.contains(Status::INFINITE), Status::INFINITE);
        let accel_x = sample(inputs.accel_x, 200.0, &mut status);
        let accel_y = sample(inputs.accel_y, 200.0, &mut status);
        let gyro = sample(inputs.gyro_z, 100.0, &mut status);
        let steering = sample(inputs.steering_angle, 1.6, &mut status);
        status.raise_if(steering.is_none(), Status::HELD_INPUT);
        let s = &mut self.state;
        s.steering = steering.unwrap_or(s.steering);
        let now = Now {
            x: filter.mean.into(),
            drive: Drive::new(s.steering, s.wheels.force),
            load: s.load,
            lateral: s.lateral,
            accel_x,
        };
        self.wheels.step(&mut s.wheels, inputs, &self.model, &now, (steps, h), &mut status);
        let drive = Drive::new(s.steering, s.wheels.force);
        let from_wheels = if p.filter.channels == Channels::WheelSpeed {
            self.wheels.speed(&s.wheels, &self.model, &now)
        } else {
            None
        };
        let speed = reference.or(from_wheels);

        // a start far from the measured speed would only bend the first samples
        if let Some(speed) = speed
            && (s.samples == 0 || status.contains(Status::RESTARTED))
            && (speed - filter.mean[0]).abs() > 3.0 * filter.factor[(0, 0)]
        {
            filter.mean[0] = speed;
        }

        // measurement update
        let (used_x, used_gyro) = (s.wheels.torque_seen, p.filter.channels != Channels::Patent);
        let z = Vector4::new(
            accel_x.filter(|_| used_x).unwrap_or(f64::NAN),
            accel_y.unwrap_or(f64::NAN),
            gyro.filter(|_| used_gyro).unwrap_or(f64::NAN),
            speed.unwrap_or(f64::NAN),
        );
        let r = &p.filter.measurement_std;
        let steered = p.steering_acceleration_std();
        let accel_y_std = (r.accel_y * r.accel_y + steered * steered).sqrt();
        let noise = Vector4::new(r.accel_x, accel_y_std, r.gyro_z, r.speed);
        let gate = Gate { deviations: p.filter.gate.max(0.0).sqrt(), patience: MOST_REJECTIONS };
        let (driven, imu) = (self.model.driven(&drive), &p.imu);
        let expected = |x: &[Vector3<f64>; 6]| {
            let accelerations = driven.accelerations_of(&x.map(Motion::from));
            std::array::from_fn(|k| {
                let (ax, ay) = specific_force_at(accelerations[k], x[k][2], imu.x, imu.y);
                Vector4::new(ax, ay, x[k][2], x[k][0])
            })
        };
        // A speed that nothing determines must not be moved by noise: it is considered, not updated.
        let blind = speed.is_none() && s.blind;
        let innovation =
            srckf::correct(&mut filter, &z, &noise, (gate, &mut s.rejections), [blind, false, false], expected);
        status.raise_if(innovation.any_rejected(), Status::GATED);
        status.raise_if(innovation.dof == 0, Status::NO_MEASUREMENT);
        if !(filter.mean.iter().all(|x| x.abs() < 1e4) && filter.factor.iter().all(|s| s.is_finite())) {
            // cannot happen with finite inputs, and must not stay if it does
            let fresh = self.start.clone();
            let samples = self.state.samples;
            self.state = State { samples, ..fresh };
            return status | Status::RECOVERED | Status::RESTARTED;
        }

        // what the outputs are made of
        s.x = filter.mean.into();
        s.factor = filter.factor.transpose().into();
        let [forces] = driven.forces_of(&[s.x]);
        (s.load, s.lateral) = (forces.load, forces.lateral);
        s.log_likelihood = innovation.log_likelihood;
        if innovation.dof > 0 {
            s.nis = innovation.nis_per_row();
            let (ax, ay) = specific_force_at(forces.accelerations(), s.x[2], imu.x, imu.y);
            let squares = [z[0] - ax, z[1] - ay].map(|e| if e.is_finite() { e * e } else { 0.0 });
            let count = innovation.used[..2].iter().filter(|used| **used).count().max(1);
            s.output_error = (squares[0] + squares[1]) / count as f64;
        }
        for j in 0..4 {
            if innovation.used[j] {
                s.nis_channels[j] = innovation.whitened[j] * innovation.whitened[j];
            }
        }
        status.raise_if(s.load.iter().any(|load| *load <= 0.0), Status::LIFT_OFF);
        status.raise_if(self.wheels.slipping(&s.wheels, &driven, &s.x), Status::SLIP);
        let still = self.wheels.standing(&s.wheels).or(reference.map(|v| v.abs() < 2.0 * r.speed));
        status.raise_if(still == Some(true), Status::STANDSTILL);
        let fresh_speed = innovation.used[3];
        status | self.judge_speed(&drive, fresh_speed, f64::from(steps) * h)
    }

    /// Whether the longitudinal speed can be known. Without a speed measurement only steering and
    /// turning carry information about it, and the filter's own covariance does not always notice.
    fn judge_speed(&mut self, drive: &Drive, measured: bool, dt: f64) -> Status {
        let sensed = self.speed_is_measured();
        let s = &mut self.state;
        let share = (dt / MEMORY).min(1.0);
        s.steering_activity += share * (drive.steering_sin().powi(2) - s.steering_activity);
        s.yaw_activity += share * (s.x[2] * s.x[2] - s.yaw_activity);
        s.speed_age = if measured { 0.0 } else { (s.speed_age + dt).min(1e9) };
        let active = s.steering_activity > 0.02f64.powi(2) && s.yaw_activity > 0.05f64.powi(2);
        let own = s.factor[0][0].abs();
        let seen = measured || (active && s.x[0].abs() > self.parameters.filter.minimum_speed);
        if seen {
            s.speed_doubt = own;
        } else {
            let p = &self.parameters;
            let (drift, noise) = (p.filter.process_std.speed_x, p.filter.measurement_std.accel_x * dt);
            let grown = s.speed_doubt.powi(2) + drift * drift * dt / p.sample_period + noise * noise;
            s.speed_doubt = grown.sqrt().max(own).min(200.0);
        }
        let unknown = s.speed_age > MEMORY || !sensed;
        s.blind = unknown && !seen;
        let mut status = Status::OK;
        status.raise_if(s.blind, Status::UNOBSERVABLE);
        status
    }
}

impl Estimator for WheeledRobot {
    const NAME: &'static str = "WheeledRobot";
    const DESCRIPTION: &'static str =
        "Longitudinal and lateral wheel forces, speeds, yaw rate and sideslip of a four-wheeled robot or car";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<Self, ParameterError> {
        parameters.validate()?;
        let p = parameters;
        let model = Model::new(&p.vehicle, &p.tire, p.filter.minimum_speed);
        check_observer(p)?;
        let rate = check_integrator(p, &model)?;
        let wheels = WheelObservers::new(p);
        let start = start(p, &model, &wheels);
        Ok(Self { parameters: p.clone(), model, wheels, rate, start: start.clone(), state: start })
    }

    fn sample_period(&self) -> f64 {
        self.parameters.sample_period
    }

    fn step(&mut self, inputs: &Inputs, dt: f64) -> Status {
        let period = self.parameters.sample_period;
        let first = self.state.samples == 0;
        let forward = dt > 0.0 && dt.is_finite();
        if !(first || forward) {
            self.state.status |= Status::BAD_STEP;
            return self.state.status;
        }
        let whole = if first { period } else { dt };
        let mut status = Status::OK;
        let bridged = whole.min(LONGEST_GAP.max(period));
        let steps = (bridged / period).round().max(1.0);
        let h = bridged / steps;
        if whole > bridged {
            let s = &self.start;
            let drive = Drive::new(self.state.steering, self.state.wheels.force);
            let driven = self.model.driven(&drive);
            let moved = (0..steps as u32).fold(self.state.x, |x, _| self.advance(&x, &driven, h));
            self.state.x = moved;
            self.state.factor = s.factor;
            self.state.wheels.observers = s.wheels.observers;
            self.state.speed_doubt = s.speed_doubt;
            status = Status::RESTARTED | Status::BAD_STEP;
            status |= self.sample(inputs, 1, h, status);
        } else {
            status |= self.sample(inputs, steps as u32, h, status);
        }
        self.state.samples = self.state.samples.saturating_add(1);
        self.state.status = status;
        status
    }

    fn outputs(&self, inputs: &Inputs, ahead: f64, outputs: &mut Outputs) {
        self.write_outputs(inputs, ahead, outputs);
    }

    fn state(&self) -> &State {
        &self.state
    }

    fn restore(&mut self, state: &State) -> Result<(), StateError> {
        let w = &state.wheels;
        let numbers = state
            .x
            .iter()
            .chain(state.factor.iter().flatten())
            .chain(w.drive_torque.iter().chain(&w.brake_torque).chain(&w.speeds).chain(&w.force).chain(&w.force_std))
            .chain(state.load.iter().chain(&state.lateral).chain(&state.nis_channels))
            .chain([&state.steering, &state.steering_activity, &state.yaw_activity, &state.speed_doubt])
            .chain([&state.speed_age, &state.nis, &state.log_likelihood, &state.output_error, &w.acceleration]);
        let observers =
            w.observers.iter().flat_map(|o| [o.speed, o.nominal, o.amplitude, o.force, o.lag, o.acceleration]);
        if !numbers.copied().chain(observers).all(f64::is_finite) {
            return Err(StateError("a number in it is not finite"));
        }
        self.state = state.clone();
        Ok(())
    }
}

/// The state before the first sample.
fn start(parameters: &Parameters, model: &Model, wheels: &WheelObservers) -> State {
    let initial = &parameters.initial;
    let mut factor = [[0.0; 3]; 3];
    factor[0][0] = initial.speed_x_std;
    factor[1][1] = initial.speed_y_std;
    factor[2][2] = initial.yaw_rate_std;
    State {
        x: [initial.speed_x, 0.0, 0.0],
        factor,
        wheels: wheels.start(),
        steering: 0.0,
        load: model.loads(0.0, 0.0),
        lateral: [0.0; 4],
        samples: 0,
        steering_activity: 0.0,
        yaw_activity: 0.0,
        speed_doubt: initial.speed_x_std,
        speed_age: 0.0,
        blind: parameters.filter.channels != Channels::WheelSpeed && !parameters.filter.use_speed,
        rejections: 0,
        nis: 0.0,
        nis_channels: [0.0; 4],
        log_likelihood: 0.0,
        output_error: 0.0,
        status: Status::OK,
    }
}

fn refuse(name: &str, value: f64, unit: &'static str, reason: String) -> ParameterError {
    ParameterError { name: name.to_owned(), value, unit, reason }
}

/// Sampled, the observer needs `kappa dt < 2`; above 1 it is useless.
fn check_observer(p: &Parameters) -> Result<(), ParameterError> {
    let o = &p.observer;
    if o.adaptive && o.amplitude_min > o.amplitude_max {
        let reason = format!("is above observer.amplitude_max = {}", o.amplitude_max);
        return Err(refuse("observer.amplitude_min", o.amplitude_min, "rad/s2", reason));
    }
    let amplitude = if o.adaptive { o.amplitude.max(o.amplitude_max) } else { o.amplitude };
    let kappa = o.gain + amplitude * o.width;
    let product = kappa * p.sample_period;
    if kappa <= 0.0 {
        return Err(refuse("observer.gain", o.gain, "1/s", "leaves the observer without any gain".to_owned()));
    }
    if product > 1.0 {
        let name = if o.gain * p.sample_period > 1.0 { "observer.gain" } else { "observer.width" };
        let (value, unit) = if name == "observer.gain" { (o.gain, "1/s") } else { (o.width, "s/rad") };
        let reason = format!(
            "makes (gain + amplitude * width) * sample_period = {product:.3}; it must not exceed 1, and 0.5 is the \
             advised limit"
        );
        return Err(refuse(name, value, unit, reason));
    }
    Ok(())
}

/// Largest product of rate and step that an integrator takes; Runge-Kutta is stable up to 2.78.
fn stable(p: &Parameters) -> f64 {
    match p.filter.integrator {
        Method::Euler => 1.0,
        Method::Rk4 => 2.5,
    }
}

/// The rate of the lateral dynamics at the minimum speed, 1/s. Explicit integration must not overshoot at the minimum speed, where the lateral dynamics are fastest.
fn check_integrator(p: &Parameters, model: &Model) -> Result<f64, ParameterError> {
    let rate = model.lateral_rate(p.filter.minimum_speed);
    let limit = stable(p);
    let needed = (rate * p.sample_period / limit).ceil();
    if f64::from(p.filter.substeps) >= needed {
        return Ok(rate);
    }
    let reason = format!(
        "is too few: the lateral dynamics at filter.minimum_speed = {} m/s have the rate {rate:.1} 1/s, so that with \
         sample_period = {} s each substep must not exceed {:.3e} s; needed are {needed} substeps (or a higher \
         minimum speed)",
        p.filter.minimum_speed,
        p.sample_period,
        limit / rate
    );
    Err(refuse("filter.substeps", f64::from(p.filter.substeps), "1", reason))
}
