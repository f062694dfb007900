//! Nursing robot that carries a seated person: load mass by least squares with adaptive forgetting, sway of the body
//! by an adaptive unscented Kalman filter. Also weighs road vehicles: their load is what `robot.mass` leaves out, and
//! `human.swaying_fraction = 0` switches the sway filter off.
//!
//! # Model
//! The robot moves along its path; the upper body of the person is a pendulum with spring and damper at the hip
//! ([`model::nursing_robot`](crate::model::nursing_robot)). The floor is level.
//! - The [mass filter](crate::estimator::nursing_robot::mass) is recursive least squares with one unknown
//!   ([`filter::rls`](crate::filter::rls)) over the longitudinal equation of motion. Force, speed and acceleration
//!   pass one low-pass filter (`mass.cutoff`); the force of the swaying body is computed and taken into the regressor.
//! - The [sway filter](crate::estimator::nursing_robot::sway) is an unscented Kalman filter
//!   ([`filter::ukf`](crate::filter::ukf)) with the states `[v, phi, phi', tau_a]` and the mass of the first one. Its
//!   noise [adapts](crate::filter::adaptation) to the innovations.
//!
//! Frame: origin at the midpoint of the driven axle, projected on the floor; x forward, y left, z up; pitch is
//! positive when the body leans forward.
//!
//! # What cannot be observed
//! The mass is seen only while the machine accelerates. The sway about the rest posture is seen from the wheels alone,
//! a kept lean only with a tilt sensor, since it needs no net force. A torque scale that is 1 % wrong or a rolling
//! coefficient that is 10 % wrong costs about 2 % of a person's mass; `load_mass_std` contains that.
//!
//! `sway_pitch` is the motion about the posture that the body keeps, with the standard deviation of what the wheels show.
//! `body_pitch_std` adds the posture's, `human.rest_pitch_std`, which `identify fit --only` brings from a log with tilt. A stop
//! lets another person sit down: until the load has been weighed again, status says `unobservable`, and the standard
//! deviations of mass and sway contain the change. If it is another one the sway filter begins anew (`restarted`).
//! Stiffness and damping of the hip differ by half from person to person (`human.stiffness_pitch_std`, `damping_pitch_std`; `identify
//! fit` brings both): as much of the motion that wheels alone show, and of the torques at the hip, is unknown. The posture is in
//! `hip_torque_std` and `active_torque_std` with a tilt sensor too, since the two are only seen together. A tilt sensor is as good
//! as its mounting (`sway.tilt_bias_std`, 0.01 rad; `tilt_rate_bias_std`), and may be late (`tilt_delay_std`, or as much as tilt and rate show beside one another). A force that nobody
//! expected, such as a cough, may come again: for some seconds three deviations of `sway_force` contain one of that size.
//! While driving, a load that changes shows when the robot accelerates; from then on `load_mass_std` contains the change that
//! the innovations speak for, until the estimate has followed.
//!
//! `contradicted` comes from the innovations of the sway filter: a mass, a rolling coefficient, a torque scale or a
//! unit is wrong, and the body leans only to explain it. Where that filter is off, forces that ask for a mass beyond
//! its bounds raise `at-bound` and `mass_implausible` instead.
//!
//! # Noise and defaults
//! - `sway.measurement_std.speed` is 5 mm/s, `tilt` 10 mrad, `tilt_rate` 10 mrad/s per sample; their variances adapt
//!   between `sway.noise_low` (0.25) and `sway.noise_high` (25) times that.
//! - `sway.process_psd.hip_torque` (1 N2 m2 s) drives speed and pitch together, as a cough does. With a tilt sensor
//!   the slow `active_torque` of the person is a state as well (`sway.model = sound_torque`).
//! - A constant error of `accel_x`, 0.05 m/s2 (`mass.accel_x_bias_std`), counts in `load_mass_std` where it is used.
//! - The mass forgets at 0.998 per sample while its prediction error is small and at 0.97 while it is large (`mass.law
//!   = exponential`). `load_mass_std` adds to the fit's own uncertainty 20 % of the rolling resistance, 1 % of the
//!   drive force and 30 % of the sway force (`mass.*_uncertainty`).
//! - The defaults are a 160 kg robot with a 70 kg person.
//!
//! # How to tune
//! 1. Identify `rolling.coefficient`, `human.stiffness_pitch`, `human.damping_pitch` and `human.rest_pitch` from 40 s
//!    of stop and go (`identify fit nursing-robot`).
//! 2. Mass too slow after a change of the load: lower `mass.forgetting_fast` or raise `mass.error_rate`. Mass too
//!    restless: lower `mass.cutoff`, or set `mass.error_persistence` to a sway period, about 1 s.
//! 3. Sway: set `sway.measurement_std.*` from the data sheets, then `sway.process_psd.hip_torque` until `nis` is near
//!    1 (`identify tune nursing-robot`).
//! 4. Road vehicles: `human.swaying_fraction = 0`, `mass.use_accelerometer = true`, `aero.drag_area`, and the limits
//!    `limit.torque`, `limit.speed` and `limit.load_mass` of the vehicle.
//!
//! ## Measured
//! Simulated patients with a plant of other coordinates, from wheels alone, after the first second, stiffness and damping known to 10
//! and 20 % as after a fit: median error of the sway, its median standard deviation, share within two of them
//! (`identify/tests/nursing_robot/accuracy.rs`).
//!
//! | drive | sway, error and std | within 2 std |
//! |---|---|---|
//! | smooth start | 1.2, 8.4 mrad | 1.00 |
//! | restless start | 3.5, 10.6 mrad | 0.94 |
//! | coughs | 1.8, 9.3 mrad | 0.96 |
//! | released from a lean | 1.1, 8.9 mrad | 1.00 |
//! | all parameters a little wrong | 4.6, 12.6 mrad | 0.91 |
//!
//! By default, nothing known of the person, no output of these and other drives is healthy and beyond three deviations in more than
//! 0.6 % of the samples (`tests/tables/honesty.py`); the load is in 1.1 % where 20 kg are taken off while driving.
//! What is taken off between two accelerations is unknown until the second one, for half a second here.
//!
//! Twelve trips of an electric car (`tests/nursing_robot/recordings.rs`), weighed with all settings but the car's constants at
//! their defaults, against a regression over the whole trip:
//!
//! | rolling coefficient | median error of the mass | within 2 std | healthy | healthy and beyond 3 std |
//! |---|---|---|---|---|
//! | fitted | 1.3 % | 0.99 | 0.99 | 0.001 |
//! | left at its default, twice a car's | 3.4 % | 0.94 | 0.91 | 0.000 |
//!
//! There is no recording of a robot that carries a person.
//!
//! # Sources and errata
//! Yang, Shi, Qi and Deng, *Research on Recognition and Estimation Algorithm for Real time Changes in the Center of
//! Gravity of Human Sitting Quality*: kinematics and Lagrange's equations (1)-(30), mass filter (31)-(37), sway filter
//! (38)-(54). Errata stand with the equations: those of (1)-(30) in the model, of (31)-(37) in the mass filter and the
//! recursion, of (38)-(54) in the sway filter.

mod centre_of_gravity;
pub mod mass;
mod parameters;
mod status;
pub mod sway;
mod variables;

pub use parameters::*;
pub use status::{MassStatus, SwayStatus};
pub use variables::{Inputs, Outputs};

use crate::estimator::lateness::Lateness;
use crate::estimator::one_step::{Belief, OneStepPrediction};
use crate::estimator::unchanged::Unchanged;
use crate::estimator::{Elapsed, Machine, Outcome, Rules, Sampled, StateError};
use crate::filter::innovation::Innovation;
use crate::variable::{Estimate, root_sum_square};
use crate::{ParameterError, Status};
use mass::{MassEstimator, MassSample, MassState};
use serde::{Deserialize, Serialize};
use sway::{SwayEstimate, SwayEstimator, SwaySample, SwayState};

/// The estimator; see the [module](self).
/// ```
/// use wheelstate::Estimator;
/// use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters};
///
/// let mut parameters = Parameters::default();
/// parameters.human.swaying_fraction = 0.0; // a load that does not sway
/// let mut estimator = NursingRobot::new(&parameters)?;
/// // 160 kg of robot and 50 kg of load accelerate with 0.5 m/s2 for four seconds
/// let (mass, acceleration, rolling) = (210.0, 0.5, 0.015 * 210.0 * 9.81);
/// let mut inputs = Inputs::default();
/// for k in 0..400 {
///     let speed = acceleration * 0.01 * f64::from(k);
///     let resistance = rolling * (speed / parameters.rolling.smoothing_speed).tanh();
///     let torque = 0.5 * parameters.robot.wheel_radius * (mass * acceleration + resistance);
///     inputs = Inputs { torque_left: torque, torque_right: torque, speed, ..Inputs::default() };
///     estimator.step(&inputs, 0.01);
/// }
/// let mut estimates = Outputs::default();
/// estimator.outputs(&inputs, 0.0, &mut estimates);
/// assert!((estimates.load_mass.value - 50.0).abs() < 2.0 * estimates.load_mass.std);
/// # Ok::<(), wheelstate::ParameterError>(())
/// ```
pub type NursingRobot = Sampled<NursingMachine>;

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The last measured speed and how far it may have changed since.
    speed: Estimate,
    /// Of the speed, where no sway filter follows it.
    speed_lateness: Lateness<1>,
    /// Of speed, tilt and tilt rate.
    unchanged: Unchanged<3>,
    /// The mass filter.
    pub mass: MassState,
    /// The load that was known last: after a stop it is another one until this has been weighed, kg.
    weighed: f64,
    /// The sway filter, unless it is off.
    pub sway: Option<SwayState>,
}

/// The robot's models and filters, under the rules of [`Sampled`].
#[derive(Clone, Debug)]
pub struct NursingMachine {
    parameters: Parameters,
    mass: MassEstimator,
    sway: Option<SwayEstimator>,
    /// What is known of the body while the sway filter is off.
    unobserved: SwayEstimate,
}

/// Share of its mass by which a person who has been weighed after a stop differs from the one before if it is another.
const OTHER_PERSON: f64 = 0.05;
/// What a body that moves does to a robot, m/s2 (one standard deviation): nobody knows it so long after the last speed, s.
const UNSEEN_ACCELERATION: f64 = 0.25;
const UNSEEN_TIME: f64 = 0.1;
/// How fast a speed may change that is not measured, m/s2.
const UNKNOWN_ACCELERATION: f64 = 5.0;

impl NursingMachine {
    /// The mass filter.
    pub fn mass(&self) -> &MassEstimator {
        &self.mass
    }

    /// The sway filter, unless it is off.
    pub fn sway(&self) -> Option<&SwayEstimator> {
        self.sway.as_ref()
    }

    /// Drive force without the air drag at the last measured speed, N; NaN without a torque.
    fn net_force(&self, state: &State, inputs: &Inputs) -> f64 {
        let drive = self.parameters.robot.drive_force(inputs.torque_left, inputs.torque_right);
        drive - self.parameters.aero.drag(state.speed.value)
    }

    /// Takes over a measured speed, or lets the last one age.
    fn watch_speed(&self, state: &mut State, speed: f64, seconds: f64) {
        state.speed = match speed.is_nan() {
            false => Estimate::new(speed, self.parameters.sway.measurement_std.speed),
            true => {
                let std = state.speed.std + UNKNOWN_ACCELERATION * seconds;
                Estimate::new(state.speed.value, std.min(self.parameters.limit.speed.max(state.speed.std)))
            }
        };
    }

    /// Standard deviation of the forces of a body that moves without a speed to show it, N.
    fn unseen_force(&self, state: &State, load: f64) -> f64 {
        let aged = state.speed.std - self.parameters.sway.measurement_std.speed;
        let unseen_for = (aged / UNKNOWN_ACCELERATION).max(0.0);
        let mass = self.parameters.robot.mass + load;
        mass * UNSEEN_ACCELERATION * (unseen_for / UNSEEN_TIME).min(1.0)
    }

    /// Passes a sample on to the sway filter. Returns its innovation and what must be said of it.
    fn follow_sway(&self, state: &mut State, sample: &SwaySample, elapsed: Elapsed) -> (Innovation<3>, Status) {
        let (Some(filter), Some(sway)) = (&self.sway, &mut state.sway) else {
            return (Innovation::none(), Status::OK);
        };
        let mut status = Status::OK;
        status.raise_if(sample.force.is_nan() && sway.has_force(), Status::HELD_INPUT);
        let mass = state.mass.rls.estimate;
        match elapsed {
            Elapsed::First => filter.restart(sway, sample, mass),
            Elapsed::Gap(_) => {
                filter.restart(sway, sample, mass);
                return (Innovation::none(), status);
            }
            Elapsed::Step(_) => {}
        }
        let done = filter.step(sway, sample, mass, elapsed.seconds());
        status.raise_if(done.repaired, Status::RECOVERED);
        status |= match done.status {
            // The screening has already said which kind of sample was missing.
            SwayStatus::Updated | SwayStatus::Missing | SwayStatus::Off => Status::OK,
            SwayStatus::Held => Status::STANDSTILL,
            SwayStatus::Gated => Status::GATED,
            SwayStatus::RolledBack => Status::RECOVERED,
            SwayStatus::Gap | SwayStatus::Restarted => Status::RESTARTED,
            SwayStatus::Realigned => Status::GATED | Status::RESTARTED,
        };
        (done.innovation, status)
    }
}

impl Machine for NursingMachine {
    const NAME: &'static str = "NursingRobot";
    const DESCRIPTION: &'static str =
        "Mass of a seated person or load and sway of the body, from wheel torques and speed";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<(Self, State), ParameterError> {
        parameters.check_together()?;
        let mass = MassEstimator::new(parameters);
        let sway = SwayEstimator::new(parameters);
        let state = State {
            speed: Estimate::new(0.0, parameters.initial.speed_std),
            speed_lateness: Lateness::default(),
            unchanged: Unchanged::default(),
            mass: mass.start(),
            weighed: parameters.human.nominal_mass,
            sway: sway.as_ref().map(SwayEstimator::start),
        };
        let unobserved = SwayEstimate::unobserved(parameters);
        Ok((Self { parameters: parameters.clone(), mass, sway, unobserved }, state))
    }

    fn rules(parameters: &Parameters) -> Rules {
        let limit = &parameters.limit;
        let [speed, tilt, tilt_rate] = parameters.sway_channels();
        let used = [
            ("yaw_rate", speed),
            ("tilt", tilt),
            ("tilt_rate", tilt_rate),
            // Identification alone reads the roll.
            ("roll", false),
            ("roll_rate", false),
            ("accel_x", parameters.mass.use_accelerometer),
        ];
        Rules {
            sample_period: parameters.sample_period,
            longest_gap: parameters.longest_step(),
            limits: vec![("torque_left", limit.torque), ("torque_right", limit.torque), ("speed", limit.speed)],
            unused: used.into_iter().filter(|(_, used)| !used).map(|(name, _)| name.to_owned()).collect(),
        }
    }

    fn sample(&mut self, state: &mut State, inputs: &Inputs, _: Status, elapsed: Elapsed) -> Outcome {
        self.watch_speed(state, inputs.speed, elapsed.seconds());
        state.unchanged.follow([inputs.speed, inputs.tilt, inputs.tilt_rate], elapsed.seconds());
        match elapsed {
            _ if self.sway.is_some() => {}
            Elapsed::First | Elapsed::Gap(_) => state.speed_lateness = Lateness::at([state.speed.value]),
            Elapsed::Step(dt) => state.speed_lateness.follow([state.speed.value], dt),
        }
        let force = self.net_force(state, inputs);
        let unknown = self.mass.is_from_before_a_stop(&state.mass);
        let measured = MassSample { force, speed: inputs.speed, specific_force: inputs.accel_x };
        match elapsed {
            Elapsed::First | Elapsed::Step(_) => {
                self.mass.step(&mut state.mass, &measured, elapsed.seconds());
            }
            Elapsed::Gap(_) => self.mass.bridge_gap(&mut state.mass, &measured),
        }
        let mut status = match state.mass.status {
            MassStatus::Updated | MassStatus::Pooling | MassStatus::Bad => Status::OK,
            MassStatus::NotMoving | MassStatus::NotExcited | MassStatus::Blocked => Status::HOLD,
            MassStatus::Rejected => Status::SLIP | Status::GATED,
        };
        let (load, still_unknown) = (state.mass.rls.estimate, self.mass.is_from_before_a_stop(&state.mass));
        status.raise_if(!state.mass.rls.valid || still_unknown, Status::UNOBSERVABLE);
        let other_person =
            unknown && !still_unknown && (load - state.weighed).abs() > OTHER_PERSON * state.weighed.abs();
        if !still_unknown {
            state.weighed = load;
        }
        status.raise_if(state.mass.implausible(), Status::AT_BOUND);
        let channels = [inputs.speed, inputs.tilt, inputs.tilt_rate];
        let sample = SwaySample { force, yaw_rate: inputs.yaw_rate, channels };
        if let (true, Some(filter), Some(sway)) = (other_person, &self.sway, &mut state.sway) {
            // The sway that was found explains the force of a mass that is not there.
            filter.restart(sway, &sample, load);
            status |= Status::RESTARTED;
        }
        let (innovation, of_sway) = self.follow_sway(state, &sample, elapsed);
        Outcome {
            status: status | of_sway,
            nis: innovation.nis,
            channels: innovation.dof,
            log_likelihood: innovation.log_likelihood,
            // A speed says at least whether the machine stands.
            used: !inputs.speed.is_nan() || innovation.used_count() > 0,
            ..Outcome::default()
        }
    }

    fn estimates(&self, state: &State, inputs: &Inputs, horizon: f64, out: &mut Outputs) {
        let mass = &state.mass;
        out.load_mass = Estimate::new(mass.rls.estimate, self.mass.std(mass));
        out.mass_valid = mass.rls.valid;
        out.mass_implausible = mass.implausible();
        out.forgetting_factor = mass.rls.forgetting;
        out.mass_status = mass.status;
        let sway = match (&self.sway, &state.sway) {
            (Some(filter), Some(sway)) => {
                out.sway_status = sway.status;
                // A wrong mass makes a force of the acceleration that the filter takes for one of the sway.
                let unexplained = if mass.rls.valid { out.load_mass.std * mass.regressor.abs() } else { 0.0 };
                let unseen = self.unseen_force(state, out.load_mass.value);
                let unexplained = root_sum_square([unexplained, unseen]);
                let mut estimate = filter.estimate_under(sway, self.net_force(state, inputs), horizon, unexplained);
                filter.widen_aged(sway, state.unchanged.seconds(), &mut estimate);
                estimate
            }
            _ => {
                out.sway_status = SwayStatus::Off;
                let [_, body @ ..] = self.unobserved.state;
                let mut speed = state.speed;
                let p = &self.parameters.sway;
                let delay = root_sum_square([p.speed_delay_std, state.unchanged.seconds()]);
                let late = state.speed_lateness.std(0, delay);
                speed.widen(root_sum_square([late, p.speed_scale_std * speed.value]));
                SwayEstimate { state: [speed, body[0], body[1], body[2]], ..self.unobserved }
            }
        };
        [out.speed_estimate, out.body_pitch, out.body_pitch_rate, out.active_torque] = sway.state;
        out.sway_pitch = sway.motion;
        (out.sway_force, out.hip_torque) = (sway.force, sway.torque);
        self.report_centre_of_gravity(out);
    }

    fn predict_one_step(
        &self,
        state: &State,
        inputs: &Inputs,
        _: Status,
        elapsed: Elapsed,
        into: &mut OneStepPrediction,
    ) {
        let mut after = state.clone();
        let dt = elapsed.seconds();
        self.watch_speed(&mut after, inputs.speed, dt);
        let force = self.net_force(&after, inputs);
        let measured = MassSample { force, speed: inputs.speed, specific_force: inputs.accel_x };
        match (&self.sway, &state.sway, elapsed) {
            (Some(filter), Some(sway), Elapsed::Step(_)) => {
                self.mass.step(&mut after.mass, &measured, dt);
                let channels = [inputs.speed, inputs.tilt, inputs.tilt_rate];
                let sample = SwaySample { force, yaw_rate: inputs.yaw_rate, channels };
                filter.predict_one_step(sway, &sample, after.mass.rls.estimate, dt, into);
            }
            // The filter begins at this sample, or is off.
            _ => into.nothing_expected(&SwayEstimator::CHANNELS),
        }
    }

    fn belief(&self, state: &State) -> Result<Belief, &'static str> {
        let off = "its sway filter is off, and its mass is no state but a regression over all samples so far";
        state.sway.as_ref().map(SwayState::belief).ok_or(off)
    }

    fn believe(&self, state: &mut State, belief: &Belief) {
        if let Some(sway) = &mut state.sway {
            sway.put(belief);
        }
    }

    fn usable(&self, state: &State, _: &Outputs) -> bool {
        state.mass.rls.valid && !state.mass.implausible()
    }

    fn check(&self, state: &State) -> Result<(), StateError> {
        let sway = match (&self.sway, &state.sway) {
            (Some(filter), Some(sway)) => sway.fits(filter),
            (None, None) => true,
            _ => false,
        };
        if !sway {
            return Err(StateError("its sway filter is of another model or invalid"));
        }
        if state.mass.rls.is_valid() && state.speed_lateness.is_valid() && state.unchanged.is_valid() {
            Ok(())
        } else {
            Err(StateError("its mass filter is invalid"))
        }
    }
}
