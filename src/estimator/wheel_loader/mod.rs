//! Centre of gravity of a wheel loader from its axle torques and wheel speeds.
//!
//! The two axles of a loader with independent drives slip in proportion to torque over load. Speed
//! and wheel speeds therefore tell how the load is shared between the axles, and from that where
//! the centre of gravity lies. The estimator joins the [load-transfer model](crate::model::wheel_loader)
//! with a [square-root unscented Kalman filter](crate::filter::srukf) or its linearised counterpart.
//!
//! # What can be known
//!
//! - `cg_ratio` and `slip_stiffness` need traction: torque at the wheels of a moving machine.
//! - `cg_height` needs *changing* acceleration. At constant torque only the combination
//!   `lambda - h (v' + g sin alpha)/(g l cos alpha)` is seen; `cg_height_std` then stays where it
//!   started and the estimate with it. The flag `cg_height_observable` says when data have spoken.
//! - `load_ratio` moves with acceleration, slope and spading; the source most probably plots it as
//!   "CG location". The geometric centre of gravity of a rigid loader does not move.
//! - A mismatch of the rolling radii looks like slip. See `filter.radii`.
//! - Tyres are not the model's: their radius and stiffness change with the load. In the ratio of the slips
//!   that cannot be told from the load share, and the error does not shrink with more data. The reported
//!   standard deviations contain it (`model_error`), the filter's own covariance does not.
//!
//! Source: Yang, Wang and Han, "A novel real-time center of gravity estimation method for wheel
//! loaders with front/rear-axle-independent electric driving" (2021); its errata stand beside the
//! equations in the model and the filter.

mod coordinates;
mod engine;
mod parameters;
mod report;
mod supervision;

pub use parameters::*;

use super::{Estimator, StateError};
use crate::filter::gaussian::FactoredGaussian;
use crate::model::wheel_loader::Drive;
use crate::{ParameterError, Status};
use engine::{Belief, Engine};
use serde::{Deserialize, Serialize};
use supervision::Supervision;

/// A gap longer than this makes the motion begin anew, s.
const LONGEST_GAP: f64 = 0.5;
/// Inputs beyond these are no measurements: torques and forces, slope, speed, wheel speeds.
const PLAUSIBLE: (f64, f64, f64, f64) = (1e8, 1.5, 200.0, 2e3);

/// Estimator of the wheel loader's centre of gravity.
#[derive(Clone, Debug)]
pub struct WheelLoader {
    parameters: Parameters,
    engine: Engine,
    state: State,
}

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    belief: Belief,
    /// A first sample has set the motion.
    started: bool,
    supervision: Supervision,
    /// The last drive that was valid, channel by channel.
    drive: Drive,
    nis: f64,
    log_likelihood: f64,
    status: Status,
}

impl State {
    /// The filter's belief `[v, w_f, w_r, theta_K, theta_h, theta_lambda, d_f, d_r]`: motion, unknowns
    /// in the filter's coordinates, relative errors of the rolling radii.
    pub fn belief(&self) -> &FactoredGaussian<8> {
        &self.belief
    }
}

impl Estimator for WheelLoader {
    const NAME: &'static str = "WheelLoader";
    const DESCRIPTION: &'static str =
        "Centre of gravity, slip stiffness and axle load share of a wheel loader from axle torques and wheel speeds";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<Self, ParameterError> {
        parameters.check()?;
        let engine = Engine::new(parameters);
        let state = State {
            belief: *engine.start(),
            started: false,
            supervision: Supervision::default(),
            drive: Drive::default(),
            nis: 0.0,
            log_likelihood: 0.0,
            status: Status::OK,
        };
        Ok(Self { parameters: parameters.clone(), engine, state })
    }

    fn sample_period(&self) -> f64 {
        self.parameters.sample_period
    }

    fn step(&mut self, inputs: &Inputs, dt: f64) -> Status {
        let gap = dt > LONGEST_GAP;
        if self.state.started && (!dt.is_finite() || dt <= 0.0) {
            self.state.status = self.state.status | Status::BAD_STEP | Status::SKIPPED;
            return self.state.status;
        }
        let mut status = Status::OK;
        let y = measurements(inputs, &mut status);
        let before = self.state.drive;
        let (drive, replaced) = self.drive(inputs, &mut status);
        let supervision = &mut self.state.supervision;
        supervision.stale = if replaced { supervision.stale.saturating_add(1) } else { 0 };
        let nothing = y.iter().all(|value| value.is_nan());
        supervision.lost = if nothing { supervision.lost.saturating_add(1) } else { 0 };
        status.raise_if(nothing, Status::NO_MEASUREMENT);
        self.state.drive = drive;

        if !self.state.started || gap {
            status.raise_if(self.state.started, Status::BAD_STEP | Status::RESTARTED);
            if !nothing {
                self.engine.begin(&mut self.state.belief, &y);
                self.state.started = true;
            }
            self.state.supervision.held = true;
            (self.state.nis, self.state.log_likelihood) = (0.0, 0.0);
            status |= Status::HOLD;
            self.state.status = status | self.report_status();
            return self.state.status;
        }

        let mean_drive = if self.parameters.filter.interpolate_inputs { mean(&before, &drive) } else { drive };
        status |= self.supervised_sample(&mean_drive, &y, dt);
        self.state.status = status | self.report_status();
        self.state.status
    }

    fn outputs(&self, inputs: &Inputs, ahead: f64, outputs: &mut Outputs) {
        self.report(inputs, ahead, outputs);
    }

    fn state(&self) -> &State {
        &self.state
    }

    fn restore(&mut self, state: &State) -> Result<(), StateError> {
        if !state.belief.is_valid() {
            return Err(StateError("the belief is not finite"));
        }
        if !self.engine.radii && state.belief.factor.fixed_rows::<2>(6).amax() > 0.0 {
            return Err(StateError("it estimates the radii and this estimator does not"));
        }
        self.state = state.clone();
        Ok(())
    }
}

impl WheelLoader {
    /// One sample under supervision, in this order: hold, floors, time update, gate, measurement
    /// update, caps.
    fn supervised_sample(&mut self, drive: &Drive, y: &[f64; 3], dt: f64) -> Status {
        let mut status = Status::OK;
        let supervise = self.parameters.filter.supervise;
        let mean = &self.state.belief.mean;
        let motion = [mean[0], mean[1], mean[2]];
        let machine = self.engine.corrected([mean[6], mean[7]]);
        let supervision = &mut self.state.supervision;
        if supervise {
            let reasons = supervision.decide(&self.parameters.hold, &machine, y, &motion, dt);
            status.raise_if(reasons.standstill, Status::STANDSTILL);
            status.raise_if(reasons.spin, Status::SLIP);
            if !reasons.standstill && !reasons.spin {
                // The radii as given: corrected ones have learnt from the same data.
                let (machine, limits) = (&self.engine.machine, &self.engine.slip_limits);
                let raised = supervision.evidence.take(machine, drive, y, limits, dt);
                if raised {
                    // What was learnt from contradictory data is forgotten.
                    self.forget();
                    status |= Status::RESTARTED;
                }
            }
            status.raise_if(self.state.supervision.held, Status::HOLD);
            status.raise_if(self.state.supervision.evidence.contradicts, Status::SLIP);
        } else {
            supervision.held = false;
        }

        let State { belief, supervision, nis, log_likelihood, .. } = &mut self.state;
        if let Some(outcome) = self.engine.sample(belief, drive, y, dt, supervision) {
            (*nis, *log_likelihood) = (outcome.nis, outcome.log_likelihood);
            status.raise_if(outcome.gated, Status::GATED);
            status.raise_if(outcome.reacquired, Status::RESTARTED);
        } else {
            status |= Status::RECOVERED | Status::SKIPPED;
        }
        status
    }

    /// Puts the unknowns back to where they started.
    fn forget(&mut self) {
        let (start, belief) = (self.engine.start(), &mut self.state.belief);
        for row in 3..engine::STATES {
            belief.mean[row] = start.mean[row];
            belief.factor.set_row(row, &start.factor.row(row));
        }
        self.state.supervision.held = true;
    }

    /// The drive of a sample, with what is missing taken from the last valid one.
    fn drive(&self, inputs: &Inputs, status: &mut Status) -> (Drive, bool) {
        let last = &self.state.drive;
        let mut replaced = false;
        let mut take = |value: f64, last: f64, limit: f64| {
            if value.abs() <= limit {
                return value;
            }
            replaced = true;
            status.raise_if(value.is_infinite(), Status::INFINITE);
            status.raise_if(value.is_finite(), Status::IMPLAUSIBLE);
            last
        };
        let (force, slope, ..) = PLAUSIBLE;
        let drive = Drive {
            torque: [take(inputs.torque_front, last.torque[0], force), take(inputs.torque_rear, last.torque[1], force)],
            brake: [
                take(inputs.brake_front, last.brake[0], force).abs(),
                take(inputs.brake_rear, last.brake[1], force).abs(),
            ],
            slope: take(inputs.slope, last.slope, slope),
            force_x: take(inputs.spading_force_x, last.force_x, force),
            force_z: take(inputs.spading_force_z, last.force_z, force),
        };
        status.raise_if(replaced, Status::HELD_INPUT);
        (drive, replaced)
    }
}

/// The measured channels; NaN where there is no usable sample.
fn measurements(inputs: &Inputs, status: &mut Status) -> [f64; 3] {
    let (.., speed, wheel_speed) = PLAUSIBLE;
    let mut take = |value: f64, limit: f64| {
        if value.abs() <= limit {
            return value;
        }
        status.raise_if(value.is_nan(), Status::MISSING);
        status.raise_if(value.is_infinite(), Status::INFINITE);
        status.raise_if(value.is_finite(), Status::IMPLAUSIBLE);
        f64::NAN
    };
    [take(inputs.speed, speed), take(inputs.wheel_speed_front, wheel_speed), take(inputs.wheel_speed_rear, wheel_speed)]
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
