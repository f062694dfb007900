//! Joint velocities and accelerations from joint positions, at the newest sample.

use super::variables::DOF;
use crate::Status;
use crate::filter::savitzky_golay::Causal;
use serde::{Deserialize, Serialize};

/// The last positions of all joints, sample by sample in a ring. Empty if none are needed.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Derivatives {
    ring: Vec<f64>,
    /// Where the next sample goes, and how many there are.
    next: usize,
    filled: usize,
    /// Samples in a row that were extrapolated because the position was missing.
    missing: usize,
}

impl Clone for Derivatives {
    fn clone(&self) -> Self {
        Self { ring: self.ring.clone(), ..*self }
    }

    /// Into memory that is there already.
    fn clone_from(&mut self, other: &Self) {
        self.ring.clone_from(&other.ring);
        (self.next, self.filled, self.missing) = (other.next, other.filled, other.missing);
    }
}

/// What became of one sample.
pub(super) struct Taken {
    pub status: Status,
    /// Whether the derivatives are there.
    pub ready: bool,
}

/// The fit of a cubic to the window, taken at its end.
#[derive(Clone, Debug)]
pub(super) struct Differentiator {
    fit: Causal,
    dt: f64,
}

impl Differentiator {
    pub fn new(window: usize, dt: f64) -> Self {
        Self { fit: Causal::new(window, dt), dt }
    }

    /// A window without samples; without memory if it is not needed.
    pub fn empty(&self, needed: bool) -> Derivatives {
        let size = if needed { DOF * self.fit.window() } else { 0 };
        Derivatives { ring: vec![0.0; size], next: 0, filled: 0, missing: 0 }
    }

    /// Whether a state is one of this window.
    pub fn fits(&self, state: &Derivatives, needed: bool) -> bool {
        let window = if needed { self.fit.window() } else { 0 };
        let sound = state.ring.iter().all(|q| q.is_finite());
        sound && state.ring.len() == DOF * window && state.filled <= window && state.next < window.max(1)
    }

    /// Takes the positions of one sample, `dt` after the last, and gives velocities and
    /// accelerations. A missing sample is bridged by the cubic's continuation, so that the next ones
    /// are not disturbed; a longer gap or another sample time empties the window.
    pub fn push(
        &self,
        state: &mut Derivatives,
        q: &[f64; DOF],
        dt: f64,
        qd: &mut [f64; DOF],
        qdd: &mut [f64; DOF],
    ) -> Taken {
        let window = self.fit.window();
        let mut status = Status::OK;
        let whole = q.iter().all(|q| q.is_finite());
        let gap = state.filled > 0 && (dt - self.dt).abs() > 0.01 * self.dt;
        let bridged = !whole && state.filled == window && state.missing < window / 4;
        if gap || (!whole && !bridged) {
            status.raise_if(state.filled > 0, Status::RESTARTED);
            (state.next, state.filled, state.missing) = (0, 0, 0);
        }
        if whole || bridged {
            state.missing = if whole { 0 } else { state.missing + 1 };
            for (ring, &position) in state.ring.chunks_exact_mut(window).zip(q) {
                let sample = if whole { position } else { self.fit.continuation(ring, state.next) };
                ring[state.next] = sample;
            }
            state.next = (state.next + 1) % window;
            state.filled = (state.filled + 1).min(window);
        }
        let ready = state.filled == window;
        if ready {
            for (joint, ring) in state.ring.chunks_exact(window).enumerate() {
                (qd[joint], qdd[joint]) = self.fit.derivatives(ring, state.next);
            }
        } else {
            (*qd, *qdd) = ([0.0; DOF], [0.0; DOF]);
        }
        Taken { status, ready }
    }
}
