//! The dung beetle optimiser: minimises a function over a box with four kinds of searchers.
//!
//! Xue & Shen, "Dung beetle optimizer" (2023), which CN117406607B, claim 1, step 4, names. With `N`
//! beetles, positions `x`, personal bests `p`, those of the iteration before `prev`, `U` uniform on
//! [0, 1) and `G` standard normal, iteration `t` of `T`:
//!
//! ```text
//! roll = U < 0.9 for the group
//! rollers    roll:  x = p + 0.3 |p - worst| ± 0.1 prev       (minus with probability 0.1)
//!            dance: x = p + tan(d°) |p - prev|, d = 1..180; x = p for 90 and 180
//! evaluate the rollers;  cur = best position now;  R = 1 - t/T
//! breeders   [l, u] = cur (1 ∓ R) in the box;   x = cur + U (p - l) + U (p - u) within [l, u]
//! foragers   [l, u] = best (1 ∓ R) in the box;  x = p + G (p - l) + U (p - u)
//! thieves    x = best + 0.5 G (|p - cur| + |p - best|)
//! evaluate the rest;  prev = p;  improve p and best
//! ```
//!
//! The published code leaves the tangent at 90 and 180 degrees unguarded and fixes the sizes of the
//! groups at 6, 6, 7, 11 of 30; here they are 20 %, 20 %, 7/30 and the rest. The intervals
//! `(1 ∓ R) best` shrink towards 0: the middle of a symmetric box is favoured, so the search belongs
//! into coordinates whose 0 is a sensible answer.
//!
//! All draws of a batch are made before it is evaluated, in the order of the beetles: evaluated in
//! parallel or not, the result has the same bits.

use super::rng::Rng;

/// Size and length of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Number of beetles, at least 5.
    pub population: usize,
    /// Number of iterations; there are `population * (iterations + 1)` evaluations.
    pub iterations: usize,
    /// Seed of all draws.
    pub seed: u64,
}

/// A search that cannot begin.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SearchError {
    /// Too few beetles for the four groups.
    #[error("a population of {0} is too small; at least 5 beetles are needed")]
    Population(usize),
    /// An empty or infinite box.
    #[error("bounds {lower} to {upper} of coordinate {index} are not an interval")]
    Bounds {
        /// The coordinate.
        index: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
}

/// The end of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimum {
    /// Where the smallest value was found.
    pub position: Vec<f64>,
    /// The smallest value.
    pub value: f64,
    /// Best value after the start and after each iteration.
    pub history: Vec<f64>,
    /// Number of evaluations.
    pub evaluations: usize,
}

/// Minimises a function over a box. `evaluate` gives the values of a batch of positions in their
/// order; values that are not finite count as infinitely bad. `watch` sees the best value after each
/// iteration and ends the search by returning false.
pub fn minimise(
    bounds: &[(f64, f64)],
    settings: &Settings,
    evaluate: impl Fn(&[Vec<f64>]) -> Vec<f64>,
    mut watch: impl FnMut(usize, f64) -> bool,
) -> Result<Optimum, SearchError> {
    let n = settings.population;
    if n < 5 {
        return Err(SearchError::Population(n));
    }
    for (index, &(lower, upper)) in bounds.iter().enumerate() {
        if !(lower < upper && lower.is_finite() && upper.is_finite()) {
            return Err(SearchError::Bounds { index, lower, upper });
        }
    }
    let share = |part: f64| (part * n as f64).round() as usize;
    let rollers = share(0.2);
    let breeders = rollers + share(0.2);
    let foragers = breeders + share(7.0 / 30.0);
    let finite = |values: Vec<f64>| -> Vec<f64> {
        values.into_iter().map(|value| if value.is_finite() { value } else { f64::INFINITY }).collect()
    };

    let mut rng = Rng::new(settings.seed);
    let x: Vec<Vec<f64>> = (0..n).map(|_| bounds.iter().map(|(l, u)| l + (u - l) * rng.uniform()).collect()).collect();
    let values = finite(evaluate(&x));
    let mut swarm = Swarm::new(bounds, x, values);
    let mut history = vec![swarm.best_value];
    let mut evaluations = n;
    for t in 1..=settings.iterations {
        if !watch(t - 1, swarm.best_value) {
            break;
        }
        swarm.roll(rollers, &mut rng);
        let values = finite(evaluate(&swarm.x[..rollers]));
        swarm.value[..rollers].copy_from_slice(&values);
        swarm.search([rollers, breeders, foragers], 1.0 - t as f64 / settings.iterations as f64, &mut rng);
        let values = finite(evaluate(&swarm.x[rollers..]));
        swarm.value[rollers..].copy_from_slice(&values);
        evaluations += n;
        swarm.improve();
        history.push(swarm.best_value);
    }
    watch(history.len() - 1, swarm.best_value);
    Ok(Optimum { position: swarm.best, value: swarm.best_value, history, evaluations })
}

/// The beetles between two evaluations.
struct Swarm<'a> {
    bounds: &'a [(f64, f64)],
    /// Positions and their values.
    x: Vec<Vec<f64>>,
    value: Vec<f64>,
    /// Each beetle's best position, its value, and that position one iteration before.
    personal: Vec<Vec<f64>>,
    personal_value: Vec<f64>,
    previous: Vec<Vec<f64>>,
    best: Vec<f64>,
    best_value: f64,
}

impl<'a> Swarm<'a> {
    fn new(bounds: &'a [(f64, f64)], x: Vec<Vec<f64>>, value: Vec<f64>) -> Self {
        let first = least(&value);
        Self {
            bounds,
            personal: x.clone(),
            personal_value: value.clone(),
            previous: x.clone(),
            best: x[first].clone(),
            best_value: value[first],
            x,
            value,
        }
    }

    /// The first beetles roll, or all of them dance.
    fn roll(&mut self, rollers: usize, rng: &mut Rng) {
        let worst = self.x[greatest(&self.value)].clone();
        let roll = rng.uniform() < 0.9;
        for i in 0..rollers {
            let (p, previous) = (&self.personal[i], &self.previous[i]);
            if roll {
                let side = if rng.uniform() <= 0.1 { -1.0 } else { 1.0 };
                for d in 0..p.len() {
                    self.x[i][d] = p[d] + 0.3 * (p[d] - worst[d]).abs() + side * 0.1 * previous[d];
                }
            } else {
                let degrees = (rng.uniform() * 180.0).floor() + 1.0;
                let turn = if degrees == 90.0 || degrees == 180.0 { 0.0 } else { degrees.to_radians().tan() };
                for d in 0..p.len() {
                    self.x[i][d] = p[d] + turn * (p[d] - previous[d]).abs();
                }
            }
            self.clip(i);
        }
    }

    /// Breeders, foragers and thieves; `ends` are where rollers, breeders and foragers end.
    fn search(&mut self, ends: [usize; 3], narrowing: f64, rng: &mut Rng) {
        let [rollers, breeders, foragers] = ends;
        let current = self.x[least(&self.value)].clone();
        let (nest, meadow) = (self.around(&current, narrowing), self.around(&self.best, narrowing));
        let dimensions = current.len();
        let draw = |rng: &mut Rng| -> Vec<f64> { (0..dimensions).map(|_| rng.uniform()).collect() };
        for i in rollers..self.x.len() {
            let (p, best) = (&self.personal[i], &self.best);
            if i < breeders {
                let (a, b) = (draw(rng), draw(rng));
                for d in 0..dimensions {
                    let (l, u) = nest[d];
                    self.x[i][d] = (current[d] + a[d] * (p[d] - l) + b[d] * (p[d] - u)).clamp(l, u);
                }
            } else if i < foragers {
                let g = rng.normal();
                let b = draw(rng);
                for d in 0..dimensions {
                    let (l, u) = meadow[d];
                    self.x[i][d] = p[d] + g * (p[d] - l) + b[d] * (p[d] - u);
                }
            } else {
                for d in 0..dimensions {
                    let spread = (p[d] - current[d]).abs() + (p[d] - best[d]).abs();
                    self.x[i][d] = best[d] + 0.5 * rng.normal() * spread;
                }
            }
            self.clip(i);
        }
    }

    /// The interval `centre (1 -+ narrowing)` of every coordinate, within the box.
    fn around(&self, centre: &[f64], narrowing: f64) -> Vec<(f64, f64)> {
        let interval = |(c, (l, u)): (&f64, &(f64, f64))| {
            let (a, b) = ((c * (1.0 - narrowing)).clamp(*l, *u), (c * (1.0 + narrowing)).clamp(*l, *u));
            (a.min(b), a.max(b))
        };
        centre.iter().zip(self.bounds).map(interval).collect()
    }

    fn clip(&mut self, i: usize) {
        self.x[i].iter_mut().zip(self.bounds).for_each(|(x, (l, u))| *x = x.clamp(*l, *u));
    }

    /// Remembers what is better than before.
    fn improve(&mut self) {
        self.previous.clone_from(&self.personal);
        for i in 0..self.x.len() {
            if self.value[i] < self.personal_value[i] {
                self.personal_value[i] = self.value[i];
                self.personal[i].clone_from(&self.x[i]);
            }
            if self.personal_value[i] < self.best_value {
                self.best_value = self.personal_value[i];
                self.best.clone_from(&self.personal[i]);
            }
        }
    }
}

fn least(values: &[f64]) -> usize {
    (0..values.len()).fold(0, |at, i| if values[i] < values[at] { i } else { at })
}

fn greatest(values: &[f64]) -> usize {
    (0..values.len()).fold(0, |at, i| if values[i] > values[at] { i } else { at })
}
