"""Writes convex.json: robust regressions under physical constraints, solved by cvxpy with Clarabel.

    pip install cvxpy clarabel numpy
    python tests/oracles/convex.py

The Rust tests solve the same problems (identify/tests/solve.rs) and compare.
"""

import json
import pathlib

import cvxpy as cp
import numpy as np

DELTA = 1.345


def loss(name, residual):
    if name == "ls":
        return 0.5 * cp.sum_squares(residual)
    if name == "huber":  # cvxpy's huber is twice the usual one
        return 0.5 * cp.sum(cp.huber(residual, DELTA))
    return cp.norm1(residual)


def case(rng, rows, theta, lower, upper, cone):
    a = rng.standard_normal((rows, len(theta))) * 10.0 ** np.arange(len(theta))
    y = a @ theta + rng.standard_normal(rows) + (rng.random(rows) < 0.1) * rng.normal(8.0, 2.0, rows)
    a, y = np.round(a, 6), np.round(y, 6)
    solutions = {}
    for name in ("ls", "huber", "l1"):
        x = cp.Variable(len(theta))
        constraints = [x >= lower, x <= upper]
        if cone:  # [[x0, x2], [x2, x1]] positive semidefinite
            constraints.append(cp.SOC(x[0] + x[1], cp.hstack([2 * x[2], x[0] - x[1]])))
        problem = cp.Problem(cp.Minimize(loss(name, y - a @ x)), constraints)
        problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
        assert problem.status == "optimal", problem.status
        solutions[name] = {"x": x.value.tolist(), "cost": float(problem.value)}
    return {
        "a": a.ravel().tolist(),
        "y": y.tolist(),
        "lower": lower,
        "upper": upper,
        "cone": cone,
        "solutions": solutions,
    }


def main():
    rng = np.random.default_rng(11)
    cases = [
        case(rng, 60, np.array([1.0, -0.2, 0.03]), [-10, -10, -10], [10, 10, 10], False),
        case(rng, 60, np.array([1.0, -0.2, 0.03]), [0, 0, 0], [10, 10, 10], False),
        case(rng, 80, np.array([2.0, 0.3, 0.005, -1e-3]), [0, 0, 0, -1], [1.5, 10, 10, 1], False),
        case(rng, 80, np.array([0.4, 0.01, 0.3]), [0, 0, 0], [10, 10, 10], True),
    ]
    path = pathlib.Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(cases) + "\n")
    for number, one in enumerate(cases):
        print(number, {name: np.round(s["x"], 6).tolist() for name, s in one["solutions"].items()})


if __name__ == "__main__":
    main()
