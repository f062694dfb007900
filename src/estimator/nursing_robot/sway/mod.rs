//! Pitch sway of the seated body: adaptive unscented Kalman filter over the planar model
//! (Yang et al., section 4.2, eq. 38-54, corrected).
//!
//! States `[v, phi, phi', tau_a]`, of which each model takes the first ones. Errata: read literally,
//! (38)-(42) leave the pitch unobservable; "adaptive" has no law in the paper; see
//! [`crate::filter::adaptation`] for the one used here. White noise on the pitch rate alone would leave
//! the speed blind to a cough, so the noise enters as a hip torque, which moves both.
//!
//! With speed alone the motion about the rest posture is observable, a kept lean is not: it needs no
//! net force. All models are of a level floor, on which a slope looks like a lean: where
//! `mass.use_accelerometer` lets the machine be weighed on slopes the filter is off, unless a tilt sensor
//! shows the body or the model is asked for by name.

mod filter;
mod motion;
mod one_step;
mod readout;
mod speed_offset;
mod state;

pub use filter::{Correction, SwaySample};
pub use readout::SwayEstimate;
pub use speed_offset::SpeedOffset;
pub use state::{SwayBelief, SwayState};

use super::Parameters;
use super::parameters::SwayModel;
use crate::filter::adaptation::MeasurementAdaptation;
use crate::filter::innovation::Gate;
use crate::filter::sigma_points::UnscentedTransform;
use crate::model::nursing_robot::{Human, Robot, Rolling};
use crate::variable::Estimate;

/// Which equations the filter carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    PaperRaw,
    Paper,
    Sound,
    SoundTorque,
}

impl Form {
    /// The form that the parameters ask for; `None` if the filter is off.
    fn chosen(p: &Parameters) -> Option<Self> {
        let (s, tilt) = (&p.sway, p.sway.use_tilt || p.sway.use_tilt_rate);
        if p.human.hip_inertia(p.human.nominal_mass) <= 0.0 {
            return None;
        }
        match s.model {
            SwayModel::Auto if tilt => Some(Self::SoundTorque),
            SwayModel::Auto if p.mass.use_accelerometer => None,
            SwayModel::Auto | SwayModel::Sound => Some(Self::Sound),
            SwayModel::PaperRaw => Some(Self::PaperRaw),
            SwayModel::Paper => Some(Self::Paper),
            SwayModel::SoundTorque => Some(Self::SoundTorque),
        }
    }

    /// Number of states.
    fn states(self) -> usize {
        match self {
            Self::PaperRaw | Self::Paper => 2,
            Self::Sound => 3,
            Self::SoundTorque => 4,
        }
    }
}

impl Parameters {
    /// Which of speed, tilt and tilt rate the sway filter uses.
    pub(super) fn sway_channels(&self) -> [bool; 3] {
        match Form::chosen(self) {
            Some(form) => [true, self.sway.use_tilt, self.sway.use_tilt_rate && form.states() > 2],
            None => [false; 3],
        }
    }
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
    /// Power spectral densities of the process noise of the states.
    density: [f64; 4],
    torque_density: f64,
    torque_time: f64,
    initial_std: [f64; 4],
    unknown_speed_std: f64,
    adaptive: bool,
    adaptation: MeasurementAdaptation,
    /// Memory, s, and bound of the scale of the process noise.
    scale: (f64, f64),
    gate: Gate,
    pitch_limit: f64,
    /// Speed, m/s, and time, s, of held wheels.
    hold: Option<(f64, f64)>,
    mass_bounds: (f64, f64),
    /// How far the posture at rest is unknown, rad.
    rest_std: f64,
    /// Standard deviations of constant errors of tilt, rad, and tilt rate, rad/s.
    bias_std: [f64; 2],
    /// Standard deviation of the time by which the two come late, s, and of that by which the speed does.
    delay_std: f64,
    speed_delay_std: f64,
    /// Relative error of the speed's scale.
    speed_scale_std: f64,
    /// Errors of the hip's stiffness and damping, relative.
    passive_std: [f64; 2],
}

/// Rejections in a row before the speed is reset to its measurement.
const REJECTIONS: u32 = 3;
/// Smallest load mass that the filter's model is given, kg: a lighter person has no plausible sway.
const LEAST_MASS: f64 = 20.0;

impl SwayEstimator {
    /// From checked parameters; `None` if nothing sways or the filter is off.
    pub fn new(p: &Parameters) -> Option<Self> {
        Form::chosen(p).map(|form| Self::with_form(p, form))
    }

    fn with_form(p: &Parameters, form: Form) -> Self {
        let (s, process, measured, initial) = (&p.sway, &p.sway.process_psd, &p.sway.measurement_std, &p.initial);
        let paper = form.states() == 2;
        let density = match paper {
            true => [process.paper_speed, process.paper_pitch, 0.0, 0.0],
            false => [process.speed, process.pitch, process.pitch_rate, process.active_torque],
        };
        let torque_density = match form {
            Form::PaperRaw | Form::Paper => 0.0,
            Form::Sound => process.hip_torque,
            Form::SoundTorque => process.hip_torque_fast,
        };
        Self {
            form,
            transform: UnscentedTransform::new(form.states(), s.alpha, s.beta, s.kappa),
            robot: p.robot,
            rolling: p.rolling,
            human: p.human,
            use_channel: p.sway_channels(),
            nominal_noise: [measured.speed, measured.tilt, measured.tilt_rate].map(|std| std * std),
            density,
            torque_density,
            torque_time: s.active_torque_time,
            initial_std: [initial.speed_std, initial.pitch_std, initial.pitch_rate_std, initial.active_torque_std],
            unknown_speed_std: p.limit.speed.max(initial.speed_std),
            adaptive: s.adaptive,
            adaptation: MeasurementAdaptation { memory: s.noise_memory, bounds: (s.noise_low, s.noise_high) },
            scale: (s.scale_time, s.scale_high),
            gate: Gate { deviations: s.gate.sqrt(), patience: REJECTIONS },
            pitch_limit: s.pitch_limit,
            hold: (s.hold_wheels && !paper).then_some((s.hold_speed, s.hold_time)),
            mass_bounds: (LEAST_MASS.min(p.limit.load_mass), p.limit.load_mass),
            rest_std: p.human.rest_pitch_std,
            bias_std: [p.sway.tilt_bias_std, p.sway.tilt_rate_bias_std],
            delay_std: p.sway.tilt_delay_std,
            speed_delay_std: p.sway.speed_delay_std,
            speed_scale_std: p.sway.speed_scale_std,
            passive_std: [p.human.stiffness_pitch_std, p.human.damping_pitch_std],
        }
    }
}

impl SwayEstimate {
    /// What is known of a body while no filter follows it: it moves about its relaxed posture, if it can move at all.
    pub(super) fn unobserved(p: &Parameters) -> Self {
        if p.human.hip_inertia(p.human.nominal_mass) <= 0.0 {
            let rigid = [Estimate::NONE, Estimate::new(p.human.rest_pitch, 0.0), Estimate::NONE, Estimate::NONE];
            return Self { state: rigid, ..Self::default() };
        }
        let estimator = SwayEstimator::with_form(p, Form::Sound);
        estimator.estimate(&estimator.start(), f64::NAN, 0.0)
    }
}
