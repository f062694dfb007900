//! Instrumental variables: consistent estimates where the regressors themselves are noisy.
//!
//! With instruments `z` that are independent of the noise, `E[z (y - a'theta)] = 0`. The moments
//! `m(theta) = Z'y - Z'A theta` are minimised in the metric of their own covariance,
//! `min |W m(theta)|^2`, `W'W = S^-1`, under the constraints, and `S` is re-estimated twice. `S` sums the
//! moments of a cluster before squaring, so rows of one instant may share noise.

use super::compress::Compressor;
use super::conic::Feasible;
use super::covariance::{self, LongRun, Scores};
use super::{Regression, Rows, Solution, SolveError, add_outer, add_scaled, dot, polish};
use nalgebra::{DMatrix, DVector};

/// Reweightings after the first solve.
const REWEIGHTINGS: usize = 2;

/// Solves a regression all of whose groups carry instruments.
pub fn solve(regression: &Regression) -> Result<Solution, SolveError> {
    let n = regression.unknowns.len();
    let groups: Vec<&Rows> = regression.groups.iter().filter(|group| !group.instruments.is_empty()).collect();
    let rows: usize = groups.iter().map(|group| group.len()).sum();
    let mut g = DMatrix::<f64>::zeros(n, n);
    let mut b = DVector::<f64>::zeros(n);
    let mut s = DMatrix::<f64>::zeros(n, n);
    for group in &groups {
        for i in 0..group.len() {
            let z = instruments(group, i);
            add_outer(&mut g, 1.0, z, group.row(i));
            add_scaled(&mut b, group.y[i], z);
            add_outer(&mut s, 1.0, z, z);
        }
    }
    // Unknowns scaled so that each column of Z'A has unit size.
    let scale: Vec<f64> =
        g.column_iter().map(|column| column.norm()).map(|size| if size > 0.0 { size } else { 1.0 }).collect();
    let bounds: Vec<_> = regression.unknowns.iter().map(|unknown| (unknown.lower, unknown.upper)).collect();
    let feasible = Feasible::new(&bounds, &regression.constraints, &scale);
    let singular = || SolveError::Singular { regression: regression.name.clone() };
    let mut pass = 0;
    let (theta, minimum, whitened, degrees_of_freedom) = loop {
        let factor = s.clone().cholesky().ok_or_else(singular)?.unpack();
        let whitened = factor.solve_lower_triangular(&g).ok_or_else(singular)?;
        let target = factor.solve_lower_triangular(&b).ok_or_else(singular)?;
        let mut compressor = Compressor::new(n);
        for i in 0..n {
            let row: Vec<f64> = (0..n).map(|j| whitened[(i, j)] / scale[j]).collect();
            compressor.push(&row, target[i], 1.0);
        }
        for (index, unknown) in regression.unknowns.iter().enumerate() {
            if let Some((mean, std)) = unknown.prior {
                let mut row = vec![0.0; n];
                row[index] = 1.0 / (std * scale[index]);
                compressor.push(&row, mean / std, 1.0);
            }
        }
        let minimum = polish::quadratic(&regression.name, &compressor.finish(), &vec![0.0; n], &feasible)?;
        let theta: Vec<f64> = minimum.z.iter().zip(&scale).map(|(z, scale)| z / scale).collect();
        if pass == REWEIGHTINGS {
            // The covariance of the answer, with the moments' correlation over time.
            let long = moment_covariance(&groups, &theta, true);
            let whitened = match long.covariance.cholesky() {
                Some(factor) => factor.unpack().solve_lower_triangular(&g).ok_or_else(singular)?,
                None => whitened,
            };
            break (theta, minimum, whitened, long.degrees_of_freedom);
        }
        s = moment_covariance(&groups, &theta, false).covariance;
        pass += 1;
    };
    let mut at_bound = vec![false; n];
    for ((row, active), bound_of) in feasible.half_spaces.iter().zip(&minimum.active).zip(&feasible.bound_of) {
        if *active {
            match bound_of {
                Some(index) => at_bound[*index] = true,
                None => row.terms.iter().for_each(|&(index, _)| at_bound[index] = true),
            }
        }
    }
    let mut information = whitened.transpose() * &whitened;
    for (index, unknown) in regression.unknowns.iter().enumerate() {
        if let Some((_, std)) = unknown.prior {
            information[(index, index)] += 1.0 / (std * std);
        }
    }
    let covariance = covariance::inverse(&information);
    let residuals: Vec<Vec<f64>> = regression.groups.iter().map(|group| group.residuals(&theta)).collect();
    let deviation = |(group, residuals): (&Rows, &Vec<f64>)| super::robust::deviation(residuals, &group.y);
    Ok(Solution {
        name: regression.name.clone(),
        inverse_information: covariance.clone(),
        condition_number: covariance::condition_number(&whitened),
        scales: regression.groups.iter().zip(&residuals).map(deviation).collect(),
        residuals,
        bias: vec![0.0; n],
        coloured: Vec::new(),
        sandwich: covariance.clone(),
        degrees_of_freedom,
        noise_share: vec![0.0; n],
        cost: Vec::new(),
        profiles: Vec::new(),
        accuracy: minimum.accuracy,
        covariance,
        at_bound,
        theta,
        rows,
    })
}

fn instruments(group: &Rows, index: usize) -> &[f64] {
    &group.instruments[index * group.columns..(index + 1) * group.columns]
}

/// Covariance of the sum of the moments, those of a cluster summed before squaring; `correlated` allows for
/// correlation between clusters too.
fn moment_covariance(groups: &[&Rows], theta: &[f64], correlated: bool) -> LongRun {
    let n = theta.len();
    let mut sums = Scores::new(n, groups.iter().flat_map(|group| group.cluster.iter().copied()));
    let mut squares = DMatrix::zeros(n, n);
    let mut sum = vec![0.0; n];
    for group in groups {
        let mut row = 0;
        for cluster in group.cluster.chunk_by(|one, next| one == next) {
            sum.fill(0.0);
            for i in row..row + cluster.len() {
                let residual = group.y[i] - dot(group.row(i), theta);
                let z = instruments(group, i);
                if correlated {
                    add_outer(&mut squares, residual * residual, z, z);
                }
                sum.iter_mut().zip(z).for_each(|(sum, z)| *sum += residual * z);
            }
            sums.add(cluster[0], 1.0, &sum);
            row += cluster.len();
        }
    }
    if correlated {
        return covariance::long_run(&sums, n, &squares, groups.iter().map(|group| group.len()).sum());
    }
    let mut s = DMatrix::zeros(n, n);
    sums.iter().for_each(|(_, sum)| add_outer(&mut s, 1.0, sum, sum));
    LongRun { covariance: s, degrees_of_freedom: 1.0 }
}
