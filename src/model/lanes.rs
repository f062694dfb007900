//! Arc tangent and sine of four numbers at once, for the four wheels of a vehicle.
//!
//! Without branches and calls, so that the compiler keeps the four lanes in vector registers: the
//! wheels' forces are evaluated some hundred times per filter step. The polynomials are Chebyshev
//! interpolants (relative error below 4e-17 before rounding); the results agree with the library's to
//! a few units in the last place and are the same on every machine.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// One number per wheel, in the order front left, front right, rear left, rear right.
pub type Lanes = [f64; 4];

/// `atan(t) / t` as a polynomial in `t²` for `|t| <= tan(pi/8)`.
const ATAN: [f64; 11] = [
    0.999999999999999965,
    -0.333333333333283932,
    0.19999999998845653,
    -0.142857141802161535,
    0.111111061495774303,
    -0.0909077235779939675,
    0.0768994340134819348,
    -0.0664014627755857721,
    0.0568789076244110246,
    -0.0434672837392663138,
    0.0211191683022010386,
];

/// `sin(t) / t` as a polynomial in `t²` for `|t| <= pi/2`.
const SIN: [f64; 9] = [
    1.0,
    -0.166666666666666653,
    0.00833333333333318536,
    -0.000198412698412083088,
    2.75573192111660219e-6,
    -2.50521068846176864e-8,
    1.60589405716741581e-10,
    -7.64301836432695456e-13,
    2.72148644167062606e-15,
];

#[inline(always)]
fn polynomial<const N: usize>(coefficients: &[f64; N], z: f64) -> f64 {
    let mut sum = coefficients[N - 1];
    for k in (0..N - 1).rev() {
        sum = sum * z + coefficients[k];
    }
    sum
}

/// The arc tangent of each lane.
#[inline(always)]
pub fn atan(x: Lanes) -> Lanes {
    let mut result = [0.0; 4];
    for i in 0..4 {
        let a = x[i].abs();
        // atan a = offset + atan t with |t| <= tan(pi/8)
        let (steep, middle) = (a > 2.414213562373095, a > 0.41421356237309503);
        let above = if steep { -1.0 } else if middle { a - 1.0 } else { a };
        let below = if steep { a } else if middle { a + 1.0 } else { 1.0 };
        let offset = if steep { FRAC_PI_2 } else if middle { FRAC_PI_4 } else { 0.0 };
        let t = above / below;
        result[i] = (offset + t * polynomial(&ATAN, t * t)).copysign(x[i]);
    }
    result
}

/// The sine of each lane, for `|x| <= 3 pi / 2`.
#[inline(always)]
pub fn sin(x: Lanes) -> Lanes {
    let mut result = [0.0; 4];
    for i in 0..4 {
        let a = x[i].abs();
        let t = if a > FRAC_PI_2 { PI - a } else { a };
        let sine = t * polynomial(&SIN, t * t);
        result[i] = if x[i] < 0.0 { -sine } else { sine };
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_agree_with_the_library() {
        for k in -40_000..=40_000 {
            let x = f64::from(k) * 1e-4;
            let wide = x * x * x * 20.0;
            let (atans, sines) = (atan([x, wide, 0.0, -x]), sin([x, -x, 0.0, x / 3.0]));
            assert!((atans[0] - x.atan()).abs() <= 8e-16 * x.atan().abs());
            assert!((atans[1] - wide.atan()).abs() <= 8e-16 * wide.atan().abs());
            assert_eq!(atans[3], -atans[0]);
            assert!((sines[0] - x.sin()).abs() <= 8e-16);
            assert!((sines[3] - (x / 3.0).sin()).abs() <= 8e-16 * (x / 3.0).abs());
            assert_eq!(sines[1], -sines[0]);
        }
    }
}
