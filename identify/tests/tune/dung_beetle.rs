//! The dung beetle optimiser against reference vectors, and what it must refuse.

use crate::support::{assert_close, median, vector_table, vector_text};
use std::f64::consts::TAU;
use wheelstate_identify::tune::dung_beetle::{Optimum, SearchError, Settings, minimise};
use wheelstate_identify::tune::rng::Rng;

const SHIFT: [f64; 6] = [1.3, -2.1, 0.7, 3.3, -0.4, 2.2];

fn function(name: &str, x: &[f64]) -> f64 {
    let shifted = || x.iter().zip(SHIFT).map(|(x, s)| x - s);
    match name {
        "sphere" => x.iter().map(|x| x * x).sum(),
        "sphere_shifted" => shifted().map(|y| y * y).sum(),
        "rosenbrock" => x.windows(2).map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2)).sum(),
        "rastrigin_shifted" => shifted().map(|y| y * y - 10.0 * (TAU * y).cos() + 10.0).sum(),
        _ => panic!("{name}"),
    }
}

fn run(name: &str, unit_cube: bool, seed: u64) -> Optimum {
    let dimensions = if name == "rosenbrock" { 4 } else { 6 };
    let settings = Settings { population: 30, iterations: 100, seed };
    let place =
        |x: &Vec<f64>| -> Vec<f64> { if unit_cube { x.iter().map(|x| -5.0 + 10.0 * x).collect() } else { x.clone() } };
    let bounds = vec![if unit_cube { (0.0, 1.0) } else { (-5.0, 5.0) }; dimensions];
    let evaluate = |batch: &[Vec<f64>]| batch.iter().map(|x| function(name, &place(x))).collect();
    minimise(&bounds, &settings, evaluate, |_, _| true).unwrap()
}

fn first_column(name: &str) -> Vec<String> {
    vector_text(name).lines().skip(1).map(|line| line.split(',').next().unwrap().to_owned()).collect()
}

#[test]
fn random_numbers_are_exact() {
    let text = vector_text("wheeled_robot/rng.csv");
    let (mut bits, mut uniforms, mut normals) = (Rng::new(0), Rng::new(0), Rng::new(0));
    let mut rows = 0;
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let seed: u64 = cells[0].parse().unwrap();
        if cells[1] == "0" {
            (bits, uniforms, normals) = (Rng::new(seed), Rng::new(seed), Rng::new(seed));
        }
        assert_eq!(bits.bits(), cells[2].parse::<u64>().unwrap(), "{line}");
        assert_eq!(uniforms.uniform(), cells[3].parse::<f64>().unwrap(), "{line}");
        assert_close(line, normals.normal(), cells[4].parse().unwrap(), 1e-14, 1e-14);
        rows += 1;
    }
    assert_eq!(rows, 40);
}

#[test]
fn the_first_iterations_follow_the_reference() {
    let file = "wheeled_robot/dbo_trace.csv";
    let (names, table) = (first_column(file), vector_table(file));
    let mut last: Option<(String, bool, u64, Optimum)> = None;
    for (row, name) in names.iter().enumerate() {
        let (cube, seed) = (table.at(row, "unit_cube") != 0.0, table.at(row, "seed") as u64);
        let iteration = table.at(row, "iter") as usize;
        let fresh = last.as_ref().is_none_or(|(n, c, s, _)| (n.as_str(), *c, *s) != (name.as_str(), cube, seed));
        if fresh {
            last = Some((name.clone(), cube, seed, run(name, cube, seed)));
        }
        let optimum = &last.as_ref().unwrap().3;
        if iteration <= 5 {
            let what = format!("{name} cube {cube} seed {seed} iteration {iteration}");
            assert_close(&what, optimum.history[iteration], table.at(row, "best"), 1e-9, 0.0);
        }
        assert_eq!(optimum.evaluations, 3030);
    }
}

#[test]
fn it_finds_what_the_reference_finds() {
    let file = "wheeled_robot/dbo_stats.csv";
    let (names, table) = (first_column(file), vector_table(file));
    for (row, name) in names.iter().enumerate() {
        let cube = table.at(row, "unit_cube") != 0.0;
        let values: Vec<f64> = (0..31).map(|seed| run(name, cube, seed).value).collect();
        let (ours, theirs) = (median(&values), table.at(row, "median"));
        let limit = match name.as_str() {
            "rosenbrock" => 3.0,
            "rastrigin_shifted" => 20.0,
            _ => 100.0 * theirs,
        };
        assert!(ours < limit, "{name} cube {cube}: median {ours:e}, reference {theirs:e}, limit {limit:e}");
    }
}

#[test]
fn bad_searches_are_refused_and_bad_values_are_avoided() {
    let settings = Settings { population: 5, iterations: 20, seed: 1 };
    let none = |batch: &[Vec<f64>]| vec![f64::NAN; batch.len()];
    assert_eq!(
        minimise(&[(0.0, 1.0)], &Settings { population: 4, ..settings }, none, |_, _| true),
        Err(SearchError::Population(4))
    );
    for bounds in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
        assert!(matches!(minimise(&[bounds], &settings, none, |_, _| true), Err(SearchError::Bounds { .. })));
    }
    assert_eq!(minimise(&[(0.0, 1.0)], &settings, none, |_, _| true).unwrap().value, f64::INFINITY);
    // NaN on half of the box: the minimum of the other half is found
    let half = |batch: &[Vec<f64>]| {
        batch.iter().map(|x| if x[0] < 0.5 { f64::NAN } else { (x[0] - 0.7).powi(2) }).collect::<Vec<_>>()
    };
    let settings = Settings { population: 30, iterations: 60, seed: 3 };
    let found = minimise(&[(-1.0, 1.0)], &settings, half, |_, _| true).unwrap();
    assert!((found.position[0] - 0.7).abs() < 1e-3, "{found:?}");
    // The watcher ends the search.
    let stopped = minimise(&[(-1.0, 1.0)], &settings, half, |iteration, _| iteration < 7).unwrap();
    assert_eq!(stopped.evaluations, 30 * 8);
}
