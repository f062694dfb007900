//! A constant beside the state of which the filter knows nothing: Friedland's two-stage filter.
//!
//! B. Friedland, "Treatment of bias in recursive filtering", IEEE Transactions on Automatic Control 14, 1969. The filter runs
//! as if the constant `b` were zero. `c = dx/db`, by which each state would be other had the filter known of `b`, goes with the
//! filter's own transition and gain,
//!
//! ```text
//! c <- Phi c + (what b adds to the states),    u = H c + (what b adds to the rows),    c <- c - K u
//! ```
//!
//! and each innovation `nu` measures `b`: `nu = u b + noise` of the innovation's variance. State and covariance of a filter
//! that has `b` as a state are `x + c b` and `P + c var(b) c^T`, exactly; with `b = 0` they are `x` and `P`.

use super::gaussian::{Gaussian, add_scaled, combination, dot};
use nalgebra::{SMatrix, SVector};

/// A constant beside `N` states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beside<const N: usize> {
    /// `c`, per unit of the constant.
    pub by: [f64; N],
    /// What the innovations say of the constant, and the variance of that.
    pub value: f64,
    /// See [`value`](Self::value).
    pub variance: f64,
}

impl<const N: usize> Beside<N> {
    /// Time update by the first `K` rows of `Phi`, the others are the identity's; `adds` is what the constant adds to these
    /// states, per unit.
    pub fn predict<const K: usize>(&mut self, transition: &SMatrix<f64, K, N>, adds: &SVector<f64, K>) {
        let moved = combination(transition, &self.by);
        for k in 0..K {
            self.by[k] = moved[k] + adds[k];
        }
    }

    /// Takes a row `h` of a correction, its innovation after the rows before it, with that one's variance and covariance with
    /// the states, `P h^T`; `adds` is what the constant adds to the row, per unit.
    #[inline(always)]
    pub(super) fn take_row(&mut self, h: &[f64; N], adds: f64, innovation: f64, variance: f64, cross: &[f64; N]) {
        let u = dot(h, &self.by) + adds;
        add_scaled(&mut self.by, cross, -u / variance);
        let gain = self.variance * u / (variance + u * u * self.variance);
        self.value += gain * (innovation - u * self.value);
        self.variance -= gain * u * self.variance;
    }

    /// Adds to the covariance of a belief what `square`, a mean square of the constant, makes of it.
    pub fn add_unknown(&self, belief: &mut Gaussian<N>, square: f64) {
        let scaled = self.by.map(|by| by * square.sqrt());
        for (column, factor) in belief.covariance.data.0.iter_mut().zip(&scaled) {
            add_scaled(column, &scaled, *factor);
        }
    }

    /// Puts the constant into the state that it was beside, as if it had been there from the start.
    pub fn put_into(&self, belief: &mut Gaussian<N>) {
        belief.mean += SVector::from(self.by) * self.value;
        self.add_unknown(belief, self.variance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::ekf::{self, Rows};

    /// Friedland's theorem.
    #[test]
    fn beside_the_state_a_constant_is_known_as_well_as_in_it() {
        let (std, unknown) = ([1.0, 0.5], 2.0);
        let mut belief = Gaussian::independent(SVector::from([0.2, -0.1]), &SVector::from(std));
        let mut whole =
            Gaussian::independent(SVector::from([0.2, -0.1, 0.0]), &SVector::from([std[0], std[1], unknown]));
        let mut beside = Beside { by: [0.0; 2], value: 0.0, variance: unknown * unknown };
        let transition = SMatrix::<f64, 2, 2>::new(1.0, 0.1, -0.3, 0.9);
        for k in 0..40 {
            let acts = f64::from(k < 20);
            let (adds, felt) = (SVector::from([0.04, 0.3]) * acts, [0.0, 2.0 * acts]);
            let mut full = SMatrix::<f64, 2, 3>::zeros();
            full.fixed_columns_mut::<2>(0).copy_from(&transition);
            full.set_column(2, &adds);
            beside.predict(&transition, &adds);
            let mean = transition * belief.mean;
            ekf::predict(&mut belief, mean, &transition);
            let (moved, constant) = (full * whole.mean, whole.mean[2]);
            ekf::predict(&mut whole, SVector::from([moved[0], moved[1], constant]), &full);
            for state in 0..2 {
                belief.inflate(state, 0.01);
                whole.inflate(state, 0.01);
            }

            let measured = SVector::from([(0.3 * f64::from(k)).sin(), (0.7 * f64::from(k)).cos()]);
            let jacobian = SMatrix::<f64, 2, 2>::new(1.0, 0.0, 0.5, 2.0);
            let mut all = SMatrix::<f64, 2, 3>::zeros();
            all.fixed_columns_mut::<2>(0).copy_from(&jacobian);
            all.set_column(2, &SVector::from(felt));
            let (noise, used) = (SMatrix::<f64, 2, 2>::new(0.3, 0.1, 0.1, 0.2), [true, k % 3 > 0]);
            let rows = Rows { innovation: measured - jacobian * belief.mean, jacobian, noise, used };
            ekf::correct_beside(&mut belief, &rows, None, Some((&mut beside, felt))).unwrap();
            let innovation = measured - all * whole.mean;
            ekf::correct(&mut whole, &Rows { innovation, jacobian: all, noise, used }, None).unwrap();

            let mut known = belief;
            beside.put_into(&mut known);
            assert!((known.mean - whole.mean.fixed_rows::<2>(0)).amax() < 1e-12);
            assert!((known.covariance - whole.covariance.fixed_view::<2, 2>(0, 0)).amax() < 1e-12);
            assert!((beside.value - whole.mean[2]).abs() < 1e-12);
            assert!((beside.variance - whole.covariance[(2, 2)]).abs() < 1e-12);
        }
        assert!(beside.variance < 0.1 * unknown * unknown, "the rows say nothing of the constant");
    }
}
