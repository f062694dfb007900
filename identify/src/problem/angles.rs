//! Sines and cosines of many angles: the tilts of a long log are most of what its fit works out.

use multiversion::multiversion;
use std::f64::consts::FRAC_PI_4;

/// `(-1)^k / (2 k + first)!` for k from 1: the series of the sine behind `x` (first = 1) and of the cosine behind 1 (first = 0).
const fn series(first: u32) -> [f64; 8] {
    let mut factors = [0.0; 8];
    let (mut k, mut factorial, mut sign) = (0, 1.0, 1.0);
    while k < 8 {
        let n = 2 * (k as u32 + 1) + first;
        factorial *= (n * (n - 1)) as f64;
        sign = -sign;
        factors[k] = sign / factorial;
        k += 1;
    }
    factors
}

const SINE: [f64; 8] = series(1);
const COSINE: [f64; 8] = series(0);

/// The powers `z, z^2, ...` times these factors, added up.
#[inline(always)]
fn polynomial(factors: &[f64; 8], z: f64) -> f64 {
    factors.iter().rev().fold(0.0, |sum, factor| (sum + factor) * z)
}

/// Sines and cosines of angles, rad. Up to a quarter of pi, farther than people and machines lean, they are Taylor's series,
/// whose rest is far below the last digit, and a processor takes several at once; beyond that they are the standard
/// library's. NaN of NaN.
pub struct Angles {
    sines: Vec<f64>,
    cosines: Vec<f64>,
}

impl Angles {
    /// Of these angles.
    pub fn of(angles: &[f64]) -> Self {
        let mut all = Self::zero(angles.len());
        if !small(angles, &mut all.sines, &mut all.cosines) {
            for ((angle, sin), cos) in angles.iter().zip(&mut all.sines).zip(&mut all.cosines) {
                if angle.abs() > FRAC_PI_4 {
                    (*sin, *cos) = angle.sin_cos();
                }
            }
        }
        all
    }

    /// Of as many angles that are 0.
    pub fn zero(count: usize) -> Self {
        Self { sines: vec![0.0; count], cosines: vec![1.0; count] }
    }

    /// Sine and cosine, one angle after the other.
    pub fn iter(&self) -> impl Iterator<Item = (f64, f64)> {
        self.sines.iter().copied().zip(self.cosines.iter().copied())
    }
}

/// Sines and cosines of a few angles side by side; those of one alone are the standard library's.
#[inline(always)]
pub fn few<const N: usize>(angles: &[f64; N]) -> ([f64; N], [f64; N]) {
    if N == 1 {
        return (angles.map(f64::sin), angles.map(f64::cos));
    }
    let (mut sines, mut cosines, mut beyond) = ([0.0; N], [0.0; N], 0_u64);
    for k in 0..N {
        (sines[k], cosines[k]) = series_at(angles[k]);
        beyond += u64::from(angles[k].abs() > FRAC_PI_4);
    }
    if beyond > 0 {
        for k in (0..N).filter(|k| angles[*k].abs() > FRAC_PI_4) {
            (sines[k], cosines[k]) = angles[k].sin_cos();
        }
    }
    (sines, cosines)
}

#[inline(always)]
fn series_at(x: f64) -> (f64, f64) {
    let z = x * x;
    (x + x * polynomial(&SINE, z), 1.0 + polynomial(&COSINE, z))
}

/// The series of each angle; whether they hold for all of them.
#[multiversion(targets("x86_64+avx+avx2"))]
fn small(angles: &[f64], sines: &mut [f64], cosines: &mut [f64]) -> bool {
    let mut beyond = 0_u64;
    for ((x, sin), cos) in angles.iter().zip(sines).zip(cosines) {
        (*sin, *cos) = series_at(*x);
        beyond += u64::from(x.abs() > FRAC_PI_4);
    }
    beyond == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn sines_and_cosines_are_those_of_the_standard_library_to_the_last_digit() {
        let angles: Vec<f64> = (-40_000..=40_000).map(|k| 1e-4 * f64::from(k)).collect();
        for (angle, (sin, cos)) in angles.iter().zip(Angles::of(&angles).iter()) {
            for (here, there) in [(sin, angle.sin()), (cos, angle.cos())] {
                assert!((here - there).abs() <= f64::EPSILON * there.abs(), "{angle}: {here:e} for {there:e}");
            }
        }
        let all = Angles::of(&[f64::NAN, -0.0, 1e9, PI]);
        let [nan, zero, far, half]: [(f64, f64); 4] = all.iter().collect::<Vec<_>>().try_into().unwrap();
        assert!(nan.0.is_nan() && nan.1.is_nan() && zero == (0.0, 1.0));
        assert_eq!((far, half), (1e9_f64.sin_cos(), PI.sin_cos()));
        for angles in [[0.3, -0.7], [-2.0, 0.1], [f64::INFINITY, 0.0]] {
            let (sines, cosines) = few(&angles);
            let pairs: Vec<_> = sines.into_iter().zip(cosines).map(|pair| format!("{pair:?}")).collect();
            assert_eq!(pairs, Angles::of(&angles).iter().map(|pair| format!("{pair:?}")).collect::<Vec<_>>());
        }
    }
}
