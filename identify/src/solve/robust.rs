//! Robust losses on many rows, by way of small quadratic programs.
//!
//! The Huber cost is quadratic on each piece of the space where the same rows are outliers (beyond
//! 1.345 standard deviations) on the same side. Newton's method takes the minimiser of the current
//! piece, a compressed QP under the constraints, as its target, searches along the line to it, and ends
//! when the target lies in its own piece: that is the exact minimiser. A few reweighted
//! least-squares steps come first, because they approach from anywhere.

use super::compress::{Compressor, Factors};
use super::conic::{self, Feasible};
use super::polish::{self, Minimum};
use super::profile::Pull;
use super::{Accuracy, HUBER_DELTA, Loss, Options, Regression, SolveError, dot};

/// The minimiser of a regression's cost in its own units.
#[derive(Clone, Debug)]
pub struct Minimiser {
    /// The unknowns.
    pub theta: Vec<f64>,
    /// Which unknowns sit at an active bound or linear inequality.
    pub at_bound: Vec<bool>,
    /// How exactly the last program was solved.
    pub accuracy: Accuracy,
}

/// Robust standard deviation of residuals: 1.4826 times the median absolute deviation from the
/// median; at least 1e-12 of the size of the right-hand sides `y`, so that rows without any noise can be divided by it.
/// Rows of nothing but zeros have no size: they are divided by 1.
pub fn deviation(residuals: &[f64], y: &[f64]) -> f64 {
    let centre = median(residuals.to_vec());
    let spread = 1.4826 * median(residuals.iter().map(|r| (r - centre).abs()).collect());
    let size = y.iter().map(|v| v.abs()).fold(0.0, f64::max);
    let least = spread.max(1e-12 * size);
    // Squares of what is divided by less would not be finite.
    if least > SMALLEST { least } else { 1.0 }
}

/// Below this a deviation is zero.
const SMALLEST: f64 = 1e-100;

fn median(mut values: Vec<f64>) -> f64 {
    let n = values.len();
    if n == 0 {
        return 0.0;
    }
    let (below, middle, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    if n % 2 == 1 { *middle } else { 0.5 * (below.iter().copied().fold(f64::NEG_INFINITY, f64::max) + *middle) }
}

/// The unknowns `z = column * theta` in which columns of the rows, divided by their noise level, have unit root mean square.
struct Units {
    column: Vec<f64>,
    /// What is known of `z` beforehand: rows that always count as squares.
    priors: Vec<(Vec<f64>, f64)>,
}

impl Units {
    fn new(regression: &Regression, factors: &Factors, scales: &[f64], pull: Option<&Pull>) -> Self {
        let n = regression.unknowns.len();
        let rows: usize = regression.groups.iter().map(super::Rows::len).sum();
        let mut squares = vec![0.0; n];
        for (factor, scale) in factors.iter().zip(scales) {
            let of_group = factor.r.column_iter().map(|column| column.norm_squared() / (scale * scale));
            squares.iter_mut().zip(of_group).for_each(|(sum, square)| *sum += square);
        }
        let column: Vec<f64> = squares
            .iter()
            .zip(&regression.unknowns)
            .map(|(sum, unknown)| match (sum / rows.max(1) as f64).sqrt() {
                rms if rms > 0.0 => rms,
                // A column of zeros: only a prior or a bound says anything.
                _ => unknown.prior.map_or(1.0, |(_, std)| 1.0 / std),
            })
            .collect();
        let priors = regression.unknowns.iter().enumerate().filter_map(|(index, unknown)| {
            let (mean, std) = unknown.prior?;
            let mut row = vec![0.0; n];
            row[index] = 1.0 / (std * column[index]);
            Some((row, mean / std))
        });
        let mut priors: Vec<_> = priors.collect();
        priors.extend(pull.map(|pull| {
            let row = pull.row.iter().zip(&column).map(|(factor, scale)| factor / (pull.std * scale)).collect();
            (row, pull.value / pull.std)
        }));
        Self { column, priors }
    }

    /// Least squares over the groups' factors instead of their rows.
    fn least_squares(
        &self,
        name: &str,
        factors: &Factors,
        scales: &[f64],
        feasible: &Feasible,
    ) -> Result<Minimum, SolveError> {
        let n = self.column.len();
        let mut compressor = Compressor::new(n);
        for (factor, scale) in factors.iter().zip(scales) {
            for (row, y) in factor.r.row_iter().zip(&factor.d) {
                let row: Vec<f64> = row.iter().zip(&self.column).map(|(value, column)| value / column).collect();
                compressor.push(&row, *y, 1.0 / scale);
            }
        }
        self.priors.iter().for_each(|(row, y)| compressor.push(row, *y, 1.0));
        polish::quadratic(name, &compressor.finish(), &vec![0.0; n], feasible)
    }
}

/// Rows divided by their noise level, in the scaled unknowns.
struct Scaled {
    unknowns: usize,
    a: Vec<f64>,
    y: Vec<f64>,
    priors: Vec<(Vec<f64>, f64)>,
}

impl Scaled {
    fn new(regression: &Regression, scales: &[f64], units: &Units) -> Self {
        let n = regression.unknowns.len();
        let rows: usize = regression.groups.iter().map(super::Rows::len).sum();
        let (mut a, mut y) = (Vec::with_capacity(rows * n), Vec::with_capacity(rows));
        for (group, scale) in regression.groups.iter().zip(scales) {
            let factor: Vec<f64> = units.column.iter().map(|column| 1.0 / (scale * column)).collect();
            for row in group.a.chunks_exact(n.max(1)) {
                a.extend(row.iter().zip(&factor).map(|(value, factor)| value * factor));
            }
            y.extend(group.y.iter().map(|value| value / scale));
        }
        Self { unknowns: n, a, y, priors: units.priors.clone() }
    }

    fn rows(&self) -> impl Iterator<Item = (&[f64], f64)> {
        self.a.chunks_exact(self.unknowns).zip(self.y.iter().copied())
    }

    /// Residuals in place of what was in `to`.
    fn residuals(&self, z: &[f64], to: &mut Vec<f64>) {
        to.clear();
        to.extend(self.rows().map(|(row, y)| y - dot(row, z)));
    }

    fn prior_cost(&self, z: &[f64]) -> f64 {
        self.priors.iter().map(|(row, y)| 0.5 * (y - dot(row, z)).powi(2)).sum()
    }

    /// Minimises the sum of `weight_i r_i^2 / 2` and of `-pull_i r_i`.
    fn quadratic(
        &self,
        name: &str,
        feasible: &Feasible,
        weights: impl Iterator<Item = (f64, f64)>,
    ) -> Result<Minimum, SolveError> {
        let mut compressor = Compressor::new(self.unknowns);
        let mut g = vec![0.0; self.unknowns];
        for ((row, y), (weight, pull)) in self.rows().zip(weights) {
            if weight > 0.0 {
                compressor.push(row, y, weight.sqrt());
            }
            if pull != 0.0 {
                g.iter_mut().zip(row).for_each(|(sum, value)| *sum -= pull * value);
            }
        }
        self.priors.iter().for_each(|(row, y)| compressor.push(row, *y, 1.0));
        polish::quadratic(name, &compressor.finish(), &g, feasible)
    }
}

/// Minimises a loss over a regression, whose rows compress to `factors` and whose groups have the noise levels `scales`, with
/// one more quadratic row if something pulls.
pub fn minimise(
    regression: &Regression,
    factors: &Factors,
    scales: &[f64],
    loss: Loss,
    options: &Options,
    pull: Option<&Pull>,
) -> Result<Minimiser, SolveError> {
    let units = Units::new(regression, factors, scales, pull);
    let bounds: Vec<_> = regression.unknowns.iter().map(|unknown| (unknown.lower, unknown.upper)).collect();
    let feasible = Feasible::new(&bounds, &regression.constraints, &units.column);
    let first = units.least_squares(&regression.name, factors, scales, &feasible)?;
    let minimum = match loss {
        Loss::Ls => first,
        _ => minimise_robust(
            &regression.name,
            &Scaled::new(regression, scales, &units),
            &feasible,
            loss,
            options,
            first,
        )?,
    };
    let mut at_bound = vec![false; bounds.len()];
    let reach = 1e-9 * (1.0 + minimum.z.iter().fold(0.0, |most: f64, z| most.max(z.abs())));
    for ((row, active), bound_of) in feasible.half_spaces.iter().zip(&minimum.active).zip(&feasible.bound_of) {
        // Copies of a half space share its multiplier, so that none of them may look active.
        if *active || row.at(&minimum.z) <= reach {
            match bound_of {
                Some(index) => at_bound[*index] = true,
                None => row.terms.iter().for_each(|&(index, _)| at_bound[index] = true),
            }
        }
    }
    let mut theta: Vec<f64> = minimum.z.iter().zip(&units.column).map(|(z, scale)| z / scale).collect();
    for (index, (value, (lower, upper))) in theta.iter_mut().zip(&bounds).enumerate() {
        *value = value.clamp(*lower, *upper);
        // Scaling there and back leaves an active bound one rounding away.
        let near = |bound: f64| at_bound[index] && bound.is_finite() && (*value - bound).abs() <= 1e-12 * bound.abs();
        if near(*lower) {
            *value = *lower;
        } else if near(*upper) {
            *value = *upper;
        }
    }
    Ok(Minimiser { theta, at_bound, accuracy: minimum.accuracy })
}

/// Minimises Huber's loss or L1 from the least-squares answer.
fn minimise_robust(
    name: &str,
    scaled: &Scaled,
    feasible: &Feasible,
    loss: Loss,
    options: &Options,
    first: Minimum,
) -> Result<Minimum, SolveError> {
    let few = scaled.y.len() <= options.exact_rows;
    let exact = |loss| conic::exact(name, loss, &first.z, scaled.rows(), &scaled.priors, feasible);
    match loss {
        Loss::Ls => Ok(first),
        Loss::Huber => {
            let reached = newton(name, scaled, feasible, HUBER_DELTA, first.z.clone(), 3)?;
            if reached.proved || !few {
                return Ok(reached.minimum);
            }
            let start = exact(Loss::Huber)?.x;
            Ok(newton(name, scaled, feasible, HUBER_DELTA, start, 0)?.minimum)
        }
        Loss::L1 if few => {
            let optimum = exact(Loss::L1)?;
            let active = optimum.non_negative.iter().map(|(slack, dual)| dual > slack).collect();
            Ok(Minimum { z: optimum.x, active, accuracy: optimum.accuracy })
        }
        Loss::L1 => {
            let mut minimum = first;
            for delta in [1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001] {
                minimum = newton(name, scaled, feasible, delta, minimum.z, 3)?.minimum;
            }
            Ok(minimum)
        }
    }
}

/// Huber cost with threshold `delta`.
fn cost(residuals: &[f64], delta: f64) -> f64 {
    let piece = |r: f64| if r.abs() <= delta { 0.5 * r * r } else { delta * (r.abs() - 0.5 * delta) };
    residuals.iter().map(|&r| piece(r)).sum()
}

/// The piece a residual is in: -1, 0, 1.
fn side(r: f64, delta: f64) -> i8 {
    if r > delta {
        1
    } else if r < -delta {
        -1
    } else {
        0
    }
}

/// Where Newton's method ended.
struct Reached {
    minimum: Minimum,
    /// It minimises its own piece of a convex cost, and with it the whole.
    proved: bool,
}

fn newton(
    name: &str,
    scaled: &Scaled,
    feasible: &Feasible,
    delta: f64,
    start: Vec<f64>,
    reweighted: usize,
) -> Result<Reached, SolveError> {
    const STEPS: usize = 100;
    let mut best = Minimum { z: start, active: vec![false; feasible.half_spaces.len()], accuracy: Accuracy::Solved };
    let (mut residuals, mut trial) = (Vec::with_capacity(scaled.y.len()), Vec::with_capacity(scaled.y.len()));
    scaled.residuals(&best.z, &mut residuals);
    let mut value = cost(&residuals, delta) + scaled.prior_cost(&best.z);
    let mut reweight = reweighted;
    for _ in 0..STEPS {
        let inliers = residuals.iter().filter(|r| r.abs() <= delta).count();
        // Too few rows in the quadratic part do not determine the target.
        let plain = reweight == 0 && inliers >= 2 * scaled.unknowns;
        let target = if plain {
            let weights = residuals.iter().map(|&r| match side(r, delta) {
                0 => (1.0, 0.0),
                sign => (0.0, f64::from(sign) * delta),
            });
            scaled.quadratic(name, feasible, weights)
        } else {
            scaled.quadratic(name, feasible, residuals.iter().map(|r| ((delta / r.abs()).min(1.0), 0.0)))
        };
        let target = match target {
            Ok(target) => target,
            // An unbounded or singular piece: one more reweighted step leaves it.
            Err(_) if plain && reweight < STEPS => {
                reweight += 1;
                continue;
            }
            Err(error) => return Err(error),
        };
        let was_reweighted = !plain;
        reweight = reweight.saturating_sub(1);
        scaled.residuals(&target.z, &mut trial);
        if !was_reweighted && trial.iter().zip(&residuals).all(|(new, old)| side(*new, delta) == side(*old, delta)) {
            return Ok(Reached { minimum: target, proved: true });
        }
        let mut share = 1.0;
        loop {
            let z: Vec<f64> = best.z.iter().zip(&target.z).map(|(from, to)| from + share * (to - from)).collect();
            scaled.residuals(&z, &mut trial);
            let reached = cost(&trial, delta) + scaled.prior_cost(&z);
            if reached < value {
                let gain = value - reached;
                best = Minimum { z, active: target.active.clone(), accuracy: target.accuracy };
                std::mem::swap(&mut residuals, &mut trial);
                value = reached;
                if gain < 1e-15 * value.max(1.0) && reweight == 0 {
                    return Ok(Reached { minimum: best, proved: false });
                }
                break;
            }
            share *= 0.5;
            if share < 1e-9 {
                // No descent is left: the point is the minimiser up to rounding.
                let minimum = Minimum { z: best.z, active: target.active, accuracy: target.accuracy };
                return Ok(Reached { minimum, proved: false });
            }
        }
    }
    Ok(Reached { minimum: best, proved: false })
}
