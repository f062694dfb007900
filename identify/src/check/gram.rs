//! Regressions between signals from sums of their products: Schur complements, one signal at a time.

/// Sums of products of `[x_1 .. x_n, y]` over a block, about the block's means if the relation has constants.
#[derive(Debug)]
pub struct Gram {
    pub n: usize,
    pub count: f64,
    pub sums: Vec<f64>,
    pub products: Vec<f64>,
}

impl Clone for Gram {
    fn clone(&self) -> Self {
        Self { n: self.n, count: self.count, sums: self.sums.clone(), products: self.products.clone() }
    }

    /// Without new memory: every block of a log leaves each lag's sums once.
    fn clone_from(&mut self, other: &Self) {
        (self.n, self.count) = (other.n, other.count);
        self.sums.clone_from(&other.sums);
        self.products.clone_from(&other.products);
    }
}

impl Gram {
    /// Empty sums of `n` signals, `y` with them.
    pub fn new(n: usize) -> Self {
        Self { n, count: 0.0, sums: vec![0.0; n], products: vec![0.0; n * n] }
    }

    /// The same about the means.
    pub fn centred(mut self) -> Self {
        for i in 0..self.n {
            for j in 0..=i {
                self.products[i * self.n + j] -= self.sums[i] * self.sums[j] / self.count.max(1.0);
            }
        }
        self
    }

    /// Adds other sums, or takes them away.
    pub fn add(&mut self, other: &Self, sign: f64) {
        self.count += sign * other.count;
        self.products.iter_mut().zip(&other.products).for_each(|(sum, value)| *sum += sign * value);
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.products[i.max(j) * self.n + i.min(j)]
    }

    /// Becomes `of` without the part `out` of it.
    pub fn assign_difference(&mut self, of: &Self, out: &Self) {
        self.clone_from(of);
        self.add(out, -1.0);
    }

    /// What is left of all after a regression on number `k` (a Schur complement).
    fn without(&mut self, k: usize) {
        let pivot = self.at(k, k);
        if pivot <= 0.0 {
            return;
        }
        for i in (0..self.n).filter(|i| *i != k) {
            for j in (0..=i).filter(|j| *j != k) {
                self.products[i * self.n + j] -= self.at(i, k) * self.at(j, k) / pivot;
            }
        }
        (0..self.n).for_each(|i| self.products[i.max(k) * self.n + i.min(k)] = 0.0);
    }

    /// Share of `y`'s variance that the others explain; `rest` is room to work in.
    pub fn explained(&self, rest: &mut Self) -> f64 {
        rest.clone_from(self);
        let y = self.n - 1;
        let whole = self.at(y, y);
        for k in 0..y {
            // What hardly differs from the others before it would only divide by rounding errors.
            if rest.at(k, k) > 1e-9 * self.at(k, k) {
                rest.without(k);
            }
        }
        if whole > 0.0 { 1.0 - rest.at(y, y).max(0.0) / whole } else { 0.0 }
    }

    /// Correlation of `y` with the first one, and the ratio of their sizes, both without the others.
    pub fn first(&self) -> (f64, f64) {
        let (mut rest, y) = (self.clone(), self.n - 1);
        for k in 1..y {
            if rest.at(k, k) > 1e-9 * self.at(k, k) {
                rest.without(k);
            }
        }
        let (xx, yy) = (rest.at(0, 0), rest.at(y, y));
        if xx > 1e-9 * self.at(0, 0) && yy > 0.0 {
            (rest.at(0, y) / (xx * yy).sqrt(), (yy / xx).sqrt())
        } else {
            (0.0, f64::NAN)
        }
    }
}
