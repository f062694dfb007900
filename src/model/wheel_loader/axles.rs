//! Arithmetic of values per axle, at four points side by side.

use crate::model::four::{Four, Mask};
use std::ops::{Add, Mul, Neg, Sub};

/// One value per axle of each point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axles {
    pub front: Four,
    pub rear: Four,
}

impl Axles {
    pub const ZERO: Self = Self { front: Four::ZERO, rear: Four::ZERO };

    /// One value per axle, the same at all points.
    #[inline(always)]
    pub fn all([front, rear]: [f64; 2]) -> Self {
        Self { front: Four::splat(front), rear: Four::splat(rear) }
    }

    /// The same value at both axles.
    #[inline(always)]
    pub fn both(value: Four) -> Self {
        Self { front: value, rear: value }
    }

    /// What one axle gains the other one loses.
    #[inline(always)]
    pub fn opposite(value: Four) -> Self {
        Self { front: value, rear: -value }
    }

    /// Of both axles.
    #[inline(always)]
    pub fn sum(self) -> Four {
        self.front + self.rear
    }

    /// The larger one of both axles.
    #[inline(always)]
    pub fn largest(self) -> Four {
        self.front.max(self.rear)
    }

    /// `self` at the points of the mask, `other` elsewhere.
    #[inline(always)]
    pub fn where_or(self, mask: Mask, other: Self) -> Self {
        Self { front: mask.choose(self.front, other.front), rear: mask.choose(self.rear, other.rear) }
    }

    /// Those of the first point.
    pub fn first(self) -> [f64; 2] {
        [self.front.first(), self.rear.first()]
    }
}

macro_rules! axle_by_axle {
    ($($operator:ident, $function:ident, $symbol:tt;)*) => {$(
        impl $operator for Axles {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self { front: self.front $symbol other.front, rear: self.rear $symbol other.rear }
            }
        }
    )*};
}

axle_by_axle! {
    Add, add, +;
    Sub, sub, -;
    Mul, mul, *;
}

impl Mul<Four> for Axles {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Four) -> Self {
        self * Self::both(other)
    }
}

impl Neg for Axles {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { front: -self.front, rear: -self.rear }
    }
}
