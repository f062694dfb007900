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
//! While no drive torque was ever measured the forces are those that explain the longitudinal acceleration, which then is no
//! measurement any more. Without a wheel's speed its force is `(T - J ax/R)/R`. The last steering angle and torques
//! hold.
//!
//! # What cannot be observed
//! With the two accelerations of the source, and also with the gyro, the longitudinal speed is not observable on a
//! straight: `status` then says so and `speed_x_std` grows like the open loop's. With the wheels' or a reference speed
//! it is. A constant error of a torque is not observable: it goes into the force as `b/R`.
//!
//! What the wheels show is as good as their radius: `wheel.radius_std`, 0.04 by default, counts in `speed_x_std` and in the deviations
//! of the forces that torques give. The gain is made for 0.01, so that an unknown radius does not make the filter rather believe
//! `ay/r`, of which the body's roll takes a tenth. Calibrate it over a known distance and say 0.005.
//!
//! Lateral speed rests on the tyres. Errors of `tire.*.stiffness` and `friction` (`stiffness_std`, `friction_std`), of
//! the rolling radius (`wheel.radius_std`), the yaw inertia and the place of the centre of gravity
//! (`vehicle.yaw_inertia_std`, `vehicle.cg_std`), constant errors of the accelerations (`imu.accel_x_bias_std`, `accel_y_bias_std`) and of the
//! directions in which the wheels roll (`filter.measurement_std.steering_angle_bias`) cannot be distinguished from the motion, so
//! the filter considers them: it neither estimates them nor takes them as zero, and they count in its gain and in all
//! standard deviations, where a speed is measured. What the model lacks altogether (camber, roll steer) does not.
//! `speed_y` is that of the centre of gravity: another point's, `d` metres ahead, is larger by `d` times the yaw rate.
//!
//! # Noise and defaults
//! - `filter.measurement_std.accel_x` and `accel_y` are 0.1 m/s2, `gyro_z` 0.01 rad/s, `speed` 0.05 m/s per sample.
//! - The noise of the steering angle moves the lateral acceleration that the model expects and counts as noise of
//!   `accel_y` (`filter.measurement_std.steering_angle`, 3 mrad; the source leaves it out, and the robot's `speed_y`
//!   then errs by 1.4 to 1.7 times its deviation).
//! - The accelerometers of road vehicles shake: 4 m/s2 of white noise are usual. While third differences of a channel
//!   show more noise than declared, it counts as that noisy ([`filter::signal_noise`](crate::filter::signal_noise),
//!   `filter.adaptive`); they need no model, so that what contradicts the model is still detected.
//! - `filter.gate` is 16: a sample that is four standard deviations off in every channel is rejected.
//! - `contradicted` comes from the innovations, from a lateral acceleration that does not follow yaw rate times speed,
//!   and from a yaw rate that turns against the steering: wrong signs and units.
//! - A lateral speed of more than twice the forward speed is lost, since beyond the peak of the tyres' forces these
//!   no longer determine the slip: the filter makes a new start and is not healthy for a second.
//! - A driven or braked wheel slips. What its force lets expect counts in `speed_x_std`: force over load times
//!   `1/wheel.slip_stiffness`, or times 1/15 where none is given, and more near the friction (Dugoff's tyre). With a slip
//!   stiffness the speed is corrected, and `wheel.slip_stiffness_std` of the correction counts.
//! - Without torques nobody knows which axle drives: the deviation of the slip is that of an axle which does it alone. Nor does anybody know whether
//!   wheels pull against one another, as to steer: `wheel_force_x_*_std` then contains a quarter of 2 m/s2 times the mass.
//! - A tyre as soft along as its cornering stiffness allows across slips more than 1/15 of force over load: the gain is that of
//!   usual tyres, `speed_x_std` contains the softer ones.
//! - Where the yaw rate's innovations are larger than noise and errors of the constants explain, a force that the model
//!   lacks turns the vehicle and pushes it sideways: a steering angle that comes late, tyres beyond their peak. It counts in
//!   `speed_y_std`, and in `speed_x_std` as far as `r vy` carries the speed on.
//! - Without `tire.combined` the model lacks what a drive or brake takes from the lateral grip: the slip angle that this costs the
//!   brush model's tyre counts as an error.
//! - Without accelerometer and torques the acceleration is unknown: 2 m/s2 (one standard deviation). Torques and a steering angle
//!   that have not been sampled for more than a tenth of a second become as unknown within the half second after it, and so do
//!   yaw rate and lateral speed where the gyro has no samples either.
//! - Constant errors of the gyro, 0.005 rad/s and 2 % (`imu.gyro_z_bias_std`, `gyro_z_scale_std`), and 15 ms by which it may be late
//!   (`gyro_z_delay_std`; [`lateness`](crate::estimator::lateness)), or by as much as it shows beside the wheels
//!   ([`relative_delay`](crate::estimator::relative_delay)), count in `yaw_rate_std`, those of the torques, 0.05 N.m
//!   (`observer.torque_bias_std`), the delay that they show beside the accelerometer, the rolling resistance's error and what a brake
//!   may hold at rest, in `wheel_force_x_*_std`; 50 ms by which a measured speed
//!   over ground may be late (`filter.measurement_std.speed_delay`) in `speed_x_std`; parallel front wheels where they may steer about one centre in `wheel_force_y_f*_std`; the mass's, 5 % (`vehicle.mass_std`), in `wheel_load_*_std`.
//! - Until a speed has been measured the estimates are not healthy; the first one takes the place of one that is far from it.
//! - A gyro whose reading repeats exactly while the steering asks for another yaw rate has no samples
//!   ([`repetition`](crate::estimator::repetition)). Wheel speeds count as noisier than declared in the forces' deviations while they are.
//! - A wheel that spins or locks shows in what it gains on the accelerometer within a third of a second: its speed then counts for little
//!   until it agrees again, `status` has `slip`, and after half a second the speed is unobservable and the estimate not
//!   healthy. Of two wheels that are far apart the one is taken that is nearer to what is expected; the very same speed of both is
//!   that of the shaft before a differential. Wheels that differ from the estimate and do not gain on it may be right: half of the
//!   difference counts in `speed_x_std`, and so does what they have gained, from two deviations of chance on. Without an accelerometer the torques have to say what the vehicle does; without
//!   both nothing shows that all wheels slip alike.
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
//! ## Measured
//! Lateral speed on recordings of real cars, all noise settings and errors at their defaults, tyres at the start values
//! of a new user (`identify/tests/wheeled_robot/recordings.rs`):
//!
//! | recording | error, m/s | within 2 std | healthy | healthy and beyond 3 std |
//! |---|---|---|---|---|
//! | Niki GTI, low speed, raw accelerometers of 4 m/s2 | 0.028 | 0.99 | 1.00 | 0.000 |
//! | Niki GTI, AA273, wheel speeds, no accelerometer | 0.056 | 1.00 | 1.00 | 0.000 |
//! | REVS 250 LM, up to 1.6 g, friction set to 1.0 | 0.300 | 0.98 | 1.00 | 0.001 |
//!
//! A small car that drifts all the time, of which hardly anything is known (`f1tenth_put`, two recordings; `python
//! tests/tables/honesty.py IDENTIFY wheeled-robot`; tyres and yaw inertia guessed). Its steering angle is the command, which the yaw rate
//! follows 0.2 s later; its README does not tell the unit of the wheels' speed, which on straights is 0.9 to 1 of the
//! reference; and in slow turns, in which the rear axle goes where it points, the reference's lateral speed is that of a point 0.17
//! and 0.05 m before the centre of gravity. It is healthy in 0.70 and 0.78 of the samples; healthy and beyond 3 std are, in per cent of all:
//!
//! | | first recording | second recording |
//! |---|---|---|
//! | `speed_x` | 0.9 | 0.5 |
//! | `speed_y` against the reference's point; moved to the centre of gravity | 5.1; 0.5 | 0.1; 0.0 |
//! | the place said (`vehicle.cg_std` 0.15): `speed_x` | 0.7 | 0.6 |
//! | `speed_y`, likewise | 2.1; 0.3 | 0.1; 0.0 |
//!
//! A steering angle that is 50 to 150 ms early (`wheeled_robot::steering`, on the plant and the multi-body car): `speed_y` was healthy
//! and beyond 3 std in up to 46 % of the samples where no such force counted, and is in at most 1 %; in up to 5 % where it is 200 ms early
//! and swings by half a radian.
//!
//! Longitudinal speed where wheels slip, torques measured, no slip stiffness given, in seeds that nothing was tuned on
//! (`cargo test -p wheelstate --test main wheeled_robot::slip -- --nocapture`, also with a slip stiffness, without torques
//! and for `speed_y`); last, the same where slip is no part of `speed_x_std`:
//!
//! | ride | error, m/s | within 2 std | healthy | healthy and beyond 3 std | the same, no slip |
//! |---|---|---|---|---|---|
//! | plant: driven hard at the rear | 0.029 | 1.00 | 1.00 | 0.000 | 0.008 |
//! | plant: driven until the rear wheels spin | 0.031 | 1.00 | 0.81 | 0.000 | 0.116 |
//! | plant: four wheels spin | 0.039 | 0.99 | 0.77 | 0.003 | 0.076 |
//! | plant: braked hard | 0.028 | 1.00 | 1.00 | 0.000 | 0.010 |
//! | plant: braked until all wheels lock | 0.105 | 1.00 | 0.29 | 0.000 | 0.011 |
//! | plant: one wheel on ice | 0.022 | 1.00 | 1.00 | 0.000 | 0.622 |
//! | multi-body car: accelerates and brakes | 0.091 | 1.00 | 1.00 | 0.000 | 0.000 |
//! | multi-body car: drives off at the limit | 0.070 | 1.00 | 0.75 | 0.000 | 0.535 |
//! | multi-body car: stops, a wheel locks | 0.261 | 1.00 | 0.63 | 0.000 | 0.018 |
//! | multi-body car: slides on slippery ground | 0.908 | 0.99 | 0.46 | 0.000 | 0.216 |
//!
//! Four wheels that spin, no torques measured, no `tire.combined`: `speed_y` is healthy and beyond 3 std in 0.1 % (1.9 % where the
//! model's lack of the friction ellipse did not count). With a centre of gravity 5 cm of 80 off and known tyres `speed_y` was
//! healthy and beyond 3 std in a third of the samples, and in none now (`wheeled_robot::parameters`).
//!
//! # Sources and errata
//! Patent CN117406607B, claim 1: planar model (step 1), sliding-mode observer (step 2), square-root cubature filter
//! (step 3). Its formulas are images that the published text lacks, so the equations are the standard ones that its
//! words describe. Errata of step 1 stand in the model, of step 2 in the observer, of step 3 in the filter.

mod agreement;
mod constants;
mod forces;
mod integration;
mod measure;
mod motion;
mod one_step;
mod parameters;
mod report;
mod slip;
mod speed_knowledge;
mod start;
mod unmodelled;
mod variables;
mod wheel_speed;

pub use constants::Grip;
pub use forces::WheelForces;
pub use parameters::{
    Axle, Channels, Filter, Imu, Initial, MeasurementStd, Method, Observer, ObserverMeasurementStd, Parameters,
    ProcessPsd,
};
pub use variables::{Inputs, Outputs};

use super::lateness::Lateness;
use super::one_step::{Belief, OneStepPrediction};
use super::relative_delay::RelativeDelay;
use super::repetition::Repetition;
use super::sampled::LONG_AGO;
use super::standstill::Standstill;
use super::unchanged::Unchanged;
use super::{Elapsed, Machine, Outcome, Rules, Sampled, StateError};
use crate::filter::bounded;
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::innovation::Gate;
use crate::filter::signal_noise::SignalNoise;
use crate::model::wheeled_robot::{Motion, WheeledRobot as Model};
use crate::{ParameterError, Status};
use agreement::Agreement;
use constants::{Constants, Cross};
use forces::ForceObservers;
use integration::Integration;
use measure::Measured;
use nalgebra::{Vector3, Vector4};
use serde::{Deserialize, Serialize};
use slip::Slip;
use speed_knowledge::{Evidence, SpeedKnowledge};
use unmodelled::Unmodelled;
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
/// Lateral over forward speed, the minimum speed at least, that no vehicle keeps: beyond the peak of the tyres' forces
/// these no longer tell the slip.
const LOST: f64 = 2.0;
/// So long after the sideslip was lost nothing is sure of it, s.
const LOST_TIME: f64 = 1.0;

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Longitudinal speed, lateral speed and yaw rate.
    pub belief: FactoredGaussian<3>,
    /// The wheels' longitudinal forces.
    pub forces: WheelForces,
    /// How the errors of the constants have moved the motion.
    cross: Cross,
    /// The tyres.
    pub grip: Grip,
    noise: SignalNoise<4>,
    steering: f64,
    speed: SpeedKnowledge,
    slip: Slip,
    unmodelled: Unmodelled,
    /// Of the wheels' longitudinal forces, and of the yaw rate.
    lateness: Lateness<6>,
    /// Of the gyro beside the wheels, and of the torques beside the accelerometer.
    gyro_delay: RelativeDelay,
    torque_delay: RelativeDelay,
    /// Of gyro, accelerometer and wheel speeds.
    unchanged: Unchanged<7>,
    /// Of the gyro, beside the steering.
    repetition: Repetition,
    standstill: Standstill,
    rejections: u32,
    /// Of lateral acceleration and yaw rate, of yaw rate and steering.
    agreement: [Agreement; 2],
    /// Time since the sideslip was lost, s.
    found: f64,
    /// For how long steering or torques have not been sampled, and the yaw rate neither, s.
    held_for: f64,
    blind_for: f64,
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
    constants: Constants,
    /// Lateral acceleration per yaw acceleration of a force that is not modelled, m.
    reach: f64,
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

impl RobotMachine {
    /// Whether the sideslip is beyond any that a vehicle keeps; then it begins anew.
    fn keep_within_bounds(&self, state: &mut State, dt: f64) -> bool {
        state.found = (state.found + dt).min(LONG_AGO);
        let [vx, vy, _] = Motion::from(state.belief.mean);
        let lost = vy.abs() > LOST * vx.abs().max(self.parameters.filter.minimum_speed);
        if lost {
            let std = state.belief.std(0);
            state.belief = self.unseen_motion(vx, std);
            state.cross = Cross::zeros();
            state.found = 0.0;
        }
        lost
    }
}

impl State {
    /// Whether the measurements contradict one another.
    fn disagrees(&self) -> bool {
        self.agreement.iter().any(Agreement::contradicted)
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
            cross: Cross::zeros(),
            grip: Grip::at_rest(&model),
            noise: SignalNoise::default(),
            steering: 0.0,
            speed: SpeedKnowledge::start(&p.filter, p.initial.speed_x_std),
            slip: Slip::default(),
            unmodelled: Unmodelled::default(),
            lateness: Lateness::default(),
            gyro_delay: RelativeDelay::default(),
            torque_delay: RelativeDelay::default(),
            unchanged: Unchanged::default(),
            repetition: Repetition::default(),
            standstill: Standstill::default(),
            rejections: 0,
            agreement: [Agreement::default(); 2],
            found: LONG_AGO,
            held_for: 0.0,
            blind_for: 0.0,
            nis: [0.0; 4],
            output_error: 0.0,
        };
        let machine = Self {
            wheel_speed: WheelSpeed::new(p),
            constants: Constants::new(p),
            reach: unmodelled::reach(&p.vehicle),
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

    fn sample(&mut self, state: &mut State, inputs: &Inputs, screened: Status, elapsed: Elapsed) -> Outcome {
        let filter = &self.parameters.filter;
        let held = screened.contains(Status::HELD_INPUT);
        let lasts = |before: f64, still: bool| if still { before + elapsed.seconds() } else { 0.0 };
        state.held_for = lasts(state.held_for, held);
        state.blind_for = lasts(state.blind_for, held && inputs.gyro_z.is_nan());
        let (steps, h) = self.steps(elapsed);
        let Measured { slopes, readings, reference, drive, driven, z, noise, rolled, gate } =
            self.measure(state, inputs, elapsed);
        let variance = |state: &State, i: usize| {
            let along = Vector3::from_fn(|row, _| f64::from(u8::from(row == i)));
            state.belief.variance_along(&along) + state.cross.row(i).norm_squared()
        };
        let (speed, turning) = (variance(state, 0), variance(state, 2) + noise[2] * noise[2]);
        let innovation = self.correct(state, (&z, &noise, gate), rolled, &slopes, &driven);
        let mut status = Status::OK;
        let known = state.belief.is_valid() && bounded(state.cross.abs().sum());
        if !(known && state.belief.mean.amax() < UNREACHABLE) {
            // cannot happen with finite inputs, and must not stay if it does
            *state = self.initial.clone();
            return Outcome { status: Status::RECOVERED | Status::RESTARTED, ..Outcome::default() };
        }

        let dt = f64::from(steps) * h;
        if innovation.used[2] && matches!(elapsed, Elapsed::Step(_)) {
            state.unmodelled.match_innovation(innovation.residual[2], turning, dt);
        }
        let left = (variance(state, 0) / speed).min(1.0);
        state.unmodelled.push(self.reach, slopes.damping(), state.belief.mean[2], left, dt);
        let [fl, fr, rl, rr] = state.forces.force;
        state.lateness.follow([fl, fr, rl, rr, state.belief.mean[2], state.belief.mean[0]], dt);
        state.gyro_delay.follow(self.wheel_speed.yaw_rate(&readings), z[2], dt);
        state.torque_delay.follow(inputs.accel_x, readings.whole_torque(state.belief.mean[0]), dt);
        let [fl, fr, rl, rr] =
            [inputs.wheel_speed_fl, inputs.wheel_speed_fr, inputs.wheel_speed_rl, inputs.wheel_speed_rr];
        state.unchanged.follow([inputs.gyro_z, inputs.accel_x, inputs.accel_y, fl, fr, rl, rr], dt);
        status.raise_if(self.keep_within_bounds(state, dt), Status::RESTARTED | Status::AT_BOUND);
        self.compare(state, (&z, &noise), &drive, dt);
        status.raise_if(state.disagrees(), Status::CONTRADICTED);

        let x = Motion::from(state.belief.mean);
        let [forces] = driven.forces_of(&[x]);
        state.grip = self.constants.grip(&self.model, &forces, &drive);
        state.nis = innovation.whitened.map(|whitened| whitened * whitened).into();
        state.output_error = self.output_error(&x, forces.accelerations(), &z).unwrap_or(state.output_error);
        let rolls = reference.is_some() || state.slip.is_right(filter.measurement_std.speed);
        // what contradicts the wheels does not show the speed
        let turning = if rolls { [drive.steering_sin(), x[2]] } else { [0.0; 2] };
        let evidence =
            Evidence { measured: innovation.used[3] && rolls, turning, speed: x[0], std: state.belief.std(0) };
        state.speed.update(filter, &evidence, dt);
        let stands = |speed: f64| speed.abs() < 2.0 * filter.measurement_std.speed;
        let quiet = self.wheel_speed.all_stand(&readings).or(reference.map(stands));
        status.raise_if(state.standstill.update(quiet, 0.0, dt), Status::STANDSTILL);
        status.raise_if(innovation.any_rejected(), Status::GATED);
        status.raise_if(state.repetition.old_reading().is_some(), Status::MISSING);
        status.raise_if(state.grip.load.iter().any(|load| *load <= 0.0), Status::LIFT_OFF);
        status.raise_if(!rolls || self.wheel_speed.any_slips(&readings, &driven, &x), Status::SLIP);
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

    fn predict_one_step(
        &self,
        state: &State,
        inputs: &Inputs,
        _: Status,
        elapsed: Elapsed,
        into: &mut OneStepPrediction,
    ) {
        self.predict_one_step(state, inputs, elapsed, into);
    }

    fn belief(&self, _: &State) -> Result<Belief, &'static str> {
        Err("its filter considers errors of constants that it does not estimate, and takes the wheels' forces from \
             observers without a covariance: its gain is not that of which the smoother's covariances are true")
    }

    fn usable(&self, state: &State, _: &Outputs) -> bool {
        !state.speed.is_unobservable() && !state.disagrees() && state.found > LOST_TIME
    }

    fn check(&self, state: &State) -> Result<(), StateError> {
        let known = state.belief.is_valid() && bounded(state.cross.abs().sum());
        if !known {
            return Err(StateError("its motion is not finite"));
        }
        let seen = state.noise.is_valid()
            && state.slip.is_valid()
            && state.unmodelled.is_valid()
            && state.lateness.is_valid()
            && state.gyro_delay.is_valid()
            && state.torque_delay.is_valid()
            && state.unchanged.is_valid()
            && state.repetition.is_valid()
            && state.agreement.iter().all(Agreement::is_valid);
        if seen { Ok(()) } else { Err(StateError("its noise is not that of any signal")) }
    }
}
