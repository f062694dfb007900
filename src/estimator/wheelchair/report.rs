//! The outputs: what the filter believes, carried forward and told in the user's terms.

use super::observer::Drive;
use super::{ChairBelief, Inputs, Outputs, Wheelchair};
use crate::filter::belief::Belief;
use crate::model::wheelchair::{self as model, Command, biased_gravity, gravity, pitch};
use nalgebra::SVector;
use std::f64::consts::{FRAC_PI_2, PI};

/// A slope below this many of its standard deviations may as well be flat.
const SIGNIFICANT: f64 = 3.0;

/// Without any measurement for this long the estimates are not healthy, s.
const LONGEST_SILENCE: f64 = 1.0;

impl Wheelchair {
    /// Speed and yaw rate.
    pub(super) fn motion(&self) -> (f64, f64) {
        match &self.state.belief {
            ChairBelief::Basic(filter) => (filter.mean[model::V], filter.mean[model::R]),
            ChairBelief::Biased(filter) => (filter.mean[model::V], filter.mean[model::R]),
            ChairBelief::Gravity(filter) => (filter.mean[gravity::V], filter.mean[gravity::R]),
        }
    }

    /// Whether the ground is steep enough to tell where uphill is.
    pub(super) fn heading_is_observable(&self) -> bool {
        let (slope, std) = match &self.state.belief {
            ChairBelief::Basic(filter) => (filter.mean[model::XI], filter.std(model::XI)),
            ChairBelief::Biased(filter) => (filter.mean[model::XI], filter.std(model::XI)),
            ChairBelief::Gravity(filter) => {
                let attitude = attitude(&filter.mean, filter);
                (attitude.slope, attitude.slope_std)
            }
        };
        slope.abs() > SIGNIFICANT * std
    }

    pub(super) fn report(&self, inputs: &Inputs, ahead: f64, outputs: &mut Outputs) {
        let held = |value: f64, last: f64, limit: f64| if value.abs() <= limit { value } else { last };
        let [force, moment] = self.state.command;
        let limit = &self.parameters.limit;
        let drive = Drive {
            command: Command::new(
                held(inputs.drive_force, force, limit.drive_force),
                held(inputs.drive_moment, moment, limit.drive_moment),
            ),
            accel_x: Some(inputs.accel_x).filter(|a| a.abs() < limit.accel),
            still: self.state.standstill.is_still() && self.parameters.filter.detect_standstill,
        };
        let ahead = if self.state.started { ahead } else { 0.0 };
        match &self.state.belief {
            ChairBelief::Basic(filter) => {
                let mean = self.basic.carry_forward(&filter.mean, ahead, &drive);
                self.report_chair(&mean, filter, outputs);
            }
            ChairBelief::Biased(filter) => {
                let mean = self.biased.carry_forward(&filter.mean, ahead, &drive);
                self.report_chair(&mean, filter, outputs);
                report_biases(&mean, filter, [model::GYRO_BIAS, model::FORCE_GAIN], outputs);
                outputs.heading_offset = mean[model::HEADING_OFFSET];
                outputs.heading_offset_std = filter.std(model::HEADING_OFFSET);
            }
            ChairBelief::Gravity(filter) => {
                let mean = self.gravity.carry_forward(&filter.mean, ahead, &drive);
                report_gravity(&mean, filter, outputs);
                report_biases(&mean, filter, [biased_gravity::GYRO_BIAS, biased_gravity::FORCE_GAIN], outputs);
            }
        }
        let state = &self.state;
        outputs.standstill = drive.still;
        outputs.nis = if state.dof > 0 { state.nis / f64::from(state.dof) } else { 0.0 };
        outputs.nis_channels = state.dof as i32;
        outputs.log_likelihood = state.log_likelihood;
        outputs.status = state.status;
        outputs.healthy = state.started
            && state.silent <= LONGEST_SILENCE
            && !state.strain.contradicts()
            && outputs.slope_std <= limit.healthy_slope_std
            && outputs.speed_std <= limit.healthy_speed_std;
    }

    /// The outputs that come from the first six states, with or without biases behind them.
    fn report_chair<const N: usize>(&self, x: &SVector<f64, N>, belief: &Belief<N>, outputs: &mut Outputs) {
        let (std, covariance) = (|index: usize| belief.std(index), &belief.covariance);
        // (alpha, xi, w) and (alpha + pi, -xi, -w) are the same pose.
        let turned = self.parameters.filter.canonical_slope && x[model::XI] < 0.0;
        let sign = if turned { -1.0 } else { 1.0 };
        (outputs.distance, outputs.distance_std) = (x[model::S], std(model::S));
        outputs.heading = x[model::ALPHA] + if turned { PI } else { 0.0 };
        outputs.heading_std = std(model::ALPHA);
        (outputs.speed, outputs.speed_std) = (x[model::V], std(model::V));
        (outputs.yaw_rate, outputs.yaw_rate_std) = (x[model::R], std(model::R));
        (outputs.slope, outputs.slope_std) = (sign * x[model::XI], std(model::XI));
        (outputs.slope_rate, outputs.slope_rate_std) = (sign * x[model::W], std(model::W));
        let (angle, [a, b]) = pitch(x[model::ALPHA], x[model::XI]);
        outputs.pitch = angle;
        let (i, j) = (model::ALPHA, model::XI);
        let variance = a * a * covariance[(i, i)] + 2.0 * a * b * covariance[(i, j)] + b * b * covariance[(j, j)];
        // Where the chair stands on end the gradient has a pole.
        outputs.pitch_std = variance.max(0.0).sqrt().min(FRAC_PI_2);
    }
}

/// Biases of the four sensors from `sensors` on, errors of the force from `force` on.
fn report_biases<const N: usize>(
    x: &SVector<f64, N>,
    belief: &Belief<N>,
    [sensors, force]: [usize; 2],
    outputs: &mut Outputs,
) {
    let told = |index: usize| (x[index], belief.std(index));
    (outputs.gyro_bias, outputs.gyro_bias_std) = told(sensors);
    (outputs.accel_x_bias, outputs.accel_x_bias_std) = told(sensors + 1);
    (outputs.accel_y_bias, outputs.accel_y_bias_std) = told(sensors + 2);
    (outputs.accel_z_bias, outputs.accel_z_bias_std) = told(sensors + 3);
    (outputs.force_gain_error, outputs.force_gain_error_std) = told(force);
    (outputs.force_offset, outputs.force_offset_std) = told(force + 1);
}

fn attitude(x: &biased_gravity::State, belief: &Belief<14>) -> gravity::Attitude {
    gravity::attitude(&biased_gravity::chair_state(x), &belief.covariance.fixed_view::<8, 8>(0, 0).into_owned())
}

fn report_gravity(mean: &biased_gravity::State, filter: &Belief<14>, outputs: &mut Outputs) {
    let attitude = attitude(mean, filter);
    (outputs.distance, outputs.distance_std) = (mean[gravity::S], filter.std(gravity::S));
    (outputs.speed, outputs.speed_std) = (mean[gravity::V], filter.std(gravity::V));
    (outputs.yaw_rate, outputs.yaw_rate_std) = (mean[gravity::R], filter.std(gravity::R));
    (outputs.heading, outputs.heading_std) = (attitude.heading, attitude.heading_std);
    (outputs.slope, outputs.slope_std) = (attitude.slope, attitude.slope_std);
    (outputs.slope_rate, outputs.slope_rate_std) = (attitude.slope_rate, attitude.slope_rate_std);
    (outputs.pitch, outputs.pitch_std) = (attitude.pitch, attitude.pitch_std);
}
