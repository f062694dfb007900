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
            fronts.push(Front { unknowns, eliminated, rows, below, above, in_above: vec![], height });
        }
        for f in 0..count {
            let Some(above) = fronts[f].above else { continue };
            let find = |u: &u32| fronts[above].unknowns.iter().position(|other| other == u).unwrap_or(0) as u32;
            fronts[f].in_above = fronts[f].unknowns[fronts[f].eliminated..].iter().map(find).collect();
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

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let lists = [&self.triangle, &self.message, &self.covariance];
        let numbers: usize = lists.iter().flat_map(|list| list.iter()).map(Vec::len).sum();
        8 * (numbers + self.dense.len() + self.gain.len() + self.solution.len())
            + 4 * (self.column.len() + self.local.len())
            + 8 * self.start.len()
    }

    /// Eliminates all fronts and solves for the mean.
    pub fn factor(&mut self, numbers: &Numbers) -> Result<(), RankDeficient> {
        for f in 0..self.fronts.len() {
            let (height, width) = self.collect(f, numbers);
            // columns are contiguous: entry (i, j) at j * height + i
            householder(&mut self.dense, height, width, self.fronts[f].width());
            let front = &self.fronts[f];
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
        let mut i = 0;
        for &r in &front.rows {
            let r = r as usize;
            let root = numbers.weight[r].sqrt();
            for entry in self.start[r]..self.start[r + 1] {
                dense[self.local[self.column[entry] as usize] as usize * height + i] = root * numbers.value[entry];
            }
            dense[(width - 1) * height + i] = root * numbers.right[r];
            i += 1;
        }
        for &b in &front.below {
            let s = self.fronts[b].separator();
            for k in 0..s {
                let row = &self.message[b][k * (s + 1)..(k + 1) * (s + 1)];
                for (value, &to) in row.iter().zip(&self.fronts[b].in_above) {
                    dense[to as usize * height + i] = *value;
                }
                dense[(width - 1) * height + i] = row[s];
                i += 1;
            }
        }
        for k in 0..front.eliminated {
            let u = front.unknowns[k] as usize;
            let root = numbers.precision[u].sqrt();
            dense[k * height + i] = root;
            dense[(width - 1) * height + i] = root * numbers.mean[u];
            i += 1;
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
            // R_EE^-1 and G = -R_EE^-1 R_ES
            let r = |i: usize, j: usize| self.triangle[f][i * (w + 1) + j];
            for j in 0..e {
                for i in (0..=j).rev() {
                    let mut sum = f64::from(u8::from(i == j));
                    for k in i + 1..=j {
                        sum -= r(i, k) * inverse[k * e + j];
                    }
                    inverse[i * e + j] = sum / r(i, i);
                }
            }
            for i in 0..e {
                for j in 0..s {
                    gain[i * s + j] = -(i..e).map(|k| inverse[i * e + k] * r(k, e + j)).sum::<f64>();
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
            for i in 0..e {
                for j in 0..s {
                    let sum = (0..s).map(|k| gain[i * s + k] * own[(e + k) * w + e + j]).sum::<f64>();
                    own[i * w + e + j] = sum;
                    own[(e + j) * w + i] = sum;
                }
            }
            for i in 0..e {
                for j in 0..=i {
                    let from_own = (i..e).map(|k| inverse[i * e + k] * inverse[j * e + k]).sum::<f64>();
                    let from_above = (0..s).map(|k| own[i * w + e + k] * gain[j * s + k]).sum::<f64>();
                    own[i * w + j] = from_own + from_above;
                    own[j * w + i] = from_own + from_above;
                }
                variance[front.unknowns[i] as usize] = own[i * w + i];
            }
            self.covariance[f] = own;
        }
    }
}

/// Triangularises the first `pivots` columns of a dense matrix with contiguous columns.
fn householder(dense: &mut [f64], height: usize, width: usize, pivots: usize) {
    for k in 0..pivots.min(height) {
        let (head, tail) = dense[..height * width].split_at_mut((k + 1) * height);
        let v = &mut head[k * height + k..];
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
                let column = &mut column[k..];
                let dot: f64 = v.iter().zip(column.iter()).map(|(a, b)| a * b).sum();
                let factor = dot / scale;
                for (c, a) in column.iter_mut().zip(v.iter()) {
                    *c += factor * a;
                }
            }
        }
        v[0] = alpha;
        v[1..].fill(0.0);
    }
}
