//! One time update and one measurement update of the chair, for any of its states.
//!
//! [`ChairEkf`] joins the model's forms ([`Form`]) with the extended Kalman filter and is what the
//! reference runs check; [`Wheelchair`](super::Wheelchair) puts inputs, standstill and outputs around it.

use super::brake::Brake;
use super::contour::MOVING;
use super::outliers::{ACCEL_X, downweight};
use super::vibration::{LARGEST, LARGEST_DRIVEN};
use super::watch::{GYRO, HEADING, LEFT, TRAVEL, UPWARD, Watch};
use crate::filter::discretise::{runge_kutta, runge_kutta_from, substeps, transition};
use crate::filter::ekf::{self, NotPositiveDefinite, Rows};
use crate::filter::gaussian::Gaussian;
use crate::filter::innovation::{Gate, Innovation};
use crate::model::wheelchair::{Chair, Command, Output, encoder_covariance};
use nalgebra::{Matrix3, SMatrix, SVector, Vector2};
use std::f64::consts::{PI, TAU};

/// Noise of process (power spectral densities) and measurements (standard deviations), SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// White acceleration, m^2/s^3.
    pub speed: f64,
    /// White yaw acceleration, rad^2/s^3.
    pub yaw_rate: f64,
    /// White second derivative of the slope, rad^2/s^3.
    pub slope_rate: f64,
    /// Drift of the gyro's bias, rad^2/s^3.
    pub gyro_bias: f64,
    /// Drift of the accelerometer's bias, m^2/s^5.
    pub accel_bias: f64,
    /// Drift of the heading relative to the encoders, rad^2/s.
    pub heading_offset: f64,
    /// Drift of an unmodelled force, N^2/s.
    pub force_offset: f64,
    /// Drift of an unmodelled moment, (N m)^2/s.
    pub moment_offset: f64,
    /// One wheel angle, rad.
    pub encoder: f64,
    /// Gyro, rad/s.
    pub gyro: f64,
    /// Accelerometer per axis, m/s^2.
    pub accel: f64,
    /// Second derivative of the slope as the accelerometer's lever feels it, rad/s^2.
    pub slope_acceleration: f64,
    /// Speed of a chair at standstill, a pseudo-measurement, m/s.
    pub standstill_speed: f64,
    /// Yaw rate and tilt rates of a chair at standstill, pseudo-measurements, rad/s.
    pub standstill_rate: f64,
}

/// Limits of steps and of the influence of outliers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Longest step that is taken as one, s.
    pub substep: f64,
    /// Longest step that is taken at all, s.
    pub longest_step: f64,
    /// Beyond this many standard deviations an accelerometer's row counts the less the further off it is; 0 = never.
    pub outlier_threshold: f64,
}

/// The chair and all that a step needs besides the state.
#[derive(Clone, Debug, PartialEq)]
pub struct ChairEkf<F> {
    /// The chair.
    pub chair: Chair,
    /// Noise.
    pub noise: Noise,
    /// Limits.
    pub limits: Limits,
    /// The gate.
    pub gate: Gate,
    /// The form of the state.
    pub form: F,
}

/// How a state of `N` numbers moves and is measured; the first `K` of them move by themselves, the others
/// only by noise, and `P` of them are zero at standstill.
pub trait Form<const N: usize, const K: usize, const P: usize> {
    /// The states that are zero at standstill: the speed, then rates.
    const AT_REST: [usize; P];
    /// Distance and heading.
    const POSE: [usize; 2];
    /// The states that say how the ground is tilted.
    const TILT: &'static [usize];

    /// The heading relative to the one line across which the ground may tilt; none where it may tilt any way.
    fn heading_to_contour(x: &SVector<f64, N>) -> Option<f64>;
    /// Whether the measured forward acceleration drives the motion instead of being a measurement.
    fn takes_acceleration(&self) -> bool {
        false
    }
    /// Whether it does over a step.
    fn is_driven_by_acceleration(&self, drive: &Drive) -> bool {
        self.takes_acceleration() && drive.accel_x.is_some() && !drive.still
    }
    /// `x' = f(x, u)`.
    fn derivative(&self, chair: &Chair, x: &SVector<f64, N>, drive: &Drive) -> SVector<f64, N>;
    /// [`derivative`](Self::derivative) with the first `K` rows of its Jacobian; the others are zero.
    fn linearise(&self, chair: &Chair, x: &SVector<f64, N>, drive: &Drive) -> (SVector<f64, N>, SMatrix<f64, K, N>);
    /// Adds the noise of a step of `dt` with the density `speed` of the acceleration to a belief at its end.
    fn add_process_noise(
        &self,
        belief: &mut Gaussian<N>,
        chair: &Chair,
        drive: &Drive,
        noise: &Noise,
        speed: f64,
        dt: f64,
    );
    /// What a brake that holds a tilt adds to the rates of the states, and to the forward and leftward accelerometer, per rad
    /// of tilt; none where the force's errors are no states.
    fn held_by_brake(&self, chair: &Chair, x: &SVector<f64, N>) -> Option<(SVector<f64, K>, [f64; 2])>;
    /// `y = h(x, u)`.
    fn observe(&self, chair: &Chair, x: &SVector<f64, N>, drive: &Drive) -> Expected<N>;
}

/// What the sensors are expected to read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected<const N: usize> {
    /// The reading.
    pub output: Output,
    /// Its derivative over the state.
    pub jacobian: SMatrix<f64, 6, N>,
    /// Per (rad/s^2)^2, what the slope's second derivative adds to the accelerometer's covariance.
    pub tilt_noise: Matrix3<f64>,
}

/// What drives the chair over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Force and moment, held over the step.
    pub command: Command,
    /// Measured forward specific force, m/s^2, for the form that is driven by it.
    pub accel_x: Option<f64>,
    /// Variance of the vibration in it, (m/s^2)^2.
    pub vibration: f64,
    /// Density of the random walk of a force that nobody reports beyond its usual drift, N^2/s.
    pub push: f64,
    /// Density of the white noise of a yaw acceleration that nobody reports beyond its usual one, rad^2/s^3.
    pub turn: f64,
    /// The chair stands still.
    pub still: bool,
}

impl Drive {
    /// The command alone: no acceleration drives the chair, and nothing is known beside what is reported.
    pub fn reported(command: Command, still: bool) -> Self {
        Self { command, accel_x: None, vibration: 0.0, push: 0.0, turn: 0.0, still }
    }
}

/// One measurement; NaN = missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// `[s_enc, alpha_enc, gyro, a_x, a_y, a_z]`.
    pub values: Output,
    /// With one wheel only: row 1 is this wheel's travel instead of `s_enc`, the number its distance
    /// from the encoder reference point (right positive), and row 2 is missing.
    pub single_wheel: Option<f64>,
}

impl From<Output> for Sample {
    fn from(values: Output) -> Self {
        Self { values, single_wheel: None }
    }
}

/// What a measurement update did: the rows of the sensors, and of the standstill.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// The six sensor rows.
    pub sensors: Innovation<6>,
    /// Normalised innovation squared of all rows.
    pub nis: f64,
    /// Number of rows with a sample, with the pseudo-measurements of the standstill.
    pub dof: usize,
}

/// Standard deviation of a chair's speed (m/s), yaw rate and tilt rates (rad/s) of which nothing is known.
const UNKNOWN_RATE: f64 = 2.0;
/// Standard deviation of the change of the ground's tilt since the chair was last seen, rad.
const UNKNOWN_TILT: f64 = 0.1;
/// Travel of the first samples that is so many standard deviations from the expected is that of another speed at the start.
const FAR: f64 = 4.0;

/// Whether a row is so far from its prediction that something taken as given is not so.
fn is_far<const N: usize>(rows: &Rows<N, 6>, row: usize, belief: &Gaussian<N>) -> bool {
    let variance = rows.expected_variance(row, belief) + rows.noise[(row, row)];
    rows.innovation[row].powi(2) > FAR * FAR * variance
}

impl<F> ChairEkf<F> {
    /// Time update over `dt > 0` seconds, in equal sub-steps if it is long.
    pub fn predict<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &mut Gaussian<N>,
        dt: f64,
        drive: &Drive,
    ) where
        F: Form<N, K, P>,
    {
        self.predict_watched(belief, &mut Brake::default(), dt, drive);
    }

    /// [`predict`](Self::predict) with a brake that may hold the chair.
    pub(super) fn predict_watched<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &mut Gaussian<N>,
        brake: &mut Brake,
        dt: f64,
        drive: &Drive,
    ) where
        F: Form<N, K, P>,
    {
        let steps = substeps(dt, self.limits.substep);
        let h = dt / steps as f64;
        // An acceleration measured once and held over dt is white noise of this density.
        let driven = self.form.is_driven_by_acceleration(drive);
        let variance = self.noise.accel * self.noise.accel + drive.vibration;
        let density = if driven { variance * dt } else { self.noise.speed };
        for _ in 0..steps {
            let (rate, jacobian) = self.form.linearise(&self.chair, &belief.mean, drive);
            let mean = runge_kutta_from(&belief.mean, &rate, h, |x| self.form.derivative(&self.chair, x, drive));
            let transition = transition(&jacobian, h);
            if brake.is_unknown() {
                // The mean over the step of what comes in and then moves.
                let adds = self.held(&belief.mean, brake, drive).map_or_else(SVector::zeros, |(rates, _)| {
                    (transition.fixed_columns::<K>(0) * rates + rates) * (0.5 * h)
                });
                let mut beside = brake.beside();
                beside.predict(&transition, &adds);
                brake.keep(&beside);
            }
            ekf::predict(belief, mean, &transition);
            self.form.add_process_noise(belief, &self.chair, drive, &self.noise, density, h);
        }
    }

    /// The mean `horizon` seconds later, the filter untouched; the mean as it is where it would leave all bounds.
    pub fn carry_forward<const N: usize, const K: usize, const P: usize>(
        &self,
        mean: &SVector<f64, N>,
        horizon: f64,
        drive: &Drive,
    ) -> SVector<f64, N>
    where
        F: Form<N, K, P>,
    {
        if horizon <= 0.0 {
            return *mean;
        }
        let steps = substeps(horizon, self.limits.substep);
        let h = horizon / steps as f64;
        let moved = (0..steps).fold(*mean, |x, _| runge_kutta(&x, h, |x| self.form.derivative(&self.chair, x, drive)));
        if moved.iter().all(|value| value.is_finite()) { moved } else { *mean }
    }

    /// Measurement update with the command that acts at the sampling instant.
    pub fn correct<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &mut Gaussian<N>,
        counters: &mut [u32; 6],
        sample: &Sample,
        drive: &Drive,
    ) -> Result<Correction, NotPositiveDefinite>
    where
        F: Form<N, K, P>,
    {
        let mut brake = Brake::default();
        self.correct_rows(belief, counters, &mut brake, &mut self.rows(belief, sample, drive), drive)
    }

    /// [`correct`](Self::correct) by a sample that came `dt` seconds after the last one, with a watch over what the filter
    /// takes as given: speed and yaw rate at the start as long as the watch [begins](Watch::begins).
    pub fn correct_watched<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &mut Gaussian<N>,
        counters: &mut [u32; 6],
        (watch, dt): (&mut Watch, f64),
        sample: &Sample,
        drive: &Drive,
    ) -> Result<Correction, NotPositiveDefinite>
    where
        F: Form<N, K, P>,
    {
        let mut rows = self.rows(belief, sample, drive);
        let far = |row: usize| rows.used[row] && is_far(&rows, row, belief);
        if watch.begins(dt) && (far(TRAVEL) || far(HEADING)) {
            self.bridge_gap(belief, 0.0);
            rows = self.rows(belief, sample, drive);
        }
        // It feels the cosine of the tilt. Where no gyro says how that changes, linear rows about one estimate after another would seem to tell it
        // from the accelerometer's bias, which none of them does.
        rows.used[UPWARD] &= rows.used[GYRO];
        let largest = if self.form.takes_acceleration() { LARGEST_DRIVEN } else { LARGEST };
        let gated = self.gate.deviations > 0.0;
        watch.vibration.add(&mut rows, self.noise.accel * self.noise.accel, dt, largest, gated);
        self.add_turn(&mut rows, watch, dt);
        let mut contradicted = false;
        if let Some(alpha) = F::heading_to_contour(&belief.mean) {
            let moves = !drive.still && belief.mean[F::AT_REST[0]].abs() > MOVING;
            contradicted = watch.compare_with_contour((alpha, moves), self.chair.gravity, belief, &rows, dt)
                && rows.used[LEFT]
                && self.gate.deviations <= 0.0;
            rows.used[LEFT] &= !contradicted;
        }
        let mut done = self.correct_rows(belief, counters, &mut watch.brake, &mut rows, drive)?;
        done.sensors.rejected[LEFT] |= contradicted;
        Ok(done)
    }

    /// Adds what the accelerometer feels of a yaw acceleration that nobody reports.
    pub(super) fn add_turn<const N: usize>(&self, rows: &mut Rows<N, 6>, watch: &Watch, dt: f64) {
        let variance = watch.turn.variance(dt);
        let [dx, dy, _] = self.chair.lever();
        let lever = Vector2::new(-dy, dx);
        let mut noise = rows.noise.fixed_view_mut::<2, 2>(ACCEL_X, ACCEL_X);
        noise += lever * lever.transpose() * variance;
    }

    fn correct_rows<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &mut Gaussian<N>,
        counters: &mut [u32; 6],
        brake: &mut Brake,
        rows: &mut Rows<N, 6>,
        drive: &Drive,
    ) -> Result<Correction, NotPositiveDefinite>
    where
        F: Form<N, K, P>,
    {
        // Without a gate nothing else uses its counters.
        let robust = self.limits.outlier_threshold > 0.0 && self.gate.deviations <= 0.0;
        let impact =
            if robust { downweight(self.limits.outlier_threshold, belief, rows, &mut counters[ACCEL_X]) } else { 0.0 };
        let before = if drive.still { Some(*belief) } else { None };
        let felt = self.held(&belief.mean, brake, drive).map_or([0.0; 2], |(_, felt)| felt);
        let mut beside = brake.is_unknown().then(|| brake.beside());
        let sensors = {
            let beside = beside.as_mut().map(|beside| (beside, [0.0, 0.0, 0.0, felt[0], felt[1], 0.0]));
            ekf::correct_beside(belief, rows, Some((self.gate, counters)), beside)?
        };
        let Some(before) = before else {
            beside.inspect(|beside| brake.keep(beside));
            return Ok(Correction { nis: sensors.nis + impact, dof: sensors.dof, sensors });
        };
        // Independent of the sensors' noise and linear: updating in turn equals stacking the rows.
        let mut at_rest = Rows {
            innovation: SVector::<f64, P>::zeros(),
            jacobian: SMatrix::<f64, P, N>::zeros(),
            noise: SMatrix::<f64, P, P>::identity() * (self.noise.standstill_rate * self.noise.standstill_rate),
            used: [true; P],
        };
        at_rest.noise[(0, 0)] = self.noise.standstill_speed * self.noise.standstill_speed;
        for (row, state) in F::AT_REST.into_iter().enumerate() {
            at_rest.innovation[row] = -belief.mean[state];
            at_rest.jacobian[(row, state)] = 1.0;
        }
        let rest = ekf::correct_beside(belief, &at_rest, None, beside.as_mut().map(|beside| (beside, [0.0; P])))
            .inspect_err(|_| *belief = before)?;
        beside.inspect(|beside| brake.keep(beside));
        Ok(Correction { nis: rest.nis + sensors.nis + impact, dof: sensors.dof + rest.dof, sensors })
    }

    /// [`Form::held_by_brake`] while a brake may hold the chair and the filter does not know that it stands.
    fn held<const N: usize, const K: usize, const P: usize>(
        &self,
        x: &SVector<f64, N>,
        brake: &Brake,
        drive: &Drive,
    ) -> Option<(SVector<f64, K>, [f64; 2])>
    where
        F: Form<N, K, P>,
    {
        if brake.holds() && !drive.still { self.form.held_by_brake(&self.chair, x) } else { None }
    }

    /// After a gap that the model cannot bridge: speeds and tilt rates are unknown, distance, heading and tilt have
    /// moved at such speeds; what the sensors get wrong stays as it was.
    pub fn bridge_gap<const N: usize, const K: usize, const P: usize>(&self, belief: &mut Gaussian<N>, gap: f64)
    where
        F: Form<N, K, P>,
    {
        for state in F::AT_REST {
            belief.reset_state(state, 0.0, UNKNOWN_RATE * UNKNOWN_RATE);
        }
        let [distance, heading] = [UNKNOWN_RATE * gap, (UNKNOWN_RATE * gap).min(PI)];
        for (state, std) in F::POSE.into_iter().zip([distance, heading]) {
            belief.inflate(state, std * std);
        }
        for state in F::TILT {
            belief.inflate(*state, UNKNOWN_TILT * UNKNOWN_TILT);
        }
    }

    /// Puts a belief where the encoders see the chair, distance and heading; how it moves is unknown.
    pub fn start_at<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &mut Gaussian<N>,
        pose: Option<[f64; 2]>,
    ) where
        F: Form<N, K, P>,
    {
        for (state, value) in F::POSE.into_iter().zip(pose.into_iter().flatten()) {
            belief.mean[state] = value;
        }
        self.bridge_gap(belief, 0.0);
    }

    /// Ends a standstill: the chair may have begun to move before the bands could show it, so speed,
    /// yaw rate and tilt rates become as uncertain as `std` says.
    pub fn end_standstill<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &mut Gaussian<N>,
        std: [f64; P],
    ) where
        F: Form<N, K, P>,
    {
        for (state, std) in F::AT_REST.into_iter().zip(std) {
            belief.inflate(state, std * std);
        }
    }

    /// The rows that have a sample.
    pub(super) fn rows<const N: usize, const K: usize, const P: usize>(
        &self,
        belief: &Gaussian<N>,
        sample: &Sample,
        drive: &Drive,
    ) -> Rows<N, 6>
    where
        F: Form<N, K, P>,
    {
        let Expected { output: predicted, mut jacobian, tilt_noise } =
            self.form.observe(&self.chair, &belief.mean, drive);
        let mut innovation = sample.values - predicted;
        let mut noise = SMatrix::<f64, 6, 6>::zeros();
        noise.fixed_view_mut::<2, 2>(0, 0).copy_from(&encoder_covariance(&self.chair, self.noise.encoder));
        noise[(2, 2)] = self.noise.gyro * self.noise.gyro;
        let mut accel = tilt_noise * (self.noise.slope_acceleration * self.noise.slope_acceleration);
        for axis in 0..3 {
            accel[(axis, axis)] += self.noise.accel * self.noise.accel;
        }
        noise.fixed_view_mut::<3, 3>(3, 3).copy_from(&accel);

        if let Some(lever) = sample.single_wheel {
            let turned = predicted[1] - self.chair.heading_reference;
            innovation[0] -= lever * turned;
            let turning = jacobian.row(1) * lever;
            let mut travel = jacobian.row_mut(0);
            travel += turning;
            let per_wheel = self.chair.body.wheel_radius * self.noise.encoder;
            noise[(0, 0)] = per_wheel * per_wheel;
        } else {
            innovation[1] = wrap(innovation[1]);
        }

        let mut used = [true; 6];
        for (row, used) in used.iter_mut().enumerate() {
            *used = sample.values[row].is_finite();
        }
        used[1] &= sample.single_wheel.is_none();
        used[ACCEL_X] &= !self.form.takes_acceleration() || drive.still;
        Rows { innovation, jacobian, noise, used }
    }
}

/// An angle in [-pi, pi).
pub fn wrap(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}
