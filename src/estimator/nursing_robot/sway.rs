//! Pitch sway of the seated body: adaptive unscented Kalman filter over the planar model
//! (Yang et al., section 4.2, eq. 38-54, corrected).
//!
//! States `[v, phi, phi', tau_a]`, of which each model takes the first ones. Errata: read literally,
//! (38)-(42) leave the pitch unobservable; "adaptive" has no law in the paper; see
//! [`crate::filter::adaptation`] for the one used here. White noise on the pitch rate alone would leave
//! the speed blind to a cough, so the noise enters as a hip torque, which moves both.
//!
//! With speed alone the motion about the rest posture is observable, a kept lean is not: it needs no
//! net force.

use super::Parameters;
use super::parameters::SwayModel;
use crate::filter::adaptation::{MeasurementAdaptation, MeasurementNoise, ProcessScale};
use crate::filter::bounded;
use crate::filter::discretise::runge_kutta;
use crate::filter::gaussian::{Gaussian, add_square};
use crate::filter::innovation::Gate;
use crate::filter::nis_monitor::NisMonitor;
use crate::filter::sigma_points::UnscentedTransform;
use crate::filter::ukf::{self, Channel};
use crate::model::nursing_robot::{Human, Lean, Planar, Robot, Rolling};
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// What happened in the last step; the numbers are the output `sway_status`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum SwayStatus {
    /// All channels were used.
    #[default]
    Updated = 0,
    /// A channel had no sample.
    Missing = 2,
    /// The wheels are held; the speed is known to be zero.
    Held = 3,
    /// The samples were rejected.
    Gated = 4,
    /// Unusable step, or restart after a gap.
    BadStep = 5,
    /// The step was rolled back.
    RolledBack = 6,
    /// Restart beyond the pitch limit.
    Restarted = 7,
    /// The speed was re-aligned with its measurement after rejections in a row.
    Realigned = 8,
    /// There is nothing that sways.
    Off = 9,
}

/// What one step needs; NaN is missing.
#[derive(Clone, Copy, Debug)]
pub struct SwaySample {
    /// Net drive force without rolling resistance and sway, N.
    pub drive_force: f64,
    /// Yaw rate, rad/s; missing means straight.
    pub yaw_rate: f64,
    /// Speed, pitch and pitch rate.
    pub channels: [f64; 3],
}

/// Which equations the filter carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    PaperRaw,
    Paper,
    Sound,
    SoundTorque,
}

/// Settings of the sway filter in the form in which a step needs them.
#[derive(Clone, Debug)]
pub struct SwayEstimator {
    form: Form,
    transform: UnscentedTransform,
    robot: Robot,
    rolling: Rolling,
    human: Human,
    use_channel: [bool; 3],
    nominal_noise: [f64; 3],
    /// Densities of the process noise of the states.
    density: [f64; 4],
    torque_density: f64,
    torque_time: f64,
    start_std: [f64; 4],
    adaptive: bool,
    adaptation: MeasurementAdaptation,
    scale: (f64, f64),
    gate: f64,
    pitch_limit: f64,
    hold: Option<(f64, f64)>,
    longest_step: f64,
    mass_bounds: (f64, f64),
    rest_std: f64,
}

/// The filter's belief; its size depends on the model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum SwayBelief {
    /// Speed and pitch.
    Two(Gaussian<2>),
    /// Speed, pitch, pitch rate.
    Three(Gaussian<3>),
    /// Speed, pitch, pitch rate, active torque.
    Four(Gaussian<4>),
}

impl SwayBelief {
    /// Mean of the pitch, rad.
    fn pitch(&self) -> f64 {
        match self {
            Self::Two(belief) => belief.mean[1],
            Self::Three(belief) => belief.mean[1],
            Self::Four(belief) => belief.mean[1],
        }
    }
}

/// Everything that the steps change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SwayState {
    /// Mean and covariance.
    pub belief: SwayBelief,
    /// Measurement variances.
    pub noise: MeasurementNoise<3>,
    /// Scale of the process noise.
    pub scale: ProcessScale<3>,
    /// What the last step did.
    pub status: SwayStatus,
    /// Normalised innovation squared of the last sample, summed over its channels.
    pub nis: f64,
    /// Logarithm of the likelihood of the last sample.
    pub log_likelihood: f64,
    /// Number of channels of the last sample.
    pub channels: u8,
    /// Whether the speeds contradict the model: a mass, a rolling coefficient or a torque scale is wrong,
    /// and the body leans in the estimate only to explain it.
    pub monitor: NisMonitor,
    /// Whether a covariance had to be repaired in the last step.
    pub repaired: bool,
    /// Load mass of the last step, kg.
    mass: f64,
    force: Option<f64>,
    yaw_rate: f64,
    smoothed_speed: f64,
    slow_for: f64,
    rejected: u32,
    held: bool,
}

/// The filter's answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SwayEstimate {
    /// Speed, pitch, pitch rate, active torque; 0 for what the model does not have.
    pub state: [f64; 4],
    /// Their standard deviations.
    pub state_std: [f64; 4],
    /// Force of the swaying body, N.
    pub force: f64,
    /// Its standard deviation, N.
    pub force_std: f64,
    /// Passive hip torque, N m.
    pub torque: f64,
    /// Its standard deviation, N m.
    pub torque_std: f64,
}

/// Time constant of the speed smoothed for the stand-still rule, s.
const SMOOTHING_TIME: f64 = 0.1;
/// Rejections in a row before the speed is re-aligned.
const REJECTIONS: u32 = 3;

/// What is constant during one step.
pub(super) struct Step<'a> {
    form: Form,
    pub(super) planar: Planar,
    pub(super) force: f64,
    /// The pitch before the step, near which all points of the step lie.
    lean: Lean,
    omega: f64,
    held: bool,
    torque_time: f64,
    mass: f64,
    human: &'a Human,
    pub(super) dt: f64,
}

impl SwayEstimator {
    /// From checked parameters; `None` if nothing sways.
    pub fn new(p: &Parameters) -> Option<Self> {
        let s = &p.sway;
        if p.human.hip_inertia(p.human.nominal_mass) <= 0.0 {
            return None;
        }
        let form = match s.model {
            SwayModel::Auto if s.use_tilt || s.use_tilt_rate => Form::SoundTorque,
            SwayModel::Auto | SwayModel::Sound => Form::Sound,
            SwayModel::PaperRaw => Form::PaperRaw,
            SwayModel::Paper => Form::Paper,
            SwayModel::SoundTorque => Form::SoundTorque,
        };
        let states = match form {
            Form::PaperRaw | Form::Paper => 2,
            Form::Sound => 3,
            Form::SoundTorque => 4,
        };
        let density = match form {
            Form::PaperRaw | Form::Paper => [s.paper_speed_noise, s.paper_pitch_noise, 0.0, 0.0],
            _ => [s.speed_noise, s.pitch_noise, s.pitch_rate_noise, s.active_torque_noise],
        };
        let torque_density = match form {
            Form::PaperRaw | Form::Paper => 0.0,
            Form::Sound => s.hip_torque_noise,
            Form::SoundTorque => s.hip_torque_noise_fast,
        };
        let start = [s.start_speed_std, s.start_pitch_std, s.start_pitch_rate_std, s.start_torque_std];
        Some(Self {
            form,
            transform: UnscentedTransform::new(states, s.alpha, s.beta, s.kappa),
            robot: p.robot,
            rolling: p.rolling,
            human: p.human,
            use_channel: [true, s.use_tilt, s.use_tilt_rate && states > 2],
            nominal_noise: [s.speed_std, s.tilt_std, s.tilt_rate_std].map(|std| std * std),
            density,
            torque_density,
            torque_time: s.active_torque_time,
            start_std: start,
            adaptive: s.adaptive,
            adaptation: MeasurementAdaptation { memory: s.noise_memory, bounds: (s.noise_low, s.noise_high) },
            scale: (s.scale_time, s.scale_high),
            gate: s.gate,
            pitch_limit: s.pitch_limit,
            hold: (s.hold_wheels && states > 2).then_some((s.hold_speed, s.hold_time)),
            longest_step: p.longest_step(),
            mass_bounds: (LEAST_MASS.min(p.limit.load_mass), p.limit.load_mass),
            rest_std: if s.use_tilt { 0.0 } else { p.human.rest_pitch_std },
        })
    }

    /// The state before the first sample.
    pub fn start(&self) -> SwayState {
        SwayState {
            belief: self.start_belief(0.0),
            noise: MeasurementNoise::new(&self.nominal_noise),
            scale: ProcessScale::default(),
            status: SwayStatus::Updated,
            nis: 0.0,
            log_likelihood: 0.0,
            channels: 0,
            monitor: NisMonitor::default(),
            repaired: false,
            mass: self.human.nominal_mass,
            force: None,
            yaw_rate: 0.0,
            smoothed_speed: 0.0,
            slow_for: 0.0,
            rejected: 0,
            held: false,
        }
    }

    fn start_belief(&self, speed: f64) -> SwayBelief {
        let rest = self.human.rest_pitch;
        let [v, pitch, rate, torque] = self.start_std;
        match self.form {
            Form::PaperRaw | Form::Paper => {
                SwayBelief::Two(Gaussian::independent([speed, rest].into(), &[v, pitch].into()))
            }
            Form::Sound => {
                SwayBelief::Three(Gaussian::independent([speed, rest, 0.0].into(), &[v, pitch, rate].into()))
            }
            Form::SoundTorque => SwayBelief::Four(Gaussian::independent(
                [speed, rest, 0.0, 0.0].into(),
                &[v, pitch, rate, torque].into(),
            )),
        }
    }

    /// Starts at a measured speed.
    pub fn seed(&self, state: &mut SwayState, speed: f64) {
        state.belief = self.start_belief(speed);
    }

    /// Model of the machine with `mass` kg of load; the hip's spring and damper stay as they are.
    fn planar(&self, mass: f64) -> Planar {
        Planar::new(&self.robot, &self.rolling, &self.human, mass)
    }

    /// Takes one sample: time update over `dt` (none if `dt` is zero), then measurement update, with
    /// `mass` kg of load.
    pub fn step(&self, state: &mut SwayState, sample: &SwaySample, mass: f64, dt: f64) -> SwayStatus {
        state.status = self.advance(state, sample, mass, dt);
        state.status
    }

    fn advance(&self, state: &mut SwayState, sample: &SwaySample, mass: f64, dt: f64) -> SwayStatus {
        // Written so that a NaN step fails too.
        if !(dt >= 0.0 && dt.is_finite()) {
            return SwayStatus::BadStep;
        }
        state.mass = mass.clamp(self.mass_bounds.0, self.mass_bounds.1);
        state.repaired = false;
        let speed = sample.channels[0];
        if dt > self.longest_step {
            let speed = if speed.is_nan() { 0.0 } else { speed };
            let (mass, smoothed_speed, slow_for) = (state.mass, state.smoothed_speed, state.slow_for);
            *state = SwayState { mass, smoothed_speed, slow_for, ..self.start() };
            self.seed(state, speed);
            return SwayStatus::BadStep;
        }
        let force = if sample.drive_force.is_nan() { state.force.unwrap_or(0.0) } else { sample.drive_force };
        let mean_force = 0.5 * (state.force.unwrap_or(force) + force);
        state.force = Some(force);
        state.yaw_rate = if sample.yaw_rate.is_nan() { 0.0 } else { sample.yaw_rate };
        let held = self.wheels_held(state, speed, dt);
        state.held = held;
        let step = self.step_of(state, mean_force, dt);
        let (z, before) = (sample.channels, *state);
        let status = match before.belief {
            SwayBelief::Two(mut belief) => {
                let status = self.filter(state, &mut belief, &step, z);
                state.belief = SwayBelief::Two(belief);
                status
            }
            SwayBelief::Three(mut belief) => {
                let status = self.filter(state, &mut belief, &step, z);
                state.belief = SwayBelief::Three(belief);
                status
            }
            SwayBelief::Four(mut belief) => {
                let status = self.filter(state, &mut belief, &step, z);
                state.belief = SwayBelief::Four(belief);
                status
            }
        };
        if status == SwayStatus::RolledBack {
            *state = before;
        }
        status
    }

    /// The equations of one step over `dt` under a drive force.
    pub(super) fn step_of(&self, state: &SwayState, force: f64, dt: f64) -> Step<'_> {
        Step {
            form: self.form,
            planar: self.planar(state.mass),
            force,
            lean: Lean::new(state.belief.pitch()),
            omega: state.yaw_rate,
            held: state.held,
            torque_time: self.torque_time,
            mass: state.mass,
            human: &self.human,
            dt,
        }
    }

    /// Uncertainty of the posture a person keeps, rad, as far as no tilt is measured.
    pub(super) fn rest_std(&self) -> f64 {
        self.rest_std
    }

    /// Variance of the hip torque that the model does not carry, N2 m2, over the time that the filter
    /// needs to notice it.
    pub(super) fn torque_noise(&self, state: &SwayState) -> f64 {
        let scale = if self.form == Form::Sound { state.scale.scale } else { 1.0 };
        self.torque_density * scale / self.scale.0
    }

    /// Stand-still rule: the smoothed speed has been small for long enough.
    fn wheels_held(&self, state: &mut SwayState, speed: f64, dt: f64) -> bool {
        let Some((hold_speed, hold_time)) = self.hold else { return false };
        if !speed.is_nan() {
            let share = 1.0 - (-dt / SMOOTHING_TIME).exp();
            state.smoothed_speed += share * (speed - state.smoothed_speed);
        }
        state.slow_for = if state.smoothed_speed.abs() < hold_speed { state.slow_for + dt } else { 0.0 };
        state.slow_for >= hold_time - 1e-9
    }

    fn filter<const N: usize>(
        &self,
        state: &mut SwayState,
        belief: &mut Gaussian<N>,
        step: &Step,
        mut z: [f64; 3],
    ) -> SwayStatus {
        if step.held {
            belief.mean[0] = 0.0;
            z[0] = f64::NAN;
        }
        if step.dt > 0.0 {
            match ukf::predict(belief, &self.transform, |x| step.propagate(x)) {
                Some(repaired) => state.repaired |= repaired,
                None => return SwayStatus::RolledBack,
            }
            self.add_noise(belief, step, state.scale.scale);
        }

        state.noise.count(&self.adaptation);
        let channels: [Channel; 3] = std::array::from_fn(|i| Channel {
            index: if i < N { i } else { 0 },
            sample: if self.use_channel[i] { z[i] } else { f64::NAN },
            variance: state.noise.variance[i],
        });
        let prior = *belief;
        let gate = Gate { deviations: self.gate.sqrt(), patience: REJECTIONS };
        let innovation = ukf::correct(belief, &channels, gate, &mut state.rejected);
        (state.nis, state.channels) = (innovation.nis, innovation.dof as u8);
        state.log_likelihood = innovation.log_likelihood;
        if innovation.dof > 0 {
            // what is rejected counts, too
            state.monitor.update(innovation.nis_per_row(), step.dt);
        }
        let wanted = self.use_channel.iter().filter(|used| **used).count();
        let complete = innovation.dof == wanted;
        let mut status = match (step.held, complete) {
            (true, _) => SwayStatus::Held,
            (false, true) => SwayStatus::Updated,
            (false, false) => SwayStatus::Missing,
        };
        if innovation.any_rejected() {
            status = SwayStatus::Gated;
        } else if state.rejected > REJECTIONS {
            state.rejected = 0;
            status = SwayStatus::Realigned;
            *belief = prior;
            if !z[0].is_nan() {
                belief.reset_state(0, z[0], self.nominal_noise[0]);
            }
        } else {
            if self.adaptive && complete {
                let residual = channels.map(|c| c.sample - belief.mean[c.index]);
                let posterior = channels.map(|c| belief.covariance[(c.index, c.index)]);
                let normalised = std::array::from_fn(|i| {
                    let (index, variance) = (channels[i].index, channels[i].variance);
                    innovation.residual[i] / (prior.covariance[(index, index)] + variance).sqrt()
                });
                state.noise.learn(&self.adaptation, &self.nominal_noise, &self.use_channel, &residual, &posterior);
                state.scale.learn(&self.use_channel, &normalised, step.dt, self.scale.0, self.scale.1);
            }
        }
        if !belief.is_valid() {
            return SwayStatus::RolledBack;
        }
        if (belief.mean[1] - self.human.rest_pitch).abs() > self.pitch_limit {
            let std = SVector::<f64, N>::from_fn(|i, _| self.start_std[i]);
            *belief = Gaussian::independent(
                SVector::from_fn(|i, _| [belief.mean[0], self.human.rest_pitch, 0.0, 0.0][i]),
                &std,
            );
            return SwayStatus::Restarted;
        }
        status
    }

    /// Process noise over one step: independent on the states, and a white hip torque.
    fn add_noise<const N: usize>(&self, belief: &mut Gaussian<N>, step: &Step, scale: f64) {
        let mut density = self.density;
        match self.form {
            Form::PaperRaw | Form::Paper => density[1] *= scale,
            Form::Sound => {}
            Form::SoundTorque => density[3] *= scale,
        }
        for (i, density) in density.iter().enumerate().take(N) {
            belief.covariance[(i, i)] += density * step.dt;
        }
        if self.torque_density > 0.0 {
            let torque = if self.form == Form::Sound { self.torque_density * scale } else { self.torque_density };
            let (v_dot, phi_ddot) = step.planar.hip_torque_response(belief.mean[1]);
            let response = SVector::<f64, N>::from_fn(|i, _| [v_dot, 0.0, phi_ddot, 0.0][i]);
            add_square(&mut belief.covariance, torque * step.dt, &response);
        }
    }
}

/// Smallest load mass that the sway filter's model is given, kg: a lighter person has no plausible sway.
const LEAST_MASS: f64 = 20.0;

impl Step<'_> {
    /// The state one step later.
    pub(super) fn propagate<const N: usize>(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        match self.form {
            Form::PaperRaw | Form::Paper => {
                let push = self.force - self.planar.rolling_resistance(x[0]) - self.paper_force(x[1]);
                SVector::from_fn(|i, _| if i == 0 { x[0] + self.dt * push / self.planar.inertial_mass } else { x[i] })
            }
            _ => runge_kutta(x, self.dt, |x| self.derivative(x)),
        }
    }

    fn derivative<const N: usize>(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let active = if N > 3 { x[3] } else { 0.0 };
        let (v_dot, phi_ddot) = self.acceleration(x[0], x[1], x[2], active);
        SVector::from_fn(|i, _| [v_dot, x[2], phi_ddot, -active / self.torque_time][i])
    }

    fn acceleration(&self, v: f64, phi: f64, phi_dot: f64, active: f64) -> (f64, f64) {
        let lean = self.lean.moved_to(phi);
        if self.held {
            return (0.0, self.planar.held_acceleration(&lean, phi_dot, self.omega, active));
        }
        let force = self.force - self.planar.rolling_resistance(v);
        self.planar.acceleration(force, &lean, phi_dot, self.omega, active)
    }

    /// Force of the swaying body, N.
    pub(super) fn sway_force<const N: usize>(&self, x: &SVector<f64, N>) -> f64 {
        if N < 3 {
            return self.paper_force(x[1]);
        }
        let active = if N > 3 { x[3] } else { 0.0 };
        let (_, phi_ddot) = self.acceleration(x[0], x[1], x[2], active);
        self.planar.sway_force(x[1], x[2], phi_ddot, self.omega)
    }

    /// The paper's disturbance force, N.
    fn paper_force(&self, phi: f64) -> f64 {
        match self.form {
            Form::PaperRaw => self.planar.printed_force(self.human, self.mass, phi),
            _ => self.planar.paper_force(phi),
        }
    }
}

impl SwayState {
    /// Drive force of the last sample, N.
    pub(super) fn last_force(&self) -> f64 {
        self.force.unwrap_or(0.0)
    }

    /// Whether all numbers are finite and fit the estimator.
    pub fn is_sound(&self, estimator: &SwayEstimator) -> bool {
        let belief = match (&self.belief, estimator.form) {
            (SwayBelief::Two(belief), Form::Paper | Form::PaperRaw) => belief.is_valid(),
            (SwayBelief::Three(belief), Form::Sound) => belief.is_valid(),
            (SwayBelief::Four(belief), Form::SoundTorque) => belief.is_valid(),
            _ => false,
        };
        let numbers = [
            self.nis,
            self.log_likelihood,
            self.mass,
            self.force.unwrap_or(0.0),
            self.yaw_rate,
            self.smoothed_speed,
            self.slow_for,
        ];
        belief
            && self.noise.is_sound()
            && self.scale.is_sound()
            && self.monitor.is_valid()
            && numbers.iter().all(|x| bounded(*x))
    }
}
