//! The states that the filter can carry.

use super::ekf::{Drive, Expected, Form, Noise};
use crate::filter::discretise::white_rate_noise;
use crate::filter::gaussian::Gaussian;
use crate::model::wheelchair::{self as model, Chair, biased_gravity, gravity};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Six states: [`model::State`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basic;

/// Thirteen states with what sensors and drive get wrong: [`model::BiasedState`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Biased {
    /// What moves the chair.
    pub mover: Mover,
}

/// What the speed's rate is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mover {
    /// The drive force.
    Force,
    /// The measured acceleration, its noise white as in the source.
    Acceleration,
    /// The measured acceleration, in which a tipping chair moves the sensor by its height: with `a_x`
    /// containing `m_x xi''` ([`tilt_lever`](model::tilt_lever)) the noise `xi''` that drives the slope
    /// drives the speed by `-m_x xi''`.
    TippingAcceleration,
}

/// Fifteen states with the direction of gravity: [`biased_gravity::State`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GravityVector {
    /// What moves the chair.
    pub mover: Mover,
}

/// Adds the noise of (position, rate) pairs.
pub(super) fn add_paired_noise<const N: usize>(
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

/// Adds the noise of states from `first` on that walk at random.
fn add_drift<const N: usize, const D: usize>(
    covariance: &mut SMatrix<f64, N, N>,
    dt: f64,
    first: usize,
    densities: [f64; D],
) {
    for (k, density) in densities.into_iter().enumerate() {
        covariance[(first + k, first + k)] += density * dt;
    }
}

/// Drift of an unmodelled force. While the force moves nothing, its errors are neither observable nor harmful.
fn force_drift(noise: &Noise, drive: &Drive) -> f64 {
    if drive.still { 0.0 } else { noise.force_offset + drive.push }
}

/// The pairs of a chair with heading and slope.
fn chair_pairs(noise: &Noise, drive: &Drive, speed: f64) -> [(usize, usize, f64); 3] {
    let yaw_rate = noise.yaw_rate + drive.turn;
    [(model::S, model::V, speed), (model::ALPHA, model::R, yaw_rate), (model::XI, model::W, noise.slope_rate)]
}

/// Adds what the noise of the pair `(slope, its rate)` does to the pair (distance, speed), `gain` times as much.
fn add_tipping_noise<const N: usize>(
    covariance: &mut SMatrix<f64, N, N>,
    dt: f64,
    density: f64,
    gain: f64,
    [s, v, slope, rate]: [usize; 4],
) {
    let (a, b, c) = white_rate_noise(density, dt);
    let (own, mut mixed) = (gain * gain, |i, j, value| {
        covariance[(i, j)] += value;
        if i != j {
            covariance[(j, i)] += value;
        }
    });
    mixed(s, s, own * a);
    mixed(s, v, own * b);
    mixed(v, v, own * c);
    mixed(s, slope, gain * a);
    mixed(s, rate, gain * b);
    mixed(v, slope, gain * b);
    mixed(v, rate, gain * c);
}

/// `v'` and `r'` per rad of tilt, of which these are the shares along and across the heading, by what holds a chair against
/// gravity.
fn against_gravity(chair: &Chair, [along, across]: [f64; 2]) -> [f64; 2] {
    let weight = chair.body.mass * chair.gravity;
    [weight * along / chair.inertial_mass(), weight * chair.body.com_ahead * across / chair.inertia_at_axle()]
}

/// What holding a chair against gravity at a heading adds to the rates of the first five states and to the forward and leftward
/// accelerometer, per rad of tilt.
fn held_at(chair: &Chair, heading: f64) -> (SVector<f64, 5>, [f64; 2]) {
    let (sa, ca) = heading.sin_cos();
    let [v_dot, r_dot] = against_gravity(chair, [sa, ca]);
    let mut rates = SVector::<f64, 5>::zeros();
    (rates[model::V], rates[model::R]) = (v_dot, r_dot);
    let [dx, dy, _] = chair.lever();
    (rates, [v_dot - dy * r_dot, dx * r_dot])
}

fn outer(lever: Vector3<f64>) -> Matrix3<f64> {
    lever * lever.transpose()
}

/// All but the slope's rate moves.
impl Form<6, 5, 3> for Basic {
    const AT_REST: [usize; 3] = [model::V, model::R, model::W];
    const POSE: [usize; 2] = [model::S, model::ALPHA];
    const TILT: &'static [usize] = &[model::XI];

    fn heading_to_contour(x: &model::State) -> Option<f64> {
        Some(x[model::ALPHA])
    }
    fn derivative(&self, chair: &Chair, x: &model::State, drive: &Drive) -> model::State {
        model::derivative(chair, x, &drive.command, drive.still)
    }
    fn linearise(&self, chair: &Chair, x: &model::State, drive: &Drive) -> (model::State, SMatrix<f64, 5, 6>) {
        model::linearise(chair, x, &drive.command, drive.still)
    }
    fn add_process_noise(
        &self,
        belief: &mut Gaussian<6>,
        _: &Chair,
        drive: &Drive,
        noise: &Noise,
        speed: f64,
        dt: f64,
    ) {
        add_paired_noise(&mut belief.covariance, dt, chair_pairs(noise, drive, speed));
    }
    fn held_by_brake(&self, chair: &Chair, x: &model::State) -> Option<(SVector<f64, 5>, [f64; 2])> {
        Some(held_at(chair, x[model::ALPHA]))
    }
    fn observe(&self, chair: &Chair, x: &model::State, drive: &Drive) -> Expected<6> {
        let seen = model::observe(chair, x, &drive.command, drive.still);
        Expected { output: seen.output, jacobian: seen.jacobian, tilt_noise: outer(seen.tilt_lever) }
    }
}

/// The slope's rate, the biases and the force's errors do not move.
impl Form<13, 5, 3> for Biased {
    const AT_REST: [usize; 3] = [model::V, model::R, model::W];
    const POSE: [usize; 2] = [model::S, model::ALPHA];
    const TILT: &'static [usize] = &[model::XI];

    fn heading_to_contour(x: &model::BiasedState) -> Option<f64> {
        Some(x[model::ALPHA])
    }
    fn takes_acceleration(&self) -> bool {
        self.mover != Mover::Force
    }
    fn derivative(&self, chair: &Chair, x: &model::BiasedState, drive: &Drive) -> model::BiasedState {
        match drive.accel_x {
            Some(a) if self.takes_acceleration() => {
                model::acceleration_driven(chair, x, &drive.command, a, drive.still)
            }
            _ => model::biased_derivative(chair, x, &drive.command, drive.still),
        }
    }
    fn linearise(
        &self,
        chair: &Chair,
        x: &model::BiasedState,
        drive: &Drive,
    ) -> (model::BiasedState, SMatrix<f64, 5, 13>) {
        let (u, still) = (&drive.command, drive.still);
        match drive.accel_x {
            Some(a) if self.takes_acceleration() => model::acceleration_driven_linearise(chair, x, u, a, still),
            _ => model::biased_linearise(chair, x, u, still),
        }
    }
    fn add_process_noise(
        &self,
        belief: &mut Gaussian<13>,
        chair: &Chair,
        drive: &Drive,
        noise: &Noise,
        speed: f64,
        dt: f64,
    ) {
        let covariance = &mut belief.covariance;
        add_paired_noise(covariance, dt, chair_pairs(noise, drive, speed));
        let force = if self.mover == Mover::Force { force_drift(noise, drive) } else { 0.0 };
        let (accel, offset) = (noise.accel_bias, noise.heading_offset);
        let drift = [noise.gyro_bias, accel, accel, accel, offset, 0.0, force];
        add_drift(covariance, dt, model::GYRO_BIAS, drift);
        if self.mover == Mover::TippingAcceleration && self.is_driven_by_acceleration(drive) {
            let lever = model::tilt_lever(chair, belief.mean[model::ALPHA])[0];
            let states = [model::S, model::V, model::XI, model::W];
            add_tipping_noise(covariance, dt, noise.slope_rate, -lever, states);
        }
    }
    fn held_by_brake(&self, chair: &Chair, x: &model::BiasedState) -> Option<(SVector<f64, 5>, [f64; 2])> {
        (self.mover == Mover::Force).then(|| held_at(chair, x[model::ALPHA]))
    }
    fn observe(&self, chair: &Chair, x: &model::BiasedState, drive: &Drive) -> Expected<13> {
        let seen = model::biased_observe(chair, x, &drive.command, drive.still);
        Expected { output: seen.output, jacobian: seen.jacobian, tilt_noise: outer(seen.tilt_lever) }
    }
}

/// The rates of pitch and roll, the biases and the errors of force and moment do not move.
impl Form<15, 6, 4> for GravityVector {
    const AT_REST: [usize; 4] = [gravity::V, gravity::R, gravity::WP, gravity::WR];
    const POSE: [usize; 2] = [gravity::S, gravity::PSI];
    const TILT: &'static [usize] = &[gravity::GX, gravity::GY];

    fn heading_to_contour(_: &biased_gravity::State) -> Option<f64> {
        None
    }
    fn takes_acceleration(&self) -> bool {
        self.mover != Mover::Force
    }
    fn derivative(&self, chair: &Chair, x: &biased_gravity::State, drive: &Drive) -> biased_gravity::State {
        let (u, still) = (&drive.command, drive.still);
        match drive.accel_x {
            Some(a) if self.takes_acceleration() => biased_gravity::driven_derivative(chair, x, u, a, still),
            _ => biased_gravity::derivative(chair, x, u, still),
        }
    }
    fn linearise(
        &self,
        chair: &Chair,
        x: &biased_gravity::State,
        drive: &Drive,
    ) -> (biased_gravity::State, SMatrix<f64, 6, 15>) {
        let (u, still) = (&drive.command, drive.still);
        match drive.accel_x {
            Some(a) if self.takes_acceleration() => biased_gravity::driven_linearise(chair, x, u, a, still),
            _ => biased_gravity::linearise(chair, x, u, still),
        }
    }
    fn add_process_noise(
        &self,
        belief: &mut Gaussian<15>,
        chair: &Chair,
        drive: &Drive,
        noise: &Noise,
        speed: f64,
        dt: f64,
    ) {
        use gravity::{GX, GY, PSI, R, S, V, WP, WR};
        let pairs = [
            (S, V, speed),
            (PSI, R, noise.yaw_rate + drive.turn),
            (GX, WP, noise.slope_rate),
            (GY, WR, noise.slope_rate),
        ];
        let covariance = &mut belief.covariance;
        add_paired_noise(covariance, dt, pairs);
        let force = if self.mover == Mover::Force { force_drift(noise, drive) } else { 0.0 };
        let moment = if drive.still { 0.0 } else { noise.moment_offset };
        let accel = noise.accel_bias;
        let drift = [noise.gyro_bias, accel, accel, accel, 0.0, force, moment];
        add_drift(covariance, dt, biased_gravity::GYRO_BIAS, drift);
        if self.mover == Mover::TippingAcceleration && self.is_driven_by_acceleration(drive) {
            let [pitching, _] = gravity::tilt_levers(chair);
            add_tipping_noise(covariance, dt, noise.slope_rate, -pitching[0], [S, V, GX, WP]);
        }
    }
    /// Along the heading only: the moment's error is a state.
    fn held_by_brake(&self, chair: &Chair, _: &biased_gravity::State) -> Option<(SVector<f64, 6>, [f64; 2])> {
        let [v_dot, _] = against_gravity(chair, [1.0, 0.0]);
        let mut rates = SVector::<f64, 6>::zeros();
        rates[gravity::V] = v_dot;
        (self.mover == Mover::Force).then_some((rates, [v_dot, 0.0]))
    }
    fn observe(&self, chair: &Chair, x: &biased_gravity::State, drive: &Drive) -> Expected<15> {
        let (output, jacobian) = biased_gravity::observe(chair, x, &drive.command, drive.still);
        let [pitching, rolling] = gravity::tilt_levers(chair);
        Expected { output, jacobian, tilt_noise: outer(pitching) + outer(rolling) }
    }
}
