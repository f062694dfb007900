//! Orthogonal solution of a sparse least squares problem, front by front along a tree.
//!
//! The unknowns are grouped in fronts that are eliminated in turn. A front collects the rows that
//! touch its unknowns and the messages of the fronts below it, triangularises them by Householder
//! reflections, keeps the rows of its own unknowns and hands the rest on as its message. Backwards
//! come the solution and the covariance: with `G = -R_EE^-1 R_ES`,
//! `Cov(E) = R_EE^-1 R_EE^-T + G Cov(S) G'`, and `Cov(S)` is a part of the covariance of the front
//! above. Slower than the sparse factor and indifferent to how stiff the problem is.

use super::sparse_rows::{Numbers, Pattern};

/// A front whose own unknowns are not determined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RankDeficient {
    /// The unknown whose diagonal vanished.
    pub unknown: usize,
}

#[derive(Clone, Debug)]
struct Front {
    /// Unknowns: first those eliminated here, then the separator.
    unknowns: Vec<u32>,
    eliminated: usize,
    rows: Vec<u32>,
    /// Fronts whose messages arrive here.
    below: Vec<usize>,
    above: Option<usize>,
    /// Where each separator unknown is among the unknowns of the front above.
    in_above: Vec<u32>,
    /// Height of the dense front before elimination.
    height: usize,
    /// Where each gathered row stands: rows are sorted by the first unknown that they touch.
    place: Vec<u32>,
    /// Per column the number of rows that begin there or before: further down all entries are zero.
    ends: Vec<u32>,
}

impl Front {
    fn width(&self) -> usize {
        self.unknowns.len()
    }
    fn separator(&self) -> usize {
        self.unknowns.len() - self.eliminated
    }
}

/// Fronts and their numbers for one pattern. Allocates at construction only.
#[derive(Clone, Debug)]
pub struct TreeQr {
    start: Vec<usize>,
    column: Vec<u32>,
    fronts: Vec<Front>,
    /// Place of each unknown in its current front, and scratch.
    local: Vec<u32>,
    /// Per front `[R_EE R_ES c]`, by rows.
    triangle: Vec<Vec<f64>>,
    /// Per front the message `[R_SS c_S]`, by rows.
    message: Vec<Vec<f64>>,
    covariance: Vec<Vec<f64>>,
    dense: Vec<f64>,
    solution: Vec<f64>,
    gain: Vec<f64>,
}

impl TreeQr {
    /// Prepares the fronts of a pattern.
    pub fn new(pattern: &Pattern) -> Self {
        let n = pattern.unknowns;
        let count = pattern.front.iter().map(|&f| f as usize + 1).max().unwrap_or(0);
        let mut members: Vec<Vec<u32>> = vec![vec![]; count];
        for (unknown, &front) in pattern.front.iter().enumerate() {
            members[front as usize].push(unknown as u32);
        }
        let mut rows: Vec<Vec<u32>> = vec![vec![]; count];
        for r in 0..pattern.start.len() - 1 {
            let entries = &pattern.column[pattern.start[r]..pattern.start[r + 1]];
            if let Some(first) = entries.iter().map(|&c| pattern.front[c as usize]).min() {
                rows[first as usize].push(r as u32);
            }
        }
        let mut below: Vec<Vec<usize>> = vec![vec![]; count];
        let mut fronts: Vec<Front> = vec![];
        for f in 0..count {
            let own = std::mem::take(&mut members[f]);
            let mut separator: Vec<u32> = rows[f]
                .iter()
                .flat_map(|&r| &pattern.column[pattern.start[r as usize]..pattern.start[r as usize + 1]])
                .chain(below[f].iter().flat_map(|&b| &fronts[b].unknowns[fronts[b].eliminated..]))
                .copied()
                .filter(|&c| pattern.front[c as usize] as usize > f)
                .collect();
            separator.sort_unstable();
            separator.dedup();
            let above = separator.iter().map(|&c| pattern.front[c as usize] as usize).min();
            if let Some(above) = above {
                below[above].push(f);
            }
            let messages: usize = below[f].iter().map(|&b| fronts[b].separator()).sum();
            let height = rows[f].len() + messages + own.len();
            let eliminated = own.len();
            let unknowns = own.into_iter().chain(separator).collect();
            let rows = std::mem::take(&mut rows[f]);
            let below = below[f].clone();
            let (place, ends) = (vec![], vec![]);
            fronts.push(Front { unknowns, eliminated, rows, below, above, in_above: vec![], height, place, ends });
        }
        for f in 0..count {
            let Some(above) = fronts[f].above else { continue };
            let find = |u: &u32| fronts[above].unknowns.iter().position(|other| other == u).unwrap_or(0) as u32;
            fronts[f].in_above = fronts[f].unknowns[fronts[f].eliminated..].iter().map(find).collect();
        }
        for f in 0..count {
            let first = first_columns(&fronts, f, pattern);
            let mut order: Vec<usize> = (0..first.len()).collect();
            order.sort_by_key(|&row| first[row]);
            fronts[f].place = vec![0; order.len()];
            for (place, row) in order.into_iter().enumerate() {
                fronts[f].place[row] = place as u32;
            }
            let begun = |column: usize| first.iter().filter(|&&other| other <= column).count() as u32;
            fronts[f].ends = (0..fronts[f].width()).map(begun).collect();
        }
        let largest = |size: fn(&Front) -> usize| fronts.iter().map(size).max().unwrap_or(0);
        Self {
            start: pattern.start.to_vec(),
            column: pattern.column.to_vec(),
            local: vec![0; n],
            triangle: fronts.iter().map(|f| vec![0.0; f.eliminated * (f.width() + 1)]).collect(),
            message: fronts.iter().map(|f| vec![0.0; f.separator() * (f.separator() + 1)]).collect(),
            covariance: fronts.iter().map(|f| vec![0.0; f.width() * f.width()]).collect(),
            dense: vec![0.0; largest(|f| f.height * (f.width() + 1))],
            solution: vec![0.0; n],
            gain: vec![0.0; largest(|f| f.eliminated * (f.eliminated + f.width()))],
            fronts,
        }
    }

    /// Eliminates all fronts and solves for the mean.
    pub fn factor(&mut self, numbers: &Numbers) -> Result<(), RankDeficient> {
        for f in 0..self.fronts.len() {
            let (height, width) = self.collect(f, numbers);
            // columns are contiguous: entry (i, j) at j * height + i
            let front = &self.fronts[f];
            householder(&mut self.dense, height, width, &front.ends);
            let (e, s) = (front.eliminated, front.separator());
            let at = |i: usize, j: usize| if i < height { self.dense[j * height + i] } else { 0.0 };
            for i in 0..e {
                if !(at(i, i).abs() > 0.0 && at(i, i).is_finite()) {
                    return Err(RankDeficient { unknown: front.unknowns[i] as usize });
                }
                for j in 0..width {
                    self.triangle[f][i * width + j] = if j >= i { at(i, j) } else { 0.0 };
                }
            }
            for i in 0..s {
                for j in 0..=s {
                    self.message[f][i * (s + 1) + j] = if j >= i { at(e + i, e + j) } else { 0.0 };
                }
            }
        }
        for f in (0..self.fronts.len()).rev() {
            let front = &self.fronts[f];
            let width = front.width() + 1;
            for i in (0..front.eliminated).rev() {
                let row = &self.triangle[f][i * width..(i + 1) * width];
                let mut x = row[width - 1];
                for (r, &u) in row[..width - 1].iter().zip(&front.unknowns).skip(i + 1) {
                    x -= r * self.solution[u as usize];
                }
                self.solution[front.unknowns[i] as usize] = x / row[i];
            }
        }
        Ok(())
    }

    /// Gathers the rows of a front: equations and measurements, messages, priors.
    fn collect(&mut self, f: usize, numbers: &Numbers) -> (usize, usize) {
        let front = &self.fronts[f];
        let (height, width) = (front.height, front.width() + 1);
        let dense = &mut self.dense[..height * width];
        dense.fill(0.0);
        for (k, &u) in front.unknowns.iter().enumerate() {
            self.local[u as usize] = k as u32;
        }
        let mut places = front.place.iter().map(|&place| place as usize);
        for &r in &front.rows {
            let Some(i) = places.next() else { break };
            let r = r as usize;
            let root = numbers.weight[r].sqrt();
            for entry in self.start[r]..self.start[r + 1] {
                dense[self.local[self.column[entry] as usize] as usize * height + i] = root * numbers.value[entry];
            }
            dense[(width - 1) * height + i] = root * numbers.right[r];
        }
        for &b in &front.below {
            let s = self.fronts[b].separator();
            for (k, i) in (0..s).zip(&mut places) {
                let row = &self.message[b][k * (s + 1)..(k + 1) * (s + 1)];
                for (value, &to) in row.iter().zip(&self.fronts[b].in_above) {
                    dense[to as usize * height + i] = *value;
                }
                dense[(width - 1) * height + i] = row[s];
            }
        }
        for (k, i) in (0..front.eliminated).zip(places) {
            let u = front.unknowns[k] as usize;
            let root = numbers.precision[u].sqrt();
            dense[k * height + i] = root;
            dense[(width - 1) * height + i] = root * numbers.mean[u];
        }
        (height, width)
    }

    /// The mean of the last factorisation.
    pub fn mean(&self, mean: &mut [f64]) {
        mean.copy_from_slice(&self.solution);
    }

    /// The variances of all unknowns of the last factorisation.
    pub fn variances(&mut self, variance: &mut [f64]) {
        for f in (0..self.fronts.len()).rev() {
            let front = &self.fronts[f];
            let (e, s, w) = (front.eliminated, front.separator(), front.width());
            let mut own = std::mem::take(&mut self.covariance[f]);
            let (inverse, gain) = self.gain.split_at_mut(e * e);
            // R_EE^-1 and G = -R_EE^-1 R_ES, row by row from below; many entries of R are zero
            for i in (0..e).rev() {
                let row = &self.triangle[f][i * (w + 1)..(i + 1) * (w + 1)];
                let (upper, solved) = inverse[i * e..].split_at_mut(e);
                upper.fill(0.0);
                upper[i] = 1.0;
                for k in (i + 1..e).filter(|&k| row[k] != 0.0) {
                    add(&mut upper[k..], -row[k], &solved[(k - i - 1) * e + k..(k - i) * e]);
                }
                upper[i..].iter_mut().for_each(|value| *value /= row[i]);
                let gain = &mut gain[i * s..(i + 1) * s];
                gain.fill(0.0);
                for k in (i..e).filter(|&k| upper[k] != 0.0) {
                    add(gain, -upper[k], &self.triangle[f][k * (w + 1) + e..k * (w + 1) + w]);
                }
            }
            if let Some(above) = front.above {
                let (outer, wide) = (&self.covariance[above], self.fronts[above].width());
                for i in 0..s {
                    for j in 0..s {
                        own[(e + i) * w + e + j] =
                            outer[front.in_above[i] as usize * wide + front.in_above[j] as usize];
                    }
                }
            }
            let (upper, lower) = own.split_at_mut(e * w);
            for i in 0..e {
                let row = &mut upper[i * w + e..(i + 1) * w];
                row.fill(0.0);
                for k in 0..s {
                    add(row, gain[i * s + k], &lower[k * w + e..(k + 1) * w]);
                }
                for (j, value) in row.iter().enumerate() {
                    lower[j * w + i] = *value;
                }
            }
            for i in 0..e {
                for j in 0..=i {
                    let from_own = product(&inverse[i * e + i..(i + 1) * e], &inverse[j * e + i..(j + 1) * e]);
                    let from_above = product(&own[i * w + e..(i + 1) * w], &gain[j * s..(j + 1) * s]);
                    own[i * w + j] = from_own + from_above;
                    own[j * w + i] = from_own + from_above;
                }
                variance[front.unknowns[i] as usize] = own[i * w + i];
            }
            self.covariance[f] = own;
        }
    }
}

/// For every row that a front gathers, in the order of gathering, the first column that it touches.
fn first_columns(fronts: &[Front], f: usize, pattern: &Pattern) -> Vec<usize> {
    let front = &fronts[f];
    let local = |unknown: &u32| front.unknowns.iter().position(|other| other == unknown).unwrap_or(0);
    let rows = front.rows.iter().map(|&r| {
        let entries = pattern.start[r as usize]..pattern.start[r as usize + 1];
        pattern.column[entries].iter().map(local).min().unwrap_or(0)
    });
    // row k of a message begins at the k-th unknown of its separator
    let messages = front.below.iter().flat_map(|&b| {
        let to = &fronts[b].in_above;
        (0..to.len()).map(|k| to[k..].iter().min().map_or(0, |&column| column as usize))
    });
    rows.chain(messages).chain(0..front.eliminated).collect()
}

/// Triangularises a dense matrix with contiguous columns, of which column `k` is zero from row
/// `ends[k]` on; `ends` ascends.
fn householder(dense: &mut [f64], height: usize, width: usize, ends: &[u32]) {
    for (k, &end) in ends.iter().enumerate().take(height) {
        let end = (end as usize).max(k + 1);
        let (head, tail) = dense[..height * width].split_at_mut((k + 1) * height);
        let v = &mut head[k * height + k..k * height + end];
        let largest = v.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        if largest == 0.0 {
            continue;
        }
        let norm = largest * v.iter().map(|x| (x / largest) * (x / largest)).sum::<f64>().sqrt();
        let alpha = if v[0] > 0.0 { -norm } else { norm };
        v[0] -= alpha;
        let scale = v[0] * alpha; // -|v|^2 / 2
        if scale != 0.0 {
            for column in tail.chunks_exact_mut(height) {
                let column = &mut column[k..end];
                let factor = product(v, column) / scale;
                for (c, a) in column.iter_mut().zip(v.iter()) {
                    *c += factor * a;
                }
            }
        }
        v[0] = alpha;
        v[1..].fill(0.0);
    }
}

/// `to += factor * from`.
fn add(to: &mut [f64], factor: f64, from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}

/// Scalar product in four independent sums, which do not wait for each other.
fn product(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a, b) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}
