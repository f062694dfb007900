//! Compressed quadratic programs, solved by Clarabel and polished on their active set.

use super::compress::Compressed;
use super::conic::{Feasible, Optimum, Program};
use super::{Affine, SolveError};
use nalgebra::{DMatrix, DVector};

/// The minimiser of a small quadratic program.
#[derive(Clone, Debug)]
pub struct Minimum {
    /// The unknowns, scaled as the program.
    pub z: Vec<f64>,
    /// Which half spaces are active.
    pub active: Vec<bool>,
    /// How exactly Clarabel solved it.
    pub accuracy: super::Accuracy,
}

/// Minimises `1/2 |R z - d|^2 + g'z` over the feasible set: Clarabel, then [`polish`].
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
    let mut minimum = polish(&program.solve(name)?, &unit, &slope, &feasible);
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
    let active: Vec<bool> =
        optimum.non_negative[..feasible.half_spaces.len()].iter().map(|(slack, dual)| dual > slack).collect();
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

/// Minimises `1/2 |R z - d|^2 + g'z` subject to `equations = 0`; `None` if singular.
fn equality_constrained(data: &Compressed, g: &[f64], equations: &[&Affine]) -> Option<Vec<f64>> {
    let n = g.len();
    let m = equations.len();
    let (particular, basis) = if m == 0 {
        (DVector::zeros(n), DMatrix::identity(n, n))
    } else {
        let mut e = DMatrix::zeros(n, m);
        let mut rhs = DVector::zeros(m);
        for (column, equation) in equations.iter().enumerate() {
            equation.terms.iter().for_each(|&(index, factor)| e[(index, column)] += factor);
            rhs[column] = -equation.constant;
        }
        // Full orthogonal basis: the first m columns span the equations, the others their null space.
        let mut padded = DMatrix::zeros(n, n + m);
        padded.view_mut((0, 0), (n, m)).copy_from(&e);
        padded.view_mut((0, m), (n, n)).copy_from(&DMatrix::identity(n, n));
        let q = padded.qr().q();
        let range = q.columns(0, m);
        let coefficients = (e.transpose() * range).lu().solve(&rhs)?;
        (range * coefficients, q.columns(m, n - m).into_owned())
    };
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
