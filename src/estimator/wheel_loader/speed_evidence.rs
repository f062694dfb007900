//! Whether speed and slope can be what they are called.

use super::coordinates::Map;
use super::parameters::{Parameters, Radii};
use crate::model::wheel_loader::{Drive, GRAVITY, SteadySlip};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Memory of the regressions, s, and time of driving before a verdict.
const MEMORY: f64 = 30.0;
const VERDICT_TIME: f64 = 8.0;
/// Memory of what is known of the delay, s.
const DELAY_MEMORY: f64 = 300.0;
/// Window over which is averaged, s: longer than tyres bounce, shorter than a machine accelerates.
const WINDOW: f64 = 0.5;
/// Windows of the momentum balance that count as one, for what changes slowly.
const CLUSTER: f64 = 2.0;
/// How often is asked what a delay may have done, s: the filter learns as fast.
const ASKED: f64 = 0.1;
/// Standard errors of a verdict, and of what a delay has to show to count in the standard deviations.
const CONFIDENCE: f64 = 5.0;
const SEEN: f64 = 4.0;
/// Delay of the speed that spoils slip, s: at 3 m/s it changes the slip stiffness by its standard deviation.
const DELAY: f64 = 3e-3;
/// Largest acceleration that forces, mass and rolling resistance as given leave unexplained, m/s2.
const UNEXPLAINED: f64 = 1.0;
/// How far from 1 the slope's effect may be, and the standard error from which it is known.
const SLOPE_ERROR: f64 = 0.4;
const SLOPE_KNOWN: f64 = 0.15;

/// Windows for which the noise counts that the sensors are said to have.
const NOISE_WINDOWS: f64 = 6.0;
/// A wrong scale has so many times the standard deviation of usual ones. Machines for each one that has it, and the probability from
/// which on it is expected all the same.
const WRONG: f64 = 4.0;
const RIGHT: f64 = 100.0;
const EXPECTED: f64 = 0.1;
/// Largest share of the slip that is put down to a delay.
const LARGEST_SHARE: f64 = 0.9;

/// What is known before the first sample of `[1/K, d, tau]`, and the noise of a slip speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlipSpeed {
    stiffness: f64,
    /// Variances of `1/K` and of the mean of the radii's errors, as the filter takes them.
    compliance: f64,
    radius: f64,
    /// Power spectral densities of their drift, 1/s.
    compliance_psd: f64,
    radius_psd: f64,
    /// Variances of the delay of a speed that is late and of one that is not, s2.
    delay: f64,
    together: f64,
    /// Variances of the speed's scale, which looks like an error of both radii: usually, and where it is wrong.
    scale: f64,
    scaled: f64,
    /// Variance of one sample, m2/s2.
    noise: f64,
}

impl SlipSpeed {
    /// Standard deviation of one sample's slip speed by the sensors' noise, m/s.
    pub fn std(&self) -> f64 {
        self.noise.sqrt()
    }

    /// From the parameters.
    pub fn new(p: &Parameters, map: &Map) -> Self {
        let (initial, std, walk) = (&p.initial, &p.filter.measurement_std, &p.filter.process_psd);
        let [front, rear] = p.loader.wheel_radius();
        // Fixed radii are those of this speed.
        let scale = if p.filter.radii == Radii::Estimated { std.speed_scale } else { 0.0 };
        let by_logit = map.unit[0] * map.derivative_of(0, initial.slip_stiffness);
        Self {
            stiffness: initial.slip_stiffness,
            compliance: (initial.slip_stiffness_std / initial.slip_stiffness.powi(2)).powi(2),
            radius: if p.filter.radii == Radii::Estimated { 0.5 * initial.wheel_radius_std.powi(2) } else { 0.0 },
            compliance_psd: walk.slip_stiffness * (by_logit / initial.slip_stiffness.powi(2)).powi(2),
            radius_psd: if p.filter.radii == Radii::Estimated { 0.5 * walk.wheel_radius } else { 0.0 },
            delay: std.speed_delay.powi(2),
            // Anywhere within a sample period, before or after.
            together: std.speed_delay.min(p.sample_period / 3f64.sqrt()).powi(2),
            scale: scale * scale,
            scaled: (WRONG * scale).powi(2),
            noise: std.speed.powi(2) + 0.25 * (front * front + rear * rear) * std.wheel_speed.powi(2),
        }
    }
}

/// What a speed that may be late or have a wrong scale may have done to the estimates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Doubt {
    /// How far the slip stiffness may be off, relatively.
    pub stiffness: f64,
    /// The same by a scale that is usual.
    pub scale: f64,
    /// How far the radii may be off, relatively.
    pub radius: f64,
    /// Specific force at which the slips were seen, on average, m/s2.
    pub specific_force: f64,
}

/// Two contradictions, and a doubt.
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
///
/// *A speed of a wrong scale.* It adds `v d` to the slip speed as radii do that are off by `d`, only that `d` is far beyond the
/// radii's standard deviation, which the filter, sure of them, rather puts into `1/K`. So the same windows are also looked at by
/// somebody who takes this for possible; as far as they speak for it, the standard deviations contain how far the two are apart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedEvidence {
    /// Time of driving, s.
    time: f64,
    window: Window,
    /// What the windows before say of the slip speed.
    slips: Slips,
    posterior: Posterior,
    /// The same where the speed's scale may be wrong.
    scaled: Posterior,
    late: bool,
    /// What delay and scale may have done when that was last asked, which was so long ago, s.
    effect: Effect,
    since: f64,
    /// Weight, sums of gravity `G`, of what the forces leave of `dv/T` `y`, of `G^2`, `G y`, `y^2`.
    balance: [f64; 6],
    sloping: bool,
}

/// Normal equations of `e = v x/K + v d + tau v'` over windows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Slips {
    normal: Matrix3<f64>,
    right: Vector3<f64>,
    /// Sum of `e^2`.
    square: f64,
    windows: f64,
    /// Sum of the specific forces, weighted as the windows count for `1/K`.
    weighted_force: f64,
}

/// Mean and covariance of `[1/K, d, tau]` by all windows and by what was known before the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Posterior {
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// Variance of a window's slip speed: by the sensors, or by the residuals, if this is larger.
    noise: f64,
    /// Sum of the squares of the innovations, each as far as it is noise, and windows in it.
    residual: f64,
    windows: f64,
}

/// What delay and scale, as far as they are known, make of the filter's estimates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Effect {
    /// Root mean square of its part of `1/K`.
    compliance: f64,
    /// Specific force at which the slips were seen, on average, m/s2.
    specific_force: f64,
    /// Root mean square of the part of a usual scale of `1/K`.
    by_scale: f64,
    /// What `1/K` is, by the windows, where they show a delay, and where a wrong scale.
    if_late: Elsewhere,
    if_scaled: Elsewhere,
    /// Mean square of the scale that is wrong.
    scale: f64,
}

/// `1/K` by the windows if something is so, and the probability that it is: the filter, which took it for something else, may have
/// become too sure of that to come back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Elsewhere {
    probability: f64,
    mean: f64,
    variance: f64,
}

impl Elsewhere {
    fn of(posterior: &Posterior, probability: f64) -> Self {
        Self { probability, mean: posterior.mean[0], variance: posterior.covariance[(0, 0)].max(0.0) }
    }

    /// Mean square of how far from there a compliance is.
    fn distance(&self, compliance: f64) -> f64 {
        self.probability * ((compliance - self.mean).powi(2) + self.variance)
    }
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
    /// Before the first sample.
    pub fn new(known: &SlipSpeed) -> Self {
        Self {
            time: 0.0,
            window: Window::default(),
            slips: Slips::default(),
            posterior: Posterior::new(known, known.radius),
            scaled: Posterior::new(known, known.radius.max(known.scaled)),
            late: false,
            effect: Effect::default(),
            since: 0.0,
            balance: [0.0; 6],
            sloping: false,
        }
    }

    /// Whether speed or slope contradict the rest.
    pub fn contradicts(&self) -> bool {
        self.late || self.sloping
    }

    /// What delay and scale may have done to an estimate of this slip stiffness that the data and not the initial value have made by
    /// so much.
    ///
    /// The slip, not the stiffness, is off by a Gaussian: two standard deviations of the share make more than twice what one
    /// does of its reciprocal. The stiffness' is half of what they do.
    pub fn doubt(&self, stiffness: f64, learnt: f64) -> Doubt {
        let Effect { compliance, specific_force, by_scale, if_late, if_scaled, scale } = self.effect;
        let apart = if_late.distance(1.0 / stiffness) + if_scaled.distance(1.0 / stiffness);
        let doubted = |compliance: f64| {
            let share = (2.0 * stiffness * compliance).min(LARGEST_SHARE);
            learnt * 0.5 * share / (1.0 - share)
        };
        Doubt {
            stiffness: doubted((compliance * compliance + apart).sqrt()),
            scale: doubted(by_scale),
            radius: scale.sqrt(),
            specific_force,
        }
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
        let window = *window;
        self.time = (self.time + dt).min(1e9);
        self.since += dt;
        let whole = window.time >= WINDOW;
        if !whole && (self.since < ASKED || window.time <= 0.0) {
            return false;
        }
        // The filter has learnt from the present window already.
        let slips = self.slips.with(&window);
        let (posterior, scaled) = (self.posterior.with(known, &window), self.scaled.with(known, &window));
        self.effect = slips.effect(known, &posterior, &scaled);
        self.since = 0.0;
        if !whole {
            return false;
        }
        let before = self.contradicts();
        (self.window, self.slips) = (Window::default(), slips);
        (self.posterior, self.scaled) = (posterior, scaled);
        self.judge_delay();
        self.judge_slope(&window, v);
        self.contradicts() && !before
    }

    /// Whether the windows prove a delay. A verdict believes nothing of what was known before.
    fn judge_delay(&mut self) {
        if self.time < VERDICT_TIME {
            return;
        }
        let Slips { normal, right, square, windows, .. } = &self.slips;
        let Some(inverse) = normal.try_inverse() else { return };
        let theta = inverse * right;
        let residual = (square - theta.dot(right)).max(0.0) / (windows - 3.0).max(1.0);
        let (tau, std) = (theta[2].abs(), (residual * inverse[(2, 2)].max(0.0)).sqrt());
        if tau > CONFIDENCE * std && tau - std > DELAY {
            self.late = true;
        } else if self.late && tau + std < DELAY {
            self.late = false;
        }
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

impl Slips {
    /// With one more window; one that is not over counts as much as it has lasted.
    fn with(&self, window: &Window) -> Self {
        let (x, slip) = (window.x / window.samples, window.slip / window.samples);
        let part = (window.time / WINDOW).min(1.0);
        let fading = 1.0 / (1.0 + part * WINDOW / MEMORY);
        let force = if window.time > 0.0 { window.gain / window.time } else { 0.0 };
        Self {
            normal: self.normal * fading + x * x.transpose() * part,
            right: self.right * fading + x * (slip * part),
            square: self.square * fading + slip * slip * part,
            windows: self.windows * fading + part,
            weighted_force: self.weighted_force * fading + x[0] * x[0] * force * part,
        }
    }

    /// What a delay makes of the filter's estimates, which has none among its unknowns, and a wrong scale. `posterior` and
    /// `scaled`: what these windows and those long before say, without and with the latter.
    fn effect(&self, known: &SlipSpeed, posterior: &Posterior, scaled: &Posterior) -> Effect {
        let noise = posterior.noise;
        let (a, b) = (self.normal[(0, 0)] + noise / known.compliance, self.normal[(0, 1)]);
        // Of a second of delay, and of a scale.
        let [late, scale] = if known.radius > 0.0 {
            let prior = noise / known.radius;
            let d = self.normal[(1, 1)] + prior;
            let determinant = a * d - b * b;
            [(d * self.normal[(0, 2)] - b * self.normal[(1, 2)]) / determinant, b * prior / determinant]
        } else {
            [self.normal[(0, 2)] / a, b / a]
        };
        let weight = self.normal[(0, 0)];
        let specific_force = if weight > 0.0 { self.weighted_force / weight } else { 0.0 };
        let wrong_scale = scaled.probability_of_wrong_scale(known);
        Effect {
            compliance: late.abs() * posterior.mean_square_delay(known).sqrt(),
            specific_force,
            by_scale: scale.abs() * scaled.hypotheses(1, [known.scale, known.scaled])[0].1.sqrt(),
            if_late: Elsewhere::of(posterior, f64::from(u8::from(posterior.shows_delay()))),
            if_scaled: Elsewhere::of(scaled, wrong_scale),
            scale: wrong_scale * (scaled.mean[1].powi(2) + scaled.covariance[(1, 1)].max(0.0)),
        }
    }
}

impl Posterior {
    /// Before the first window, by which the mean of the radii's errors has this variance.
    fn new(known: &SlipSpeed, radius: f64) -> Self {
        let variance = Vector3::new(known.compliance, radius, known.delay);
        Self {
            mean: Vector3::new(1.0 / known.stiffness, 0.0, 0.0),
            covariance: Matrix3::from_diagonal(&variance),
            noise: 0.0,
            residual: 0.0,
            windows: 0.0,
        }
    }

    /// With one more window, by a Kalman filter; one that is not over counts as much as it has lasted.
    fn with(&self, known: &SlipSpeed, window: &Window) -> Self {
        let (x, slip) = (window.x / window.samples, window.slip / window.samples);
        let part = (window.time / WINDOW).min(1.0);
        if part <= 0.0 {
            return *self;
        }
        let mut new = *self;
        // Tyres, ground and pressures change as the filter takes them to, a signal's delay hardly.
        let lasted = part * WINDOW;
        new.covariance[(0, 0)] += known.compliance_psd * lasted;
        new.covariance[(1, 1)] += known.radius_psd * lasted;
        if new.covariance[(2, 2)] < known.delay {
            new.covariance[(2, 2)] *= 1.0 + lasted / DELAY_MEMORY;
        }
        let white = known.noise * part / window.samples;
        let noise = white.max((NOISE_WINDOWS * white + self.residual) / (NOISE_WINDOWS + self.windows));
        let gain = new.covariance * x;
        let (innovation, variance) = (slip - x.dot(&self.mean), x.dot(&gain) + noise / part);
        new.mean += gain * (innovation / variance);
        new.covariance -= gain * gain.transpose() / variance;
        let memory = 1.0 / (1.0 + part * WINDOW / MEMORY);
        new.residual = memory * self.residual + noise * innovation * innovation / variance;
        new.windows = memory * self.windows + part;
        new.noise = noise;
        new
    }

    /// Mean square of the delay, s2.
    ///
    /// A speed comes within a sample period of the wheel speeds or it is late, the one as likely as the other.
    fn mean_square_delay(&self, known: &SlipSpeed) -> f64 {
        let [together, late] = self.hypotheses(2, [known.together, known.delay]);
        let share = 1.0 / (1.0 + (together.0 - late.0).exp());
        (1.0 - share) * together.1 + share * late.1
    }

    /// Whether a delay is significant.
    fn shows_delay(&self) -> bool {
        self.mean[2].powi(2) > SEEN * SEEN * self.covariance[(2, 2)] && self.covariance[(2, 2)] > 0.0
    }

    /// Probability that the speed's scale is wrong, where it was said to be one of [`RIGHT`].
    fn probability_of_wrong_scale(&self, known: &SlipSpeed) -> f64 {
        if known.scaled <= known.radius {
            return 0.0;
        }
        let [right, wrong] = self.hypotheses(1, [known.radius, known.scaled]);
        let probability = 1.0 / (1.0 + RIGHT * (right.0 - wrong.0).exp());
        if probability > EXPECTED { probability } else { 0.0 }
    }

    /// Logarithm of the weight and mean square of an unknown if its variance before the first window was the one, or the other, which
    /// is that of this posterior.
    ///
    /// What the windows say, the information `j` and `z = j tau`, makes the weight `exp(z^2 v/2)/sqrt(1 + P j)` of an unknown `tau`
    /// whose variance was `P` and is `v = P/(1 + P j)`.
    fn hypotheses(&self, unknown: usize, [one, other]: [f64; 2]) -> [(f64, f64); 2] {
        let (mean, variance) = (self.mean[unknown], self.covariance[(unknown, unknown)]);
        if variance <= 0.0 || other <= 0.0 {
            return [(0.0, 0.0); 2];
        }
        let (j, z) = ((1.0 / variance - 1.0 / other).max(0.0), mean / variance);
        [one, other].map(|before| {
            let spread = 1.0 / (1.0 + before * j);
            let after = before * spread;
            (0.5 * (spread.ln() + z * z * after), after + (after * z).powi(2))
        })
    }
}
