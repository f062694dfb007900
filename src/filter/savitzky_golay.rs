//! Savitzky-Golay derivatives: a cubic fitted to a window of equally spaced samples.
//!
//! Savitzky and Golay (1964). Offline the fit is centred ([`smooth`]); online it is taken at the
//! newest sample ([`Causal`]), which delays nothing and amplifies noise more:
//! the variance of a result is `sigma^2 sum w^2`.

/// Order of the polynomial.
const ORDER: usize = 3;

/// Weights of the `derivative`-th derivative (0 to 3) at sample `at` of a window of `window`
/// samples (at least 4) with spacing `dt`, also beyond the window; the result is `sum_k weight_k x_k`.
pub fn weights(window: usize, at: usize, derivative: usize, dt: f64) -> Vec<f64> {
    debug_assert!(window > ORDER && derivative <= ORDER);
    // abscissae in -1..1 and polynomials orthonormal on them keep this exact to rounding
    let half = 0.5 * (window as f64 - 1.0);
    let abscissa = |k: usize| (k as f64 - half) / half;
    // monomial coefficients of the orthonormal polynomials, lowest first
    let mut basis: Vec<[f64; ORDER + 1]> = vec![];
    let value = |p: &[f64; ORDER + 1], t: f64| p.iter().rev().fold(0.0, |sum, c| sum * t + c);
    for degree in 0..=ORDER {
        let mut p = [0.0; ORDER + 1];
        p[degree] = 1.0;
        for _ in 0..2 {
            for earlier in &basis {
                let dot: f64 = (0..window).map(|k| value(&p, abscissa(k)) * value(earlier, abscissa(k))).sum();
                for (c, e) in p.iter_mut().zip(earlier) {
                    *c -= dot * e;
                }
            }
        }
        let norm = (0..window).map(|k| value(&p, abscissa(k)).powi(2)).sum::<f64>().sqrt();
        basis.push(p.map(|c| c / norm));
    }
    let slope = |p: &[f64; ORDER + 1], t: f64| {
        let mut p = *p;
        for _ in 0..derivative {
            for i in 0..ORDER {
                p[i] = (i + 1) as f64 * p[i + 1];
            }
            p[ORDER] = 0.0;
        }
        value(&p, t)
    };
    let scale = (half * dt).powi(derivative as i32);
    let here = abscissa(at);
    (0..window).map(|k| basis.iter().map(|p| slope(p, here) * value(p, abscissa(k))).sum::<f64>() / scale).collect()
}

/// The `derivative`-th derivative of a whole record, centred; the edges take the fit of the first
/// and last full window. A record shorter than the window gives NaN.
pub fn smooth(samples: &[f64], window: usize, derivative: usize, dt: f64) -> Vec<f64> {
    let n = samples.len();
    if n < window || window <= ORDER {
        return vec![f64::NAN; n];
    }
    let m = window / 2;
    let centre = weights(window, m, derivative, dt);
    let fit = |weights: &[f64], from: usize| weights.iter().zip(&samples[from..]).map(|(w, x)| w * x).sum();
    (0..n)
        .map(|k| {
            if k < m {
                fit(&weights(window, k, derivative, dt), 0)
            } else if k + window - m > n {
                fit(&weights(window, k + window - n, derivative, dt), n - window)
            } else {
                fit(&centre, k - m)
            }
        })
        .collect()
}

/// First and second derivatives at the newest sample of a window that fills as samples come.
#[derive(Clone, Debug)]
pub struct Causal {
    window: usize,
    first: Vec<f64>,
    second: Vec<f64>,
    /// Value of the cubic one sample after the window.
    next: Vec<f64>,
}

impl Causal {
    /// For windows of `window >= 4` samples at spacing `dt`.
    pub fn new(window: usize, dt: f64) -> Self {
        let newest = window - 1;
        Self {
            window,
            first: weights(window, newest, 1, dt),
            second: weights(window, newest, 2, dt),
            next: weights(window, window, 0, dt),
        }
    }

    /// Number of samples in a window.
    pub fn window(&self) -> usize {
        self.window
    }

    /// First and second derivative from a ring of samples whose oldest one is at `oldest`.
    pub fn derivatives(&self, ring: &[f64], oldest: usize) -> (f64, f64) {
        let (mut d1, mut d2) = (0.0, 0.0);
        let samples = ring[oldest..].iter().chain(&ring[..oldest]);
        for ((x, w1), w2) in samples.zip(&self.first).zip(&self.second) {
            d1 += w1 * x;
            d2 += w2 * x;
        }
        (d1, d2)
    }

    /// Where the cubic continues one sample after the newest, from the same ring.
    pub fn continuation(&self, ring: &[f64], oldest: usize) -> f64 {
        let samples = ring[oldest..].iter().chain(&ring[..oldest]);
        samples.zip(&self.next).map(|(x, w)| w * x).sum()
    }
}
