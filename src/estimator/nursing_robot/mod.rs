//! Nursing robot that carries a seated person: load mass by least squares with adaptive forgetting,
//! sway of the body by an adaptive unscented Kalman filter (Yang, Shi, Qi, Deng). Also weighs road
//! vehicles: their load is what `robot.mass` leaves out, and `human.swaying_fraction = 0` switches the
//! sway filter off.
//!
//! # What is observable
//! The mass, while the machine accelerates. The sway about the rest posture, from the wheels alone. A
//! kept lean only with a tilt sensor: it needs no net force. A torque scale that is 1 % wrong or a
//! rolling coefficient that is 10 % wrong costs about 2 % of a person's mass; `load_mass_std` contains
//! that.
//!
//! # Frame
//! Origin: midpoint of the driven axle projected on the floor; x forward, y left, z up. See
//! [`crate::model::nursing_robot`] for angles, signs and errata of the source.

pub mod mass;
mod parameters;
mod readout;
pub mod sway;

pub use parameters::*;

use crate::estimator::{Estimator, StateError};
use crate::filter::bounded;
use crate::model::nursing_robot::CentreOfGravity;
use crate::variable::Variable;
use crate::{ParameterError, Status, Variables};
use mass::{MassEstimator, MassSample, MassState, MassStatus};
use serde::{Deserialize, Serialize};
use sway::{SwayEstimate, SwayEstimator, SwaySample, SwayState, SwayStatus};

impl Parameters {
    /// Longest step that the filters bridge, s; a rounding error longer than 1.5 sample periods is not
    /// taken for a gap.
    pub fn longest_step(&self) -> f64 {
        self.limit.step.max(1.5 * self.sample_period) * (1.0 + 1e-9)
    }

    /// Checks what single ranges cannot.
    fn check_together(&self) -> Result<(), ParameterError> {
        let (human, mass) = (&self.human, self.human.nominal_mass);
        let toppling = human.toppling_stiffness(mass);
        let refuse = |name: &str, reason: String| {
            let declared = Self::declare();
            let index = declared.iter().position(|v: &Variable| v.name == name).unwrap_or(0);
            Err(declared[index].refuse(self.to_vec()[index], reason))
        };
        if human.hip_inertia(mass) > 0.0 && human.stiffness_pitch <= toppling {
            let reason = format!(
                "does not hold the body upright: it must exceed {toppling:.1} N.m/rad, the moment of gravity per angle"
            );
            return refuse("human.stiffness_pitch", reason);
        }
        if self.mass.forgetting_fast > self.mass.forgetting_slow {
            return refuse("mass.forgetting_fast", "must not exceed mass.forgetting_slow".to_owned());
        }
        if self.mass.error_low >= self.mass.error_high {
            return refuse("mass.error_low", "must be below mass.error_high".to_owned());
        }
        if self.mass.covariance_low > self.mass.covariance_high {
            return refuse("mass.covariance_low", "must not exceed mass.covariance_high".to_owned());
        }
        if self.robot.mass + self.limit.load_mass_low <= 0.0 {
            return refuse("limit.load_mass_low", "leaves no mass: it must be above -robot.mass".to_owned());
        }
        Ok(())
    }
}

/// The estimator; see the module's page.
#[derive(Clone, Debug)]
pub struct NursingRobot {
    parameters: Parameters,
    mass: MassEstimator,
    sway: Option<SwayEstimator>,
    state: State,
}

/// Everything that the steps change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    started: bool,
    status: Status,
    speed: f64,
    mass: MassState,
    sway: Option<SwayState>,
}

/// Inputs with the implausible ones taken out.
struct Screened {
    drive_force: f64,
    air_drag: f64,
    speed: f64,
    yaw_rate: f64,
    tilt: f64,
    tilt_rate: f64,
    accel_x: f64,
}

/// Largest plausible tilt, rad; rates, rad/s; and specific force, m/s2.
const PLAUSIBLE: (f64, f64, f64) = (1.6, 50.0, 100.0);

impl NursingRobot {
    /// Takes out what cannot be a sample, and says so. A channel that is not used may be missing.
    fn screen(&self, inputs: &Inputs, status: &mut Status) -> Screened {
        let p = &self.parameters;
        let mut take = |value: f64, limit: f64, wanted: bool| {
            status.raise_if(value.is_infinite(), Status::INFINITE);
            status.raise_if(value.is_nan() && wanted, Status::MISSING);
            let implausible = value.is_finite() && value.abs() > limit;
            status.raise_if(implausible && wanted, Status::IMPLAUSIBLE);
            if value.is_finite() && !implausible { value } else { f64::NAN }
        };
        let left = take(inputs.torque_left, p.limit.torque, true);
        let right = take(inputs.torque_right, p.limit.torque, true);
        let speed = take(inputs.speed, p.limit.speed, true);
        let (tilt, rate, force) = PLAUSIBLE;
        // identification alone reads the roll
        take(inputs.roll, tilt, false);
        take(inputs.roll_rate, rate, false);
        Screened {
            drive_force: p.robot.drive_force(left, right),
            air_drag: p.aero.drag(speed),
            speed,
            yaw_rate: take(inputs.yaw_rate, rate, false),
            tilt: take(inputs.tilt, tilt, p.sway.use_tilt),
            tilt_rate: take(inputs.tilt_rate, rate, p.sway.use_tilt_rate),
            accel_x: take(inputs.accel_x, force, p.mass.use_accelerometer),
        }
    }

    /// Net force for the sway filter: air drag at the last known speed if it is not measured now.
    fn sway_force(&self, sample: &Screened) -> f64 {
        sample.drive_force - if sample.air_drag.is_nan() { 0.0 } else { sample.air_drag }
    }

    /// The mass to go on with, kg.
    fn load_mass(&self) -> f64 {
        self.state.mass.rls.estimate
    }

    /// The mass estimator and its state, for those who want every number of the recursion.
    pub fn mass_filter(&self) -> (&MassEstimator, &MassState) {
        (&self.mass, &self.state.mass)
    }

    /// The sway filter and its state, unless nothing sways.
    pub fn sway_filter(&self) -> Option<(&SwayEstimator, &SwayState)> {
        self.sway.as_ref().zip(self.state.sway.as_ref())
    }

    fn step_sway(&mut self, sample: &Screened, dt: f64, status: &mut Status) {
        let force = self.sway_force(sample);
        let mass = self.load_mass();
        let first = !self.state.started;
        let (Some(sway), Some(state)) = (&self.sway, &mut self.state.sway) else { return };
        if first && !sample.speed.is_nan() {
            sway.seed(state, sample.speed);
        }
        let channels = [sample.speed, sample.tilt, sample.tilt_rate];
        let sample = SwaySample { drive_force: force, yaw_rate: sample.yaw_rate, channels };
        let outcome = sway.step(state, &sample, mass, if first { 0.0 } else { dt });
        status.raise_if(force.is_nan(), Status::HELD_INPUT);
        status.raise_if(state.repaired, Status::RECOVERED);
        status.raise_if(state.monitor.contradicted(), Status::CONTRADICTED);
        *status |= match outcome {
            SwayStatus::Updated | SwayStatus::Off => Status::OK,
            // The screening has already said which kind of sample was missing.
            SwayStatus::Missing => Status::OK,
            SwayStatus::Held => Status::STANDSTILL,
            SwayStatus::Gated => Status::GATED,
            SwayStatus::BadStep => Status::BAD_STEP | Status::RESTARTED,
            SwayStatus::RolledBack => Status::RECOVERED,
            SwayStatus::Restarted => Status::RESTARTED,
            SwayStatus::Realigned => Status::GATED | Status::RESTARTED,
        };
    }

    /// Speed, pitch and the rest without a sway filter: the last measured speed and nothing that sways.
    fn rigid(&self) -> SwayEstimate {
        let std = self.parameters.sway.speed_std;
        SwayEstimate {
            state: [self.state.speed, self.parameters.human.rest_pitch, 0.0, 0.0],
            state_std: [std, 0.0, 0.0, 0.0],
            ..SwayEstimate::default()
        }
    }

    fn write_cog(&self, pitch: f64, pitch_std: f64, out: &mut Outputs) {
        let p = &self.parameters;
        let (mass, mass_std) = (out.load_mass, out.load_mass_std);
        let (person, by_pitch) = (p.human.cog(p.robot.seat_height, pitch), p.human.cog_derivative(pitch));
        let CentreOfGravity { x, z } = p.robot.common_cog(mass, person);
        let (share, per_mass) = p.robot.load_share(mass);
        (out.load_cog_x, out.load_cog_z, out.cog_x, out.cog_z) = (person.x, person.z, x, z);
        out.load_cog_x_std = (by_pitch.x * pitch_std).abs();
        // The height is stationary upright: the second-order term is kept there.
        out.load_cog_z_std = (by_pitch.z * pitch_std).hypot(by_pitch.x * pitch_std * pitch_std * 0.5f64.sqrt());
        out.cog_x_std = (share * out.load_cog_x_std).hypot(person.x * per_mass * mass_std);
        out.cog_z_std = (share * out.load_cog_z_std).hypot((person.z - p.robot.cog_height) * per_mass * mass_std);
    }
}

impl Estimator for NursingRobot {
    const NAME: &'static str = "NursingRobot";
    const DESCRIPTION: &'static str =
        "Mass of a seated person or load and sway of the body, from wheel torques and speed";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<Self, ParameterError> {
        parameters.validate()?;
        parameters.check_together()?;
        let mass = MassEstimator::new(parameters);
        let sway = SwayEstimator::new(parameters);
        let state = State {
            started: false,
            status: Status::OK,
            speed: 0.0,
            mass: mass.start(),
            sway: sway.as_ref().map(SwayEstimator::start),
        };
        Ok(Self { parameters: parameters.clone(), mass, sway, state })
    }

    fn sample_period(&self) -> f64 {
        self.parameters.sample_period
    }

    fn step(&mut self, inputs: &Inputs, dt: f64) -> Status {
        if !(dt > 0.0 && dt.is_finite()) {
            self.state.status = Status::BAD_STEP;
            return Status::BAD_STEP;
        }
        let mut status = Status::OK;
        let sample = self.screen(inputs, &mut status);
        if !sample.speed.is_nan() {
            self.state.speed = sample.speed;
        }
        status.raise_if(self.state.started && dt > self.parameters.longest_step(), Status::BAD_STEP);
        let measured =
            MassSample { drive_force: sample.drive_force, speed: sample.speed, specific_force: sample.accel_x };
        let nominal = self.parameters.sample_period;
        let mass_dt = if self.state.started { dt } else { nominal };
        match self.mass.step(&mut self.state.mass, &measured, mass_dt) {
            MassStatus::Updated | MassStatus::Pooling | MassStatus::Bad => {}
            MassStatus::NotMoving | MassStatus::NotExcited | MassStatus::Blocked => status |= Status::HOLD,
            MassStatus::Rejected => status |= Status::SLIP | Status::GATED,
        }
        self.step_sway(&sample, dt, &mut status);
        status.raise_if(!self.state.mass.rls.valid, Status::UNOBSERVABLE);
        status.raise_if(self.state.mass.implausible(), Status::AT_BOUND);
        self.state.started = true;
        self.state.status = status;
        status
    }

    fn outputs(&self, inputs: &Inputs, ahead: f64, out: &mut Outputs) {
        let mass = &self.state.mass;
        out.load_mass = mass.rls.estimate;
        out.load_mass_std = self.mass.std(mass);
        out.mass_valid = mass.rls.valid;
        out.mass_implausible = mass.implausible();
        out.forgetting_factor = mass.rls.forgetting;
        out.mass_status = mass.status as i32;

        let estimate = match (&self.sway, &self.state.sway) {
            (Some(sway), Some(state)) => {
                out.sway_status = state.status as i32;
                out.nis = if state.channels > 0 { state.nis / f64::from(state.channels) } else { 0.0 };
                out.log_likelihood = state.log_likelihood;
                let mut ignored = Status::OK;
                let force = if ahead > 0.0 { self.sway_force(&self.screen(inputs, &mut ignored)) } else { f64::NAN };
                sway.estimate(state, force, ahead)
            }
            _ => {
                (out.sway_status, out.nis, out.log_likelihood) = (SwayStatus::Off as i32, 0.0, 0.0);
                self.rigid()
            }
        };
        [out.speed_estimate, out.body_pitch, out.body_pitch_rate, out.active_torque] = estimate.state;
        [out.speed_estimate_std, out.body_pitch_std, out.body_pitch_rate_std, out.active_torque_std] =
            estimate.state_std;
        (out.sway_force, out.sway_force_std) = (estimate.force, estimate.force_std);
        (out.hip_torque, out.hip_torque_std) = (estimate.torque, estimate.torque_std);
        self.write_cog(estimate.state[1], estimate.state_std[1], out);
        out.status = self.state.status;
        let starting = Status::RESTARTED.bits() | Status::RECOVERED.bits() | Status::BAD_STEP.bits();
        // a vehicle weighed by its accelerometer may have nobody on board who sways as declared
        let sway = self.state.sway.as_ref().filter(|_| !self.parameters.mass.use_accelerometer);
        let contradicted = sway.is_some_and(|sway| sway.monitor.contradicted());
        out.healthy =
            mass.rls.valid && !mass.implausible() && !contradicted && self.state.status.bits() & starting == 0;
    }

    fn state(&self) -> &State {
        &self.state
    }

    fn restore(&mut self, state: &State) -> Result<(), StateError> {
        let sway = match (&self.sway, &state.sway) {
            (Some(estimator), Some(sway)) => sway.is_sound(estimator),
            (None, None) => true,
            _ => false,
        };
        if !sway {
            return Err(StateError("its sway filter is of another model or not finite"));
        }
        if !(state.mass.is_sound() && bounded(state.speed)) {
            return Err(StateError("its mass filter is not finite"));
        }
        self.state = state.clone();
        Ok(())
    }
}
