//! Elementary functions of several numbers side by side, one per lane.
//!
//! Written by hand because the filters spend most of their time here and those of `wide`, which serve arguments that no
//! tyre sees, execute 1.5 (arc tangent), 4 (sine) and 6 times (hyperbolic tangent) as many instructions; these are exact
//! to a few units in the last place, as the tests say.

use super::four::Four;
use std::f64::consts::PI;

/// An angle and its tangent, both not negative.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Angle {
    pub tangent: Four,
    pub angle: Four,
}

impl Angle {
    /// Goes to another tangent. If it is `nearby`, `atan x = atan x0 + atan((x - x0)/(1 + x x0))`, where the
    /// last angle is small and has a short series.
    #[inline(always)]
    pub fn turn(&mut self, tangent: Four, nearby: bool) {
        let t = (tangent - self.tangent) / (Four::ONE + tangent * self.tangent);
        self.tangent = tangent;
        if !nearby || t.abs().greater(Four::splat(0.125)).any() {
            self.angle = arc_tangent(tangent);
            return;
        }
        let series = polynomial(
            t * t,
            [-0.33333333333333287, -0.14285714129116034, -0.09085599506798686],
            [0.19999999999790477, 0.1111106826170422, 0.07387718384425714],
        );
        self.angle += t + t * (t * t * series);
    }
}

/// A polynomial from its even and its odd coefficients by Horner's scheme in `z²`: two chains of dependent
/// operations, half as long as one.
#[inline(always)]
fn polynomial<const E: usize, const O: usize>(z: Four, even: [f64; E], odd: [f64; O]) -> Four {
    let square = z * z;
    let horner = |coefficients: &[f64]| {
        coefficients.iter().rev().map(|c| Four::splat(*c)).reduce(|sum, c| sum * square + c).unwrap_or(Four::ZERO)
    };
    horner(&even) + z * horner(&odd)
}

/// The arc tangent for `x >= 0`. Above tan(30°) the angle is counted from 60°, `atan x = 60° +
/// atan((x - tan 60°)/(1 + x tan 60°))`, which leaves arguments up to tan(30°); there a Chebyshev
/// interpolant in their square has a relative error of 4e-17 before rounding.
#[inline(always)]
pub(super) fn arc_tangent(x: Four) -> Four {
    const TAN_30: f64 = 0.577_350_269_189_625_7;
    const TAN_60: f64 = 1.732_050_807_568_877_2;
    let far = x.greater(Four::splat(TAN_30));
    let turned = far.select(Four::splat(TAN_60));
    let t = (x - turned) / (Four::ONE + x * turned);
    let z = t * t;
    let series = polynomial(
        z,
        [
            -0.3333333333333332,
            -0.14285714283920362,
            -0.09090904942979589,
            -0.06665508502217014,
            -0.05196651814660573,
            -0.03424200375100575,
            -0.006070764829439552,
        ],
        [
            0.1999999999998937,
            0.11111110991697927,
            0.07692221484970703,
            0.058718231326435506,
            0.044665387521620394,
            0.019776845738205054,
        ],
    );
    far.select(Four::FRAC_PI_3) + (t + t * (z * series))
}

/// The sine for `|x| <= 3 pi / 2`, which the shape's range `C <= 2.2` never leaves. A Chebyshev
/// interpolant in `x²` (relative error 4e-19 before rounding), without the range reduction of the library's.
#[inline(always)]
pub(super) fn sine(x: Four) -> Four {
    let a = x.abs();
    let t = a.min(Four::splat(PI) - a);
    let series = polynomial(
        t * t,
        [1.0, 0.008333333333333186, 2.7557319211166023e-06, 1.6058940571674158e-10, 2.721486441670626e-15],
        [-0.16666666666666666, -0.0001984126984120831, -2.5052106884617687e-08, -7.643018364326954e-13],
    );
    (t * series).flip_signs(x)
}

/// Hyperbolic tangent; near zero, where the tyres work, by its continued fraction, which has a relative error below 3e-15
/// there; far from zero it has reached 1 to the last bit.
#[inline(always)]
pub(super) fn tanh(x: Four) -> Four {
    let size = x.abs();
    if !Four::splat(20.0).greater(size).any() {
        return Four::ONE.flip_signs(x);
    }
    if size.greater(Four::splat(0.6)).any() {
        return Four::new(x.to_array().map(f64::tanh));
    }
    let (s, n) = (x * x, Four::splat);
    x * (n(135_135.0) + s * (n(17_325.0) + s * (n(378.0) + s)))
        / (n(135_135.0) + s * (n(62_370.0) + s * (n(3_150.0) + s * n(28.0))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_tangent_agrees_with_the_library() {
        for k in 0..=100_000 {
            let x = 1e-6 * 1.000_3_f64.powi(k) - 1e-6;
            let exact = x.atan();
            let [whole, ..] = arc_tangent(Four::splat(x)).to_array();
            assert!((whole - exact).abs() <= 8e-16 * exact, "{x}");
            for near in [0.9 * x, x + 0.1, 3.0 * x] {
                let mut angle = Angle { tangent: Four::splat(near), angle: arc_tangent(Four::splat(near)) };
                angle.turn(Four::splat(x), true);
                let [turned, ..] = angle.angle.to_array();
                assert!((turned - exact).abs() <= 8e-16 * exact.max(near.atan()), "{x} from {near}");
            }
        }
    }

    #[test]
    fn sine_agrees_with_the_library() {
        for k in -47_000..=47_000 {
            let x = f64::from(k) * 1e-4;
            let [near, far, ..] = sine(Four::new([x / 3.0, x, 0.0, 0.0])).to_array();
            assert!((near - (x / 3.0).sin()).abs() <= 4e-16 * (x / 3.0).abs(), "{x}");
            assert!((far - x.sin()).abs() <= 1e-15, "{x}");
        }
    }

    #[test]
    fn hyperbolic_tangent_agrees_with_the_library() {
        for k in -40_000..=40_000 {
            let x = f64::from(k) * 5e-5;
            for four in [[x / 4.0, -x / 4.0, x / 8.0, 0.0], [x, -x / 4.0, 2.0 * x, 0.0]] {
                for (tanh, x) in tanh(Four::new(four)).to_array().into_iter().zip(four) {
                    assert!((tanh - x.tanh()).abs() <= 3e-15 * x.abs(), "{x}");
                }
            }
            let far = [20.0, 25.0, 30.0, 1e300].map(|far| (far + x.abs()).copysign(x));
            assert_eq!(tanh(Four::new(far)).to_array(), far.map(f64::tanh), "{x}");
        }
    }
}
