//! A sparse linear Gaussian problem: where its rows have entries, and their numbers.

/// The pattern of the rows.
#[derive(Clone, Debug)]
pub struct Pattern<'a> {
    /// Number of unknowns.
    pub unknowns: usize,
    /// Where each row starts in `column`; one more than there are rows.
    pub start: &'a [usize],
    /// Unknown of each entry.
    pub column: &'a [u32],
    /// Whether the value of an entry changes between solutions.
    pub varies: &'a [bool],
    /// Rows whose leverage will be asked for.
    pub monitored: std::ops::Range<usize>,
    /// Front of each unknown: fronts are eliminated in ascending order by the orthogonal method.
    pub front: &'a [u32],
}

/// The numbers of one problem.
#[derive(Clone, Copy, Debug)]
pub struct Numbers<'a> {
    /// Values of the entries.
    pub value: &'a [f64],
    /// Right sides `b`; anything finite where the weight is zero.
    pub right: &'a [f64],
    /// Weights; zero leaves a row out.
    pub weight: &'a [f64],
    /// Precision of the prior, positive.
    pub precision: &'a [f64],
    /// Mean of the prior.
    pub mean: &'a [f64],
}
