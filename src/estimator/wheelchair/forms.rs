//! The states the observer can work with.

use super::observer::{Drive, Expected, Form, Noise};
use crate::filter::discretise::white_rate_noise;
use crate::model::wheelchair::{self as model, Chair, gravity};
use nalgebra::{Matrix3, SMatrix, Vector3};

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

/// Adds the noise of (position, rate) pairs.
fn add_paired_noise<const N: usize>(
    covariance: &mut SMatrix<f64, N, N>,
    dt: f64,
    pairs: impl IntoIterator<Item = (usize, usize, f64)>,
) {
    for (position, rate, density) in pairs {
        let (a, b, c) = white_rate_noise(density, dt);
        covariance[(position, position)] += a;
        covariance[(position, rate)] += b;
        covariance[(rate, position)] += b;
        covariance[(rate, rate)] += c;
    }
}

/// The pairs of a chair with heading and slope.
fn chair_pairs(noise: &Noise, speed: f64) -> [(usize, usize, f64); 3] {
    [(model::S, model::V, speed), (model::ALPHA, model::R, noise.yaw_rate), (model::XI, model::W, noise.slope_rate)]
}

fn outer(lever: Vector3<f64>) -> Matrix3<f64> {
    lever * lever.transpose()
}

/// All but the slope's rate moves.
impl Form<6, 5, 3> for Basic {
    const AT_REST: [usize; 3] = [model::V, model::R, model::W];

    fn derivative(&self, chair: &Chair, x: &model::State, drive: &Drive) -> model::State {
        model::derivative(chair, x, &drive.command, drive.still)
    }
    fn linearise(&self, chair: &Chair, x: &model::State, drive: &Drive) -> (model::State, SMatrix<f64, 5, 6>) {
        model::linearise(chair, x, &drive.command, drive.still)
    }
    fn add_process_noise(&self, covariance: &mut SMatrix<f64, 6, 6>, noise: &Noise, speed: f64, dt: f64) {
        add_paired_noise(covariance, dt, chair_pairs(noise, speed));
    }
    fn observe(&self, chair: &Chair, x: &model::State, drive: &Drive) -> Expected<6> {
        let seen = model::observe(chair, x, &drive.command, drive.still);
        Expected { output: seen.output, jacobian: seen.jacobian, tilt_noise: outer(seen.tilt_lever) }
    }
}

/// The slope's rate and the biases do not move.
impl Form<11, 5, 3> for Biased {
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
    fn linearise(
        &self,
        chair: &Chair,
        x: &model::BiasedState,
        drive: &Drive,
    ) -> (model::BiasedState, SMatrix<f64, 5, 11>) {
        let (u, still) = (&drive.command, drive.still);
        match drive.accel_x {
            Some(a) if self.acceleration_input => model::acceleration_driven_linearise(chair, x, u, a, still),
            _ => model::biased_linearise(chair, x, u, still),
        }
    }
    fn add_process_noise(&self, covariance: &mut SMatrix<f64, 11, 11>, noise: &Noise, speed: f64, dt: f64) {
        add_paired_noise(covariance, dt, chair_pairs(noise, speed));
        let drift = [noise.gyro_bias, noise.accel_bias, noise.accel_bias, noise.accel_bias, noise.heading_offset];
        for (k, density) in drift.into_iter().enumerate() {
            covariance[(6 + k, 6 + k)] += density * dt;
        }
    }
    fn observe(&self, chair: &Chair, x: &model::BiasedState, drive: &Drive) -> Expected<11> {
        let seen = model::biased_observe(chair, x, &drive.command, drive.still);
        Expected { output: seen.output, jacobian: seen.jacobian, tilt_noise: outer(seen.tilt_lever) }
    }
}

/// All but the rates of pitch and roll moves.
impl Form<8, 6, 4> for GravityVector {
    const AT_REST: [usize; 4] = [gravity::V, gravity::R, gravity::WP, gravity::WR];

    fn derivative(&self, chair: &Chair, x: &gravity::State, drive: &Drive) -> gravity::State {
        gravity::derivative(chair, x, &drive.command, drive.still)
    }
    fn linearise(&self, chair: &Chair, x: &gravity::State, drive: &Drive) -> (gravity::State, SMatrix<f64, 6, 8>) {
        gravity::linearise(chair, x, &drive.command, drive.still)
    }
    fn add_process_noise(&self, covariance: &mut SMatrix<f64, 8, 8>, noise: &Noise, speed: f64, dt: f64) {
        use gravity::{GX, GY, PSI, R, S, V, WP, WR};
        let pairs = [(S, V, speed), (PSI, R, noise.yaw_rate), (GX, WP, noise.slope_rate), (GY, WR, noise.slope_rate)];
        add_paired_noise(covariance, dt, pairs);
    }
    fn observe(&self, chair: &Chair, x: &gravity::State, drive: &Drive) -> Expected<8> {
        let (output, jacobian) = gravity::observe(chair, x, &drive.command, drive.still);
        let [pitching, rolling] = gravity::tilt_levers(chair);
        Expected { output, jacobian, tilt_noise: outer(pitching) + outer(rolling) }
    }
}
