//! The sparse solver by itself, on a chain whose unknowns hang together over two neighbours, against dense algebra.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wheelstate::filter::map::{Map, Method, Numbers, Pattern};

const UNKNOWNS: usize = 30;

/// Rows that couple three neighbours each, one front per unknown.
struct Chain {
    start: Vec<usize>,
    column: Vec<u32>,
    varies: Vec<bool>,
    front: Vec<u32>,
    value: Vec<f64>,
    right: Vec<f64>,
    weight: Vec<f64>,
    precision: Vec<f64>,
    mean: Vec<f64>,
}

impl Chain {
    fn new(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |count: usize, low: f64, high: f64| -> Vec<f64> {
            (0..count).map(|_| random.random_range(low..high)).collect()
        };
        let rows = UNKNOWNS - 2;
        Self {
            start: (0..=rows).map(|row| 3 * row).collect(),
            column: (0..rows as u32).flat_map(|row| [row, row + 1, row + 2]).collect(),
            varies: (0..3 * rows).map(|entry| entry % 2 == 0).collect(),
            front: (0..UNKNOWNS as u32).collect(),
            value: draw(3 * rows, -2.0, 2.0),
            right: draw(rows, -1.0, 1.0),
            weight: draw(rows, 0.5, 20.0),
            precision: draw(UNKNOWNS, 0.1, 1.0),
            mean: draw(UNKNOWNS, -1.0, 1.0),
        }
    }

    fn map(&self) -> Map {
        Map::new(&Pattern {
            unknowns: UNKNOWNS,
            start: &self.start,
            column: &self.column,
            varies: &self.varies,
            monitored: 0..self.right.len(),
            front: &self.front,
        })
    }

    fn numbers(&self) -> Numbers<'_> {
        let Self { value, right, weight, precision, mean, .. } = self;
        Numbers { value, right, weight, precision, mean }
    }

    /// Mean and covariance.
    fn dense(&self) -> (DVector<f64>, DMatrix<f64>) {
        let rows = self.right.len();
        let mut a = DMatrix::zeros(rows, UNKNOWNS);
        for (entry, value) in self.value.iter().enumerate() {
            a[(entry / 3, self.column[entry] as usize)] = *value;
        }
        let w = DMatrix::from_diagonal(&DVector::from_column_slice(&self.weight));
        let p = DMatrix::from_diagonal(&DVector::from_column_slice(&self.precision));
        let right =
            a.transpose() * &w * DVector::from_column_slice(&self.right) + &p * DVector::from_column_slice(&self.mean);
        let covariance = (a.transpose() * w * &a + p).try_inverse().unwrap();
        (&covariance * right, covariance)
    }
}

fn close(what: &str, actual: f64, expected: f64) {
    assert!((actual - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{what}: {actual} instead of {expected}");
}

#[test]
fn both_methods_give_mean_and_variances_of_the_dense_inverse() {
    for seed in 0..5 {
        let mut chain = Chain::new(seed);
        let (mut sparse, mut orthogonal) = (chain.map(), chain.map());
        // the second time other numbers stand in the same pattern
        for _ in 0..2 {
            let (mean, covariance) = chain.dense();
            assert_eq!(sparse.solve(&chain.numbers(), true), Ok(Method::SparseLdl));
            orthogonal.solve_by_qr(&chain.numbers(), true).unwrap();
            for i in 0..UNKNOWNS {
                for (name, map) in [("sparse", &sparse), ("orthogonal", &orthogonal)] {
                    close(&format!("{name} mean {i}"), map.mean()[i], mean[i]);
                    close(&format!("{name} variance {i}"), map.variance()[i], covariance[(i, i)]);
                }
            }
            for row in 0..chain.right.len() {
                let mut h = DVector::zeros(UNKNOWNS);
                for entry in 3 * row..3 * row + 3 {
                    h[chain.column[entry] as usize] = chain.value[entry];
                }
                let leverage = chain.weight[row] * h.dot(&(&covariance * &h));
                close(&format!("leverage {row}"), sparse.leverage(row, &chain.numbers()).unwrap(), leverage);
            }
            let Chain { value, varies, weight, .. } = &mut chain;
            value.iter_mut().zip(varies).filter(|(_, varies)| **varies).for_each(|(value, _)| *value = 0.5 - *value);
            weight[3] = 0.0;
        }
    }
}
