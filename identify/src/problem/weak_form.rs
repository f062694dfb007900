//! Weak (modulating-function) rows: differential equations without differentiating data.
//!
//! An equation `sum of coefficient * d^i x / dt^i = 0` is multiplied with a modulating function `psi` that vanishes
//! with its first derivatives at both ends of a window and integrated by parts, so the derivatives
//! fall on `psi`: `int psi d^i x/dt^i dt = (-1)^i int psi^(i) x dt`.

/// A modulating function and its derivatives on the samples of one window.
#[derive(Clone, Debug)]
pub struct ModulatingFunction {
    /// `psi`, `psi'`, `psi''`, `psi'''`, already multiplied with the sample period: an integral is a plain sum.
    pub weights: [Vec<f64>; 4],
    /// `int psi dt` from each sample to the next: the weights of a signal that is held from sample to sample.
    pub held: Vec<f64>,
}

impl ModulatingFunction {
    /// Steps of a window of so many seconds; at least 20, however slow the sampling.
    pub fn steps(seconds: f64, period: f64) -> usize {
        ((seconds / period).round() as usize).max(20)
    }

    /// `psi(s) = (1 - s^2)^p` on `n + 1` samples, `s = -1 + 2 t / T`, `T = n dt`.
    pub fn polynomial(n: usize, dt: f64, p: i32) -> Self {
        let rate = 2.0 / (n as f64 * dt);
        let power = f64::from(p);
        let of = |order: i32| {
            (0..=n).map(move |i| {
                let s = -1.0 + 2.0 * i as f64 / n as f64;
                let u = 1.0 - s * s;
                let value = match order {
                    0 => u.powi(p),
                    1 => -2.0 * power * s * u.powi(p - 1),
                    2 => -2.0 * power * u.powi(p - 1) + 4.0 * power * (power - 1.0) * s * s * u.powi(p - 2),
                    _ => {
                        12.0 * power * (power - 1.0) * s * u.powi(p - 2)
                            - 8.0 * power * (power - 1.0) * (power - 2.0) * s.powi(3) * u.powi(p - 3)
                    }
                };
                value * rate.powi(order) * dt
            })
        };
        Self::new([0, 1, 2, 3].map(|order| of(order).collect()), dt)
    }

    /// `psi(t) = (1 - cos(2 pi t / T))^2 / 4` on `n + 1` samples.
    pub fn cosine(n: usize, dt: f64) -> Self {
        let omega = std::f64::consts::TAU / (n as f64 * dt);
        let of = |order: i32| {
            (0..=n).map(move |i| {
                // psi = 3/8 - cos(w t) / 2 + cos(2 w t) / 8
                let (one, two) = (omega * i as f64 * dt, 2.0 * omega * i as f64 * dt);
                let value = match order {
                    0 => 0.375 - 0.5 * one.cos() + 0.125 * two.cos(),
                    1 => omega * (0.5 * one.sin() - 0.25 * two.sin()),
                    2 => omega.powi(2) * (0.5 * one.cos() - 0.5 * two.cos()),
                    _ => omega.powi(3) * (-0.5 * one.sin() + two.sin()),
                };
                value * dt
            })
        };
        Self::new([0, 1, 2, 3].map(|order| of(order).collect()), dt)
    }

    fn new(weights: [Vec<f64>; 4], dt: f64) -> Self {
        // Trapezoidal rule with the Euler-Maclaurin term of the slopes at both ends: fourth order.
        let [psi, slope, ..] = &weights;
        let between = |k: usize| 0.5 * (psi[k] + psi[k + 1]) - dt / 12.0 * (slope[k + 1] - slope[k]);
        let held = (0..psi.len() - 1).map(between).collect();
        Self { weights, held }
    }

    /// Samples of a window.
    pub fn len(&self) -> usize {
        self.weights[0].len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.weights[0].is_empty()
    }

    /// First samples of the windows that fit into `samples`, every `stride`.
    pub fn starts(&self, samples: usize, stride: usize) -> impl Iterator<Item = usize> + use<> {
        (0..(samples + 1).saturating_sub(self.len())).step_by(stride)
    }

    /// `int psi^(order) x dt` over the window that starts at sample `start`; NaN samples make it NaN.
    pub fn integral(&self, order: usize, start: usize, x: impl Fn(usize) -> f64) -> f64 {
        self.weights[order].iter().enumerate().map(|(i, weight)| weight * x(start + i)).sum()
    }

    /// `int psi x dt` of a signal that is held from each sample to the next.
    pub fn held_integral(&self, start: usize, x: impl Fn(usize) -> f64) -> f64 {
        self.held.iter().enumerate().map(|(i, weight)| weight * x(start + i)).sum()
    }
}
