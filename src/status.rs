//! What an estimator says about its last sample: one bit field with one meaning in all machines.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::{BitOr, BitOrAssign};

/// A set of conditions; empty means that all is well.
///
/// The bits are the same for every machine and appear as the FMU's output `status`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Status(u32);

macro_rules! bits {
    ($($(#[doc = $doc:literal])+ $name:ident = $bit:literal, $word:literal;)+) => {
        impl Status {
            $($(#[doc = $doc])+ pub const $name: Self = Self(1 << $bit);)+

            /// Every condition with its bit, its word and its meaning.
            pub const ALL: &'static [(u32, &'static str, &'static str)] =
                &[$(($bit, $word, concat!($($doc),+))),+];
        }
    };
}

bits! {
    /// A measured input had no sample (NaN); its channel was left out.
    MISSING = 0, "missing";
    /// An input was infinite and was treated as missing.
    INFINITE = 1, "infinite";
    /// An input was outside its plausible range and was treated as missing.
    IMPLAUSIBLE = 2, "implausible";
    /// A measurement disagreed too much with the prediction and was rejected.
    GATED = 3, "gated";
    /// The machine stands still; estimates that need motion are held.
    STANDSTILL = 4, "standstill";
    /// Estimates are held because the sample carries no information about them.
    HOLD = 5, "hold";
    /// The filter restarted or re-aligned itself after a gap or a jump.
    RESTARTED = 6, "restarted";
    /// Numerical trouble was repaired: rolled back, covariance repaired, or a second method used.
    RECOVERED = 7, "recovered";
    /// The time step was not positive, not finite or too long; the sample was not used as it stood.
    BAD_STEP = 8, "bad-step";
    /// An estimate sits at its bound, so the inputs and the parameters do not fit each other.
    AT_BOUND = 9, "at-bound";
    /// A main estimate is not observable at present; its standard deviation says how well it is known.
    UNOBSERVABLE = 10, "unobservable";
    /// A wheel slips, or slip and torque contradict each other.
    SLIP = 11, "slip";
    /// A wheel carries no load.
    LIFT_OFF = 12, "lift-off";
    /// An input that cannot be missing was, and its last valid value was used.
    HELD_INPUT = 13, "held-input";
    /// Nothing at all was measured; the outputs are the prior through the model.
    NO_MEASUREMENT = 14, "no-measurement";
    /// The sample was skipped whole.
    SKIPPED = 15, "skipped";
    /// The measurements of the last seconds contradict the parameters; standard deviations mean nothing.
    CONTRADICTED = 16, "contradicted";
    /// A force, moment, torque or other input that cannot be missing was never set; it is taken as zero or left out.
    NEVER_SET = 17, "never-set";
}

impl Status {
    /// All is well.
    pub const OK: Self = Self(0);

    /// The bit field.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Whether all conditions of `other` hold.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether any condition of `other` holds.
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Adds the conditions of `other` if `condition` is true.
    pub fn raise_if(&mut self, condition: bool, other: Self) {
        if condition {
            *self |= other;
        }
    }
}

impl BitOr for Status {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Status {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::OK {
            return f.write_str("ok");
        }
        let words = Self::ALL.iter().filter(|(bit, ..)| self.0 >> bit & 1 == 1);
        for (i, (_, word, _)) in words.enumerate() {
            write!(f, "{}{word}", if i == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}

// The FMU's and the machine's view of the same number.
impl crate::variable::Value for Status {
    const KIND: crate::variable::Kind = crate::variable::Kind::Integer;
    const RANGE: (f64, f64) = (0.0, ((1_u32 << Status::ALL.len()) - 1) as f64);
    fn to_number(self) -> f64 {
        f64::from(self.0)
    }
    fn from_number(number: f64) -> Self {
        Self(number as u32)
    }
}
