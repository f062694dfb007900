//! By how much a signal comes later than another one that shows the same motion.
//!
//! A signal `y` that comes `tau` later than `x` is `y(t) = c + g x(t - tau) + e(t)`, for a delay that is short beside the motion
//!
//! ```text
//! y = c + g x - g tau x' + e
//! ```
//!
//! so that the linear regression of `y` on `x` and `x'` gives the delay and its standard error. Neither the gain `g` need be known
//! (a radius, a mass, wheels that slip) nor the offset `c` (a bias, a slope), which may change within seconds: all three are taken
//! without their slow part. It is how Lucas and Kanade find the displacement of an image (*An iterative image registration technique with
//! an application to stereo vision*, IJCAI 1981, 674-679), in one dimension. Both signals go through the same low-pass, critically damped, whose two states differ by `x'` times its
//! time constant.
//!
//! Which of the two is late it does not tell. It says nothing before they have moved for seconds, and nothing of two signals that are
//! equally late; what a sensor may be late without being seen is a parameter of each machine.

use crate::filter::bounded;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Time constant of the low-pass, s.
const SMOOTHING: f64 = 0.05;
/// Time in which an offset is forgotten, s.
const OFFSET_TIME: f64 = 2.0;
/// Memory of the regression, s: sensors stay as late as they are.
const MEMORY: f64 = 60.0;
/// Time over which the residuals count as one, s.
const CORRELATED: f64 = 0.3;
/// Standard errors by which chance lets two signals differ.
const CHANCE: f64 = 3.0;
/// Samples further apart do not show how a signal changes, s.
const LONGEST: f64 = 0.1;
/// Longest delay, s.
const MOST: f64 = 0.3;
/// Time in which the integral of a rate fades, s.
const FADES: f64 = 1.0;

/// What is remembered of the two signals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RelativeDelay {
    /// Of `x` and `y`, the states of the low-pass.
    smoothed: [[f64; 2]; 2],
    /// Time since the last pair, s.
    age: f64,
    /// Time of which something is remembered, s.
    time: f64,
    /// Slow part of `(x, x', y)`, and mean products of what is left.
    mean: Vector3<f64>,
    products: Matrix3<f64>,
    kept: Shown,
}

/// A delay that the signals have shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Shown {
    /// What is beyond chance, s.
    delay: f64,
    /// Its standard error, s.
    std: f64,
}

impl Default for Shown {
    fn default() -> Self {
        Self { delay: 0.0, std: MOST }
    }
}

impl RelativeDelay {
    /// Takes the signals `dt` seconds after those before; nothing if one of them is NaN.
    pub fn follow(&mut self, x: f64, y: f64, dt: f64) {
        self.age = (self.age + dt).min(1.0);
        if !(bounded(x) && bounded(y)) {
            return;
        }
        if self.time == 0.0 || self.age > LONGEST {
            // where it stands now nothing has changed yet
            self.smoothed = [[x; 2], [y; 2]];
            self.mean = Vector3::new(x, 0.0, y);
            (self.age, self.time) = (0.0, self.time.max(dt));
            return;
        }
        let stays = (-self.age / SMOOTHING).exp();
        for ([once, twice], value) in self.smoothed.iter_mut().zip([x, y]) {
            *once = value - (value - *once) * stays;
            *twice = *once - (*once - *twice) * stays;
        }
        let [[x_once, x], [_, y]] = self.smoothed;
        let seen = Vector3::new(x, (x_once - x) / SMOOTHING, y);
        self.time += self.age * (1.0 - self.time / MEMORY);
        let left = seen - self.mean;
        self.mean += left * (self.age / OFFSET_TIME).min(1.0);
        let products = left * left.transpose();
        self.products += (products - self.products) * (self.age / self.time).min(1.0);
        self.kept.std = (self.kept.std * (1.0 + self.age / MEMORY)).min(MOST);
        self.age = 0.0;
        if let Some(now) = self.shown_now()
            && now.std <= self.kept.std
        {
            self.kept = now;
        }
    }

    /// The delay that the signals show beyond chance, s; which of them is late is not said. The most certain answer of late counts:
    /// what other errors blur later was clear before, and sensors are as late as they were.
    pub fn shown(&self) -> f64 {
        self.kept.delay
    }

    /// How late a sensor may be, s (one standard deviation), that is said to be late by `declared` at most: by this, or by more if that is
    /// shown. 0 says that it is not late.
    pub fn delay_std(&self, declared: f64) -> f64 {
        if declared > 0.0 { declared.max(self.shown()) } else { 0.0 }
    }

    /// What the products say now; nothing if the signals do not follow one another.
    fn shown_now(&self) -> Option<Shown> {
        let c = &self.products;
        let determinant = c[(0, 0)] * c[(1, 1)] - c[(0, 1)] * c[(0, 1)];
        let independent = self.time / CORRELATED - 3.0;
        if !(determinant > 1e-9 * c[(0, 0)] * c[(1, 1)] && independent > 0.0) {
            return None;
        }
        let gain = (c[(1, 1)] * c[(0, 2)] - c[(0, 1)] * c[(1, 2)]) / determinant;
        let late = (c[(0, 0)] * c[(1, 2)] - c[(0, 1)] * c[(0, 2)]) / determinant;
        let residual = (c[(2, 2)] - gain * c[(0, 2)] - late * c[(1, 2)]).max(0.0) / independent;
        let of = |other: usize| (residual * c[(other, other)] / determinant).sqrt();
        let (gain_std, std) = (of(1), of(0) / gain.abs());
        let beyond = ((late / gain).powi(2) - (CHANCE * std).powi(2)).max(0.0).sqrt();
        (gain.abs() > CHANCE * gain_std).then_some(Shown { delay: beyond.min(MOST), std })
    }

    /// Whether the numbers can have come from [`follow`](Self::follow).
    pub fn is_valid(&self) -> bool {
        let finite =
            self.smoothed.iter().flatten().chain(&self.mean).chain(&self.products).all(|value| value.is_finite());
        let shown = (0.0..=MOST).contains(&self.kept.delay) && (0.0..=MOST).contains(&self.kept.std);
        shown && finite && (0.0..=MEMORY).contains(&self.time) && self.age >= 0.0
    }
}

/// The same of a signal and another one that shows its rate, whose integral is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DelayOfRate {
    delay: RelativeDelay,
    /// Integral of the rate, which fades, and the slow part of the signal that fades alike.
    integral: f64,
    slow: f64,
    begun: bool,
}

impl DelayOfRate {
    /// Takes the signal and its rate `dt` seconds after those before; NaN is none.
    pub fn follow(&mut self, signal: f64, rate: f64, dt: f64) {
        if !(bounded(signal) && bounded(rate)) {
            return;
        }
        if !self.begun {
            (self.slow, self.begun) = (signal, true);
        }
        let fading = (dt / FADES).min(1.0);
        self.slow += (signal - self.slow) * fading;
        self.integral += rate * dt.min(FADES) - self.integral * fading;
        self.delay.follow(self.integral, signal - self.slow, dt);
    }

    /// As [`RelativeDelay::delay_std`].
    pub fn delay_std(&self, declared: f64) -> f64 {
        self.delay.delay_std(declared)
    }

    /// Whether the numbers can have come from [`follow`](Self::follow).
    pub fn is_valid(&self) -> bool {
        self.delay.is_valid() && self.integral.is_finite() && self.slow.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// A motion of two frequencies, and its rate.
    fn motion(t: f64) -> f64 {
        (2.1 * t).sin() + 0.4 * (5.3 * t + 1.0).sin()
    }

    fn rate(t: f64) -> f64 {
        2.1 * (2.1 * t).cos() + 0.4 * 5.3 * (5.3 * t + 1.0).cos()
    }

    /// What ten seconds show of a signal of this gain, offset and delay, with white noise on both.
    fn shown(dt: f64, late: f64, std: f64, seed: u64) -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = || std * random.sample::<f64, _>(StandardNormal);
        let mut delay = RelativeDelay::default();
        for k in 0..(10.0 / dt) as u32 {
            let t = dt * f64::from(k);
            delay.follow(motion(t) + noise(), 5.0 - 0.7 * motion(t - late) + noise(), dt);
        }
        delay.shown()
    }

    #[test]
    fn a_delay_is_found_whatever_gain_offset_and_noise() {
        for dt in [0.002, 0.01, 0.02] {
            for late in [-0.1, 0.03, 0.1] {
                for std in [0.0, 0.05, 0.1] {
                    let found = shown(dt, late, std, 3);
                    assert!(found > 0.5 * late.abs() && found < 1.2 * late.abs() + 0.01, "{dt} {late} {std}: {found}");
                }
            }
        }
    }

    #[test]
    fn chance_shows_none() {
        let wrong = (0..50).filter(|seed| shown(0.01, 0.0, 0.3, *seed) > 0.01).count();
        assert!(wrong <= 1, "{wrong} of 50");
        let mut random = ChaCha8Rng::seed_from_u64(8);
        let mut unrelated = RelativeDelay::default();
        for _ in 0..6000 {
            unrelated.follow(random.sample(StandardNormal), random.sample(StandardNormal), 0.01);
        }
        assert_eq!(unrelated.shown(), 0.0);
    }

    #[test]
    fn a_rate_may_be_late_too() {
        for late in [0.0, 0.05, 0.1] {
            let mut delay = DelayOfRate::default();
            for k in 0..1000 {
                let t = 0.01 * f64::from(k);
                delay.follow(4.0 + motion(t), rate(t - late) + 0.1, 0.01);
            }
            let shown = delay.delay.shown();
            assert!((shown - late).abs() < 0.1 * late + 0.005, "{late}: {shown}");
        }
    }

    #[test]
    fn what_stands_or_is_missing_shows_none() {
        let mut delay = RelativeDelay::default();
        (0..1000).for_each(|_| delay.follow(1.0, 2.0, 0.01));
        assert_eq!(delay.shown(), 0.0);
        let before = delay;
        (0..1000).for_each(|_| delay.follow(f64::NAN, 2.0, 0.01));
        assert_eq!((delay.shown(), delay.products), (0.0, before.products));
        assert_eq!([delay.delay_std(0.0), delay.delay_std(0.015)], [0.0, 0.015]);
    }
}
