//! Four numbers side by side.
//!
//! Written with plain arrays: the compiler puts them into one register where a kernel is compiled for AVX, or into two
//! of every x86-64 processor, chosen when the program runs. Those of `wide` are fixed to what the program is built for.
//!
//! The compiler finds the four by where results are stored: a kernel gives them lane beside lane. One that stored points one after the
//! other ended in registers for two, all of it.

use std::array::from_fn;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_3};
use std::ops::{Add, AddAssign, BitOr, Div, Mul, MulAssign, Neg, Sub};

/// Four numbers, one per lane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub struct Four([f64; 4]);

/// One truth value per lane.
#[derive(Clone, Copy, Debug)]
pub struct Mask([bool; 4]);

impl Four {
    pub const ZERO: Self = Self([0.0; 4]);
    pub const ONE: Self = Self([1.0; 4]);
    pub const FRAC_PI_2: Self = Self([FRAC_PI_2; 4]);
    pub const FRAC_PI_3: Self = Self([FRAC_PI_3; 4]);

    #[inline(always)]
    pub const fn new(lanes: [f64; 4]) -> Self {
        Self(lanes)
    }

    #[inline(always)]
    pub const fn splat(x: f64) -> Self {
        Self([x; 4])
    }

    #[inline(always)]
    pub fn to_array(self) -> [f64; 4] {
        self.0
    }

    #[inline(always)]
    pub fn first(self) -> f64 {
        self.0[0]
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(from_fn(|lane| f(self.0[lane], other.0[lane])))
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self(self.0.map(f64::abs))
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }

    /// The larger one, `other` where one is NaN.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    /// The smaller one, `other` where one is NaN.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// With the other sign where `sign` is negative.
    #[inline(always)]
    pub fn flip_signs(self, sign: Self) -> Self {
        const SIGN: u64 = 1 << 63;
        self.zip(sign, |a, sign| f64::from_bits(a.to_bits() ^ (sign.to_bits() & SIGN)))
    }

    #[inline(always)]
    pub fn greater(self, other: Self) -> Mask {
        Mask(from_fn(|lane| self.0[lane] > other.0[lane]))
    }

    #[inline(always)]
    pub fn is_finite(self) -> Mask {
        Mask(self.0.map(f64::is_finite))
    }
}

impl Mask {
    #[inline(always)]
    pub fn any(self) -> bool {
        self.0[0] | self.0[1] | self.0[2] | self.0[3]
    }

    #[inline(always)]
    pub fn first(self) -> bool {
        self.0[0]
    }

    /// `x` where the lane is true, 0 elsewhere.
    #[inline(always)]
    pub fn select(self, x: Four) -> Four {
        self.choose(x, Four::ZERO)
    }

    /// `x` where the lane is true, `y` elsewhere.
    #[inline(always)]
    pub fn choose(self, x: Four, y: Four) -> Four {
        Four(from_fn(|lane| if self.0[lane] { x.0[lane] } else { y.0[lane] }))
    }
}

impl BitOr for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(from_fn(|lane| self.0[lane] | other.0[lane]))
    }
}

macro_rules! lane_by_lane {
    ($($operator:ident, $function:ident, $symbol:tt;)*) => {$(
        impl $operator for Four {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, |a, b| a $symbol b)
            }
        }
    )*};
}

lane_by_lane! {
    Add, add, +;
    Sub, sub, -;
    Mul, mul, *;
    Div, div, /;
}

impl Neg for Four {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl AddAssign for Four {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl MulAssign for Four {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}
