//! The model made discrete, fine enough at every speed.

use super::parameters::{MOST_SUBSTEPS, Method, Parameters};
use crate::ParameterError;
use crate::filter::discretise::runge_kutta;
use crate::model::wheeled_robot::{Driven, Motion, WheeledRobot};
use nalgebra::SMatrix;

/// Steps per sample where the parameters leave it open, or as many more as are needed.
const USUAL: f64 = 3.0;

/// How the equations of motion are made discrete.
#[derive(Clone, Debug)]
pub(super) struct Integration {
    method: Method,
    /// Speed below which the lateral dynamics get no faster, m/s.
    minimum_speed: f64,
    /// Rate of the lateral dynamics at this speed, 1/s.
    rate: f64,
    /// Largest product of rate and step that the integrator takes.
    stable: f64,
    /// Most steps per sample.
    most: u32,
}

impl Integration {
    /// Refuses too few steps: explicit integration must not overshoot at the minimum speed, where the lateral dynamics
    /// are fastest.
    pub fn new(p: &Parameters, model: &WheeledRobot) -> Result<Self, ParameterError> {
        let method = p.filter.integrator;
        let stable = match method {
            Method::Euler => 1.0,
            Method::Rk4 => 2.5, // stable up to 2.78
        };
        let minimum_speed = p.filter.minimum_speed;
        let rate = model.lateral_rate(minimum_speed);
        let needed = (rate * p.sample_period / stable).ceil();
        let most = match p.filter.substeps.unsigned_abs() {
            0 => needed.clamp(USUAL, f64::from(MOST_SUBSTEPS)) as u32,
            most => most,
        };
        if f64::from(most) >= needed {
            return Ok(Self { method, minimum_speed, rate, stable, most });
        }
        let reason = format!(
            "is too few: the lateral dynamics at filter.minimum_speed = {minimum_speed} m/s have the rate {rate:.1} 1/s, \
             so that with sample_period = {} s each substep must not exceed {:.3e} s; needed are {needed} substeps (or a \
             higher minimum speed)",
            p.sample_period,
            stable / rate
        );
        Err(ParameterError { name: "filter.substeps".to_owned(), value: f64::from(most), unit: "1", reason })
    }

    /// Motions after `dt` seconds, the inputs being held; `speed` is about theirs.
    pub fn advance<const N: usize>(&self, driven: &Driven, x: [Motion; N], dt: f64, speed: f64) -> [Motion; N] {
        let substeps = self.substeps(speed, dt);
        let h = dt / f64::from(substeps);
        // one motion per column
        let derivative = |x: &SMatrix<f64, 3, N>| SMatrix::from(driven.derivatives_of(&x.data.0));
        let step = |x: SMatrix<f64, 3, N>, _| match self.method {
            Method::Euler => x + derivative(&x) * h,
            Method::Rk4 => runge_kutta(&x, h, derivative),
        };
        (0..substeps).fold(SMatrix::from(x), step).data.0
    }

    /// Steps of the integrator at a speed: what keeps it at half its limit of stability, but no more than the
    /// parameter allows. The lateral dynamics slow down with speed.
    fn substeps(&self, speed: f64, dt: f64) -> u32 {
        let rate = self.rate * self.minimum_speed / speed.abs().max(self.minimum_speed);
        (2.0 * rate * dt / self.stable).ceil().clamp(1.0, f64::from(self.most)) as u32
    }
}
