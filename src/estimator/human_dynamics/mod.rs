//! Joint torques, seat wrench and centre of mass of a seated person, with variances.
//!
//! # Model
//! The equations of motion of a body of 12 segments and 19 joints ([`model::multibody`](crate::model::multibody), its
//! [rows](crate::model::multibody::equations)) and whatever sensors there are make one linear least squares problem
//! per sample. Its solution ([`filter::map`](crate::filter::map)) is the maximum a posteriori estimate of all
//! accelerations, wrenches and torques, with the variance of each. No estimate is carried from sample to sample. The
//! segments' masses and inertias follow from `body.height` and `body.mass`. [`HumanDynamics`] is the seated body with
//! a fixed list of sensors; [`WholeBody`] takes any tree and any sensors.
//!
//! The standard deviations of torques and seat wrench also contain what these have changed of late in the time since the sample (a host
//! reads an FMU at the end of its step, where an estimate is still that of the sample) and in the time by which sensors may come apart
//! (`delay_std`), and their white noise where it is clearly more than the sensors are said to have.
//!
//! Frames of pelvis, thorax, head and arms: x forward, y left, z up when sitting upright with the arms hanging; thighs
//! as the pelvis, with the thigh along x; shanks with z up and the foot forward. All joint coordinates are zero in
//! this posture. A segment's origin is the joint towards the pelvis; the pelvis's origin is midway between the hips.
//!
//! Coupling to a vehicle: `-seat_wrench` at the pelvis's origin is the load on the vehicle; it holds the person's
//! weight and inertia. `body_mass` and `com` serve estimators that model the person as a carried mass instead: one or
//! the other, never both.
//!
//! # What cannot be observed
//! Without hand and foot sensors the wrenches there are known only by their prior, and what they carry through legs
//! and arms blurs torques and seat wrench: the standard deviations show it. Noise of the joint positions is not part
//! of the model, nor are errors of the segments' lengths.
//!
//! Masses, centres of mass and inertias come from a table from which every person differs, and the seat's axes are known to some
//! milliradians. These errors are not estimated, but the standard deviations of torques and seat wrench contain what they make of
//! them ([`scatter`](crate::model::multibody::scatter), `scatter.*`). They are the same in all samples of a person: no average over
//! time makes them smaller. Where a seat's force sensor repeats what body, hands and feet say, `nis` and `healthy` show a person who
//! is not the table's; what the errors make of the estimates then takes a solution for each of them, a third of a step more.
//!
//! Without samples of the joint accelerations (where these are not used, of the accelerometers on the segments) the prior decides how
//! the body moves, and with neither the base's accelerations nor the seat wrench what it weighs. The prior knows nothing of a body: the
//! estimates are not healthy then.
//!
//! # Noise and defaults
//! Variances, as in the source, in the square of the unit of what they belong to:
//! - equations of motion 1e-4 (`variance.equation.*`), all priors 1e4, the seat's wrench 1e6; a hand's force 30 N and
//!   moment 10 N m, a foot's force 80 N and moment 40 N m (standard deviations, `variance.prior_*`);
//! - joint accelerations 0.5 rad/s2, the pelvis's accelerometer 0.05 m/s2, body accelerometers 0.03 m/s2, seat force 2
//!   N and moment 0.3 N m, hands 0.5 N, feet 2 N (standard deviations);
//! - the segments' masses 15 %, their centres of mass a tenth of the radius of gyration, inertias 25 %, the person's mass 1
//!   kg, the seat's axes 10 mrad (standard deviations, `scatter.*`);
//! - joints' motion and other sensors come apart by 15 ms (standard deviation, `delay_std`);
//! - used by default are joint accelerations and the pelvis's accelerometer. The default person is 1.70 m tall and
//!   weighs 65 kg.
//!
//! # How to tune
//! 1. Set `body.height`, `body.mass` and `use.*` for the sensors that there are, and their places `mount.*`.
//! 2. Joint motion from cameras or inertial suits comes as positions: `differentiate = true`. A longer
//!    `differentiation.window` gives smoother and later accelerations; raise `variance.joint_acceleration` to the
//!    variance that is left.
//! 3. `chi2_*` over the number of channels of a sensor should be 1 or less: far more means a variance set too small, a
//!    wrong frame or a wrong unit (`identify tune human-dynamics`).
//! 4. Where hands rest on something without a sensor leave `variance.prior_hand_*` as wide as the force may be.
//!
//! # Sources and errata
//! Latella et al., *Towards real-time whole-body human dynamics estimation through probabilistic sensor fusion
//! algorithms*, Autonomous Robots 43 (2019): rows (2)-(4), estimate (5). No errata were found; the article prints
//! neither the rows nor its priors, which are derived here. Extensions: a base that moves with a seat, joints with
//! several degrees of freedom, and the variances of all estimates at every step.

mod derivatives;
mod parameters;
pub mod variables;
pub mod whole_body;

pub use parameters::{
    DifferentiationParameters, EquationVariances, FootMount, HandMount, ImuMount, MountParameters, Parameters,
    SeatMount, UseParameters, VarianceParameters,
};
pub use variables::{Inputs, Outputs};

use crate::estimator::lateness::Lateness;
use crate::estimator::{Elapsed, Machine, Outcome, Rules, Sampled, StateError};
use crate::filter::signal_noise::SignalNoise;
use crate::model::STANDARD_GRAVITY;
use crate::model::multibody::anthropometry::seated12;
use crate::model::multibody::equations::{Base, Kind};
use crate::model::multibody::error::ModelError;
use crate::model::multibody::tree::Tree;
use crate::variable::{Estimate, root_sum_square};
use crate::{ParameterError, Status};
use derivatives::Derivatives;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};
use variables::{DOF, GROUPS, JOINTS, WRENCHES};
use whole_body::{Posture, WholeBody};

/// The estimator; see the [module](self).
/// ```
/// use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};
/// use wheelstate::{Estimator, Variables};
///
/// let mut parameters = Parameters::default();
/// parameters.body.mass = 80.0;
/// parameters.r#use.hand_wrench = true;
/// parameters.r#use.foot_wrench = true;
/// let mut estimator = HumanDynamics::new(&parameters)?;
/// // upright at rest, nothing touches hands and feet
/// let mut inputs = Inputs::default();
/// inputs.map(&mut |_| 0.0);
/// inputs.base_accel = [0.0, 0.0, 9.80665];
/// estimator.step(&inputs, 0.01);
/// let mut estimates = Outputs::default();
/// estimator.outputs(&inputs, 0.0, &mut estimates);
/// let seat = estimates.seat_wrench[2]; // force along z, N: the seat carries the whole weight, known to a kilogram
/// assert!((seat.value - 80.0 * 9.80665).abs() < 3.0 * seat.std && seat.std < 12.0);
/// # Ok::<(), wheelstate::ParameterError>(())
/// ```
pub type HumanDynamics = Sampled<SeatedBody>;

/// Time after which a torque is as unknown as it gets, s.
const LONGEST_HORIZON: f64 = 1e3;

/// Everything that a step changes: the last estimates, and positions to differentiate.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    outputs: Outputs,
    /// Whether the last sample had a measurement of accelerations or wrenches.
    measured: bool,
    derivatives: Derivatives,
    /// How much torques and seat wrench change while no sample is taken.
    lateness: Lateness<WRENCHES>,
    /// How noisy they are beside their standard deviations.
    noise: SignalNoise<WRENCHES>,
}

impl Clone for State {
    fn clone(&self) -> Self {
        Self { outputs: self.outputs.clone(), derivatives: self.derivatives.clone(), ..*self }
    }

    /// Into memory that is there already.
    fn clone_from(&mut self, other: &Self) {
        self.outputs.clone_from(&other.outputs);
        self.measured = other.measured;
        self.derivatives.clone_from(&other.derivatives);
        (self.lateness, self.noise) = (other.lateness, other.noise);
    }
}

/// The seated body and its sensors, under the rules of [`Sampled`].
#[derive(Clone, Debug)]
pub struct SeatedBody {
    body: WholeBody,
    /// Group of each sensor of the body, none for "nothing touches this segment".
    groups: Vec<Option<usize>>,
    /// Coordinate in the model of each joint outside, and where its torque is.
    coordinate: [usize; DOF],
    torque: [usize; DOF],
    /// Joint positions, velocities and the sensors' samples, in the model's order.
    q: [f64; DOF],
    qd: [f64; DOF],
    samples: Vec<f64>,
    /// Whether a wrench is measured that the others already say.
    redundant: bool,
    /// The base's acceleration is measured, the joints' accelerations are, those of accelerometers on the segments.
    accelerates: bool,
    joints_move: bool,
    segments_move: bool,
    delay_std: f64,
    differentiate: bool,
    differentiator: derivatives::Differentiator,
}

impl SeatedBody {
    /// The estimator of the whole body behind this one.
    pub fn body(&self) -> &WholeBody {
        &self.body
    }

    fn build(parameters: &Parameters) -> Result<(WholeBody, Vec<Option<usize>>), ModelError> {
        let description = seated12(&parameters.body);
        let tree = Tree::new(&description, "Pelvis", true, &[])?;
        let (groups, sensors) = parameters.sensors(&tree).into_iter().unzip();
        let variances = parameters.variances(&tree);
        let body = WholeBody::new(tree, Base::Moving, sensors, &variances)?;
        Ok((body.considering(&parameters.scatter), groups))
    }

    /// Puts the inputs of the switched-on sensors in the body's order; how many are there.
    fn collect(&mut self, inputs: &Inputs, qdd: &[f64; DOF]) -> usize {
        let (mut at, mut present) = (0, 0);
        let (mut joint, mut imu) = (0, 0);
        let (mut hand, mut foot) = (0, 2);
        for group in &self.groups {
            // which inputs feed the next sensor of each group, in the order in which they were added
            let linear_and_angular;
            let taken: &[f64] = match group {
                None => &[0.0; 6],
                Some(0) => {
                    joint += 1;
                    &qdd[joint - 1..joint]
                }
                Some(1) => {
                    let (a, w) = (&inputs.base_accel, &inputs.base_angular_accel);
                    linear_and_angular = [a[0], a[1], a[2], w[0], w[1], w[2]];
                    &linear_and_angular
                }
                Some(2) => &inputs.seat,
                Some(3) => {
                    imu += 1;
                    &inputs.imu[imu - 1]
                }
                Some(4) => {
                    hand += 1;
                    &inputs.contact[hand - 1]
                }
                Some(_) => {
                    foot += 1;
                    &inputs.contact[foot - 1]
                }
            };
            self.samples[at..at + taken.len()].copy_from_slice(taken);
            at += taken.len();
            present += if group.is_some() { taken.iter().filter(|y| y.is_finite()).count() } else { 0 };
        }
        present
    }

    /// Reads the estimates of the step just taken.
    fn read(&mut self, outputs: &mut Outputs) {
        let mut scattered = [0.0; DOF + 6];
        scattered.copy_from_slice(if self.redundant {
            self.body.scattered()
        } else {
            self.body.scattered_by_statics()
        });
        let (mean, variance) = (self.body.mean(), self.body.variance());
        let estimate = |slot: usize, considered: f64| Estimate::new(mean[slot], (variance[slot] + considered).sqrt());
        for ((tau, &slot), &coordinate) in outputs.tau.iter_mut().zip(&self.torque).zip(&self.coordinate) {
            *tau = estimate(slot, scattered[coordinate]);
        }
        if let Some(base) = self.body.equations().slots()[0] {
            let slots = base.range(Kind::ParentWrench).zip(&scattered[DOF..]);
            for (wrench, (slot, &considered)) in outputs.seat_wrench.iter_mut().zip(slots) {
                *wrench = estimate(slot, considered);
            }
        }
        let (com, velocity) = self.body.equations().centre_of_mass();
        outputs.com = com.into();
        outputs.com_velocity = velocity.into();
        outputs.chi2 = [0.0; GROUPS.len()];
        for (sensor, group) in self.groups.iter().enumerate() {
            if let Some(group) = group {
                outputs.chi2[*group] += self.body.sensor_chi2(sensor).0;
            }
        }
    }
}

/// Whether the seat force is known to within the person's weight.
fn is_observable(outputs: &Outputs) -> bool {
    let worst = outputs.seat_wrench[..3].iter().fold(0.0_f64, |worst, force| worst.max(force.std));
    worst < outputs.body_mass * STANDARD_GRAVITY
}

impl Machine for SeatedBody {
    const NAME: &'static str = "HumanDynamics";
    const DESCRIPTION: &'static str = "Joint torques, seat wrench and centre of mass of a seated person with their \
        standard deviations, by maximum a posteriori estimation over the whole body";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<(Self, State), ParameterError> {
        let window = parameters.differentiation.window;
        if window % 2 == 0 {
            let name = "differentiation.window";
            let reason = "is even; the window needs an odd number of samples".to_owned();
            return Err(ParameterError { name: name.to_owned(), value: f64::from(window), unit: "1", reason });
        }
        // ranges exclude what the model could refuse; if it still does, the person is named
        let refused = |error: ModelError| ParameterError {
            name: "body.mass".to_owned(),
            value: parameters.body.mass,
            unit: "kg",
            reason: format!("gives no body: {error}"),
        };
        let (body, groups) = Self::build(parameters).map_err(refused)?;
        let mut coordinate = [0; DOF];
        let mut torque = [0; DOF];
        for (joint, (_, model_name, _)) in JOINTS.iter().enumerate() {
            coordinate[joint] = body.equations().tree().coordinate(model_name).map_err(refused)?;
            torque[joint] = body.torque_slot(coordinate[joint]);
        }
        let outputs = Outputs { body_mass: body.equations().tree().mass(), ..Default::default() };
        let differentiator = derivatives::Differentiator::new(window as usize, parameters.sample_period);
        let derivatives = differentiator.empty(parameters.differentiate);
        let machine = Self {
            samples: vec![0.0; body.samples()],
            accelerates: parameters.r#use.base_acceleration,
            joints_move: parameters.r#use.joint_acceleration,
            segments_move: parameters.r#use.imu,
            redundant: parameters.r#use.seat_wrench,
            body,
            groups,
            coordinate,
            torque,
            q: [0.0; DOF],
            qd: [0.0; DOF],
            delay_std: parameters.delay_std,
            differentiate: parameters.differentiate,
            differentiator,
        };
        let lateness = Lateness::default();
        let noise = SignalNoise::default();
        Ok((machine, State { outputs, measured: false, derivatives, lateness, noise }))
    }

    fn rules(parameters: &Parameters) -> Rules {
        Rules {
            sample_period: parameters.sample_period,
            // nothing here has dynamics
            longest_gap: f64::INFINITY,
            limits: Vec::new(),
            unused: parameters.unused(),
        }
    }

    fn sample(&mut self, state: &mut State, inputs: &Inputs, _: Status, elapsed: Elapsed) -> Outcome {
        let mut status = Status::OK;
        let (mut qd, mut qdd) = (inputs.qd, inputs.qdd);
        let mut ready = true;
        if self.differentiate {
            let dt = elapsed.seconds();
            let taken = self.differentiator.push(&mut state.derivatives, &inputs.q, dt, &mut qd, &mut qdd);
            status |= taken.status;
            ready = taken.ready;
        }
        let skipped = Outcome { status: status | Status::SKIPPED | Status::HOLD, ..Outcome::default() };
        let posture = [inputs.q.as_slice(), &qd, &inputs.base_gyro];
        if !ready || posture.iter().flat_map(|part| part.iter()).any(|value| !value.is_finite()) {
            return skipped;
        }
        let mut model_qdd = [0.0; DOF];
        for (joint, &c) in self.coordinate.iter().enumerate() {
            (self.q[c], self.qd[c], model_qdd[c]) = (inputs.q[joint], qd[joint], qdd[joint]);
        }
        let present = self.collect(inputs, &model_qdd);
        status.raise_if(present == 0, Status::NO_MEASUREMENT);
        let posture = Posture { q: &self.q, qd: &self.qd, base_rate: inputs.base_gyro };
        let Ok(of_body) = self.body.step(&posture, &self.samples, true) else { return skipped };
        // With neither of them weight and inertia are the prior's, which knows none.
        let sampled = |values: &[f64]| values.iter().all(|value| value.is_finite());
        let weighed = self.accelerates && sampled(&inputs.base_accel) && sampled(&inputs.base_angular_accel)
            || self.redundant && sampled(&inputs.seat);
        // Nor does it know how the body moves.
        let moves = match (self.joints_move, self.segments_move) {
            (true, _) => sampled(&qdd),
            (false, true) => inputs.imu.iter().all(|accel| sampled(accel)),
            (false, false) => false,
        };
        state.measured = present > 0 && weighed && moves;
        self.read(&mut state.outputs);
        let (mut relative, mut values) = (SVector::<f64, WRENCHES>::zeros(), [0.0; WRENCHES]);
        for (i, estimate) in state.outputs.wrenches_mut().enumerate() {
            (relative[i], values[i]) = (estimate.value / estimate.std, estimate.value);
        }
        match elapsed {
            Elapsed::First => state.lateness = Lateness::at(values),
            Elapsed::Step(dt) | Elapsed::Gap(dt) => state.lateness.follow(values, dt),
        }
        state.noise.update(&relative, elapsed.seconds());
        status |= of_body;
        status.raise_if(!is_observable(&state.outputs), Status::UNOBSERVABLE);
        let innovations = self.body.innovations(|sensor| self.groups[sensor].is_some());
        Outcome {
            status,
            nis: innovations.nis * innovations.rows as f64,
            channels: innovations.rows,
            log_likelihood: self.body.log_likelihood(),
            used: present > 0,
            ..Outcome::default()
        }
    }

    /// Nothing here has dynamics that would smooth an estimate or carry it forward, so its standard deviation contains its noise, as
    /// far as this is more than what the sensors are said to have, what it changes until then, and in the time by which a sensor is late.
    fn estimates(&self, state: &State, _: &Inputs, horizon: f64, outputs: &mut Outputs) {
        outputs.clone_from(&state.outputs);
        let late = root_sum_square([self.delay_std, horizon.min(LONGEST_HORIZON)]);
        for (i, estimate) in outputs.wrenches_mut().enumerate() {
            let noisy = estimate.std * state.noise.inflation(i).sqrt();
            estimate.std = root_sum_square([noisy, state.lateness.std(i, late)]);
        }
    }

    fn usable(&self, state: &State, outputs: &Outputs) -> bool {
        state.measured && is_observable(outputs)
    }

    fn check(&self, state: &State) -> Result<(), StateError> {
        if !self.differentiator.fits(&state.derivatives, self.differentiate) {
            return Err(StateError("its differentiation window differs"));
        }
        if !(state.lateness.is_valid() && state.noise.is_valid()) {
            return Err(StateError("its torques are not those of any body"));
        }
        Ok(())
    }
}
