//! What a measurement says about a prediction, and whether it is believed.

use nalgebra::SVector;
use std::f64::consts::TAU;

/// The result of a measurement update; every filter returns one, and nothing of it is thrown away.
///
/// A row is a measured channel. It is *available* if it had a sample, and then either *used* or *rejected*.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation<const M: usize> {
    /// Measured minus predicted; 0 in rows without a sample.
    pub residual: SVector<f64, M>,
    /// The residual in units of its standard deviation, made independent row by row where rows are used together;
    /// 0 in rows without a sample.
    pub whitened: SVector<f64, M>,
    /// Rows that corrected the state.
    pub used: [bool; M],
    /// Rows that the gate rejected.
    pub rejected: [bool; M],
    /// Normalised innovation squared over the available rows, chi-squared with [`dof`](Self::dof) degrees of
    /// freedom if filter and plant agree: jointly over the rows used, singly for those rejected; 0 without rows.
    pub nis: f64,
    /// Number of available rows.
    pub dof: usize,
    /// Logarithm of the likelihood of the available rows; 0 without rows.
    pub log_likelihood: f64,
}

impl<const M: usize> Innovation<M> {
    /// No row had a sample.
    pub fn none() -> Self {
        Self {
            residual: SVector::zeros(),
            whitened: SVector::zeros(),
            used: [false; M],
            rejected: [false; M],
            nis: 0.0,
            dof: 0,
            log_likelihood: 0.0,
        }
    }

    /// Adds one row with its whitened residual and the variance by which that was made white, which also goes into
    /// the determinant of the residuals' covariance.
    pub(super) fn count(&mut self, row: usize, whitened: f64, variance: f64, determinant: &mut f64) {
        self.whitened[row] = whitened;
        self.nis += whitened * whitened;
        self.dof += 1;
        *determinant *= variance;
    }

    /// With the likelihood that follows from the determinant of the residuals' covariance.
    pub(super) fn with_determinant(mut self, determinant: f64) -> Self {
        if self.dof > 0 {
            self.log_likelihood = -0.5 * (self.nis + determinant.ln() + self.dof as f64 * TAU.ln());
        }
        self
    }

    /// Number of rows that corrected the state.
    pub fn used_count(&self) -> usize {
        self.used.iter().filter(|used| **used).count()
    }

    /// Whether the gate rejected a row.
    pub fn any_rejected(&self) -> bool {
        self.rejected.contains(&true)
    }

    /// Normalised innovation squared per available row; 0 without rows.
    pub fn nis_per_row(&self) -> f64 {
        if self.dof > 0 { self.nis / self.dof as f64 } else { 0.0 }
    }
}

/// Rejects what is implausibly far from its prediction, and gives in if that does not end: then it is the filter that
/// has diverged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Rejected is what exceeds this many standard deviations; 0 or less rejects nothing.
    pub deviations: f64,
    /// After so many rejections in a row samples are let through until one agrees.
    pub patience: u32,
}

/// What a [`Gate`] says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It agrees with the prediction.
    Accepted,
    /// It does not, and is not used.
    Rejected,
    /// It does not, but the gate has run out of patience: it is used.
    LetThrough,
}

impl Gate {
    /// Rejects nothing.
    pub const OPEN: Self = Self { deviations: 0.0, patience: 0 };

    /// Judges the normalised innovation squared (per channel) of a sample. `in_a_row` counts rejections.
    pub fn judge(&self, square: f64, in_a_row: &mut u32) -> Verdict {
        let far = self.deviations > 0.0 && square > self.deviations * self.deviations;
        if !far {
            *in_a_row = 0;
            return Verdict::Accepted;
        }
        *in_a_row = in_a_row.saturating_add(1);
        if *in_a_row <= self.patience { Verdict::Rejected } else { Verdict::LetThrough }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The verdicts on a sequence of normalised innovations squared.
    fn verdicts(gate: Gate, squares: &[f64]) -> Vec<Verdict> {
        let mut in_a_row = 0;
        squares.iter().map(|square| gate.judge(*square, &mut in_a_row)).collect()
    }

    #[test]
    fn a_gate_gives_in_after_its_patience_and_closes_when_samples_agree_again() {
        use Verdict::{Accepted, LetThrough, Rejected};
        let gate = Gate { deviations: 3.0, patience: 2 };
        let far = 9.1;
        assert_eq!(verdicts(gate, &[8.9, far, far, far, far]), [Accepted, Rejected, Rejected, LetThrough, LetThrough]);
        // one that agrees in between begins the count anew
        assert_eq!(verdicts(gate, &[far, far, 1.0, far, far, far])[3..], [Rejected, Rejected, LetThrough]);
    }

    #[test]
    fn an_open_gate_rejects_nothing() {
        assert_eq!(verdicts(Gate::OPEN, &[1e300]), [Verdict::Accepted]);
    }

    #[test]
    fn likelihood_and_nis_are_those_of_independent_rows() {
        let mut innovation = Innovation::<2>::none();
        let mut determinant = 1.0;
        innovation.count(0, 1.5, 4.0, &mut determinant);
        innovation.count(1, -0.5, 0.25, &mut determinant);
        let innovation = innovation.with_determinant(determinant);
        let density = |white: f64, variance: f64| (-0.5 * white * white).exp() / (TAU * variance).sqrt();
        let expected = (density(1.5, 4.0) * density(-0.5, 0.25)).ln();
        assert!((innovation.log_likelihood - expected).abs() < 1e-12);
        assert_eq!((innovation.nis, innovation.dof, innovation.nis_per_row()), (2.5, 2, 1.25));
    }
}
