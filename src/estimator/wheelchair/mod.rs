//! Wheelchair with power assistance: speed, heading, slope and pitch, with sensor biases.
//!
//! Model: [`model::wheelchair`](crate::model::wheelchair) (Oh and Hori, corrected). Filter: the extended
//! Kalman filter of eq. (28)-(40) with Joseph update, in one of four kinds:
//!
//! | kind | states | for |
//! |---|---|---|
//! | `basic` | 6 | calibrated sensors and forces; misses slopes and is overconfident with others |
//! | `bias` (default) | 13 | unknown biases of gyro and accelerometer, force and mass not quite right |
//! | `acceleration_input` | 11 | force not or badly known: the measured acceleration drives the motion |
//! | `gravity_vector` | 14 | as `bias`, the direction of the contour line unknown at the start |
//!
//! Impacts on a kerb or a ramp's edge, which none of these models has, are weighed down (`filter.impact`).
//!
//! # What cannot be observed
//! On flat ground nothing tells the heading against the contour line: it rests on the initial heading
//! and the encoders, and `status` says `unobservable`. A slope that contradicts the heading raises
//! `contradicted` and clears `healthy`. Even on a slope a wrong initial heading is
//! corrected only by `gravity_vector`; the other kinds take the encoders' heading as true. At rest
//! slope and accelerometer bias cannot be told apart (0.05 m/s^2 look like 5 mrad). A slope that
//! appears as a step, without rotation that the gyro could see, is found late or not at all. A constant
//! force that nobody reports and the bias of the accelerometer ahead look like slope too, until the drive
//! force changes; `bias` and `gravity_vector` carry the force's errors as states, `basic` takes force and mass as true.

mod forms;
mod impacts;
pub mod observer;
mod parameters;
mod report;
mod standstill;
mod variables;
mod wheels;

pub use forms::{Basic, Biased, GravityVector, Mover};
pub use parameters::{
    ChairParameters, EncoderParameters, FilterParameters, ImuParameters, InitialParameters, Kind, LimitParameters,
    MeasurementParameters, Model, Parameters, ProcessParameters, RollingParameters, StandstillParameters, Zero,
};
pub use variables::{Inputs, Outputs};

use crate::estimator::{Estimator, StateError};
use crate::filter::belief::Belief;
use crate::filter::consistency::Strain;
use crate::filter::ekf::NotPositiveDefinite;
use crate::model::wheelchair::{self as model, Chair, Command, biased_gravity, gravity};
use crate::{ParameterError, Status};
use nalgebra::SVector;
use observer::{Drive, Observer, Sample, Update};
use serde::{Deserialize, Serialize};
use standstill::{Bands, Signs, Standstill};
use std::f64::consts::FRAC_PI_2;
use wheels::Wheels;

/// One sample's normalised innovation squared per row counts as at most this against the filter.
const LARGEST_NIS: f64 = 16.0;

/// What the filter believes, in the form of its kind.
#[expect(clippy::large_enum_variant, reason = "there is one per estimator, and copying it must not allocate")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ChairBelief {
    /// `basic`
    Basic(Belief<6>),
    /// `bias` and `acceleration_input`
    Biased(Belief<13>),
    /// `gravity_vector`
    Gravity(Belief<14>),
}

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Mean and covariance.
    pub belief: ChairBelief,
    started: bool,
    /// Last valid command.
    command: [f64; 2],
    /// Specific force ahead at the last sample, if it had one.
    accel_x: Option<f64>,
    rejections: [u32; 6],
    wheels: Wheels,
    standstill: Standstill,
    /// Time since anything was measured, s.
    silent: f64,
    status: Status,
    /// Normalised innovation squared of the last sample and its number of rows.
    nis: f64,
    dof: u32,
    log_likelihood: f64,
    strain: Strain,
}

/// The estimator; see the [module](self).
#[derive(Clone, Debug)]
pub struct Wheelchair {
    parameters: Parameters,
    chair: Chair,
    basic: Observer<Basic>,
    biased: Observer<Biased>,
    gravity: Observer<GravityVector>,
    bands: Bands,
    /// Known biases of gyro and accelerometer, where they are no states.
    calibration: [f64; 4],
    initial: ChairBelief,
    state: State,
}

/// Known biases of gyro and accelerometer.
fn biases(initial: &InitialParameters) -> [f64; 4] {
    [initial.gyro_bias, initial.accel_x_bias, initial.accel_y_bias, initial.accel_z_bias]
}

impl Wheelchair {
    /// The chair of the parameters.
    pub fn chair(&self) -> &Chair {
        &self.chair
    }

    fn initial_belief(parameters: &Parameters) -> ChairBelief {
        let p = &parameters.initial;
        let squares = |std: [f64; 6]| SVector::<f64, 6>::from(std).map(|s| s * s);
        let chair = model::State::new(0.0, p.heading, p.speed, 0.0, p.slope, 0.0);
        let variances =
            squares([p.distance_std, p.heading_std, p.speed_std, p.yaw_rate_std, p.slope_std, p.slope_rate_std]);
        let kind = parameters.filter.kind;
        match kind {
            Kind::Basic => ChairBelief::Basic(Belief::new(chair, &variances)),
            Kind::Bias | Kind::AccelerationInput => {
                let (mut mean, mut all) = (model::BiasedState::zeros(), model::BiasedState::zeros());
                mean.fixed_rows_mut::<6>(0).copy_from(&chair);
                all.fixed_rows_mut::<6>(0).copy_from(&variances);
                mean.fixed_rows_mut::<4>(model::GYRO_BIAS).copy_from(&SVector::from(biases(p)));
                let accel = p.accel_bias_std;
                let bias = [p.gyro_bias_std, accel, accel, accel, p.heading_offset_std];
                all.fixed_rows_mut::<5>(model::GYRO_BIAS).copy_from(&SVector::from(bias).map(|s| s * s));
                // without the force as input its errors have no part: known to be zero
                if kind == Kind::Bias {
                    all[model::FORCE_GAIN] = p.force_gain_std * p.force_gain_std;
                    all[model::FORCE_OFFSET] = p.force_offset_std * p.force_offset_std;
                }
                ChairBelief::Biased(Belief::new(mean, &all))
            }
            Kind::GravityVector => {
                let ((sa, ca), tilt) = (p.heading.sin_cos(), p.slope.sin());
                let chair = gravity::State::from([0.0, p.heading, p.speed, 0.0, tilt * sa, tilt * ca, 0.0, 0.0]);
                let [s, alpha, v, r, xi, w]: [f64; 6] = variances.into();
                let (mut mean, mut all) = (biased_gravity::State::zeros(), biased_gravity::State::zeros());
                mean.fixed_rows_mut::<8>(0).copy_from(&chair);
                mean.fixed_rows_mut::<4>(biased_gravity::GYRO_BIAS).copy_from(&SVector::from(biases(p)));
                all.fixed_rows_mut::<8>(0).copy_from(&gravity::State::from([s, alpha, v, r, xi, xi, w, w]));
                let accel = p.accel_bias_std;
                let errors = [p.gyro_bias_std, accel, accel, accel, p.force_gain_std, p.force_offset_std];
                all.fixed_rows_mut::<6>(biased_gravity::GYRO_BIAS).copy_from(&SVector::from(errors).map(|s| s * s));
                ChairBelief::Gravity(Belief::new(mean, &all))
            }
        }
    }

    fn predict(&mut self, dt: f64, drive: &Drive) -> Status {
        let done = match &mut self.state.belief {
            ChairBelief::Basic(filter) => self.basic.predict(filter, dt, drive),
            ChairBelief::Biased(filter) => self.biased.predict(filter, dt, drive),
            ChairBelief::Gravity(filter) => self.gravity.predict(filter, dt, drive),
        };
        if done.is_err() { Status::BAD_STEP } else { Status::OK }
    }

    fn update(&mut self, sample: &Sample, drive: &Drive) -> Result<Update, NotPositiveDefinite> {
        let counters = &mut self.state.rejections;
        match &mut self.state.belief {
            ChairBelief::Basic(filter) => self.basic.update(filter, counters, sample, drive),
            ChairBelief::Biased(filter) => self.biased.update(filter, counters, sample, drive),
            ChairBelief::Gravity(filter) => self.gravity.update(filter, counters, sample, drive),
        }
    }

    /// Ends a standstill. Within the bands the chair may have reached these rates.
    fn release(&mut self) {
        let within = 0.05; // s, the shortest time in which a chair crosses a band from rest
        let (v, r) = (self.bands.distance / within, self.bands.heading / within);
        let w = self.bands.gyro;
        match &mut self.state.belief {
            ChairBelief::Basic(filter) => self.basic.release(filter, [v, r, w]),
            ChairBelief::Biased(filter) => self.biased.release(filter, [v, r, w]),
            ChairBelief::Gravity(filter) => self.gravity.release(filter, [v, r, w, w]),
        }
    }

    /// Whether mean and variances are numbers that a chair can have; what a run of impossible samples has
    /// driven beyond that would not come back by itself.
    fn is_plausible(&self) -> bool {
        let (sound, tilt) = match &self.state.belief {
            ChairBelief::Basic(belief) => (belief.is_sound(), belief.mean[model::XI].abs() / FRAC_PI_2),
            ChairBelief::Biased(belief) => (belief.is_sound(), belief.mean[model::XI].abs() / FRAC_PI_2),
            ChairBelief::Gravity(belief) => {
                (belief.is_sound(), belief.mean[gravity::GX].hypot(belief.mean[gravity::GY]))
            }
        };
        let (speed, yaw_rate) = self.motion();
        let limit = &self.parameters.limit;
        sound && tilt <= 1.0 && speed.abs() <= limit.speed && yaw_rate.abs() <= limit.yaw_rate
    }

    /// Starts the filter anew where the encoders last put the chair.
    fn restart(&mut self) {
        self.state.belief = self.initial.clone();
        self.state.wheels = Wheels::default();
        self.state.rejections = [0; 6];
        self.state.strain = Strain::default();
    }

    /// The command that acts now: the inputs, or what was last valid.
    fn command(&mut self, inputs: &Inputs, status: &mut Status) -> Command {
        let limits = [self.parameters.limit.drive_force, self.parameters.limit.drive_moment];
        for (k, value) in [inputs.drive_force, inputs.drive_moment].into_iter().enumerate() {
            status.raise_if(value.is_infinite(), Status::INFINITE);
            status.raise_if(value.is_finite() && value.abs() > limits[k], Status::IMPLAUSIBLE);
            if value.is_finite() && value.abs() <= limits[k] {
                self.state.command[k] = value;
            } else {
                *status |= Status::HELD_INPUT;
            }
        }
        Command::from(self.state.command)
    }
}

impl Estimator for Wheelchair {
    const NAME: &'static str = "Wheelchair";
    const DESCRIPTION: &'static str = "Speed, heading, slope and pitch of a wheelchair with power assistance, \
        with sensor biases, by an extended Kalman filter";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<Self, ParameterError> {
        parameters.check()?;
        let (chair, noise) = (parameters.chair(), parameters.noise());
        let (limits, gate) = (parameters.limits(), parameters.gate());
        let driven = parameters.filter.kind == Kind::AccelerationInput;
        let mover = if driven { Mover::TippingAcceleration } else { Mover::Force };
        let initial = Self::initial_belief(parameters);
        let state = State {
            belief: initial.clone(),
            started: false,
            command: [0.0; 2],
            accel_x: None,
            rejections: [0; 6],
            wheels: Wheels::default(),
            standstill: Standstill::default(),
            silent: 0.0,
            status: Status::OK,
            nis: 0.0,
            dof: 0,
            log_likelihood: 0.0,
            strain: Strain::default(),
        };
        let bands = &parameters.standstill;
        Ok(Self {
            basic: Observer { chair, noise, limits, gate, form: Basic },
            biased: Observer { chair, noise, limits, gate, form: Biased { mover } },
            gravity: Observer { chair, noise, limits, gate, form: GravityVector },
            bands: Bands {
                time: bands.time,
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
            state,
            parameters: parameters.clone(),
        })
    }

    fn sample_period(&self) -> f64 {
        self.parameters.sample_period
    }

    fn step(&mut self, inputs: &Inputs, dt: f64) -> Status {
        if self.state.started && !(dt > 0.0 && dt <= self.basic.limits.longest_step) {
            return Status::BAD_STEP | Status::SKIPPED;
        }
        let dt = if self.state.started { dt } else { 0.0 };
        let mut status = Status::OK;
        let measured = [
            inputs.encoder_right,
            inputs.encoder_left,
            inputs.gyro_pitch,
            inputs.accel_x,
            inputs.accel_y,
            inputs.accel_z,
        ];
        status.raise_if(measured.iter().any(|value| value.is_nan()), Status::MISSING);
        status.raise_if(measured.iter().any(|value| value.is_infinite()), Status::INFINITE);
        let limit = &self.parameters.limit;
        let saturated = measured[2].is_finite() && measured[2].abs() >= limit.gyro
            || measured[3..].iter().any(|a| a.is_finite() && a.abs() >= limit.accel);
        status.raise_if(saturated, Status::IMPLAUSIBLE);

        let (speed, yaw_rate) = self.motion();
        let wheels = &mut self.state.wheels;
        let readings = wheels.read(
            &self.chair,
            [measured[0], measured[1]],
            (speed, yaw_rate),
            dt,
            limit.wheel_step,
            self.parameters.encoder.zero,
        );
        status.raise_if(readings.implausible, Status::IMPLAUSIBLE);
        status.raise_if(readings.restarted, Status::RESTARTED);
        let calibrated: [f64; 4] = std::array::from_fn(|k| measured[2 + k] - self.calibration[k]);
        let [gyro, accel @ ..] = calibrated;
        let sample = wheels::sample(&self.chair, readings.angles, gyro, accel);
        let was_still = self.state.standstill.is_still();
        let still = self.parameters.filter.detect_standstill && {
            let signs =
                Signs { distance: sample.values[0], heading: sample.values[1], gyro, accel: [accel[0], accel[1]] };
            self.state.standstill.update(&self.bands, &signs, dt)
        };
        status.raise_if(still, Status::STANDSTILL);
        if was_still && !still {
            self.release();
        }

        if self.state.started {
            let command = Command::from(self.state.command);
            status |= self.predict(dt, &Drive { command, accel_x: self.state.accel_x, still });
        }
        let command = self.command(inputs, &mut status);
        let drive = Drive { command, accel_x: None, still };
        self.state.started = true;
        self.state.accel_x = Some(measured[3]).filter(|a| a.is_finite() && a.abs() < self.parameters.limit.accel);
        match self.update(&sample, &drive) {
            Ok(update) => {
                status.raise_if(update.sensors.rejected.contains(&true), Status::GATED);
                let nothing = update.sensors.dof == 0;
                status.raise_if(nothing, Status::NO_MEASUREMENT);
                self.state.silent = if nothing { self.state.silent + dt } else { 0.0 };
                self.state.nis = if update.dof > 0 { update.nis.min(f64::MAX) } else { 0.0 };
                self.state.dof = update.dof as u32;
                self.state.log_likelihood = update.sensors.log_likelihood();
                if update.dof > 0 {
                    self.state.strain.take(self.state.nis / update.dof as f64, LARGEST_NIS, dt);
                }
            }
            Err(NotPositiveDefinite) => {
                self.restart();
                status |= Status::RECOVERED | Status::RESTARTED;
            }
        }
        if !self.is_plausible() {
            self.restart();
            status |= Status::RECOVERED | Status::RESTARTED;
        }
        status.raise_if(!self.heading_is_observable(), Status::UNOBSERVABLE);
        status.raise_if(self.state.strain.contradicts(), Status::CONTRADICTED);
        self.state.status = status;
        status
    }

    fn outputs(&self, inputs: &Inputs, ahead: f64, outputs: &mut Outputs) {
        self.report(inputs, ahead, outputs);
    }

    fn state(&self) -> &State {
        &self.state
    }

    fn restore(&mut self, state: &State) -> Result<(), StateError> {
        let sound = match (&state.belief, &self.initial) {
            (ChairBelief::Basic(filter), ChairBelief::Basic(_)) => filter.is_sound(),
            (ChairBelief::Biased(filter), ChairBelief::Biased(_)) => filter.is_sound(),
            (ChairBelief::Gravity(filter), ChairBelief::Gravity(_)) => filter.is_sound(),
            _ => return Err(StateError("its filter.kind differs")),
        };
        let numbers =
            state.command.iter().chain(&state.accel_x).chain([&state.silent, &state.nis, &state.log_likelihood]);
        if !sound
            || !state.wheels.is_sound()
            || !state.strain.is_sound()
            || !numbers.into_iter().all(|value| value.is_finite())
        {
            return Err(StateError("it holds values that are not finite or not positive definite"));
        }
        self.state.clone_from(state);
        Ok(())
    }
}
