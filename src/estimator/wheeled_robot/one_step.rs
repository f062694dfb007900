//! What the filter expected of a sample.

use super::measure::Measured;
use super::{Inputs, RobotMachine, State};
use crate::estimator::Elapsed;
use crate::estimator::one_step::{OneStepPrediction, PredictedMeasurement};
use crate::model::wheeled_robot::{Motion, specific_force_at};
use nalgebra::Vector3;

/// The channels of a sample; `speed` is that over ground, measured or from the wheels.
const CHANNELS: [(&str, &str); 4] = [("accel_x", "m/s2"), ("accel_y", "m/s2"), ("gyro_z", "rad/s"), ("speed", "m/s")];

impl RobotMachine {
    /// See [`Machine::predict_one_step`](crate::estimator::Machine::predict_one_step): the cubature points of the predicted belief
    /// through the measurement equation, with the constants' errors and the noise ([`crate::filter::srckf`]).
    pub(super) fn predict_one_step(
        &self,
        before: &State,
        inputs: &Inputs,
        elapsed: Elapsed,
        into: &mut OneStepPrediction,
    ) {
        let mut state = before.clone();
        let Measured { slopes, driven, z, noise, rolled, .. } = self.measure(&mut state, inputs, elapsed);
        let imu = &self.parameters.imu;
        let (mean, factor) = (state.belief.mean, state.belief.factor * 3f64.sqrt());
        let points: [Vector3<f64>; 6] =
            std::array::from_fn(|k| mean + factor.column(k % 3) * if k < 3 { 1.0 } else { -1.0 });
        let accelerations = driven.accelerations_of(&points.map(Motion::from));
        let seen: [[f64; 4]; 6] = std::array::from_fn(|k| {
            let (ax, ay) = specific_force_at(accelerations[k], points[k][2], imu.x, imu.y);
            [ax, ay, points[k][2], points[k][0]]
        });
        let shown = self.constants.shown(&state.cross, &slopes, &mean.into(), rolled);
        for (row, (channel, unit)) in CHANNELS.into_iter().enumerate() {
            let expected = seen.iter().map(|point| point[row]).sum::<f64>() / 6.0;
            let spread = seen.iter().map(|point| (point[row] - expected).powi(2)).sum::<f64>() / 6.0;
            let variance = spread + shown.row(row).norm_squared() + noise[row] * noise[row];
            into.expected.push(PredictedMeasurement::new(channel, unit, z[row], z[row] - expected, variance));
        }
    }
}
