//! Whether speed and slope can be what they are called.

use super::parameters::{Parameters, Radii};
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

/// Windows for which the noise counts that the sensors are said to have.
const NOISE_WINDOWS: f64 = 6.0;
/// Largest share of the slip that is put down to a delay.
const LARGEST_SHARE: f64 = 0.8;

/// What is known before the first sample of `[1/K, d, tau]`, and the noise of a slip speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlipSpeed {
    stiffness: f64,
    /// Variances of `1/K` and of the mean of the radii's errors, as the filter takes them.
    compliance: f64,
    radius: f64,
    /// Variances of the delay of a speed that is late and of one that is not, s2.
    delay: f64,
    together: f64,
    /// Variance of one sample, m2/s2.
    noise: f64,
}

impl SlipSpeed {
    /// From the parameters.
    pub fn new(p: &Parameters) -> Self {
        let (initial, std) = (&p.initial, &p.filter.measurement_std);
        let [front, rear] = p.loader.wheel_radius();
        Self {
            stiffness: initial.slip_stiffness,
            compliance: (initial.slip_stiffness_std / initial.slip_stiffness.powi(2)).powi(2),
            radius: if p.filter.radii == Radii::Estimated { 0.5 * initial.wheel_radius_std.powi(2) } else { 0.0 },
            delay: std.speed_delay.powi(2),
            together: std.speed_delay.min(p.sample_period).powi(2),
            noise: std.speed.powi(2) + 0.25 * (front * front + rear * rear) * std.wheel_speed.powi(2),
        }
    }
}

/// What a speed that may be late may have done to the estimates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Doubt {
    /// How far the slip stiffness may be off, relatively.
    pub stiffness: f64,
    /// Specific force at which the slips were seen, on average, m/s2.
    pub specific_force: f64,
}

/// Two contradictions.
///
/// *A late speed.* Slip grows with the torque: the slip speed `e = r w - v` is `v mu/K`. A speed that comes `tau` late
/// adds `tau v'` to it, which does not grow with the speed. `e = v x/K + v d + tau v'` is linear in `1/K`, the radii's
/// error `d` and `tau`, and a machine that changes its speed tells them apart. The filter knows of no delay and puts it into
/// `1/K` and `d`: by how much follows from the same equations, and how large the delay may be from what was known of it
/// ([`SlipSpeed`]) and what the windows say. So the standard deviations contain a delay until it is proved, or none.
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
    /// Sum of the specific forces, weighted as the windows count for `1/K`.
    weighted_force: f64,
    late: bool,
    /// Root mean square of what the delay, as far as it is known, makes of the filter's `1/K`.
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

/// Mean square of a delay, s2, of which `mean` and `variance` are known if its variance before was that of a late speed.
///
/// A speed comes within a sample period of the wheel speeds or it is late, the one as likely as the other. What the windows say,
/// the information `j` and `z = j tau`, makes the weight `exp(z^2 v/2)/sqrt(1 + P j)` of a delay whose variance was `P` and is
/// `v = P/(1 + P j)`.
fn mean_square_delay(mean: f64, variance: f64, [together, late]: [f64; 2]) -> f64 {
    if variance <= 0.0 || late <= 0.0 {
        return 0.0;
    }
    let (j, z) = ((1.0 / variance - 1.0 / late).max(0.0), mean / variance);
    let [together, late] = [together, late].map(|before| {
        let spread = 1.0 / (1.0 + before * j);
        let after = before * spread;
        (0.5 * (spread.ln() + z * z * after), after + (after * z).powi(2))
    });
    let share = 1.0 / (1.0 + (together.0 - late.0).exp());
    (1.0 - share) * together.1 + share * late.1
}

impl SpeedEvidence {
    /// Whether speed or slope contradict the rest.
    pub fn contradicts(&self) -> bool {
        self.late || self.sloping
    }

    /// What a delay may have done to an estimate of this slip stiffness.
    pub fn doubt(&self, stiffness: f64) -> Doubt {
        let share = (stiffness * self.bias).min(LARGEST_SHARE);
        let weight = self.normal[(0, 0)];
        let specific_force = if weight > 0.0 { self.weighted_force / weight } else { 0.0 };
        Doubt { stiffness: share / (1.0 - share), specific_force }
    }

    /// Nothing was measured: the present window begins anew.
    pub fn interrupt(&mut self) {
        self.window = Window::default();
    }

    /// Takes the measurements `y` of a machine that drives without spinning wheels. Returns true at the sample that first
    /// shows a contradiction.
    pub fn update(
        &mut self,
        known: &SlipSpeed,
        (radius, steady, drive): ([f64; 2], &SteadySlip, &Drive),
        y: &Vector3<f64>,
        dt: f64,
    ) -> bool {
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
        self.judge_delay(known, &window);
        self.judge_slope(&window, v);
        self.contradicts() && !before
    }

    fn judge_delay(&mut self, known: &SlipSpeed, window: &Window) {
        let (x, slip) = (window.x / window.samples, window.slip / window.samples);
        let fading = 1.0 / (1.0 + WINDOW / MEMORY);
        self.weighted_force = self.weighted_force * fading + x[0] * x[0] * window.gain / window.time;
        self.normal = self.normal * fading + x * x.transpose();
        self.right = self.right * fading + x * slip;
        self.square = self.square * fading + slip * slip;
        self.windows = self.windows * fading + 1.0;
        let white = known.noise / window.samples;
        let start = Vector3::new(1.0 / known.stiffness, 0.0, 0.0);
        let as_filter = Vector3::new(known.compliance, known.radius, known.delay);
        let mut noise = white;
        let Some((theta, variance)) = self.posterior(&start, &as_filter, &mut noise) else { return };
        // The filter has no delay among its unknowns.
        let mean_square = mean_square_delay(theta[2], variance[2], [known.together, known.delay]);
        let (a, b) = (self.normal[(0, 0)] + noise / known.compliance, self.normal[(0, 1)]);
        let taken = if known.radius > 0.0 {
            let d = self.normal[(1, 1)] + noise / known.radius;
            (d * self.normal[(0, 2)] - b * self.normal[(1, 2)]) / (a * d - b * b)
        } else {
            self.normal[(0, 2)] / a
        };
        self.bias = taken.abs() * mean_square.sqrt();
        if self.time < VERDICT_TIME {
            return;
        }
        // A verdict believes nothing of what was known before.
        let Some(inverse) = self.normal.try_inverse() else { return };
        let theta = inverse * self.right;
        let residual = (self.square - theta.dot(&self.right)).max(0.0) / (self.windows - 3.0).max(1.0);
        let (tau, std) = (theta[2].abs(), (residual * inverse[(2, 2)].max(0.0)).sqrt());
        if tau > CONFIDENCE * std && tau - std > DELAY {
            self.late = true;
        } else if self.late && tau + std < DELAY {
            self.late = false;
        }
    }

    /// Mean and variances of `[1/K, d, tau]` by the windows and by what was known of them: `start`, with variances `known`.
    /// `noise`, the variance of a window's slip speed by the sensors, becomes that by the residuals, if this is larger.
    fn posterior(
        &self,
        start: &Vector3<f64>,
        known: &Vector3<f64>,
        noise: &mut f64,
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let solve = |noise: f64| {
            // Nothing is known better than to the last digits: a standard deviation may be 0.
            let information = known.map(|variance| noise / variance.max(1e-20));
            let inverse = (self.normal + Matrix3::from_diagonal(&information)).try_inverse()?;
            Some((inverse * (self.right + information.component_mul(start)), inverse.diagonal()))
        };
        let (theta, _) = solve(*noise)?;
        let residual = (self.square - 2.0 * theta.dot(&self.right) + theta.dot(&(self.normal * theta))).max(0.0);
        *noise = noise.max((NOISE_WINDOWS * *noise + residual) / (NOISE_WINDOWS + self.windows));
        let (theta, diagonal) = solve(*noise)?;
        Some((theta, diagonal.map(|variance| (variance * *noise).max(0.0))))
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
