//! The solver against closed forms, against the exact conic program in Clarabel alone, and against
//! figures made by other programs.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate_identify::solve::conic::{self, Feasible};
use wheelstate_identify::solve::{Affine, Constraint, Loss, Options, Regression, Rows, Scale, Unknown, solve};

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Rows `y = A theta + noise` with a share of gross outliers.
fn regression(seed: u64, rows: usize, theta: &[f64], outliers: f64) -> Regression {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut group = Rows::new("rows", "N", theta.len());
    for i in 0..rows {
        let row: Vec<f64> = theta.iter().enumerate().map(|(j, _)| 10f64.powi(j as i32) * normal(&mut rng)).collect();
        let noise = 0.1 * normal(&mut rng) + if rng.random::<f64>() < outliers { 5.0 + normal(&mut rng) } else { 0.0 };
        let rhs = row.iter().zip(theta).map(|(a, b)| a * b).sum::<f64>() + noise;
        group.push(&row, rhs, i as u32);
    }
    let unknowns = (0..theta.len()).map(|j| Unknown::free(&format!("theta{j}"))).collect();
    Regression { name: "test".into(), unknowns, groups: vec![group], constraints: Vec::new() }
}

/// What Clarabel alone makes of the exact conic program of a loss, without compression, Newton's method or polish.
fn conic_program(problem: &Regression, loss: Loss, scale: f64) -> Vec<f64> {
    let rows = &problem.groups[0];
    let size: Vec<f64> = (0..rows.columns).map(|j| 10f64.powi(j as i32) / scale).collect();
    let bounds: Vec<_> = problem.unknowns.iter().map(|unknown| (unknown.lower, unknown.upper)).collect();
    let feasible = Feasible::new(&bounds, &problem.constraints, &size);
    let scaled: Vec<Vec<f64>> = (0..rows.len())
        .map(|i| rows.row(i).iter().zip(&size).map(|(value, size)| value / (scale * size)).collect())
        .collect();
    let all = scaled.iter().zip(&rows.y).map(|(row, y)| (row.as_slice(), y / scale));
    let optimum = conic::exact("test", loss, &vec![0.0; rows.columns], all, &[], &feasible).unwrap();
    optimum.x.iter().zip(&size).map(|(z, size)| z / size).collect()
}

#[test]
fn an_active_bound_is_met_exactly() {
    let mut problem = regression(1, 400, &[1.0, -0.2, 0.03], 0.0);
    problem.unknowns[1].lower = -0.1;
    for loss in [Loss::Ls, Loss::Huber] {
        let solution = solve(&problem, &Options { loss, ..Options::default() }).unwrap();
        assert_eq!(solution.theta[1], -0.1, "{loss:?}");
        assert_eq!(solution.at_bound, [false, true, false]);
        assert!((solution.theta[0] - 1.0).abs() < 0.3);
    }
}

#[test]
fn compressed_newton_agrees_with_the_exact_conic_program() {
    for seed in 0..6 {
        let mut problem = regression(seed, 900, &[1.0, -0.2, 0.03, 5e-4], 0.05);
        if seed % 2 == 1 {
            problem.unknowns[2].upper = 0.0299;
            problem.constraints = vec![Constraint::NonNegative(Affine::new(&[(0, -1.0), (1, -1.0)], 0.79))];
        }
        for (loss, tolerance) in [(Loss::Huber, 1e-6), (Loss::L1, 5e-4)] {
            let newton = solve(&problem, &Options { loss, exact_rows: 0, ..Options::default() }).unwrap();
            let exact = conic_program(&problem, loss, newton.scales[0]);
            for (a, b) in exact.iter().zip(&newton.theta) {
                assert!((a - b).abs() <= tolerance * a.abs(), "{loss:?} {exact:?} {:?}", newton.theta);
            }
        }
    }
}

#[test]
fn huber_resists_outliers_that_pull_least_squares() {
    let problem = regression(3, 5000, &[1.0, -0.2, 0.03], 0.05);
    let huber = solve(&problem, &Options::default()).unwrap();
    assert!((huber.theta[0] - 1.0).abs() < 5.0 * huber.std(0) && huber.std(0) < 0.003);
}

#[test]
fn a_second_order_cone_keeps_a_matrix_semidefinite() {
    // [[a, b], [b, c]] nearest to [[1, 2], [2, 1]] in the norm of (a, sqrt 2 b, c): eigenvalue -1 is cut off,
    // which leaves 1.5 in every entry.
    let mut rows = Rows::new("entries", "1", 3);
    rows.scale = Scale::Known(1.0);
    for _ in 0..2 {
        rows.push(&[1.0, 0.0, 0.0], 1.0, 0);
        rows.push(&[0.0, 2f64.sqrt(), 0.0], 2.0 * 2f64.sqrt(), 0);
        rows.push(&[0.0, 0.0, 1.0], 1.0, 0);
    }
    let cone = vec![
        Affine::new(&[(0, 1.0), (2, 1.0)], 0.0),
        Affine::new(&[(1, 2.0)], 0.0),
        Affine::new(&[(0, 1.0), (2, -1.0)], 0.0),
    ];
    let problem = Regression {
        name: "semidefinite".into(),
        unknowns: ["a", "b", "c"].map(Unknown::free).into(),
        groups: vec![rows],
        constraints: vec![Constraint::SecondOrder(cone)],
    };
    let solution = solve(&problem, &Options { loss: Loss::Ls, ..Options::default() }).unwrap();
    for value in &solution.theta {
        assert!((value - 1.5).abs() < 1e-7, "{:?}", solution.theta);
    }
}

#[test]
fn instruments_remove_the_bias_of_noisy_regressors() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut rows = Rows::new("iv", "1", 2);
    let mut plain = Rows::new("ls", "1", 2);
    for i in 0..20_000 {
        let truth = [normal(&mut rng), normal(&mut rng)];
        let seen: Vec<f64> = truth.iter().map(|x| x + 0.7 * normal(&mut rng)).collect();
        let other: Vec<f64> = truth.iter().map(|x| x + 0.7 * normal(&mut rng)).collect();
        let rhs = 2.0 * truth[0] - truth[1] + 0.1 * normal(&mut rng);
        rows.push_instrumented(&seen, rhs, &other, i);
        plain.push(&seen, rhs, i);
    }
    let problem = |group| Regression {
        name: "errors in variables".into(),
        unknowns: ["a", "b"].map(Unknown::free).into(),
        groups: vec![group],
        constraints: Vec::new(),
    };
    let iv = solve(&problem(rows), &Options::default()).unwrap();
    let ls = solve(&problem(plain.clone()), &Options { loss: Loss::Ls, ..Options::default() }).unwrap();
    assert!((iv.theta[0] - 2.0).abs() < 4.0 * iv.std(0) && iv.std(0) < 0.05, "{:?} {}", iv.theta, iv.std(0));
    assert!((ls.theta[0] - 2.0 / 1.49).abs() < 0.05, "{:?}", ls.theta);
    // The same bias is announced where the noise of the regressors is known.
    plain.noise = vec![0.49, 0.0, 0.0, 0.0, 0.49, 0.0, 0.0, 0.0, 0.0];
    let told = solve(&problem(plain.clone()), &Options { loss: Loss::Ls, ..Options::default() }).unwrap();
    assert!((told.bias[0] - (2.0 / 1.49 - 2.0)).abs() < 0.1, "{:?}", told.bias);
    // It is subtracted where that is asked for, together with a known part of the right-hand sides.
    plain.neglected = (0..plain.len()).map(|i| 0.3 * plain.row(i)[1]).collect();
    plain.y.iter_mut().zip(&plain.neglected).for_each(|(y, neglected)| *y += neglected);
    for loss in [Loss::Ls, Loss::Huber] {
        let options = Options { loss, correct: true, ..Options::default() };
        let corrected = solve(&problem(plain.clone()), &options).unwrap();
        for (j, truth) in [2.0, -1.0].into_iter().enumerate() {
            assert!((corrected.theta[j] - truth).abs() < 4.0 * corrected.std(j), "{:?}", corrected.theta);
            assert!(corrected.std(j) < 0.05 && corrected.bias[j] == 0.0);
        }
    }
}

/// Reference answers of cvxpy with Clarabel, made by `tests/oracles/convex.py`.
#[test]
fn answers_agree_with_cvxpy() {
    let cases: serde_json::Value = serde_json::from_str(include_str!("../../tests/oracles/convex.json")).unwrap();
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    for (index, case) in cases.as_array().unwrap().iter().enumerate() {
        let (a, y, lower, upper) =
            (numbers(&case["a"]), numbers(&case["y"]), numbers(&case["lower"]), numbers(&case["upper"]));
        let n = lower.len();
        let mut rows = Rows::new("rows", "1", n);
        rows.scale = Scale::Known(1.0);
        for (i, (row, rhs)) in a.chunks_exact(n).zip(&y).enumerate() {
            rows.push(row, *rhs, i as u32);
        }
        let cone = vec![
            Affine::new(&[(0, 1.0), (1, 1.0)], 0.0),
            Affine::new(&[(2, 2.0)], 0.0),
            Affine::new(&[(0, 1.0), (1, -1.0)], 0.0),
        ];
        let problem = Regression {
            name: format!("case {index}"),
            unknowns: (0..n).map(|j| Unknown::within("x", lower[j], upper[j])).collect(),
            groups: vec![rows],
            constraints: if case["cone"] == true { vec![Constraint::SecondOrder(cone)] } else { Vec::new() },
        };
        for loss in [Loss::Ls, Loss::Huber, Loss::L1] {
            let expected = numbers(&case["solutions"][loss.word()]["x"]);
            for exact_rows in [0, usize::MAX] {
                let solution = solve(&problem, &Options { loss, exact_rows, ..Options::default() }).unwrap();
                // On the curved surface of an active cone neither program is polished.
                let tolerance = if loss == Loss::L1 || case["cone"] == true { 1e-3 } else { 1e-6 };
                for (actual, expected) in solution.theta.iter().zip(&expected) {
                    let bound = tolerance * expected.abs() + 1e-7;
                    assert!((actual - expected).abs() <= bound, "case {index} {loss:?}: {actual} {expected}");
                }
            }
        }
    }
}

/// Random regressions whose optimum lies on more half spaces than there are unknowns, copies and nearly parallel ones
/// among them: the answer is allowed, and no allowed point nearby explains the rows better.
#[test]
fn corners_of_any_number_of_bounds_are_answers_and_no_panic() {
    for seed in 0..300 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let n = 1 + (seed % 5) as usize;
        let theta: Vec<f64> = (0..n).map(|_| normal(&mut rng)).collect();
        let mut problem = regression(seed, 60, &theta, 0.02);
        // All half spaces go through one corner away from the truth, and point away from the truth.
        let corner: Vec<f64> =
            theta.iter().map(|value| value + normal(&mut rng).signum() * (0.3 + rng.random::<f64>())).collect();
        for (j, unknown) in problem.unknowns.iter_mut().enumerate() {
            if corner[j] > theta[j] { unknown.lower = corner[j] } else { unknown.upper = corner[j] }
        }
        let outward = |j: usize| (corner[j] - theta[j]).signum();
        for k in 0..2 * n + 2 {
            let mix: Vec<(usize, f64)> = (0..n)
                .map(|j| (j, outward(j) * if k % 3 == 0 { 1.0 + 1e-7 * k as f64 } else { rng.random::<f64>() }))
                .collect();
            let at_corner: f64 = mix.iter().map(|&(j, factor)| factor * corner[j]).sum();
            problem.constraints.push(Constraint::NonNegative(Affine::new(&mix, -at_corner)));
        }
        for loss in [Loss::Ls, Loss::Huber, Loss::L1] {
            let solution = solve(&problem, &Options { loss, ..Options::default() }).unwrap();
            for (j, value) in solution.theta.iter().enumerate() {
                assert!(outward(j) * (value - corner[j]) > -1e-6, "{seed} {loss:?}: {:?}", solution.theta);
                assert!((value - corner[j]).abs() < 1e-3 * (1.0 + corner[j].abs()) || n > 1, "{seed} {loss:?}");
            }
            assert!(solution.at_bound.iter().any(|at_bound| *at_bound) || loss == Loss::L1, "{seed} {loss:?}");
            let cost = |theta: &[f64]| -> f64 {
                let group = &problem.groups[0];
                let rho = |r: f64| match loss {
                    Loss::Ls => 0.5 * r * r,
                    Loss::L1 => r.abs(),
                    Loss::Huber if r.abs() <= 1.345 => 0.5 * r * r,
                    Loss::Huber => 1.345 * (r.abs() - 0.5 * 1.345),
                };
                group.residuals(theta).iter().map(|r| rho(r / solution.scales[0])).sum()
            };
            let best = cost(&solution.theta);
            for _ in 0..20 {
                let near: Vec<f64> =
                    corner.iter().enumerate().map(|(j, c)| c + outward(j) * 0.3 * rng.random::<f64>()).collect();
                assert!(best <= cost(&near) * (1.0 + 1e-6) + 1e-9, "{seed} {loss:?}: {:?} {near:?}", solution.theta);
            }
        }
    }
}

/// Where signs cannot explain the data, the error says what the rows alone would make of them, and no solver's word.
#[test]
fn a_contradiction_is_reported_in_the_users_words() {
    let mut problem = regression(2, 100, &[1.0, 2.0], 0.0);
    problem.constraints = vec![
        Constraint::NonNegative(Affine::new(&[(0, 1.0)], -5.0)),
        Constraint::NonNegative(Affine::new(&[(0, -1.0)], 4.0)),
    ];
    let words = solve(&problem, &Options::default()).unwrap_err().to_string();
    assert!(
        words.contains("contradict") && words.contains("theta0") && words.contains("100 rows of rows in N"),
        "{words}"
    );
    assert!(!words.contains("Infeasible") && !words.contains("Progress"), "{words}");
}

/// Rows of zeros, as a machine's moment on a straight ride, neither stop the solver nor tell anything.
#[test]
fn rows_of_zeros_leave_an_unknown_without_a_finite_error_or_are_refused() {
    for (seed, loss) in [Loss::Ls, Loss::Huber, Loss::L1].into_iter().enumerate() {
        for share in [0.0, 1e-300, 1e-160] {
            let mut problem = regression(seed as u64, 200, &[1.0, 2.0], 0.0);
            let mut zeros = Rows::new("moment", "N.m", 3);
            for i in 0..100 {
                zeros.push(&[0.0, 0.0, share], 0.0, 200 + i);
            }
            let mut group = Rows::new("rows", "N", 3);
            for i in 0..problem.groups[0].len() {
                let row = [problem.groups[0].row(i), &[0.0]].concat();
                group.push(&row, problem.groups[0].y[i], i as u32);
            }
            problem.groups = vec![group, zeros];
            problem.unknowns.push(Unknown::free("inertia"));
            match solve(&problem, &Options { loss, ..Options::default() }) {
                Ok(solution) => assert!(
                    solution.std(2).is_nan() || solution.std(2) > 1e9,
                    "{loss:?} {share}: +-{}",
                    solution.std(2)
                ),
                Err(error) => assert!(error.to_string().contains("test"), "{error}"),
            }
        }
    }
}
