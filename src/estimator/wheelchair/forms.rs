//! The states the observer can work with.

use super::observer::{Drive, Form, Noise};
use crate::filter::discretise::white_rate_noise;
use crate::model::wheelchair::{self as model, Chair, Output};
use nalgebra::{Matrix3, SMatrix};

/// Six states: [`model::State`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basic;

/// Eleven states with sensor biases: [`model::BiasedState`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Biased {
    /// The measured acceleration takes the place of the drive force.
    pub acceleration_input: bool,
}

/// Eight states with the direction of gravity: [`model::gravity::State`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GravityVector;

/// Noise of (position, rate) pairs.
fn paired_noise<const N: usize>(pairs: [(usize, usize, f64); N], dt: f64, q: &mut impl FnMut(usize, usize, f64)) {
    for (position, rate, density) in pairs {
        let (a, b, c) = white_rate_noise(density, dt);
        q(position, position, a);
        q(position, rate, b);
        q(rate, position, b);
        q(rate, rate, c);
    }
}

fn outer(lever: nalgebra::Vector3<f64>) -> Matrix3<f64> {
    lever * lever.transpose()
}

impl Form<6, 3> for Basic {
    const AT_REST: [usize; 3] = [model::V, model::R, model::W];

    fn derivative(&self, chair: &Chair, x: &model::State, drive: &Drive) -> model::State {
        model::derivative(chair, x, &drive.command, drive.still)
    }
    fn jacobian(&self, chair: &Chair, x: &model::State, drive: &Drive) -> SMatrix<f64, 6, 6> {
        model::jacobian(chair, x, &drive.command, drive.still)
    }
    fn process_noise(&self, noise: &Noise, speed: f64, dt: f64) -> SMatrix<f64, 6, 6> {
        let mut q = SMatrix::zeros();
        let pairs = [
            (model::S, model::V, speed),
            (model::ALPHA, model::R, noise.yaw_rate),
            (model::XI, model::W, noise.slope_rate),
        ];
        paired_noise(pairs, dt, &mut |i, j, value| q[(i, j)] = value);
        q
    }
    fn output(&self, chair: &Chair, x: &model::State, drive: &Drive) -> (Output, SMatrix<f64, 6, 6>) {
        let (u, still) = (&drive.command, drive.still);
        model::observe(chair, x, u, still)
    }
    fn tilt_noise(&self, chair: &Chair, x: &model::State) -> Matrix3<f64> {
        outer(model::tilt_lever(chair, x[model::ALPHA]))
    }
}

impl Form<11, 3> for Biased {
    const AT_REST: [usize; 3] = [model::V, model::R, model::W];

    fn driven_by_acceleration(&self) -> bool {
        self.acceleration_input
    }
    fn derivative(&self, chair: &Chair, x: &model::BiasedState, drive: &Drive) -> model::BiasedState {
        match drive.accel_x {
            Some(a) if self.acceleration_input => model::acceleration_driven(chair, x, &drive.command, a, drive.still),
            _ => model::biased_derivative(chair, x, &drive.command, drive.still),
        }
    }
    fn jacobian(&self, chair: &Chair, x: &model::BiasedState, drive: &Drive) -> SMatrix<f64, 11, 11> {
        match drive.accel_x {
            Some(_) if self.acceleration_input => {
                model::acceleration_driven_jacobian(chair, x, &drive.command, drive.still)
            }
            _ => model::biased_jacobian(chair, x, &drive.command, drive.still),
        }
    }
    fn process_noise(&self, noise: &Noise, speed: f64, dt: f64) -> SMatrix<f64, 11, 11> {
        let mut q = SMatrix::<f64, 11, 11>::zeros();
        q.fixed_view_mut::<6, 6>(0, 0).copy_from(&Basic.process_noise(noise, speed, dt));
        let drift = [noise.gyro_bias, noise.accel_bias, noise.accel_bias, noise.accel_bias, noise.heading_offset];
        for (k, density) in drift.into_iter().enumerate() {
            q[(6 + k, 6 + k)] = density * dt;
        }
        q
    }
    fn output(&self, chair: &Chair, x: &model::BiasedState, drive: &Drive) -> (Output, SMatrix<f64, 6, 11>) {
        let (u, still) = (&drive.command, drive.still);
        model::biased_observe(chair, x, u, still)
    }
    fn tilt_noise(&self, chair: &Chair, x: &model::BiasedState) -> Matrix3<f64> {
        outer(model::tilt_lever(chair, x[model::ALPHA]))
    }
}

impl Form<8, 4> for GravityVector {
    const AT_REST: [usize; 4] = [model::gravity::V, model::gravity::R, model::gravity::WP, model::gravity::WR];

    fn derivative(&self, chair: &Chair, x: &model::gravity::State, drive: &Drive) -> model::gravity::State {
        model::gravity::derivative(chair, x, &drive.command, drive.still)
    }
    fn jacobian(&self, chair: &Chair, x: &model::gravity::State, drive: &Drive) -> SMatrix<f64, 8, 8> {
        model::gravity::jacobian(chair, x, drive.still)
    }
    fn process_noise(&self, noise: &Noise, speed: f64, dt: f64) -> SMatrix<f64, 8, 8> {
        use model::gravity::{GX, GY, PSI, R, S, V, WP, WR};
        let mut q = SMatrix::zeros();
        let pairs = [(S, V, speed), (PSI, R, noise.yaw_rate), (GX, WP, noise.slope_rate), (GY, WR, noise.slope_rate)];
        paired_noise(pairs, dt, &mut |i, j, value| q[(i, j)] = value);
        q
    }
    fn output(&self, chair: &Chair, x: &model::gravity::State, drive: &Drive) -> (Output, SMatrix<f64, 6, 8>) {
        let (u, still) = (&drive.command, drive.still);
        (model::gravity::output(chair, x, u, still), model::gravity::output_jacobian(chair, x, still))
    }
    fn tilt_noise(&self, chair: &Chair, _x: &model::gravity::State) -> Matrix3<f64> {
        let [pitching, rolling] = model::gravity::tilt_levers(chair);
        outer(pitching) + outer(rolling)
    }
}
