//! What the filter knows of the chair, in the form of its kind.

use super::contour;
use super::parameters::{InitialParameters, Kind, Parameters};
use crate::filter::gaussian::Gaussian;
use crate::model::wheelchair::{self as model, biased_gravity, gravity};
use nalgebra::SVector;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// Mean and covariance of the chair's states.
#[expect(clippy::large_enum_variant, reason = "there is one per estimator, and copying it must not allocate")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ChairBelief {
    /// `basic`
    Basic(Gaussian<6>),
    /// `bias` and `acceleration_input`
    Biased(Gaussian<13>),
    /// `gravity_vector`, and the others once the ground has contradicted the initial heading
    Gravity(Gaussian<15>),
}

/// The filter of a machine that goes with a belief, and the belief, in the form of its kind.
macro_rules! of_kind {
    ($machine:expr, $belief:expr, |$filter:ident, $gaussian:ident| $body:expr) => {
        match $belief {
            ChairBelief::Basic($gaussian) => {
                let $filter = &$machine.basic;
                $body
            }
            ChairBelief::Biased($gaussian) => {
                let $filter = &$machine.biased;
                $body
            }
            ChairBelief::Gravity($gaussian) => {
                let $filter = &$machine.gravity;
                $body
            }
        }
    };
}
pub(super) use of_kind;

/// Known biases of gyro, rad/s, and accelerometer, m/s^2.
pub(super) fn biases(initial: &InitialParameters) -> [f64; 4] {
    [initial.gyro_bias, initial.accel_x_bias, initial.accel_y_bias, initial.accel_z_bias]
}

impl ChairBelief {
    /// The estimated bias of the gyro, rad/s; 0 where the known one is taken off before.
    pub(super) fn gyro_bias(&self) -> f64 {
        match self {
            Self::Basic(_) => 0.0,
            Self::Biased(belief) => belief.mean[model::GYRO_BIAS],
            Self::Gravity(belief) => belief.mean[biased_gravity::GYRO_BIAS],
        }
    }

    /// The belief before the first sample.
    pub(super) fn initial(parameters: &Parameters) -> Self {
        let p = &parameters.initial;
        let chair = model::State::new(0.0, p.heading, p.speed, 0.0, p.slope, 0.0);
        let std = [p.distance_std, p.heading_std, p.speed_std, p.yaw_rate_std, p.slope_std, p.slope_rate_std];
        let kind = parameters.filter.kind;
        match kind {
            Kind::Basic => Self::Basic(Gaussian::independent(chair, &SVector::from(std))),
            Kind::Bias | Kind::AccelerationInput => {
                let (mut mean, mut all) = (model::BiasedState::zeros(), model::BiasedState::zeros());
                mean.fixed_rows_mut::<6>(0).copy_from(&chair);
                all.fixed_rows_mut::<6>(0).copy_from(&SVector::from(std));
                mean.fixed_rows_mut::<4>(model::GYRO_BIAS).copy_from(&SVector::from(biases(p)));
                let accel = p.accel_bias_std;
                let bias = [p.gyro_bias_std, accel, accel, accel, p.heading_offset_std];
                all.fixed_rows_mut::<5>(model::GYRO_BIAS).copy_from(&SVector::from(bias));
                // without the force as input its errors have no part: known to be zero
                if kind == Kind::Bias {
                    all[model::FORCE_GAIN] = p.force_gain_std;
                    all[model::FORCE_OFFSET] = p.force_offset_std;
                }
                Self::Biased(Gaussian::independent(mean, &all))
            }
            Kind::GravityVector => Self::Gravity(contour::start(parameters)),
        }
    }

    /// Speed, m/s, and yaw rate, rad/s.
    pub(super) fn motion(&self) -> (f64, f64) {
        match self {
            Self::Basic(belief) => (belief.mean[model::V], belief.mean[model::R]),
            Self::Biased(belief) => (belief.mean[model::V], belief.mean[model::R]),
            Self::Gravity(belief) => (belief.mean[gravity::V], belief.mean[gravity::R]),
        }
    }

    /// Rate at which the ground tilts forward, or up the slope where the heading is given, rad/s.
    pub(super) fn tilt_rate(&self) -> f64 {
        match self {
            Self::Basic(belief) => belief.mean[model::W],
            Self::Biased(belief) => belief.mean[model::W],
            Self::Gravity(belief) => belief.mean[gravity::WP],
        }
    }

    /// Variance of the yaw rate, rad^2/s^2.
    pub(super) fn yaw_rate_variance(&self) -> f64 {
        match self {
            Self::Basic(belief) => belief.covariance[(model::R, model::R)],
            Self::Biased(belief) => belief.covariance[(model::R, model::R)],
            Self::Gravity(belief) => belief.covariance[(gravity::R, gravity::R)],
        }
    }

    /// Variances of distance, m^2, and heading, rad^2.
    pub(super) fn pose_variances(&self) -> [f64; 2] {
        match self {
            Self::Basic(belief) => [model::S, model::ALPHA].map(|state| belief.covariance[(state, state)]),
            Self::Biased(belief) => [model::S, model::ALPHA].map(|state| belief.covariance[(state, state)]),
            Self::Gravity(belief) => [gravity::S, gravity::PSI].map(|state| belief.covariance[(state, state)]),
        }
    }

    /// Variance of the force's offset, N^2; 0 where that is no state.
    pub(super) fn force_variance(&self) -> f64 {
        match self {
            Self::Basic(_) => 0.0,
            Self::Biased(belief) => belief.covariance[(model::FORCE_OFFSET, model::FORCE_OFFSET)],
            Self::Gravity(belief) => belief.covariance[(biased_gravity::FORCE_OFFSET, biased_gravity::FORCE_OFFSET)],
        }
    }

    /// The force's offset, N; none where that is no state.
    pub(super) fn force_offset(&self) -> Option<f64> {
        match self {
            Self::Basic(_) => None,
            Self::Biased(belief) => Some(belief.mean[model::FORCE_OFFSET]),
            Self::Gravity(belief) => Some(belief.mean[biased_gravity::FORCE_OFFSET]),
        }
    }

    /// Tilt of the ground, 1 where the chair stands on end.
    pub(super) fn tilt(&self) -> f64 {
        match self {
            Self::Basic(belief) => belief.mean[model::XI].abs() / FRAC_PI_2,
            Self::Biased(belief) => belief.mean[model::XI].abs() / FRAC_PI_2,
            Self::Gravity(belief) => belief.mean[gravity::GX].hypot(belief.mean[gravity::GY]),
        }
    }

    /// Whether mean and covariance are finite and no variance is negative.
    pub(super) fn is_valid(&self) -> bool {
        match self {
            Self::Basic(belief) => belief.is_valid(),
            Self::Biased(belief) => belief.is_valid(),
            Self::Gravity(belief) => belief.is_valid(),
        }
    }
}
