//! A brake that may hold the chair at the start of a ride, where nobody reports it.
//!
//! A chair that stands without a reported force says that the ground is level, or that a brake holds it: a specific force that
//! it feels then is a bias of the accelerometer, or a slope. No measurement at rest tells the two apart, and the filter, which
//! knows no brake, takes the first for true. So the tilt `b` at which a brake may hold the chair is carried beside the state
//! ([`two_stage`](crate::filter::two_stage)): while it holds, it adds to `v'` and `r'` what gravity takes from them on such a
//! tilt. That `b` is not known counts in the standard deviations of all estimates from the start, with its mean square. Once
//! the chair moves, its acceleration under the reported force shows what is true: a `b` that is significant then goes into
//! the state, as if it had been there from the start.

use crate::filter::gaussian::Gaussian;
use crate::filter::two_stage::Beside;
use serde::{Deserialize, Serialize};

/// Largest number of states.
const STATES: usize = 15;
/// Standard deviation of the tilt at which a brake may hold a chair, rad.
const UNKNOWN: f64 = 0.1;
/// The brake is taken for true if the tilt that it held is so many standard deviations from zero, and so large, rad. Rolling
/// resistance that nobody reported, up to 0.02 of the weight, looks like a tilt of as many radians at the first motion: a smaller
/// one is left to the standard deviations.
const SIGNIFICANT: f64 = 5.0;
const LEAST: f64 = 0.03;
/// For so long after the first motion, s, static friction and casters that swivel say nothing of a brake.
const SETTLES: f64 = 1.0;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
enum Phase {
    /// There was none, or it has gone into the state.
    #[default]
    None,
    /// The chair stands.
    Holds,
    /// It has moved.
    Released,
}

/// The tilt at which a brake may have held the chair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Brake {
    phase: Phase,
    /// The change of the states, per rad of tilt; the tilt, rad, and its variance.
    by: [f64; STATES],
    tilt: f64,
    variance: f64,
    /// The force that was reported first, N.
    force: Option<f64>,
    /// Time since the first motion, s.
    released_for: f64,
}

impl Brake {
    /// One that may hold the chair from now on.
    pub(super) fn unknown() -> Self {
        Self { phase: Phase::Holds, variance: UNKNOWN * UNKNOWN, ..Self::default() }
    }

    /// Whether there may have been one of which the state does not know.
    pub(super) fn is_unknown(&self) -> bool {
        self.phase != Phase::None
    }

    /// Whether the chair still stands where a brake may hold it.
    pub(super) fn holds(&self) -> bool {
        self.phase == Phase::Holds
    }

    /// Whether the reported force, N, has changed by more than `little` since the first: nobody drives against a brake.
    pub(super) fn is_driven(&mut self, force: f64, little: f64) -> bool {
        (force - *self.force.get_or_insert(force)).abs() > little
    }

    pub(super) fn release(&mut self) {
        if self.holds() {
            self.phase = Phase::Released;
        }
    }

    /// The tilt beside a state of `N` numbers.
    pub(super) fn beside<const N: usize>(&self) -> Beside<N> {
        Beside { by: std::array::from_fn(|k| self.by[k]), value: self.tilt, variance: self.variance }
    }

    /// Takes over what a step made of [`beside`](Self::beside).
    pub(super) fn keep<const N: usize>(&mut self, beside: &Beside<N>) {
        self.by[..N].copy_from_slice(&beside.by);
        (self.tilt, self.variance) = (beside.value, beside.variance);
    }

    /// Puts the brake into the state once that it held is significant, `dt` seconds after the last call.
    pub(super) fn settle<const N: usize>(&mut self, belief: &mut Gaussian<N>, dt: f64) {
        if self.phase != Phase::Released {
            return;
        }
        self.released_for += dt;
        let significant = self.tilt.abs() > LEAST.max(SIGNIFICANT * self.variance.sqrt());
        if significant && self.released_for > SETTLES {
            self.beside().put_into(belief);
            *self = Self::default();
        }
    }

    /// Mean square of the tilt, of which the state knows nothing.
    fn square(&self) -> f64 {
        self.tilt * self.tilt + self.variance
    }

    /// Mean square of what is unknown of a state for the brake's sake.
    pub(super) fn variance_of(&self, index: usize) -> f64 {
        self.by[index] * self.by[index] * self.square()
    }

    /// A belief with what is unknown of the brake.
    pub(super) fn with_unknown<const N: usize>(&self, belief: &Gaussian<N>) -> Gaussian<N> {
        let mut all = *belief;
        if self.is_unknown() {
            self.beside().add_unknown(&mut all, self.square());
        }
        all
    }
}
