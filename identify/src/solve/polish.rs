//! Compressed quadratic programs, solved by Clarabel and polished on their active set.

use super::compress::Compressed;
use super::conic::{Feasible, NEGLIGIBLE, Optimum, Program};
use super::{Accuracy, Affine, SolveError};
use nalgebra::{DMatrix, DVector};

/// The minimiser of a small quadratic program.
#[derive(Clone, Debug)]
pub struct Minimum {
    /// The unknowns, scaled as the program.
    pub z: Vec<f64>,
    /// Which half spaces are active.
    pub active: Vec<bool>,
    /// How exactly Clarabel solved it.
    pub accuracy: Accuracy,
}

/// Minimises `1/2 |R z - d|^2 + g'z` over the feasible set: directly where that is allowed, else Clarabel, then [`polish`].
///
/// Clarabel sees a problem of unit size (`R` and `d` scaled to entries of at most one), because its
/// tolerances are absolute near zero.
pub fn quadratic(name: &str, data: &Compressed, g: &[f64], feasible: &Feasible) -> Result<Minimum, SolveError> {
    let size = |value: f64| if value > 0.0 && value.is_finite() { value } else { 1.0 };
    let rate = size(data.r.amax());
    let reach = size(data.d.amax() / rate);
    let unit = Compressed { r: &data.r / rate, d: &data.d / (rate * reach) };
    let slope: Vec<f64> = g.iter().map(|g| g / (rate * rate * reach)).collect();
    let feasible = feasible.shrunk(reach);
    // Inside all bounds nothing needs a conic program: the minimiser without them is the minimiser.
    if let Some(mut z) = equality_constrained(&unit, &slope, &[])
        && feasible.holds(&z, -1e-9)
    {
        z.iter_mut().for_each(|z| *z *= reach);
        let active = vec![false; feasible.half_spaces.len()];
        return Ok(Minimum { z, active, accuracy: Accuracy::Solved });
    }
    let mut program = Program::default();
    let z = program.add(g.len());
    let r = program.add(g.len());
    feasible.constrain(&mut program);
    for (i, &slope) in slope.iter().enumerate() {
        program.square(r + i, 1.0);
        program.cost(z + i, slope);
        let mut terms: Vec<_> = (i..g.len()).map(|j| (z + j, unit.r[(i, j)])).collect();
        terms.push((r + i, -1.0));
        program.zero(Affine { terms, constant: -unit.d[i] });
    }
    let optimum = program.solve(name)?;
    let mut minimum = polish(&optimum, &unit, &slope, &feasible);
    // What an answer of reduced accuracy costs too much, in units of the noise, says whether that matters.
    let z = DVector::from_column_slice(&minimum.z);
    let cost = 0.5 * (&unit.r * &z - &unit.d).norm_squared() + z.dot(&DVector::from_column_slice(&slope));
    if (cost - optimum.least_cost).abs() * (rate * reach).powi(2) < NEGLIGIBLE {
        minimum.accuracy = Accuracy::Solved;
    }
    minimum.z.iter_mut().for_each(|z| *z *= reach);
    Ok(minimum)
}

/// Puts an interior-point answer on its active half spaces.
///
/// An interior-point method ends about its tolerance inside an active bound. A half space is
/// active if its multiplier exceeds its slack; with these as equations the rest is a least-squares
/// problem, solved by orthogonal transformations in the null space. The polished point is taken if it
/// is feasible; with a second-order cone active (a curved surface) the point is left as it is.
pub fn polish(optimum: &Optimum, data: &Compressed, g: &[f64], feasible: &Feasible) -> Minimum {
    let n = g.len();
    let z = optimum.x[..n].to_vec();
    let active = optimum.non_negative[..feasible.half_spaces.len()]
        .iter()
        .map(|(slack, dual)| dual > slack || *slack < TOUCHING);
    let active = active.collect();
    let raw = Minimum { z, active, accuracy: optimum.accuracy };
    if optimum.cone_margin.iter().any(|&margin| margin < 1e-5) {
        return raw;
    }
    let equations: Vec<&Affine> =
        feasible.half_spaces.iter().zip(&raw.active).filter(|(_, active)| **active).map(|(row, _)| row).collect();
    match equality_constrained(data, g, &equations) {
        Some(z) if feasible.holds(&z, 1e-9 * (1.0 + z.iter().fold(0.0, |m: f64, v| m.max(v.abs())))) => {
            Minimum { z, ..raw }
        }
        _ => raw,
    }
}

/// Slack of a half space that the optimum touches, in a program of unit size: copies of it share one multiplier, so that
/// none of theirs need exceed it.
const TOUCHING: f64 = 1e-8;

/// Minimises `1/2 |R z - d|^2 + g'z` subject to `equations = 0`; `None` if singular.
fn equality_constrained(data: &Compressed, g: &[f64], equations: &[&Affine]) -> Option<Vec<f64>> {
    let n = g.len();
    let (particular, basis) =
        if equations.is_empty() { (DVector::zeros(n), DMatrix::identity(n, n)) } else { null_space(n, equations) };
    if basis.ncols() == 0 {
        return Some(particular.as_slice().to_vec());
    }
    let reduced = (&data.r * &basis).qr();
    let target = &data.d - &data.r * &particular;
    // R2'R2 w = R2'Q'target - N'g
    let triangle = reduced.r();
    let largest = triangle.diagonal().amax();
    if triangle.diagonal().iter().any(|pivot| pivot.abs() <= 1e-13 * largest) {
        return None;
    }
    let pull = triangle.transpose().solve_lower_triangular(&(basis.transpose() * DVector::from_column_slice(g)))?;
    let w = triangle.solve_upper_triangular(&(reduced.q().transpose() * target - pull))?;
    let z = particular + basis * w;
    z.iter().all(|value| value.is_finite()).then(|| z.as_slice().to_vec())
}

/// A point on all equations and an orthonormal basis of the directions that stay on them.
///
/// More half spaces than unknowns may be active at a corner: an equation whose normal depends on those before it
/// says nothing new, and is left out. (If it contradicts them, the point does not satisfy it, and the caller sees that.)
fn null_space(n: usize, equations: &[&Affine]) -> (DVector<f64>, DMatrix<f64>) {
    const DEPENDENT: f64 = 1e-9;
    let mut point = DVector::zeros(n);
    let mut normals: Vec<DVector<f64>> = Vec::new();
    // Twice, because one pass of Gram-Schmidt leaves rounding errors of the size of what it removed.
    let reduce = |normal: &mut DVector<f64>, against: &[DVector<f64>]| {
        for _ in 0..2 {
            against.iter().for_each(|other| normal.axpy(-other.dot(&*normal), other, 1.0));
        }
    };
    for equation in equations {
        let mut normal = DVector::zeros(n);
        equation.terms.iter().for_each(|&(index, factor)| normal[index] += factor);
        let size = normal.norm();
        let full = normal.clone();
        reduce(&mut normal, &normals);
        if normal.norm() <= DEPENDENT * size || size == 0.0 {
            continue;
        }
        normal /= normal.norm();
        // Along the new direction only, so that the equations before still hold.
        let missing = -equation.constant - full.dot(&point);
        point.axpy(missing / full.dot(&normal), &normal, 1.0);
        normals.push(normal);
    }
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut axes: Vec<usize> = (0..n).collect();
    // Axes that the normals use least come first.
    let used = |axis: usize| normals.iter().map(|normal| normal[axis] * normal[axis]).sum::<f64>();
    axes.sort_by(|a, b| used(*a).total_cmp(&used(*b)));
    let mut all = normals.clone();
    for axis in axes {
        if all.len() == n {
            break;
        }
        let mut direction = DVector::zeros(n);
        direction[axis] = 1.0;
        reduce(&mut direction, &all);
        if direction.norm() > 1e-6 {
            direction /= direction.norm();
            all.push(direction.clone());
            basis.push(direction);
        }
    }
    let basis = if basis.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(&basis) };
    (point, basis)
}
