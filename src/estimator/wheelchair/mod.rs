//! Wheelchair with power assistance: speed, heading, slope and pitch, with sensor biases.
//!
//! # Model
//! Motion on a sloping plane, and what encoders, gyro and accelerometer read on it
//! ([`model::wheelchair`](crate::model::wheelchair)). The filter is an extended Kalman filter with Joseph update
//! ([`filter::ekf`](crate::filter::ekf)) in one of four kinds:
//!
//! | `filter.kind` | states | for |
//! |---|---|---|
//! | `basic` | 6 | calibrated sensors; misses slopes with others, and where force or mass are wrong |
//! | `bias` (default) | 13 | unknown biases of gyro and accelerometer, force and mass not quite right |
//! | `acceleration_input` | 11 | force not or badly known: the measured acceleration drives the motion |
//! | `gravity_vector` | 15 | as `bias`, the direction of the contour line unknown at the start |
//!
//! Impacts on a kerb or a ramp's edge, which none of these models has, are down-weighted (`filter.outlier_threshold`).
//! Vibration, as on cobbles, is added to the accelerometer's noise as long as it lasts (`vibration.rs`).
//! A force that nobody reports and that swings or sets in is followed as fast as it moves (`push.rs`), and so is a turn whose
//! moment nobody reports (`turn.rs`).
//!
//! ## The contour line
//! The kinds other than `gravity_vector` know the tilt of the ground across one line, that of `initial.heading`: this makes
//! them precise on a ramp that lies as was said. Ground that tilts otherwise, such as the cross slope of a pavement, moves
//! the leftward accelerometer, the gyro, or the moment that holds the chair straight in a way that is no noise
//! (`watch.rs`). The accelerometer is not used meanwhile, and the standard deviations contain what the ground may be; what
//! lasts for 1.5 s gives the heading up: from then on the filter is that of `gravity_vector`, with what is known
//! of motion, biases and forces (`contour.rs`), and the output `heading_from_gravity` says so. A tilt along the contour
//! line that has been there from the start looks like a bias of the leftward accelerometer: up to 2.5 of its standard
//! deviations it is taken for one, and `slope_std`, `heading_std` contain that it may be none.
//!
//! ## Hands and brakes that nobody reports
//! On a slope across the heading gravity turns the chair. Hands, a caregiver or a caster that hold it without the moment being
//! reported leave a yaw acceleration unexplained, of which the leftward accelerometer feels a part: the share of gravity's moment
//! that is held so is estimated beside the state (`held.rs`), taken once it is significant, and what is unknown of it counts
//! in `slope_std` and `pitch_std`.
//!
//! A ride may start on a ramp of which `initial.slope` knows nothing, with a brake that nobody reports: standing still, a slope and
//! a bias of the accelerometer are one. The kinds with a drive force take the ground for level, as a chair without a brake shows it
//! to be; the standard deviations of all estimates contain from the first sample that it may not be (`brake.rs`). Once the chair
//! moves, its acceleration under the reported force tells: a tilt of more than 30 mrad, significant a second after the first
//! motion, goes into the state. A smaller one looks like rolling resistance that nobody reported: the slope remains wrong by it, and the
//! standard deviation says so for the rest of the ride. A first sample whose specific force is three standard deviations beyond what
//! `initial.slope_std` and `initial.accel_bias_std` explain (45 mrad of slope at the defaults) widens the slope to the unknown
//! at once; until the chair moves, force and moment may then be any (`contour.rs`). `basic`, which has no bias
//! either, says `contradicted` for the first seconds.
//!
//! ## Starts
//! A ride that begins at another speed than `initial.speed` shows in the travel of its first 0.3 s: speed and rates are unknown then,
//! and the ground is tilted by as much as it may be. So they are after a restart, which keeps the pose that the encoders show, and
//! where encoders begin late: a zero that is put where the filter expected it counts in `distance_std` and `heading_std`. A force
//! that is not sampled for a tenth of a second may be as large as a brake's.
//!
//! On the plant, 30 s each, four seeds, sensors with biases but for `basic`: root mean square error of pitch and of slope,
//! mrad; then in per cent the share of both within two standard deviations (the lesser), the share healthy, and the largest
//! share of any estimate in any run that is healthy and beyond three. `tests/wheelchair/ground.rs` holds the bounds and makes
//! the table (`cargo test -p wheelstate --test main wheelchair::ground::table -- --ignored --nocapture`):
//!
//! | ground | `basic` | `bias` | `acceleration_input` | `gravity_vector` |
//! |---|---|---|---|---|
//! | flat | 0.6 0.6, 100 100 0.0 | 1.1 1.1, 100 100 0.0 | 4.0 4.0, 100 100 0.0 | 1.0 4.3, 100 100 0.0 |
//! | ramp, 4 degrees | 0.8 0.8, 100 100 0.0 | 1.0 1.0, 100 100 0.0 | 2.9 2.9, 100 100 0.0 | 1.0 2.4, 100 100 0.0 |
//! | the same at 60 degrees | 1.0 1.1, 100 100 0.0 | 1.1 1.3, 100 100 0.0 | 1.2 1.4, 100 100 0.0 | 0.9 3.1, 100 100 0.0 |
//! | the same, moment not reported | 1.0 1.1, 100 100 0.0 | 1.9 2.2, 100 100 0.0 | 2.8 3.2, 98 100 0.0 | 1.0 3.2, 100 100 0.0 |
//! | ramp, `initial.heading` 0 | 6.8 90.2, 99 90 0.0 | 7.5 89.1, 99 90 0.0 | 9.5 87.9, 99 90 0.0 | 1.0 2.4, 100 100 0.0 |
//! | starts braked on 1 degree | 4.1 4.0, 100 100 0.1 | 16.2 16.1, 100 100 0.1 | 12.4 12.4, 91 100 0.0 | 16.1 13.7, 100 100 0.0 |
//! | starts braked on 2 degrees | 7.9 7.7, 100 93 0.1 | 9.2 9.0, 100 96 0.4 | 11.6 11.6, 100 99 0.1 | 9.1 8.4, 100 95 0.0 |
//! | starts braked on the ramp | 15.7 15.5, 100 84 0.2 | 6.6 6.5, 100 99 0.0 | 10.0 9.9, 100 99 0.0 | 6.4 6.2, 100 99 0.0 |
//! | the same at 60 degrees | 10.6 11.8, 100 85 0.1 | 3.7 4.3, 100 99 0.0 | 2.8 3.3, 100 99 0.1 | 5.8 8.3, 100 99 0.0 |
//! | the same at 0 degrees | 0.1 3.6, 100 98 0.0 | 0.1 3.6, 100 100 0.0 | 0.1 3.6, 100 100 0.2 | 1.0 11.2, 100 100 0.0 |
//! | cross slope, 2 degrees | 1.3 8.3, 100 95 0.0 | 1.1 8.6, 100 95 0.0 | 4.0 8.2, 100 95 0.0 | 1.1 4.0, 100 100 0.0 |
//! | the same, moment not reported | 1.3 8.2, 100 95 0.0 | 1.1 8.6, 100 95 0.0 | 3.9 8.1, 100 95 0.0 | 1.1 4.1, 100 100 0.0 |
//! | circles on it | 1.2 8.1, 100 95 0.0 | 1.3 8.1, 100 95 0.0 | 3.9 8.0, 100 95 0.0 | 1.2 3.4, 100 100 0.0 |
//! | ramp, shaken by 0.2 m/s2 | 0.6 0.6, 100 100 0.0 | 2.0 2.0, 100 100 0.0 | 3.7 3.7, 100 100 0.0 | 2.0 4.3, 100 99 0.0 |
//! | ramp, shaken by 1 m/s2 | 0.6 0.6, 100 100 0.0 | 3.1 3.1, 100 100 0.0 | 5.4 5.4, 100 100 0.0 | 3.1 9.2, 100 87 0.4 |
//! | the same, coloured | 0.6 0.6, 100 100 0.0 | 4.3 4.3, 100 100 0.0 | 9.3 9.3, 100 100 0.1 | 4.3 10.9, 100 88 0.4 |
//! | ramp, shaken by 2 m/s2, coloured | 0.6 0.6, 100 100 0.0 | 3.6 3.6, 100 100 0.0 | 11.1 11.1, 100 100 0.1 | 3.6 9.9, 100 87 0.0 |
//!
//! On a cross slope a second and a half of the ride is flagged; on a ramp of which the heading was said to be 0 the slope is
//! wrong by a radian for as long. Of 24 other runs on each of four vibrations of 1 and 2 m/s2, of which up to 0.7 is left after
//! 10 ms, the worst is wrong and healthy for 0 % of the ride with `bias`, 0.9 % with `gravity_vector` and 0.3 % with
//! `acceleration_input` (means of at most 0.0, 0.1 and 0.1 %), to which coloured vibration costs most: 11 mrad at 1 m/s2 with 0.7
//! left, 17 at 2. If 0.85 of it is left, the worst of 72 is wrong and healthy for 1.8, 1.7 and 14 % of the ride at 1 m/s2 (means of 0.0,
//! 0.2 and 1.0 %): where it drives the motion, as in `acceleration_input`, such vibration is beyond what is recognised.
//!
//! A chair of MuJoCo, with casters, slip and soft contacts, on the same grounds, made of boxes
//! (`tests/oracles/wheelchair_ground.py Wheelchair.fmu` makes the table, `tests/fmpy/test_wheelchair_mujoco.py` holds bounds):
//!
//! | ground | `basic` | `bias` | `acceleration_input` | `gravity_vector` |
//! |---|---|---|---|---|
//! | flat | 1.2 0.7, 100 100 0.0 | 1.5 0.8, 100 100 0.0 | 2.1 2.0, 100 100 0.9 | 1.5 3.2, 100 100 0.0 |
//! | ramp, 4 degrees | 1.6 1.5, 100 100 0.0 | 1.3 1.0, 100 100 0.0 | 2.1 2.0, 100 100 0.9 | 1.3 2.0, 100 100 0.0 |
//! | the same at 60 degrees | 2.2 2.3, 99 100 1.5 | 1.5 1.4, 100 100 0.0 | 1.4 1.6, 100 100 0.7 | 1.3 2.9, 100 100 0.0 |
//! | the same, moment not reported | 2.0 2.1, 99 100 1.8 | 1.8 2.0, 100 100 0.0 | 2.6 3.2, 98 100 0.7 | 1.3 2.9, 100 100 0.0 |
//! | starts braked on 2 degrees | 5.4 5.4, 99 94 0.1 | 9.2 9.2, 100 98 0.0 | 6.8 6.8, 100 100 1.0 | 9.1 8.6, 100 97 0.0 |
//! | starts braked on 4 degrees | 12.3 12.3, 99 84 0.6 | 3.8 3.8, 100 100 0.0 | 5.6 5.6, 100 100 0.7 | 4.0 3.8, 100 100 0.0 |
//! | cross slope, 2 degrees | 1.3 10.2, 98 96 0.0 | 1.5 10.4, 99 96 0.0 | 1.9 10.3, 99 96 0.9 | 1.4 5.8, 100 97 0.0 |
//! | ramp, shaken by 1 m/s2 | 1.2 1.1, 100 100 0.0 | 3.6 3.5, 100 100 0.0 | 6.9 6.9, 100 100 0.8 | 3.6 10.1, 100 81 0.4 |
//! | the same, coloured | 1.2 1.1, 100 100 0.0 | 4.6 4.5, 100 100 0.0 | 11.7 11.6, 98 100 0.6 | 4.5 12.4, 100 81 0.2 |
//!
//! What is wrong and healthy there beyond 1 %: the speed of `acceleration_input` by a centimetre per second while it pulls away, and the
//! heading of `basic` on the oblique ramp.
//!
//! # What cannot be observed
//! Encoders that sit on the frame read the wheels relative to it, `r theta'` more than the axle travels while the frame pitches; those of
//! the source do not. `speed_std` contains it where the gyro shows a pitch rate, `distance_std` what the frame has turned since the
//! start. The error of the wheels' radius (`chair.wheel_radius_std`, 0.02 by default) counts in the deviations of speed, distance, yaw
//! rate, and of a heading that the encoders give, that of their difference (`wheel_radius_difference_std`, 0.007) in those of yaw rate and
//! heading. Rolling resistance of which nobody knows takes the force of a slope: `initial.rolling_coefficient_std`, 0.0075, counts in slope
//! and pitch, and in a heading that gravity gives. Encoders and gyro may be late (`filter.measurement_std.delay`), the
//! encoders by as much as they show beside the accelerometer. A reading of an encoder
//! that repeats exactly while the wheel turns is no sample, for half a second; what stands then has stopped in an instant or is broken, and
//! `speed_std` contains for some seconds that it may roll on.
//!
//! Without a sample of the gyro the upward accelerometer is left out, too: it feels the cosine of a tilt, which its unknown bias hides.
//!
//! On flat ground nothing measured gives the heading relative to the contour line: it rests on the initial heading and the
//! encoders, and `status` says `unobservable`. Where the heading comes from gravity it is as good as the leftward
//! accelerometer's bias is known: 25 to 70 mrad on a slope of 70, at a bias of 0.05 m/s2, of which `heading_std` contains 0.1
//! (`initial.accel_bias_std`). At rest slope and accelerometer bias cannot be
//! distinguished (0.05 m/s2 look like 5 mrad). A slope that appears as a step, without rotation that the gyro could see,
//! is found late or not at all. A constant unmodelled force and the bias of the forward accelerometer look like slope too, until the drive force
//! changes; `bias` and `gravity_vector` carry the force's errors as states, `basic` takes force and mass as true and counts
//! `initial.force_gain_std`, `force_offset_std` and `moment_offset_std` in its standard deviations.
//!
//! # Noise and defaults
//! - `filter.measurement_std`: encoders 3 mrad, gyro 5 mrad/s, accelerometer 0.05 m/s2 per sample. The lever of the
//!   accelerometer carries the slope's second derivative into it (`slope_acceleration`, 1 rad/s2).
//! - `filter.process_psd`: 1e-3 m2/s3 for the speed, 4e-3 rad2/s3 for the yaw rate, 0.5 rad2/s3 for the slope's rate;
//!   biases drift slowly, an unmodelled force by 2 N and an unmodelled moment by 1 N.m in one second.
//! - Biases at the start are known to 0.02 rad/s and 0.1 m/s2, the drive force to 10 % and 3 N, the moment
//!   to 3 N.m (`initial.*_std`).
//! - At standstill speed and rates are known to be zero within 2 mm/s and 2 mrad/s, and brakes may hold the chair.
//! - The defaults are 100 kg of chair and user with 0.305 m wheels.
//!
//! # How to tune
//! 1. Weigh chair and user, measure wheel radius, track and the place of the accelerometer; fit `chair.drag`,
//!    `rolling.coefficient` and `chair.yaw_inertia` to a log (`identify fit wheelchair`).
//! 2. Set `filter.measurement_std.*` from the data sheets. The accelerometer's need not cover vibration, which is added
//!    while it lasts.
//! 3. Slope too slow: raise `filter.process_psd.slope_rate`; too restless: lower it. If `nis` stays above 1 raise
//!    `filter.process_psd.speed` first (`identify tune wheelchair`).
//! 4. If the chair's heading to the contour line is not known at the start: `filter.kind = gravity_vector`. If the
//!    wheels slip on ramps: `filter.process_psd.heading_offset = 1e-5`.
//!
//! # Sources and errata
//! Oh and Hori, *Development of an Extended Operational States Observer of a Power Assist Wheelchair*: motion and
//! sensors (1)-(20), extended Kalman filter (28)-(40), Jacobians (43)-(45). All errata, with reasons, stand in the
//! model. Biases and errors of the force ([`BiasedState`](crate::model::wheelchair::BiasedState)) and the [direction
//! of gravity as state](crate::model::wheelchair::gravity) are not in the source.

pub mod attitude;
mod belief;
mod brake;
mod contour;
pub mod ekf;
mod encoder_delay;
mod forms;
mod held;
mod one_step;
mod outliers;
mod parameters;
mod push;
mod report;
mod rest;
mod steps;
mod turn;
mod variables;
mod vibration;
mod watch;
mod wheels;

pub use belief::ChairBelief;
pub use brake::Brake;
pub use forms::{Basic, Biased, GravityVector, Mover};
pub use held::Held;
pub use parameters::{
    EncoderParameters, FilterParameters, InitialParameters, Kind, LimitParameters, MeasurementParameters, Model,
    Parameters, ProcessParameters, StandstillParameters, Zero,
};
pub use push::Push;
pub use turn::Turn;
pub use variables::{Inputs, Outputs};
pub use vibration::Vibration;
pub use watch::Watch;

use crate::estimator::lateness::Lateness;
use crate::estimator::one_step::{Belief, OneStepPrediction};
use crate::estimator::standstill::Standstill;
use crate::estimator::unchanged::Unchanged;
use crate::estimator::{Elapsed, Machine, Outcome, Rules, Sampled, StateError};
use crate::model::wheelchair::{self as model, Chair, Command};
use crate::{ParameterError, Status};
use belief::{biases, of_kind};
use ekf::ChairEkf;
use encoder_delay::EncoderDelay;
use rest::{Bands, Rest};
use serde::{Deserialize, Serialize};
use watch::{GYRO, HEADING};
use wheels::{FrameTurn, Wheels};

/// The estimator; see the [module](self).
/// ```
/// use wheelstate::Estimator;
/// use wheelstate::estimator::wheelchair::{Inputs, Outputs, Parameters, Wheelchair};
///
/// let mut parameters = Parameters::default();
/// parameters.initial.heading = std::f64::consts::FRAC_PI_2;
/// let mut estimator = Wheelchair::new(&parameters)?;
/// // one second at rest, the nose up by 50 mrad; no wheel encoders: what is not set is missing
/// let g = 9.80665;
/// let (sin, cos) = 0.05_f64.sin_cos();
/// let inputs = Inputs {
///     gyro_pitch: 0.0,
///     accel_x: g * sin,
///     accel_y: 0.0,
///     accel_z: g * cos,
///     drive_force: 100.0 * g * sin, // somebody holds the chair
///     drive_moment: 0.0,
///     ..Inputs::default()
/// };
/// for _ in 0..100 {
///     estimator.step(&inputs, 0.01);
/// }
/// let mut estimates = Outputs::default();
/// estimator.outputs(&inputs, 0.0, &mut estimates);
/// assert!((estimates.slope.value - 0.05).abs() < 3.0 * estimates.slope.std);
/// # Ok::<(), wheelstate::ParameterError>(())
/// ```
pub type Wheelchair = Sampled<ChairMachine>;

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Mean and covariance.
    pub belief: ChairBelief,
    /// Command and forward specific force (if it had one) of the last sample.
    command: [f64; 2],
    accel_x: Option<f64>,
    rejections: [u32; 6],
    watch: Watch,
    /// The ground has contradicted the initial heading.
    left_contour: bool,
    wheels: Wheels,
    /// Variances of distance, m^2, and heading, rad^2, where the encoders' zeros were guessed.
    zeros: [f64; 2],
    frame_turn: FrameTurn,
    /// Of the rate at which the ground tilts, and of the speed.
    lateness: Lateness<2>,
    encoder_delay: EncoderDelay,
    /// Of all sensors.
    unchanged: Unchanged<6>,
    /// Speed of wheels that were expected to turn and did not, m/s; it fades.
    stopped: f64,
    rest: Rest,
    standstill: Standstill,
    /// A brake may have held the chair since the start.
    may_be_braked: bool,
    /// For how long force or moment have not been sampled, s.
    held_for: f64,
}

/// The chair's model and filter, under the rules of [`Sampled`].
#[derive(Clone, Debug)]
pub struct ChairMachine {
    parameters: Parameters,
    chair: Chair,
    basic: ChairEkf<Basic>,
    biased: ChairEkf<Biased>,
    gravity: ChairEkf<GravityVector>,
    bands: Bands,
    /// Known biases of gyro and accelerometer, where they are no states.
    calibration: [f64; 4],
    initial: ChairBelief,
}

impl ChairMachine {
    /// The chair of the parameters.
    pub fn chair(&self) -> &Chair {
        &self.chair
    }

    /// Ends a standstill. Within the bands the chair may have reached these rates.
    fn end_standstill(&self, belief: &mut ChairBelief) {
        let within = 0.05; // s, the shortest time in which a chair crosses a band from rest
        let (v, r) = (self.bands.distance / within, self.bands.heading / within);
        let w = self.bands.gyro;
        match belief {
            ChairBelief::Basic(belief) => self.basic.end_standstill(belief, [v, r, w]),
            ChairBelief::Biased(belief) => self.biased.end_standstill(belief, [v, r, w]),
            ChairBelief::Gravity(belief) => self.gravity.end_standstill(belief, [v, r, w, w]),
        }
    }

    /// Whether mean and variances are numbers that a chair can have; what a run of impossible samples has
    /// driven beyond that would not come back by itself.
    fn is_plausible(&self, belief: &ChairBelief) -> bool {
        let (speed, yaw_rate) = belief.motion();
        let limit = &self.parameters.limit;
        belief.is_valid() && belief.tilt() <= 1.0 && speed.abs() <= limit.speed && yaw_rate.abs() <= limit.yaw_rate
    }

    /// Starts the filter anew where the encoders last put the chair.
    fn restart(&self, state: &mut State) {
        state.belief = match state.left_contour {
            true => ChairBelief::Gravity(contour::start(&self.parameters)),
            false => self.initial.clone(),
        };
        let pose = state.wheels.pose(&self.chair);
        if pose.is_none() {
            state.wheels = Wheels::default();
        }
        of_kind!(self, &mut state.belief, |filter, belief| filter.start_at(belief, pose));
        state.watch = Watch::default();
        state.rejections = [0; 6];
    }
}

/// The moment that hands hold.
impl ChairMachine {
    /// Yaw acceleration that a moment makes which just holds the chair against gravity, rad/s^2; none where the moment is a
    /// state, or the equations are the source's.
    fn held_acceleration(&self, belief: &ChairBelief) -> f64 {
        let across = match belief {
            _ if self.parameters.filter.model == Model::Paper => 0.0,
            ChairBelief::Basic(belief) => belief.mean[model::ALPHA].cos() * belief.mean[model::XI].sin(),
            ChairBelief::Biased(belief) => belief.mean[model::ALPHA].cos() * belief.mean[model::XI].sin(),
            ChairBelief::Gravity(_) => 0.0,
        };
        let body = &self.chair.body;
        body.mass * self.chair.gravity * body.com_ahead * across / self.chair.inertia_at_axle()
    }

    /// Force and moment that act, of those that are reported.
    fn acting(&self, state: &State, [force, moment]: [f64; 2]) -> Command {
        // What turns out to be flat has no moment to be held.
        let mut held = state.watch.held.taken();
        if held != 0.0 {
            held *= self.held_acceleration(&state.belief);
        }
        if held != 0.0 && !state.belief.heading_is_observable() {
            held = 0.0;
        }
        Command::new(force, moment + held * self.chair.inertia_at_axle())
    }

    /// Standard deviation of the slope from what is unknown of a moment held, rad: the leftward accelerometer feels
    /// `dx r'` and takes it for gravity, as far as it and not the force determines the slope.
    fn slope_std_of_held(&self, state: &State) -> f64 {
        let heading = match &state.belief {
            ChairBelief::Basic(belief) => belief.mean[model::ALPHA],
            ChairBelief::Biased(belief) => belief.mean[model::ALPHA],
            ChairBelief::Gravity(_) => return 0.0,
        };
        let (sin, cos) = heading.sin_cos();
        let noise = &self.basic.noise;
        // Densities of what leftward acceleration and force say of gravity, per that of the force.
        let left = noise.accel * noise.accel * self.parameters.sample_period / noise.speed;
        let weight = cos * cos + left * sin * sin;
        let felt = self.chair.lever()[0] * self.held_acceleration(&state.belief) * state.watch.held.unknown();
        if weight > 0.0 { (felt * cos / (self.chair.gravity * weight)).abs() } else { 0.0 }
    }
}

impl Machine for ChairMachine {
    const NAME: &'static str = "Wheelchair";
    const DESCRIPTION: &'static str = "Speed, heading, slope and pitch of a wheelchair with power assistance, \
        with sensor biases, by an extended Kalman filter";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<(Self, State), ParameterError> {
        parameters.check()?;
        let (chair, noise) = (parameters.chair(), parameters.noise());
        let (limits, gate) = (parameters.limits(), parameters.gate());
        let driven = parameters.filter.kind == Kind::AccelerationInput;
        let mover = if driven { Mover::TippingAcceleration } else { Mover::Force };
        let initial = ChairBelief::initial(parameters);
        let state = State {
            belief: initial.clone(),
            command: [0.0; 2],
            accel_x: None,
            rejections: [0; 6],
            watch: Watch::default(),
            left_contour: false,
            wheels: Wheels::default(),
            zeros: [0.0; 2],
            frame_turn: FrameTurn::default(),
            lateness: Lateness::default(),
            encoder_delay: EncoderDelay::default(),
            unchanged: Unchanged::default(),
            stopped: 0.0,
            rest: Rest::default(),
            standstill: Standstill::default(),
            may_be_braked: false,
            held_for: 0.0,
        };
        let bands = &parameters.standstill;
        let machine = Self {
            basic: ChairEkf { chair, noise, limits, gate, form: Basic },
            biased: ChairEkf { chair, noise, limits, gate, form: Biased { mover } },
            gravity: ChairEkf { chair, noise, limits, gate, form: GravityVector { mover } },
            bands: Bands {
                distance: bands.distance_band,
                heading: bands.heading_band,
                gyro: bands.gyro_band,
                accel: bands.accel_band,
            },
            calibration: match parameters.filter.kind {
                Kind::Basic => biases(&parameters.initial),
                Kind::Bias | Kind::AccelerationInput | Kind::GravityVector => [0.0; 4],
            },
            chair,
            initial,
            parameters: parameters.clone(),
        };
        Ok((machine, state))
    }

    fn rules(parameters: &Parameters) -> Rules {
        let limit = &parameters.limit;
        // a sensor at its limit is saturated
        let (accel, gyro) = (limit.accel.next_down(), limit.gyro.next_down());
        Rules {
            sample_period: parameters.sample_period,
            longest_gap: parameters.limits().longest_step,
            limits: vec![
                ("gyro_pitch", gyro),
                ("accel_x", accel),
                ("accel_y", accel),
                ("accel_z", accel),
                ("drive_force", limit.drive_force),
                ("drive_moment", limit.drive_moment),
            ],
            unused: Vec::new(),
        }
    }

    fn sample(&mut self, state: &mut State, inputs: &Inputs, screened: Status, elapsed: Elapsed) -> Outcome {
        let (mut status, dt) = (Status::OK, elapsed.seconds());
        let sample = self.read(state, inputs, dt, &mut status);
        let was_still = state.standstill.is_still();
        let still = self.parameters.filter.detect_standstill && self.is_still(state, &sample, dt);
        status.raise_if(still, Status::STANDSTILL);
        if was_still && !still {
            self.end_standstill(&mut state.belief);
            state.watch.brake.release();
        }
        self.predict(state, &sample, elapsed, still);
        self.let_brakes_hold(state, dt);
        let reported = !(screened.contains(Status::HELD_INPUT) || screened.contains(Status::NEVER_SET));
        self.doubt_held_force(state, !reported, dt);
        state.command = [inputs.drive_force, inputs.drive_moment];
        state.accel_x = Some(inputs.accel_x).filter(|a| a.is_finite());
        let gravity = self.held_acceleration(&state.belief);
        let turns = sample.values[HEADING].is_finite() && sample.single_wheel.is_none();
        let measurable = turns && gravity != 0.0 && state.belief.heading_is_observable();
        let (yaw_rate, variance) = (state.belief.motion().1, state.belief.yaw_rate_variance());
        let corrected = self.correct(state, &sample, dt, still);
        if let Elapsed::Step(dt) = elapsed
            && !still
        {
            let added = state.belief.motion().1 - yaw_rate;
            let learnt = variance - state.belief.yaw_rate_variance();
            if turns {
                state.watch.turn.follow(added, learnt, reported, dt);
            }
            let lowered = learnt.max(self.basic.noise.yaw_rate * dt);
            state.watch.follow_held(measurable.then_some((added, lowered)), gravity, dt);
        } else {
            state.watch.turn.interrupt();
        }
        self.settle_brake(state, dt);
        let restart = corrected.is_err() || !self.is_plausible(&state.belief);
        let outcome = corrected.unwrap_or_default();
        if restart {
            self.restart(state);
            status |= Status::RECOVERED | Status::RESTARTED;
        }
        self.doubt_contour(state, dt);
        let pitch_rate = sample.values[GYRO] - state.belief.gyro_bias();
        state.frame_turn.watch(pitch_rate, self.basic.noise.gyro, dt);
        state.lateness.follow([state.belief.tilt_rate(), state.belief.motion().0], dt);
        let rolled = state.wheels.rolled(&self.chair);
        state.encoder_delay.follow(rolled, inputs.accel_x, pitch_rate, self.chair.gravity, dt);
        let Inputs { encoder_left, encoder_right, gyro_pitch, accel_x, accel_y, accel_z, .. } = *inputs;
        state.unchanged.follow([encoder_left, encoder_right, gyro_pitch, accel_x, accel_y, accel_z], dt);
        status.raise_if(!state.belief.heading_is_observable(), Status::UNOBSERVABLE);
        Outcome { status: status | outcome.status, ..outcome }
    }

    fn estimates(&self, state: &State, inputs: &Inputs, horizon: f64, outputs: &mut Outputs) {
        self.report(state, inputs, horizon, outputs);
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

    fn belief(&self, state: &State) -> Result<Belief, &'static str> {
        Ok(one_step::of(&state.belief))
    }

    fn believe(&self, state: &mut State, belief: &Belief) {
        Self::put(state, belief);
    }

    fn usable(&self, _: &State, outputs: &Outputs) -> bool {
        let limit = &self.parameters.limit;
        outputs.slope.std <= limit.healthy_slope_std && outputs.speed.std <= limit.healthy_speed_std
    }

    fn check(&self, state: &State) -> Result<(), StateError> {
        let left = matches!(state.belief, ChairBelief::Gravity(_)) && state.left_contour;
        if !left && std::mem::discriminant(&state.belief) != std::mem::discriminant(&self.initial) {
            return Err(StateError("its filter.kind differs"));
        }
        if !state.belief.is_valid() {
            return Err(StateError("it holds a negative variance"));
        }
        let followed = state.lateness.is_valid()
            && state.encoder_delay.is_valid()
            && state.unchanged.is_valid()
            && state.watch.push.is_valid()
            && state.watch.turn.is_valid();
        if followed { Ok(()) } else { Err(StateError("its motion is not that of any chair")) }
    }
}
