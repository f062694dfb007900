//! Maximum a posteriori estimate of a linear Gaussian model as one sparse least squares problem.
//!
//! Minimises `sum_r w_r (A_r x - b_r)^2 + sum_i p_i (x_i - m_i)^2` with weights `w = 1/variance`
//! and a prior of precision `p` and mean `m`. With `Lambda = A' W A + P` the minimum is the mean
//! `Lambda^-1 (A' W b + P m)` and `Lambda^-1` is its covariance (Latella et al. 2019, eq. 5).
//! `Lambda` is factored sparsely ([`SparseLdl`]); the mean is then corrected twice with the
//! residual of the rows themselves, `x += Lambda^-1 (A' W (b - A x) + P (m - x))`, which brings it
//! to the accuracy of an orthogonal method. Where a pivot is not positive or the corrections do not
//! settle, the rows are factored by [`TreeQr`] instead: a wrong number is never silent.

pub use super::sparse_rows::{Numbers, Pattern};

use super::sparse_ldl::SparseLdl;
use super::tree_qr::TreeQr;

/// Which method gave the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Sparse `L D L'` with corrections. Where it would lose too many digits of the variances,
    /// these come from the orthogonal method.
    SparseLdl,
    /// Orthogonal elimination along the tree, because the first method failed.
    TreeQr,
}

/// The weights are such that neither method can solve the problem in double precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the information matrix is singular to working precision")]
pub struct SingularInformation;

/// A pair of entries of one row whose product changes with the posture.
#[derive(Clone, Copy, Debug)]
struct Product {
    weighted: u32,
    plain: u32,
    slot: u32,
}

/// Solver for problems of one pattern. Allocates at construction only.
#[derive(Clone, Debug)]
pub struct Map {
    start: Vec<usize>,
    column: Vec<u32>,
    products: Vec<Product>,
    /// Slot in `L` of every pair of constant entries, row by row.
    constant_pairs: Vec<Product>,
    constant_rows: Vec<u32>,
    /// Weights and precisions for which `constant` was summed.
    last_weight: Vec<f64>,
    last_precision: Vec<f64>,
    constant: Vec<f64>,
    weighted: Vec<f64>,
    ldl: SparseLdl,
    qr: TreeQr,
    /// Slots of the pairs of entries of the monitored rows, row by row.
    monitored: std::ops::Range<usize>,
    pair_start: Vec<usize>,
    pair_slot: Vec<u32>,
    /// Whether the selected inverse belongs to the last solution.
    inverse_known: bool,
    /// Right side and solution in the order of elimination.
    work: Vec<f64>,
    columns: Vec<[f64; LANES]>,
    gradient: Vec<f64>,
    x: Vec<f64>,
    variance: Vec<f64>,
}

/// Unknowns whose covariances are asked for at once: two wide registers of four.
pub const LANES: usize = 8;
/// Corrections after the first solution.
const CORRECTIONS: usize = 2;
/// Cancellation in the factor beyond which the variances, which cannot be corrected, would have less
/// than five digits; the orthogonal method then gives them. An unknown that only a wide prior holds,
/// such as a contact without a sensor, cancels by the prior's variance times the equations' weight.
const CANCELLATION: f64 = 2e10;
/// The same, for eight digits, where rows are left out: samples are missing now and then, so the
/// slower method's time does not matter.
const CANCELLATION_WITH_GAPS: f64 = 1e7;
/// Largest last correction, relative to the solution, that counts as settled.
const SETTLED: f64 = 1e-7;

impl Map {
    /// Prepares for a pattern.
    pub fn new(pattern: &Pattern) -> Self {
        let rows = pattern.start.len() - 1;
        let mut pairs = vec![];
        for r in 0..rows {
            let entries = &pattern.column[pattern.start[r]..pattern.start[r + 1]];
            for (k, &i) in entries.iter().enumerate() {
                pairs.extend(entries[k + 1..].iter().map(|&j| (i, j)));
            }
        }
        let ldl = SparseLdl::new(pattern.unknowns, &pairs);
        let (mut products, mut constant_pairs, mut constant_rows) = (vec![], vec![], vec![]);
        for r in 0..rows {
            for a in pattern.start[r]..pattern.start[r + 1] {
                for b in a..pattern.start[r + 1] {
                    let (i, j) = (pattern.column[a] as usize, pattern.column[b] as usize);
                    let Some(slot) = ldl.slot(i, j) else { continue };
                    let product = Product { weighted: a as u32, plain: b as u32, slot: slot as u32 };
                    if pattern.varies[a] || pattern.varies[b] {
                        products.push(product);
                    } else {
                        constant_pairs.push(product);
                        constant_rows.push(r as u32);
                    }
                }
            }
        }
        let (mut pair_start, mut pair_slot) = (vec![0], vec![]);
        for r in pattern.monitored.clone() {
            let entries = &pattern.column[pattern.start[r]..pattern.start[r + 1]];
            for (k, &i) in entries.iter().enumerate() {
                pair_slot
                    .extend(entries[k..].iter().filter_map(|&j| ldl.slot(i as usize, j as usize)).map(|s| s as u32));
            }
            pair_start.push(pair_slot.len());
        }
        let n = pattern.unknowns;
        Self {
            monitored: pattern.monitored.clone(),
            pair_start,
            pair_slot,
            inverse_known: false,
            start: pattern.start.to_vec(),
            column: pattern.column.to_vec(),
            products,
            constant_pairs,
            constant_rows,
            last_weight: vec![f64::NAN; rows],
            last_precision: vec![f64::NAN; n],
            constant: vec![0.0; ldl.nonzeros()],
            weighted: vec![0.0; pattern.column.len()],
            qr: TreeQr::new(pattern),
            work: vec![0.0; n],
            columns: vec![[0.0; LANES]; n],
            gradient: vec![0.0; n],
            x: vec![0.0; n],
            variance: vec![0.0; n],
            ldl,
        }
    }

    /// Solves one problem; also for the variances of all unknowns if `variances`.
    pub fn solve(&mut self, numbers: &Numbers, variances: bool) -> Result<Method, SingularInformation> {
        self.assemble(numbers);
        self.inverse_known = false;
        if self.ldl.factor().is_ok() && self.mean_by_ldl(numbers) {
            if !variances {
                return Ok(Method::SparseLdl);
            }
            let gaps = numbers.weight.contains(&0.0);
            let bound = if gaps { CANCELLATION_WITH_GAPS } else { CANCELLATION };
            if self.ldl.cancellation() < bound && self.variances_by_ldl() {
                self.inverse_known = true;
                return Ok(Method::SparseLdl);
            }
            // the corrected mean is the better one, only the variances need the other method
            if self.qr.factor(numbers).is_ok() {
                self.qr.variances(&mut self.variance);
                if self.variance.iter().all(|v| *v > 0.0 && v.is_finite()) {
                    return Ok(Method::SparseLdl);
                }
            }
        }
        self.solve_by_qr(numbers, variances)?;
        Ok(Method::TreeQr)
    }

    /// Solves by the orthogonal method alone.
    pub fn solve_by_qr(&mut self, numbers: &Numbers, variances: bool) -> Result<(), SingularInformation> {
        self.inverse_known = false;
        self.qr.factor(numbers).map_err(|_| SingularInformation)?;
        self.qr.mean(&mut self.x);
        if variances {
            self.qr.variances(&mut self.variance);
        }
        let finite = self.x.iter().all(|x| x.is_finite())
            && (!variances || self.variance.iter().all(|v| v.is_finite() && *v > 0.0));
        if finite { Ok(()) } else { Err(SingularInformation) }
    }

    /// The mean of the last solution.
    pub fn mean(&self) -> &[f64] {
        &self.x
    }

    /// The variances of the last solution that was asked for them.
    pub fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// `w a' Lambda^-1 a` of a monitored row after a solution with variances: the share of its own
    /// reading in the estimate of what it measures, 1 if nothing else says anything about it. Not
    /// known if the orthogonal method had to give the variances.
    pub fn leverage(&self, row: usize, numbers: &Numbers) -> Option<f64> {
        if !self.inverse_known || !self.monitored.contains(&row) {
            return None;
        }
        let values = &numbers.value[self.start[row]..self.start[row + 1]];
        let k = row - self.monitored.start;
        let mut slots = self.pair_slot[self.pair_start[k]..self.pair_start[k + 1]].iter();
        let mut sum = 0.0;
        for (i, a) in values.iter().enumerate() {
            for (j, b) in values[i..].iter().enumerate() {
                let z = self.ldl.inverse_at(*slots.next()? as usize);
                sum += if j == 0 { a * a * z } else { 2.0 * a * b * z };
            }
        }
        Some(numbers.weight[row] * sum)
    }

    /// The covariances of some unknowns with all of them, `Lambda^-1 e`, of the last solution with variances; false if the
    /// orthogonal method had to give these.
    pub fn covariances(&mut self, unknowns: &[usize; LANES], covariance: &mut [[f64; LANES]]) -> bool {
        if !self.inverse_known {
            return false;
        }
        self.columns.fill([0.0; LANES]);
        let places = unknowns.map(|unknown| self.ldl.place(unknown));
        for (lane, place) in places.into_iter().enumerate() {
            self.columns[place][lane] = 1.0;
        }
        self.ldl.solve_columns(&mut self.columns, places.into_iter().min().unwrap_or(0));
        for (&value, &other) in self.columns.iter().zip(self.ldl.order()) {
            covariance[other as usize] = value;
        }
        true
    }

    /// The factor, for its size.
    pub fn ldl(&self) -> &SparseLdl {
        &self.ldl
    }

    /// Writes `Lambda` into the factor's place.
    fn assemble(&mut self, numbers: &Numbers) {
        if self.last_weight != numbers.weight || self.last_precision != numbers.precision {
            self.sum_constants(numbers);
        }
        for r in 0..self.start.len() - 1 {
            let w = numbers.weight[r];
            let entries = self.start[r]..self.start[r + 1];
            for (weighted, value) in self.weighted[entries.clone()].iter_mut().zip(&numbers.value[entries]) {
                *weighted = w * value;
            }
        }
        let values = self.ldl.values_mut();
        values.copy_from_slice(&self.constant);
        for product in &self.products {
            values[product.slot as usize] +=
                self.weighted[product.weighted as usize] * numbers.value[product.plain as usize];
        }
    }

    /// What does not change with the posture is summed again only when a weight changed.
    fn sum_constants(&mut self, numbers: &Numbers) {
        self.last_weight.copy_from_slice(numbers.weight);
        self.last_precision.copy_from_slice(numbers.precision);
        self.constant.fill(0.0);
        for (slot, &unknown) in self.constant.iter_mut().zip(self.ldl.order()) {
            *slot = numbers.precision[unknown as usize];
        }
        for (product, &row) in self.constant_pairs.iter().zip(&self.constant_rows) {
            let value = numbers.value[product.weighted as usize] * numbers.value[product.plain as usize];
            self.constant[product.slot as usize] += numbers.weight[row as usize] * value;
        }
    }

    /// Mean with corrections; false if they do not settle.
    fn mean_by_ldl(&mut self, numbers: &Numbers) -> bool {
        self.x.fill(0.0);
        let mut settled = false;
        for pass in 0..=CORRECTIONS {
            // A correction leaves about its own square: what the first one brings to `SETTLED` the next one would not move.
            if pass > 1 && settled {
                break;
            }
            self.descend(numbers, pass > 0);
            for (slot, &unknown) in self.work.iter_mut().zip(self.ldl.order()) {
                *slot = self.gradient[unknown as usize];
            }
            self.ldl.solve(&mut self.work);
            let (mut largest, mut change) = (0.0_f64, 0.0_f64);
            for (&dx, &unknown) in self.work.iter().zip(self.ldl.order()) {
                let x = &mut self.x[unknown as usize];
                *x += dx;
                largest = largest.max(x.abs());
                change = change.max(dx.abs());
                // NaN would vanish in max
                if !x.is_finite() {
                    return false;
                }
            }
            settled = change <= SETTLED * (1.0 + largest);
        }
        settled
    }

    /// The gradient `A' W (b - A x) + P (m - x)`; `x` is 0 unless it has `moved`.
    fn descend(&mut self, numbers: &Numbers, moved: bool) {
        let prior = numbers.precision.iter().zip(numbers.mean);
        for ((g, x), (p, m)) in self.gradient.iter_mut().zip(&self.x).zip(prior) {
            *g = p * (m - x);
        }
        for r in 0..self.start.len() - 1 {
            let entries = self.start[r]..self.start[r + 1];
            let columns = &self.column[entries.clone()];
            let values = &numbers.value[entries];
            let mut residual = numbers.right[r];
            if moved {
                for (&c, &v) in columns.iter().zip(values) {
                    residual -= v * self.x[c as usize];
                }
            }
            let s = numbers.weight[r] * residual;
            for (&c, &v) in columns.iter().zip(values) {
                self.gradient[c as usize] += v * s;
            }
        }
    }

    fn variances_by_ldl(&mut self) -> bool {
        self.ldl.invert();
        let mut good = true;
        for (&v, &unknown) in self.ldl.inverse_diagonal().iter().zip(self.ldl.order()) {
            self.variance[unknown as usize] = v;
            good &= v > 0.0 && v < f64::INFINITY;
        }
        good
    }
}
