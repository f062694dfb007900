//! Profile of a function of the unknowns: how much worse the best fit becomes when its value is held.
//!
//! For a function `g` of the unknowns and the cost `Q` of a fit with its weights and its loss,
//!
//! ```text
//! D(c) = 2 (min {Q(theta) : g(theta) = c} - Q(theta_hat)) / lambda
//! ```
//!
//! is chi-squared with one degree of freedom at the true `c`. Residuals that hang together, weights that are not the noise
//! and a robust loss make `D` without `lambda` a multiple of that; `lambda` is the variance of `g` that the interval is
//! made of over the one that `Q` as a likelihood would give, `g' C g / g' B^-1 g` (Kent 1982, "Robust properties of
//! likelihood ratio tests"), so that near the estimate `D` is `((c - c_hat)/std)^2`. Where `Q` is quadratic and `g` linear
//! it is that everywhere.
//!
//! Instead of an equation each refit gets one more row that pulls `g`: the minimiser of `Q + (g - t)^2/(2 s^2)` is the best
//! fit among all with its value of `g`, whatever `t` and `s` are, so that every point of the curve is exact.

use super::{Loss, Regression, Rows, Scale, Solution, SolveError, Unknown, covariance, dot};
use nalgebra::DVector;

/// 95 % and 99.7 % of chi-squared with one degree of freedom.
pub const LEVELS: [f64; 2] = [3.841_459, 8.807_469];

/// Refits outward on each side at most.
const POINTS: usize = 40;
/// How far to go, in standard deviations: a curve that has not risen by then has no end.
const FARTHEST: f64 = 100.0;
/// Wanted rise of the root of the statistic from refit to refit.
const RISE: f64 = 0.4;
/// Largest growth of a step.
const GROWTH: f64 = 1.6;
/// Refits that close in on a level.
const CLOSER: usize = 4;
/// Linearisations of the function in one refit.
const LINEARISATIONS: usize = 8;

/// A row that pulls: `row . unknowns = value +- std`.
#[derive(Clone, Debug)]
pub struct Pull {
    /// One factor per unknown.
    pub row: Vec<f64>,
    /// Where to.
    pub value: f64,
    /// How weakly.
    pub std: f64,
}

impl Pull {
    /// The same for unknowns that count from a point.
    pub(super) fn from(&self, point: &[f64]) -> Self {
        Self { value: self.value - dot(&self.row, point), ..self.clone() }
    }

    /// Its part of the cost.
    pub(super) fn cost(&self, theta: &[f64]) -> f64 {
        0.5 * ((self.value - dot(&self.row, theta)) / self.std).powi(2)
    }
}

/// How a side of a curve ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The statistic passes the last of the [`LEVELS`].
    Passed,
    /// A bound of the parameter, or of what it is made of.
    Bound,
    /// Nowhere: it is still below when the value is a hundred standard deviations away.
    Open,
}

/// The curve, and what can be read from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Values, ascending.
    pub value: Vec<f64>,
    /// The statistic `D` at each of them.
    pub statistic: Vec<f64>,
    /// Where it passes each of the [`LEVELS`], below and above; infinite where it does not.
    pub crossings: [[f64; 2]; 2],
    /// How each side ends.
    pub ends: [End; 2],
    /// `lambda`
    pub inflation: f64,
    /// The best value, where a refit found a fit that is clearly better than the one that is profiled.
    pub better: Option<f64>,
}

/// A function of the unknowns.
pub type Function = dyn Fn(&[f64]) -> f64;
/// The minimiser with a pull, if any, near a point, and its cost without the pull.
pub type Refit<'a> = dyn Fn(Option<&Pull>, &[f64]) -> Result<(Vec<f64>, f64), SolveError> + 'a;
/// The best fit at a value of the function, near a point.
type At<'a> = dyn Fn(f64, &[f64]) -> Result<Point, SolveError> + 'a;

/// What is profiled: the cost of a fit and the function.
pub struct Subject<'a> {
    /// The unknowns of the fit.
    pub theta: &'a [f64],
    /// The function.
    pub of: &'a Function,
    /// Its standard deviation, as the interval has it.
    pub std: f64,
    /// The same as the cost has it.
    pub std_of_cost: f64,
    /// Range of the function.
    pub range: (f64, f64),
    /// How to fit anew.
    pub refit: &'a Refit<'a>,
}

/// A refit.
#[derive(Clone)]
struct Point {
    value: f64,
    /// Signed root of the statistic: negative where the fit is better than the profiled one.
    root: f64,
    theta: Vec<f64>,
}

/// The profile of a function of the unknowns of a fit; none where the function does not depend on them.
pub fn curve(subject: &Subject) -> Result<Option<Curve>, SolveError> {
    let inflation = (subject.std / subject.std_of_cost).powi(2);
    if !(inflation > 0.0 && inflation.is_finite() && subject.std > 0.0) {
        return Ok(None);
    }
    let (theta, least) = (subject.refit)(None, subject.theta)?;
    let start = Point { value: (subject.of)(&theta), root: 0.0, theta };
    let at = |target: f64, from: &[f64]| -> Result<Point, SolveError> {
        let (theta, cost) = held(subject, target, from)?;
        let statistic = 2.0 * (cost - least) / inflation;
        Ok(Point { value: (subject.of)(&theta), root: statistic.abs().sqrt().copysign(statistic), theta })
    };
    let (below, lower) = side(subject, &start, -1.0, &at)?;
    let (above, upper) = side(subject, &start, 1.0, &at)?;
    let crossings = [crossings(&below), crossings(&above)];
    let mut points: Vec<&Point> = below.iter().chain(&above[1..]).collect();
    points.sort_by(|a, b| a.value.total_cmp(&b.value));
    let best = points.iter().min_by(|a, b| a.root.total_cmp(&b.root)).filter(|best| best.root < -BETTER);
    // A bias that was subtracted from the minimiser moves the curve with it.
    let shift = (subject.of)(subject.theta) - start.value;
    Ok(Some(Curve {
        value: points.iter().map(|point| point.value + shift).collect(),
        statistic: points.iter().map(|point| point.root.max(0.0).powi(2)).collect(),
        crossings: [0, 1].map(|level| [crossings[0][level] + shift, crossings[1][level] + shift]),
        ends: [lower, upper],
        inflation,
        better: best.map(|best| best.value + shift),
    }))
}

/// Root of the statistic by which a better fit is worth a word.
const BETTER: f64 = 0.3;

/// The curve of a quadratic cost: a parabola that ends at the range.
pub fn parabola(value: f64, std: f64, range: (f64, f64)) -> Option<Curve> {
    if !(std > 0.0 && std.is_finite()) {
        return None;
    }
    let last = LEVELS[1].sqrt();
    let steps = 24;
    let offsets = (0..=steps).map(|k| 1.1 * last * (2.0 * f64::from(k) / f64::from(steps) - 1.0));
    let inside = |v: &f64| (range.0..=range.1).contains(v);
    let values: Vec<f64> = offsets.map(|offset| value + offset * std).filter(inside).collect();
    let end = |crossing: f64| if inside(&crossing) { End::Passed } else { End::Bound };
    let open = |crossing: f64, side: f64| if inside(&crossing) { crossing } else { side * f64::INFINITY };
    Some(Curve {
        statistic: values.iter().map(|v| ((v - value) / std).powi(2)).collect(),
        value: values,
        crossings: LEVELS.map(|level| [-1.0, 1.0].map(|side| open(value + side * level.sqrt() * std, side))),
        ends: [-1.0, 1.0].map(|side| end(value + side * last * std)),
        inflation: 1.0,
        better: None,
    })
}

/// The best fit at a value of the function, near a point.
fn held(subject: &Subject, target: f64, from: &[f64]) -> Result<(Vec<f64>, f64), SolveError> {
    let mut theta = from.to_vec();
    let mut cost = f64::INFINITY;
    for _ in 0..LINEARISATIONS {
        let row = gradient(subject.of, &theta, subject.std_of_cost);
        let value = dot(&row, &theta) + target - (subject.of)(&theta);
        let pull = Pull { row, value, std: 0.01 * subject.std_of_cost };
        let (next, reached) = (subject.refit)(Some(&pull), &theta)?;
        let settled = (reached - cost).abs() < 1e-4 * (subject.std / subject.std_of_cost).powi(2)
            && ((subject.of)(&next) - target).abs() < 0.05 * subject.std;
        let linear = (subject.of)(&next) - dot(&pull.row, &next) - (subject.of)(&theta) + dot(&pull.row, &theta);
        (theta, cost) = (next, reached);
        if settled || linear.abs() < 1e-9 * subject.std {
            break;
        }
    }
    Ok((theta, cost))
}

/// Central differences; `size` is about what the function may change by.
fn gradient(of: &Function, theta: &[f64], size: f64) -> Vec<f64> {
    let mut moved = theta.to_vec();
    let mut slope = |index: usize| {
        let step = 1e-6 * if theta[index] == 0.0 { size.max(1e-6) } else { theta[index].abs() };
        moved[index] = theta[index] + step;
        let ahead = of(&moved);
        moved[index] = theta[index] - step;
        let behind = of(&moved);
        moved[index] = theta[index];
        (ahead - behind) / (2.0 * step)
    };
    (0..theta.len()).map(&mut slope).collect()
}

/// Refits outward on one side until the statistic passes the last level, then ever closer to each level.
fn side(subject: &Subject, start: &Point, sign: f64, at: &At) -> Result<(Vec<Point>, End), SolveError> {
    let last = LEVELS[1].sqrt();
    let bound = if sign < 0.0 { subject.range.0 } else { subject.range.1 };
    let mut points = vec![start.clone()];
    let mut step = RISE * subject.std;
    let mut end = End::Open;
    while points.len() <= POINTS {
        let here = &points[points.len() - 1];
        let wanted = here.value + sign * step;
        let beyond = sign * (wanted - bound) >= 0.0;
        // A little inside: at the bound itself the function may not be defined.
        let target = if beyond { bound - sign * 1e-9 * subject.std } else { wanted };
        if sign * (target - here.value) <= 1e-6 * subject.std {
            end = End::Bound;
            break;
        }
        let next = match at(target, &here.theta) {
            Ok(next) => next,
            // Values that the model does not allow: nothing can be fitted there.
            Err(SolveError::Contradiction { .. } | SolveError::Diverged { .. }) => {
                end = End::Bound;
                break;
            }
            Err(error) => return Err(error),
        };
        let moved = sign * (next.value - here.value);
        if moved < 0.2 * (target - here.value).abs() {
            // What the parameter is made of does not let it go farther.
            end = End::Bound;
            break;
        }
        let slope = (next.root - here.root) / moved;
        let (root, far) = (next.root, (next.value - start.value).abs() > FARTHEST * subject.std);
        points.push(next);
        if root > last {
            end = End::Passed;
            break;
        }
        if beyond {
            end = End::Bound;
            break;
        }
        if far {
            break;
        }
        let ideal = if slope > 0.0 { RISE / slope } else { f64::INFINITY };
        step = ideal.clamp(0.5 * step, GROWTH * step);
    }
    for level in LEVELS.map(f64::sqrt) {
        for _ in 0..CLOSER {
            let Some(after) = points.iter().position(|point| point.root >= level).filter(|index| *index > 0) else {
                break;
            };
            let (low, high) = (&points[after - 1], &points[after]);
            if (high.root - level).min(level - low.root) < 2e-3 {
                break;
            }
            let share = (level - low.root) / (high.root - low.root);
            let from = if share < 0.5 { low } else { high };
            let closer = at(low.value + share * (high.value - low.value), &from.theta)?;
            if sign * (closer.value - low.value) <= 0.0 || sign * (high.value - closer.value) <= 0.0 {
                break;
            }
            points.insert(after, closer);
        }
    }
    Ok((points, end))
}

/// Where one side of a curve passes the levels.
fn crossings(points: &[Point]) -> [f64; 2] {
    let sign = if points.last().is_some_and(|last| last.value < points[0].value) { -1.0 } else { 1.0 };
    LEVELS.map(f64::sqrt).map(|level| {
        let Some(after) = points.iter().position(|point| point.root >= level).filter(|index| *index > 0) else {
            return sign * f64::INFINITY;
        };
        let (low, high) = (&points[after - 1], &points[after]);
        low.value + (level - low.root) / (high.root - low.root) * (high.value - low.value)
    })
}

/// The regression whose least squares are the quadratic form of an answer: for answers that minimise no cost of rows, as
/// those by instruments. Bounds and constraints stay.
pub fn quadratic(regression: &Regression, solution: &Solution) -> Option<Regression> {
    let n = solution.theta.len();
    let factor = covariance::inverse(&solution.inverse_information).cholesky()?.unpack().transpose();
    let target = &factor * DVector::from_column_slice(&solution.theta);
    let mut rows = Rows { scale: Scale::Known(1.0), ..Rows::new(&regression.name, "1", n) };
    for i in 0..n {
        let row: Vec<f64> = factor.row(i).iter().copied().collect();
        rows.push(&row, target[i], i as u32);
    }
    let plain = |unknown: &Unknown| Unknown { prior: None, ..unknown.clone() };
    Some(Regression {
        name: regression.name.clone(),
        unknowns: regression.unknowns.iter().map(plain).collect(),
        groups: vec![rows],
        constraints: regression.constraints.clone(),
    })
}

/// Cost of a regression at a point, with the noise levels of its groups.
pub fn cost(regression: &Regression, scales: &[f64], loss: Loss, theta: &[f64]) -> f64 {
    let groups = regression.groups.iter().zip(scales);
    let rows: f64 =
        groups.map(|(group, scale)| group.residuals(theta).iter().map(|r| loss.of(r / scale)).sum::<f64>()).sum();
    let priors = regression.unknowns.iter().zip(theta);
    let prior = |(unknown, value): (&Unknown, &f64)| Some((unknown.prior?, *value));
    rows + priors.filter_map(prior).map(|((mean, std), value)| 0.5 * ((value - mean) / std).powi(2)).sum::<f64>()
}
