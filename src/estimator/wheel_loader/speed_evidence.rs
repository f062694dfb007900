//! Whether speed and slope can be what they are called.

use crate::model::wheel_loader::{Drive, GRAVITY, SteadySlip};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Memory of the regressions, s, and time of driving before a verdict.
const MEMORY: f64 = 30.0;
const VERDICT_TIME: f64 = 8.0;
/// Window over which is averaged, s: longer than tyres bounce, shorter than a machine accelerates.
const WINDOW: f64 = 0.5;
/// Windows of the momentum balance that count as one, for what changes slowly.
const CLUSTER: f64 = 2.0;
/// Standard errors of a verdict.
const CONFIDENCE: f64 = 5.0;
/// Delay of the speed that spoils slip, s: at 3 m/s it changes the slip stiffness by its standard deviation.
const DELAY: f64 = 3e-3;
/// Largest acceleration that forces, mass and rolling resistance as given leave unexplained, m/s2.
const UNEXPLAINED: f64 = 1.0;
/// How far from 1 the slope's effect may be, and the standard error from which it is known.
const SLOPE_ERROR: f64 = 0.4;
const SLOPE_KNOWN: f64 = 0.15;

/// Two contradictions.
///
/// *A late speed.* Slip grows with the torque: the slip speed `e = r w - v` is `v mu/K`. A speed that comes `tau` late
/// adds `tau v'` to it, which does not grow with the speed. `e = v x/K + v d + tau v'` is linear in `1/K`, the radii's
/// error `d` and `tau`, and a machine that changes its speed tells them apart.
///
/// *A slope that gravity does not follow.* Over a second the speed gains what the forces give and the slope takes,
/// `dv = T (a - kappa g sin alpha)`, with `kappa = 1` if the slope is one. In degrees, per cent or with the other sign it is
/// not, and what is left is more than mass or rolling resistance can explain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpeedEvidence {
    /// Time of driving, s.
    time: f64,
    window: Window,
    /// Normal equations of `e = v x/K + v d + tau v'`, sum of `e^2`, windows in them.
    normal: Matrix3<f64>,
    right: Vector3<f64>,
    square: f64,
    windows: f64,
    late: bool,
    /// What the delay that the data point to makes of `1/K`.
    bias: f64,
    /// Weight, sums of gravity `G`, of what the forces leave of `dv/T` `y`, of `G^2`, `G y`, `y^2`.
    balance: [f64; 6],
    sloping: bool,
}

/// Sums over the present window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Window {
    samples: f64,
    time: f64,
    /// Sums of the regressors `[v x, v, v']` and of the slip speed.
    x: Vector3<f64>,
    slip: f64,
    /// Its first speed.
    start: f64,
    /// Integrals of the acceleration by all forces but gravity and of gravity along the slope, m/s.
    gain: f64,
    gravity: f64,
}

impl SpeedEvidence {
    /// Whether speed or slope contradict the rest.
    pub fn contradicts(&self) -> bool {
        self.late || self.sloping
    }

    /// How far the slip stiffness may be off, relatively, by a delay that the data point to but do not prove. By as much
    /// is the difference of the axles' loads, from which share and height follow: a delay adds the same to both slips.
    pub fn relative_error(&self, stiffness: f64) -> f64 {
        let share = (stiffness * self.bias.abs()).min(0.5);
        share / (1.0 - share)
    }

    /// Nothing was measured: the present window begins anew.
    pub fn interrupt(&mut self) {
        self.window = Window::default();
    }

    /// Takes the measurements `y` of a machine that drives without spinning wheels. Returns true at the sample that first
    /// shows a contradiction.
    pub fn update(&mut self, radius: [f64; 2], steady: &SteadySlip, drive: &Drive, y: &Vector3<f64>, dt: f64) -> bool {
        if !y.iter().all(|value| value.is_finite()) {
            self.interrupt();
            return false;
        }
        let (v, a) = (y[0], steady.acceleration);
        let gravity = GRAVITY * drive.slope.sin();
        let window = &mut self.window;
        if window.samples == 0.0 {
            window.start = v;
        } else {
            window.time += dt;
            window.gain += dt * (a + gravity);
            window.gravity += dt * gravity;
        }
        window.samples += 1.0;
        window.x += Vector3::new(0.5 * v.abs() * (steady.demand[0] + steady.demand[1]), v, a);
        window.slip += 0.5 * (radius[0] * y[1] + radius[1] * y[2]) - v;
        self.time = (self.time + dt).min(1e9);
        if window.time < WINDOW {
            return false;
        }
        let before = self.contradicts();
        let window = std::mem::take(&mut self.window);
        self.judge_delay(&window);
        self.judge_slope(&window, v);
        self.contradicts() && !before
    }

    fn judge_delay(&mut self, window: &Window) {
        let (x, slip) = (window.x / window.samples, window.slip / window.samples);
        let fading = 1.0 / (1.0 + WINDOW / MEMORY);
        self.normal = self.normal * fading + x * x.transpose();
        self.right = self.right * fading + x * slip;
        self.square = self.square * fading + slip * slip;
        self.windows = self.windows * fading + 1.0;
        let Some(inverse) = self.normal.try_inverse() else { return };
        if self.time < VERDICT_TIME {
            return;
        }
        let theta = inverse * self.right;
        let residual = (self.square - theta.dot(&self.right)).max(0.0) / (self.windows - 3.0).max(1.0);
        let (tau, std) = (theta[2].abs(), (residual * inverse[(2, 2)].max(0.0)).sqrt());
        if tau > CONFIDENCE * std && tau - std > DELAY {
            self.late = true;
        } else if self.late && tau + std < DELAY {
            self.late = false;
        }
        // Without the delay among its unknowns a regression puts it into 1/K and d.
        let determinant = self.normal[(0, 0)] * self.normal[(1, 1)] - self.normal[(0, 1)] * self.normal[(0, 1)];
        let moment = self.normal[(1, 1)] * self.normal[(0, 2)] - self.normal[(0, 1)] * self.normal[(1, 2)];
        self.bias = if determinant > 0.0 { moment / determinant * (tau - 2.0 * std).max(0.0) } else { 0.0 };
    }

    fn judge_slope(&mut self, window: &Window, v: f64) {
        let (y, g) = ((v - window.start - window.gain) / window.time, window.gravity / window.time);
        let fading = 1.0 / (1.0 + WINDOW / MEMORY);
        for (sum, new) in self.balance.iter_mut().zip([1.0, g, y, g * g, g * y, y * y]) {
            *sum = fading * *sum + new;
        }
        if self.time < VERDICT_TIME {
            return;
        }
        let [n, mean_g, mean_y, gg, gy, yy] = self.balance.map(|sum| sum / self.balance[0]);
        let independent = n * self.balance[0] / CLUSTER;
        let (var_g, cov, var_y) = (gg - mean_g * mean_g, gy - mean_g * mean_y, yy - mean_y * mean_y);
        let kappa = -cov / var_g.max(1e-12);
        let left = (var_y + kappa * cov).max(0.0);
        let std = (left / (independent * var_g.max(1e-12))).sqrt();
        let wrong_effect = std < SLOPE_KNOWN && (kappa - 1.0).abs() > SLOPE_ERROR + CONFIDENCE * std;
        let unexplained = (mean_y + mean_g).abs();
        let spread = (gg + 2.0 * gy + yy - unexplained * unexplained).max(0.0);
        let wrong_level = unexplained > UNEXPLAINED + CONFIDENCE * (spread / independent).sqrt();
        if wrong_effect || wrong_level {
            self.sloping = true;
        } else if self.sloping && unexplained < 0.5 * UNEXPLAINED && (kappa - 1.0).abs() < SLOPE_ERROR + std {
            self.sloping = false;
        }
    }
}
