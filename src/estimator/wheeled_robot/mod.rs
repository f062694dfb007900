//! Wheel forces, motion and sideslip of a four-wheeled robot or car.
//!
//! # Model
//! A sliding-mode observer per wheel ([`filter::sliding_mode`](crate::filter::sliding_mode)) finds the longitudinal
//! forces from torque and wheel speed, `J w' = T - R F`. With them and the steering angle as input a square-root
//! cubature Kalman filter ([`filter::srckf`](crate::filter::srckf)) estimates longitudinal speed, lateral speed and
//! yaw rate of the planar model ([`model::wheeled_robot`](crate::model::wheeled_robot)), whose lateral forces are
//! those of the tyres ([`model::tire`](crate::model::tire)). Measured are `a_x`, `a_y` (`filter.channels = patent`),
//! the yaw rate as well (`gyro`), and the speed of the wheels or a reference as well (`wheel_speed`, the default).
//!
//! While no torque was ever measured the forces are those that explain the longitudinal acceleration, which then is no
//! measurement any more. Without a wheel's speed its force is `(T - J ax/R)/R`. The last steering angle and torques
//! hold.
//!
//! # What cannot be observed
//! With the two accelerations of the source, and also with the gyro, the longitudinal speed is not observable on a
//! straight: `status` then says so and `speed_x_std` grows like the open loop's. With the wheels' or a reference speed
//! it is. A constant error of a torque cannot be seen: it goes into the force as `b/R`. Lateral speed rests on the
//! tyres' parameters; their errors are not in the standard deviations.
//!
//! # Noise and defaults
//! - `filter.measurement_std.accel_x` and `accel_y` are 0.1 m/s2, `gyro_z` 0.01 rad/s, `speed` 0.05 m/s per sample.
//! - The noise of the steering angle moves the lateral acceleration that the model expects and counts as noise of
//!   `accel_y` (`filter.measurement_std.steering_angle`, 3 mrad; the source leaves it out, and the robot's `speed_y`
//!   then errs by 1.4 to 1.7 times its deviation).
//! - Slip of the wheels is an error of the measured speed: in hard braking a car's `speed_x` errs by five times
//!   `speed_x_std` unless `wheel.slip_stiffness` or `filter.measurement_std.speed` says so.
//! - `filter.process_psd.*` are 0.04 (m2/s3 and rad2/s3).
//! - A step longer than the sample period is predicted in steps of about one period, up to one second; after a longer
//!   gap the filter makes a new start at the last speed, uncertain by what a vehicle may do meanwhile.
//! - The defaults are a 60 kg robot with 0.8 m wheelbase.
//!
//! # How to tune
//! 1. Measure mass, axle distances, tracks and wheel radius; fit `tire.*` to a log with turns near the limit
//!    (`identify fit wheeled-robot`).
//! 2. Observers: `observer.gain + observer.amplitude * observer.steepness`, the bandwidth in 1/s, near the one that
//!    the observer's page gives, and below half of the sample rate; `observer.nominal_rate` a quarter of it at most.
//! 3. Filter: `filter.measurement_std.*` from the data sheets, those of the accelerations with what the model's force
//!    lacks (roll, road); then `filter.process_psd.*` until `nis` is near 1. `nis_accel_x` to `nis_speed` show which
//!    channel is wrong (`identify tune wheeled-robot`).
//!
//! # Sources and errata
//! Patent CN117406607B, claim 1: planar model (step 1), sliding-mode observer (step 2), square-root cubature filter
//! (step 3). Its formulas are images that the published text lacks, so the equations are the standard ones that its
//! words describe. Errata of step 1 stand in the model, of step 2 in the observer, of step 3 in the filter.

mod forces;
mod integration;
mod motion;
mod parameters;
mod report;
mod speed_knowledge;
mod start;
mod variables;
mod wheel_speed;

pub use forces::WheelForces;
pub use parameters::{
    Axle, Channels, Filter, Imu, Initial, MeasurementStd, Method, Observer, ObserverMeasurementStd, Parameters,
    ProcessPsd,
};
pub use variables::{Inputs, Outputs};

use super::standstill::Standstill;
use super::{Elapsed, Machine, Outcome, Rules, Sampled, StateError};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::innovation::Gate;
use crate::model::wheeled_robot::{Drive, Motion, WheeledRobot as Model, Wheels};
use crate::{ParameterError, Status};
use forces::{ForceObservers, Predicted, Readings, sampled};
use integration::Integration;
use nalgebra::{Vector3, Vector4};
use serde::{Deserialize, Serialize};
use speed_knowledge::{Evidence, SpeedKnowledge};
use wheel_speed::WheelSpeed;

/// The estimator; see the [module](self).
/// ```
/// use wheelstate::Estimator;
/// use wheelstate::estimator::wheeled_robot::{Inputs, Outputs, Parameters, WheeledRobot};
///
/// let parameters = Parameters::default();
/// let mut estimator = WheeledRobot::new(&parameters)?;
/// // one second straight on at 3 m/s
/// let wheel = 3.0 / parameters.wheel.radius;
/// let inputs = Inputs {
///     steering_angle: 0.0,
///     wheel_speed_fl: wheel,
///     wheel_speed_fr: wheel,
///     wheel_speed_rl: wheel,
///     wheel_speed_rr: wheel,
///     accel_x: 0.0,
///     accel_y: 0.0,
///     gyro_z: 0.0,
///     ..Inputs::default() // no torque, no reference speed
/// };
/// for _ in 0..100 {
///     estimator.step(&inputs, 0.01);
/// }
/// let mut estimates = Outputs::default();
/// estimator.outputs(&inputs, 0.0, &mut estimates);
/// assert!((estimates.speed_x.value - 3.0).abs() < 2.0 * estimates.speed_x.std);
/// assert!(estimates.sideslip.value.abs() < 2.0 * estimates.sideslip.std);
/// # Ok::<(), wheelstate::ParameterError>(())
/// ```
pub type WheeledRobot = Sampled<RobotMachine>;

/// Longest gap that is predicted through, s.
const LONGEST_GAP: f64 = 1.0;
/// What no vehicle reaches, m/s and rad/s.
const UNREACHABLE: f64 = 1e4;
/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Longitudinal speed, lateral speed and yaw rate.
    pub belief: FactoredGaussian<3>,
    /// The wheels' longitudinal forces.
    pub forces: WheelForces,
    steering: f64,
    load: Wheels,
    lateral: Wheels,
    speed: SpeedKnowledge,
    standstill: Standstill,
    rejections: u32,
    nis: [f64; 4],
    output_error: f64,
}

/// The robot's model, observers and filter, under the rules of [`Sampled`].
#[derive(Clone, Debug)]
pub struct RobotMachine {
    parameters: Parameters,
    model: Model,
    observers: ForceObservers,
    wheel_speed: WheelSpeed,
    integration: Integration,
    noise: Vector4<f64>,
    gate: Gate,
    initial: State,
}

impl RobotMachine {
    /// A remark about parameters that are allowed but unwise, if any.
    pub fn warning(&self) -> Option<String> {
        let product = self.observers.observer.greatest_layer_gain() * self.parameters.sample_period;
        (product > 0.5).then(|| {
            format!(
                "observer: (gain + amplitude * steepness) * sample_period = {product:.3} is above 0.5; \
                 the forces lag and carry much noise"
            )
        })
    }

    /// Number and length of the steps that lead to a sample.
    fn steps(&self, elapsed: Elapsed) -> (u32, f64) {
        let period = self.parameters.sample_period;
        match elapsed {
            Elapsed::Step(dt) => {
                let steps = (dt / period).round().max(1.0);
                (steps as u32, dt / steps)
            }
            Elapsed::First | Elapsed::Gap(_) => (1, period),
        }
    }
}

impl Machine for RobotMachine {
    const NAME: &'static str = "WheeledRobot";
    const DESCRIPTION: &'static str =
        "Longitudinal and lateral wheel forces, speeds, yaw rate and sideslip of a four-wheeled robot or car";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(p: &Parameters) -> Result<(Self, State), ParameterError> {
        let model = Model::new(&p.vehicle, &p.tire, p.filter.minimum_speed);
        let observers = ForceObservers::new(p)?;
        let integration = Integration::new(p, &model)?;
        let std = Vector3::new(p.initial.speed_x_std, p.initial.speed_y_std, p.initial.yaw_rate_std);
        let state = State {
            belief: FactoredGaussian::independent(Vector3::new(p.initial.speed_x, 0.0, 0.0), &std),
            forces: observers.start(),
            steering: 0.0,
            load: model.loads(0.0, 0.0),
            lateral: [0.0; 4],
            speed: SpeedKnowledge::start(&p.filter, p.initial.speed_x_std),
            standstill: Standstill::default(),
            rejections: 0,
            nis: [0.0; 4],
            output_error: 0.0,
        };
        let machine = Self {
            wheel_speed: WheelSpeed::new(p),
            noise: motion::measurement_noise(p),
            gate: motion::gate(p),
            initial: state.clone(),
            parameters: p.clone(),
            model,
            observers,
            integration,
        };
        Ok((machine, state))
    }

    fn rules(p: &Parameters) -> Rules {
        let mut unused = Vec::new();
        if p.filter.channels == Channels::Patent {
            unused.push("gyro_z".to_owned());
        }
        if !p.filter.use_speed {
            unused.push("speed".to_owned());
        }
        let longest_gap = LONGEST_GAP.max(p.sample_period);
        Rules { sample_period: p.sample_period, longest_gap, limits: Vec::new(), unused }
    }

    fn sample(&mut self, state: &mut State, inputs: &Inputs, _: Status, elapsed: Elapsed) -> Outcome {
        let filter = &self.parameters.filter;
        let (steps, h) = self.steps(elapsed);
        match elapsed {
            Elapsed::First => {}
            Elapsed::Step(_) => self.predict(state, (steps, h)),
            Elapsed::Gap(gap) => self.bridge_gap(state, gap),
        }

        let readings = Readings::from(inputs);
        state.steering = inputs.steering_angle;
        let drive = Drive::new(state.steering, state.forces.force);
        let (load, lateral) = (state.load, state.lateral);
        let predicted = Predicted { x: state.belief.mean.into(), drive, load, lateral };
        self.observers.step(&mut state.forces, &readings, &self.model, &predicted, (steps, h));
        let from_wheels = || self.wheel_speed.speed(&readings, &state.forces.force, &predicted);
        let reference = sampled(inputs.speed);
        let speed = reference.or_else(|| if filter.channels == Channels::WheelSpeed { from_wheels() } else { None });
        if let Some(speed) = speed {
            self.start_at(&mut state.belief, speed, elapsed);
        }

        let drive = Drive::new(state.steering, state.forces.force);
        let driven = self.model.driven(&drive);
        // an acceleration that gave the forces is no measurement any more
        let accel_x = readings.accel_x.filter(|_| readings.torque_is_known);
        let z = Vector4::new(accel_x.unwrap_or(f64::NAN), inputs.accel_y, inputs.gyro_z, speed.unwrap_or(f64::NAN));
        let innovation = self.correct(state, &z, &driven);
        let mut status = Status::OK;
        if !(state.belief.is_valid() && state.belief.mean.amax() < UNREACHABLE) {
            // cannot happen with finite inputs, and must not stay if it does
            *state = self.initial.clone();
            return Outcome { status: Status::RECOVERED | Status::RESTARTED, ..Outcome::default() };
        }

        let x = Motion::from(state.belief.mean);
        let [forces] = driven.forces_of(&[x]);
        (state.load, state.lateral) = (forces.load, forces.lateral);
        state.nis = innovation.whitened.map(|whitened| whitened * whitened).into();
        state.output_error = self.output_error(&x, forces.accelerations(), &z).unwrap_or(state.output_error);
        let evidence = Evidence {
            measured: innovation.used[3],
            turning: [drive.steering_sin(), x[2]],
            speed: x[0],
            std: state.belief.std(0),
        };
        let dt = f64::from(steps) * h;
        state.speed.update(filter, &evidence, dt);
        let stands = |speed: f64| speed.abs() < 2.0 * filter.measurement_std.speed;
        let quiet = self.wheel_speed.all_stand(&readings).or(reference.map(stands));
        status.raise_if(state.standstill.update(quiet, 0.0, dt), Status::STANDSTILL);
        status.raise_if(innovation.any_rejected(), Status::GATED);
        status.raise_if(state.load.iter().any(|load| *load <= 0.0), Status::LIFT_OFF);
        status.raise_if(self.wheel_speed.any_slips(&readings, &driven, &x), Status::SLIP);
        status.raise_if(state.speed.is_unobservable(), Status::UNOBSERVABLE);
        Outcome {
            status,
            nis: innovation.nis,
            channels: innovation.dof,
            log_likelihood: innovation.log_likelihood,
            used: innovation.used_count() > 0,
            ..Outcome::default()
        }
    }

    fn estimates(&self, state: &State, inputs: &Inputs, horizon: f64, outputs: &mut Outputs) {
        self.report(state, inputs.steering_angle, horizon, outputs);
    }

    fn usable(&self, state: &State, _: &Outputs) -> bool {
        !state.speed.is_unobservable()
    }

    fn check(&self, state: &State) -> Result<(), StateError> {
        if state.belief.is_valid() { Ok(()) } else { Err(StateError("its motion is not finite")) }
    }
}
