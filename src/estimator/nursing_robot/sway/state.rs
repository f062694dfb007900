//! What the sway filter knows.

use super::speed_offset::SpeedOffset;
use super::{Form, SwayEstimator};
use crate::estimator::lateness::Lateness;
use crate::estimator::nursing_robot::status::SwayStatus;
use crate::estimator::relative_delay::DelayOfRate;
use crate::estimator::standstill::Standstill;
use crate::filter::adaptation::{MeasurementNoise, ProcessScale, UnmodelledAcceleration};
use crate::filter::gaussian::Gaussian;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

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
    pub(super) fn pitch(&self) -> f64 {
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
    /// What the innovations of the speed say of a force that the filter does not follow yet.
    pub unmodelled: UnmodelledAcceleration,
    /// Of pitch rate and speed.
    pub(super) lateness: Lateness<2>,
    pub(super) speed_offset: SpeedOffset,
    /// Of tilt and pitch rate beside one another.
    pub(super) rate_delay: DelayOfRate,
    /// What the last step did.
    pub status: SwayStatus,
    /// Load mass of the last step, kg.
    pub(super) mass: f64,
    /// Drive force of the last sample that had one, N.
    pub(super) force: Option<f64>,
    pub(super) yaw_rate: f64,
    pub(super) smoothed_speed: f64,
    /// Whether the wheels are held.
    pub(super) standstill: Standstill,
    /// Samples that the gate rejected in a row.
    pub(super) rejected: u32,
}

impl SwayState {
    /// Whether a drive force was ever measured.
    pub(in super::super) fn has_force(&self) -> bool {
        self.force.is_some()
    }

    /// Drive force of the last sample, N; 0 if there was none yet.
    pub(super) fn last_force(&self) -> f64 {
        self.force.unwrap_or(0.0)
    }

    /// Whether it can have come from this estimator; its numbers are finite.
    pub fn fits(&self, estimator: &SwayEstimator) -> bool {
        let belief = match (&self.belief, estimator.form) {
            (SwayBelief::Two(belief), Form::Paper | Form::PaperRaw) => belief.is_valid(),
            (SwayBelief::Three(belief), Form::Sound) => belief.is_valid(),
            (SwayBelief::Four(belief), Form::SoundTorque) => belief.is_valid(),
            _ => false,
        };
        belief
            && self.noise.is_valid()
            && self.scale.is_valid()
            && self.unmodelled.is_valid()
            && self.lateness.is_valid()
            && self.speed_offset.is_valid()
            && self.rate_delay.is_valid()
    }
}

impl SwayEstimator {
    /// The state before the first sample.
    pub fn start(&self) -> SwayState {
        self.start_at(0.0, self.initial_std[0])
    }

    /// At a speed that is known this well, the body about its relaxed posture.
    pub(super) fn start_at(&self, speed: f64, std: f64) -> SwayState {
        SwayState {
            belief: match self.form {
                Form::PaperRaw | Form::Paper => SwayBelief::Two(self.relaxed(speed, std)),
                Form::Sound => SwayBelief::Three(self.relaxed(speed, std)),
                Form::SoundTorque => SwayBelief::Four(self.relaxed(speed, std)),
            },
            noise: MeasurementNoise::new(&self.nominal_noise),
            scale: ProcessScale::default(),
            unmodelled: UnmodelledAcceleration::default(),
            lateness: Lateness::at([0.0, speed]),
            speed_offset: SpeedOffset::default(),
            rate_delay: DelayOfRate::default(),
            status: SwayStatus::Updated,
            mass: self.human.nominal_mass,
            force: None,
            yaw_rate: 0.0,
            smoothed_speed: 0.0,
            standstill: Standstill::default(),
            rejected: 0,
        }
    }

    /// The belief that the body is about its relaxed posture.
    pub(super) fn relaxed<const N: usize>(&self, speed: f64, speed_std: f64) -> Gaussian<N> {
        let [_, pitch, rate, torque] = self.initial_std;
        Gaussian::independent(
            SVector::from_fn(|i, _| [speed, self.human.rest_pitch, 0.0, 0.0][i]),
            &SVector::from_fn(|i, _| [speed_std, pitch, rate, torque][i]),
        )
    }
}
