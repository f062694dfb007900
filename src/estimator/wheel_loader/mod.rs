//! Centre of gravity of a wheel loader from its axle torques and wheel speeds.
//!
//! The two axles of a loader with independent drives slip in proportion to torque over load. Speed and wheel speeds
//! therefore show how the load is shared between the axles, and from that where the centre of gravity lies.
//!
//! # Model
//! Longitudinal motion and both axles' rotation with exact load transfer
//! ([`model::wheel_loader`](crate::model::wheel_loader)). States `[v, w_f, w_r]` and the unknowns `[K, h, lambda]`:
//! slip stiffness, height and ratio of the centre of gravity, kept in their range as logits; with `filter.radii =
//! estimated` also the relative errors of both rolling radii. Measured are `v`, `w_f`, `w_r`. The filter is a
//! square-root unscented Kalman filter ([`filter::srukf`](crate::filter::srukf)), or with `filter.kind = ekf` its
//! linearised counterpart.
//!
//! # What cannot be observed
//! - `cg_ratio` and `slip_stiffness` need traction: torque at the wheels of a moving machine.
//! - `cg_height` needs *changing* acceleration. At constant torque only the combination `lambda - h (v' + g sin
//!   alpha)/(g l cos alpha)` is observed; `cg_height_std` then stays where it started and the estimate with it.
//!   `cg_height_observable` says when the data have revealed it.
//! - `load_ratio` moves with acceleration, slope and spading; the source most probably plots it as "CG location". The
//!   geometric centre of gravity of a rigid loader does not move.
//! - A mismatch of the rolling radii looks like slip: 0.3 % spoil the centre of gravity. See `filter.radii`.
//! - So does a bend, in which the axles' paths differ in length: by 1 % at a steering angle of 8 degrees, where slip is as
//!   small. With `steering_angle` and `loader.steering` it is subtracted from the front wheels' speed. Without, it is detected
//!   (`bend`): the difference of the wheel speeds that no slip explains grows beyond its standard deviation; the estimates of
//!   the last one to two seconds are discarded, and the unknowns are held and not healthy until the paths agree again. A
//!   difference of more than 20 s means another machine (tyres, load), which is estimated from the start.
//! - Slip speed is torque times speed over stiffness. A speed over ground that comes late adds the acceleration times the
//!   delay, ten milliseconds as much as the slip itself; a slope that is none, because it is in degrees or has the
//!   other sign, adds a gravity that no speed follows. Both are estimated beside the filter and contradict
//!   (`slip_inconsistent`) where they are proved. Whether or not, the standard deviations contain what the delay may be,
//!   by `filter.measurement_std.speed_delay` and by the data: only a machine that changes its speed by metres per second
//!   tells a delay from a softer tyre. With a speed near 3 m/s a few milliseconds stay possible for the first minute, which are
//!   15 % of the slip stiffness and, of a height that was learnt, as much. What is learnt of the delay is remembered for five
//!   minutes: strong accelerating and braking shows the height after half a minute where no delay is possible, after two minutes
//!   otherwise. Set `speed_delay` to 0 where the speed is known to be sampled with the wheel speeds.
//! - A speed over ground of a wrong scale looks like slip, too: by `filter.measurement_std.speed_scale`, half a per cent, `slip_stiffness_std`
//!   contains it from the start, and where the data speak for more, all standard deviations contain what it makes of the estimates. A speed
//!   that repeats exactly while the wheels change theirs is an old one and no sample.
//! - Tyres whose radius and stiffness change with the load are not part of the model. In the ratio of the slips that
//!   cannot be distinguished from the load share, and the error does not shrink with more data. The reported standard
//!   deviations contain it (`model_error.*`), the filter's own covariance does not.
//!
//! # Noise and defaults
//! - `filter.measurement_std.speed` is 0.02 m/s and `wheel_speed` 0.035 rad/s per sample. On rough ground the slip
//!   innovations raise both, up to `filter.adaptation.limit` (10) times.
//! - `filter.process_psd.*`: 0.01 m2/s3 for the speed, 0.04 rad2/s3 for the wheels; the unknowns drift by 0.015 (slip
//!   stiffness), 0.003 (height) and 0.007 (ratio) logit units in one second.
//! - Before the first sample: `K` 19 +- 10, `h` 0.95 +- 0.16 m, `lambda` 0.45 +- 0.1 (`initial.*`).
//! - The defaults are a 4.7 t compact loader with 2.2 m wheelbase and 0.55 m wheels.
//!
//! # How to tune
//! 1. Calibrate the rolling radii while coasting, or set `initial.wheel_radius_std` to 0.003 and let the filter
//!    correct them.
//! 2. Set `initial.cg_ratio`, `initial.cg_height` and their `_std` to what is known of the machine with an empty and a
//!    full bucket.
//! 3. Set `filter.measurement_std.*` from the data sheets, `speed_delay` to 0 if the speed comes with the wheel speeds. Where the estimates jump on rough ground raise
//!    `filter.adaptation.memory`; where they are slow after the bucket was filled raise `filter.process_psd.cg_ratio`.
//! 4. `nis` above 1 on smooth ground means a wrong mass, rolling coefficient or radius (`identify fit wheel-loader`).
//!
//! ## Measured
//! The share of the front axle with default noise settings, after the first second; machines of other equations than the
//! filter's. Error: median / 95 % of all samples.
//!
//! | drive | error | within 2 std | healthy | healthy and beyond 3 std |
//! |---|---|---|---|---|
//! | average road, 10 s | 3.9 / 15.3 % | 1.00 | 0.32 | 0.000 |
//! | poor road, 10 s | 3.9 / 14.9 % | 1.00 | 0.24 | 0.000 |
//! | constant torque, 20 s | 6.9 / 20.2 % | 1.00 | 0.00 | 0.000 |
//! | accelerating and braking, 30 s | 1.6 / 5.0 % | 1.00 | 0.87 | 0.000 |
//! | rigid machine, both axles driven, 40 s | 1.6 / 5.0 % | 1.00 | 0.89 | 0.000 |
//! | rigid car driven in front, straight, 40 s | 4.5 / 6.0 % | 1.00 | 0.00 | 0.000 |
//! | the same with a bend of 4 to 25 degrees | 4.8 / 13.5 % | 1.00 | 0.00 | 0.000 |
//! | speed 10 ms late, 60 s | 4.9 / 6.3 % | 1.00 | 0.95 | 0.000 |
//! | speed 20 ms late, 60 s | given up after 8 to 48 s | 1.00 | 0.29 | 0.000 |
//! | speed 50 ms late, 60 s | given up after 8 s | 1.00 | 0.00 | 0.000 |
//! | slope in degrees, 60 s | given up after 1 to 5 s | 0.87 | 0.06 | 0.002 |
//!
//! The slip stiffness is healthy and beyond 3 standard deviations for at most 0.8 % of the samples of these drives, whichever the
//! machine and however late the speed, 0 to 100 ms (`tests/wheel_loader/speed_and_slope.rs`). A car that is driven in front only says little of its
//! share, and is not healthy with radii that may be 0.3 % off. There is no recording of a real machine with axle torques and
//! wheel speeds to hold this against.
//!
//! # Sources and errata
//! Yang, Wang and Han, *A Novel Real-Time Center of Gravity Estimation Method for Wheel Loaders with
//! Front/Rear-Axle-Independent Electric Driving* (2021): load transfer (6)-(14), equations of motion (15)-(19), filter
//! (20)-(28). Errata of (6)-(18) and Table 1 stand in the model, of (22)-(27) in the filter.

mod belief;
mod bend;
mod coordinates;
mod evidence;
mod filter;
mod noise;
mod one_step;
mod parameters;
mod prediction;
mod report;
mod speed_evidence;
mod supervision;
mod uncertainty;
mod variables;

pub use belief::Belief;
pub use parameters::*;
pub use variables::{Inputs, Outputs};

use super::one_step::{Belief as Smoothed, OneStepPrediction};
use super::repetition::Repetition;
use super::{Elapsed, Machine, Outcome, Rules, Sampled, StateError};
use crate::model::wheel_loader::{Drive, Motion, Steering};
use crate::{ParameterError, Status};
use belief::restore_unknowns;
use bend::{PathWatch, Paths, Seen, SteeringAngle};
use evidence::{SlipEvidence, SlipLimits};
use filter::{Channels, LoaderFilter};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use speed_evidence::{SlipSpeed, SpeedEvidence};
use supervision::{Mode, Supervision};
use uncertainty::Uncertainty;

/// A gap longer than this makes the motion begin anew, s.
const LONGEST_GAP: f64 = 0.5;

/// Standard deviations by which the wheels must have changed their speed since a speed over ground that repeats.
const MOVED: f64 = 3.0;

/// Time between two beliefs that are kept, so that what was estimated in a bend before it was detected can be discarded, s.
const KEEP_TIME: f64 = 1.0;

/// The estimator; see the [module](self).
/// ```
/// use wheelstate::Estimator;
/// use wheelstate::estimator::wheel_loader::{Inputs, Outputs, Parameters, WheelLoader};
/// use wheelstate::plant::road::Road;
/// use wheelstate::plant::wheel_loader::{Action, Machine, Plant};
///
/// // a machine that is unlike the estimator's model in its tyres and suspension pulls for three seconds
/// let mut plant = Plant::new(Machine::default(), Road::flat(), 2.0);
/// let mut estimator = WheelLoader::new(&Parameters::default())?;
/// let mut inputs = Inputs::default();
/// for _ in 0..300 {
///     let [wheel_speed_front, wheel_speed_rear] = plant.wheel_speeds();
///     inputs = Inputs {
///         torque_front: 1500.0,
///         torque_rear: 1500.0,
///         brake_front: 0.0,
///         brake_rear: 0.0,
///         slope: 0.0,
///         spading_force_x: 0.0,
///         spading_force_z: 0.0,
///         speed: plant.speed(),
///         wheel_speed_front,
///         wheel_speed_rear,
///         ..Inputs::default()
///     };
///     estimator.step(&inputs, 0.01);
///     for _ in 0..10 {
///         plant.advance(&Action { torque: [1500.0; 2], ..Action::default() }, 1e-3);
///     }
/// }
/// let mut estimates = Outputs::default();
/// estimator.outputs(&inputs, 0.0, &mut estimates);
/// let [to_front, to_rear] = plant.machine.to_axle;
/// let ratio = to_rear / (to_front + to_rear);
/// assert!((estimates.cg_ratio.value - ratio).abs() < 3.0 * estimates.cg_ratio.std);
/// # Ok::<(), wheelstate::ParameterError>(())
/// ```
pub type WheelLoader = Sampled<LoaderMachine>;

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The filter's belief `[v, w_f, w_r, theta_K, theta_h, theta_lambda, d_f, d_r]`: motion, unknowns
    /// in the filter's coordinates, relative errors of the rolling radii.
    pub belief: Belief,
    channels: Channels,
    /// A sample has given the motion since the start or the last gap.
    motion_known: bool,
    /// The drive of the last sample.
    drive: Drive,
    supervision: Supervision,
    evidence: SlipEvidence,
    speed_evidence: SpeedEvidence,
    repetition: Repetition,
    steering: SteeringAngle,
    paths: PathWatch,
    kept: Kept,
}

/// The estimates at some earlier time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Learnt {
    belief: Belief,
    evidence: SlipEvidence,
    speed_evidence: SpeedEvidence,
}

/// The two last times.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Kept {
    older: Learnt,
    newer: Learnt,
    /// Time of learning since the newer one, s.
    age: f64,
}

impl Kept {
    fn new(learnt: Learnt) -> Self {
        Self { older: learnt, newer: learnt, age: 0.0 }
    }
}

impl State {
    fn motion(&self) -> Motion {
        Motion::new(self.belief.mean[0], self.belief.mean[1], self.belief.mean[2])
    }

    fn learnt(&self) -> Learnt {
        Learnt { belief: self.belief, evidence: self.evidence, speed_evidence: self.speed_evidence }
    }

    /// Keeps what is believed after `dt` more seconds of learning when it is time.
    fn keep(&mut self, dt: f64) {
        self.kept.age += dt;
        if self.kept.age >= KEEP_TIME {
            self.kept = Kept { older: self.kept.newer, newer: self.learnt(), age: 0.0 };
        }
    }

    /// Discards what was estimated in the last one to two [`KEEP_TIME`].
    fn take_back(&mut self) {
        let Learnt { belief, evidence, speed_evidence } = self.kept.older;
        restore_unknowns(&mut self.belief, &belief);
        (self.evidence, self.speed_evidence) = (evidence, speed_evidence);
        self.kept = Kept::new(self.kept.older);
        self.supervision.mode = Mode::Held;
    }
}

/// The loader's model and filter, under the rules of [`Sampled`].
#[derive(Clone, Debug)]
pub struct LoaderMachine {
    filter: LoaderFilter,
    hold: Hold,
    slip_limits: SlipLimits,
    slip_speed: SlipSpeed,
    uncertainty: Uncertainty,
    initial: Belief,
    steering_std: f64,
    supervise: bool,
    interpolate_inputs: bool,
    healthy_std: f64,
    speed_scale_std: f64,
}

impl Machine for LoaderMachine {
    const NAME: &'static str = "WheelLoader";
    const DESCRIPTION: &'static str =
        "Centre of gravity, slip stiffness and axle load share of a wheel loader from axle torques and wheel speeds";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<(Self, State), ParameterError> {
        parameters.check()?;
        let filter = LoaderFilter::new(parameters);
        let initial = belief::initial(parameters, &filter.map);
        let slip_speed = SlipSpeed::new(parameters, &filter.map);
        let speed_evidence = SpeedEvidence::new(&slip_speed);
        let state = State {
            belief: initial,
            channels: Channels::default(),
            motion_known: false,
            drive: Drive::default(),
            supervision: Supervision::default(),
            evidence: SlipEvidence::default(),
            speed_evidence,
            repetition: Repetition::default(),
            steering: SteeringAngle::default(),
            paths: PathWatch::default(),
            kept: Kept::new(Learnt { belief: initial, evidence: SlipEvidence::default(), speed_evidence }),
        };
        let machine = Self {
            slip_limits: SlipLimits::new(parameters, &filter.map, &initial),
            slip_speed,
            uncertainty: Uncertainty::new(parameters, &initial),
            filter,
            hold: parameters.hold.clone(),
            initial,
            steering_std: parameters.filter.measurement_std.steering_angle,
            supervise: parameters.filter.supervise,
            interpolate_inputs: parameters.filter.interpolate_inputs,
            healthy_std: parameters.healthy_std,
            speed_scale_std: parameters.filter.measurement_std.speed_scale,
        };
        Ok((machine, state))
    }

    fn rules(parameters: &Parameters) -> Rules {
        let unmeasured = parameters.loader.steering == Steering::None;
        Rules {
            sample_period: parameters.sample_period,
            longest_gap: LONGEST_GAP,
            limits: Vec::new(),
            unused: unmeasured.then(|| "steering_angle".to_owned()).into_iter().collect(),
        }
    }

    fn sample(&mut self, state: &mut State, inputs: &Inputs, screened: Status, elapsed: Elapsed) -> Outcome {
        let mut y = Vector3::new(inputs.speed, inputs.wheel_speed_front, inputs.wheel_speed_rear);
        let (loader, angle) = (&self.filter.map.machine.loader, inputs.steering_angle);
        let mut old = Status::OK;
        let [front, rear] = loader.wheel_radius();
        let rims = 0.5 * (front * y[1] + rear * y[2]);
        // The speed of a machine that stands repeats, whatever its wheels do.
        if state.repetition.is_old(y[0], rims, MOVED * self.slip_speed.std()) && y[0] != 0.0 {
            y[0] = f64::NAN;
            old = Status::MISSING;
        }
        let since = if let Elapsed::Step(dt) = elapsed { Some(dt) } else { None };
        let path_std = state.steering.straighten(loader, angle, self.steering_std, &mut y, since);
        let drive = drive(inputs);
        let before = std::mem::replace(&mut state.drive, drive);
        state.supervision.count(screened);
        let outcome = match elapsed {
            Elapsed::Step(dt) if state.motion_known => {
                let drive = if self.interpolate_inputs { mean(&before, &drive) } else { drive };
                self.step(state, &drive, &y, path_std, dt)
            }
            _ => self.begin(state, &y),
        };
        Outcome { status: outcome.status | old | self.conditions(state), ..outcome }
    }

    fn estimates(&self, state: &State, inputs: &Inputs, horizon: f64, outputs: &mut Outputs) {
        self.report(state, inputs, horizon, outputs);
    }

    fn predict_one_step(
        &self,
        state: &State,
        inputs: &Inputs,
        screened: Status,
        elapsed: Elapsed,
        into: &mut OneStepPrediction,
    ) {
        self.predict_one_step(state, inputs, screened, elapsed, into);
    }

    fn belief(&self, state: &State) -> Result<Smoothed, &'static str> {
        Ok(self.states(state))
    }

    fn believe(&self, state: &mut State, belief: &Smoothed) {
        self.put(state, belief);
    }

    fn usable(&self, state: &State, outputs: &Outputs) -> bool {
        !self.contradicted(state)
            && !state.paths.differs()
            && !state.supervision.is_stale(&self.hold)
            && outputs.cg_ratio.std <= self.healthy_std
    }

    fn check(&self, state: &State) -> Result<(), StateError> {
        if !self.filter.radii && state.belief.factor.fixed_rows::<2>(6).amax() > 0.0 {
            return Err(StateError("it estimates the radii and this estimator does not"));
        }
        if !state.repetition.is_valid() {
            return Err(StateError("its speed is not that of any machine"));
        }
        Ok(())
    }
}

impl LoaderMachine {
    /// Begins the motion at a sample, if this says anything about it.
    fn begin(&self, state: &mut State, y: &Vector3<f64>) -> Outcome {
        self.filter.begin(&mut state.belief, &mut state.channels, y);
        state.supervision.reset();
        state.speed_evidence.interrupt();
        state.motion_known = y.iter().any(|value| value.is_finite());
        Outcome { used: state.motion_known, ..Outcome::default() }
    }

    /// One sample under supervision: hold, time update, gate, measurement update, limits.
    fn step(&self, state: &mut State, drive: &Drive, y: &Vector3<f64>, path_std: f64, dt: f64) -> Outcome {
        let mut status = if self.supervise {
            self.supervise(state, drive, y, path_std, dt)
        } else {
            state.supervision.mode = Mode::Active;
            Status::OK
        };
        let State { belief, channels, supervision, .. } = state;
        let Some(innovation) = self.filter.sample(belief, channels, supervision.mode, drive, (y, path_std), dt) else {
            status |= Status::RECOVERED | Status::SKIPPED;
            return Outcome { status, ..Outcome::default() };
        };
        status.raise_if(innovation.any_rejected(), Status::GATED);
        status.raise_if(channels.any_let_through(&innovation), Status::RESTARTED);
        if state.supervision.mode == Mode::Active {
            state.keep(dt);
        }
        Outcome {
            status,
            nis: innovation.nis,
            channels: innovation.dof,
            log_likelihood: innovation.log_likelihood,
            used: innovation.used_count() > 0,
            // The motion walks at random, which a wheel that spins or grips again does not, nor a tyre right after that.
            unmodelled: state.supervision.mode == Mode::Held || state.supervision.is_settling(&self.hold),
        }
    }

    /// Decides whether the unknowns are held, and whether their estimates can be true.
    fn supervise(&self, state: &mut State, drive: &Drive, y: &Vector3<f64>, path_std: f64, dt: f64) -> Status {
        let mut status = Status::OK;
        let (motion, map) = (state.motion(), &self.filter.map);
        let machine = map.corrected(&state.belief.mean);
        let contradicted = self.contradicted(state);
        let barred = contradicted || state.paths.differs();
        let reasons = state.supervision.decide(&self.hold, &machine, y, &motion, barred, dt);
        status.raise_if(reasons.standstill, Status::STANDSTILL);
        status.raise_if(reasons.spin, Status::SLIP);
        if reasons.standstill || reasons.spin {
            state.speed_evidence.interrupt();
        }
        if reasons.standstill {
            return status;
        }
        let mut late = false;
        if !reasons.spin {
            let v = if y[0].is_finite() { y[0] } else { motion[0] };
            let unknowns = map.unknowns_of(&state.belief.mean);
            let (radius, steady) = (machine.loader.wheel_radius(), machine.steady_slip(v, &unknowns, drive));
            let wheel_std = self.filter.noise.wheel_std(path_std);
            let seen = Seen { map, belief: &state.belief, unknowns: &unknowns, radius, steady: &steady, wheel_std };
            match state.paths.update(&seen, y, v, dt) {
                Paths::Same => {}
                Paths::Part => {
                    state.take_back();
                }
                Paths::StayApart => status |= self.begin_anew(state),
            }
            // An old speed is a late one, which shows in many together.
            let given = Vector3::new(state.repetition.old_reading().unwrap_or(y[0]), y[1], y[2]);
            late = !state.paths.differs()
                && state.speed_evidence.update(&self.slip_speed, (radius, &steady, drive), &given, dt);
        }
        // By the radii as given: corrected ones come from the same data.
        let slipless = !state.paths.is_bend() && state.evidence.update(&map.machine, drive, y, &self.slip_limits, dt);
        if slipless || late {
            // Estimates from contradictory data are worthless.
            self.forget(state);
            status |= Status::RESTARTED;
        }
        if contradicted && !self.contradicted(state) {
            // What agrees again is other data than what did not.
            state.speed_evidence = SpeedEvidence::new(&self.slip_speed);
        }
        status
    }

    /// Whether slip, torque, speed and slope contradict each other.
    pub(super) fn contradicted(&self, state: &State) -> bool {
        state.evidence.contradicts() || state.speed_evidence.contradicts()
    }

    /// Resets the estimates.
    fn forget(&self, state: &mut State) {
        restore_unknowns(&mut state.belief, &self.initial);
        state.supervision.mode = Mode::Held;
        state.kept = Kept::new(state.learnt());
    }

    /// Paths that differ for good are those of another machine: tyres, pressure, load. The estimates are reset, and
    /// the radii, where they are estimated, may be as wrong as the paths showed.
    fn begin_anew(&self, state: &mut State) -> Status {
        if !self.filter.radii {
            return Status::OK;
        }
        self.forget(state);
        for i in 6..8 {
            let factor = &mut state.belief.factor[(i, i)];
            *factor = factor.max(state.paths.difference());
        }
        state.paths.reset();
        Status::RESTARTED
    }
}

/// What drives the model.
fn drive(inputs: &Inputs) -> Drive {
    Drive {
        torque: [inputs.torque_front, inputs.torque_rear],
        brake: [inputs.brake_front.abs(), inputs.brake_rear.abs()],
        slope: inputs.slope,
        force_x: inputs.spading_force_x,
        force_z: inputs.spading_force_z,
    }
}

fn mean(a: &Drive, b: &Drive) -> Drive {
    let pair = |a: [f64; 2], b: [f64; 2]| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    Drive {
        torque: pair(a.torque, b.torque),
        brake: pair(a.brake, b.brake),
        slope: 0.5 * (a.slope + b.slope),
        force_x: 0.5 * (a.force_x + b.force_x),
        force_z: 0.5 * (a.force_z + b.force_z),
    }
}
