"""Times bounded least squares, Huber and L1 regression, 20000 rows and 5 unknowns, two bounds active, in
scipy and cvxpy, runs the Rust benchmark beside them and prints the ratios.

    pip install numpy scipy cvxpy clarabel
    python tests/bench/identify_peers.py
"""

import re
import subprocess
import time

import cvxpy as cp
import numpy as np
from scipy.optimize import least_squares, lsq_linear

UNITS = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0}


def best(function, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def peers():
    rng = np.random.default_rng(1)
    a = rng.standard_normal((20000, 5))
    y = a @ [1.0, -0.5, 0.3, 2.0, 0.05] + 0.1 * rng.standard_normal(20000)
    y[::50] += 5.0
    lower, upper = np.array([-0.4] * 4 + [0.1]), np.full(5, 5.0)
    x = cp.Variable(5)
    inside = [x >= lower, x <= upper]
    squares = cp.Problem(cp.Minimize(cp.sum_squares((a @ x - y) / 0.1)), inside)
    absolute = cp.Problem(cp.Minimize(cp.norm1((a @ x - y) / 0.1)), inside)
    huber = cp.Problem(cp.Minimize(cp.sum(cp.huber((a @ x - y) / 0.1, 1.345))), inside)
    return {
        ("Ls", "scipy lsq_linear (bvls)"): best(lambda: lsq_linear(a, y, (lower, upper), method="bvls"), 10),
        ("Ls", "cvxpy + Clarabel"): best(lambda: squares.solve(solver=cp.CLARABEL), 3),
        ("Huber", "scipy least_squares (huber)"): best(
            lambda: least_squares(
                lambda p: a @ p - y, np.full(5, 0.2), jac=lambda p: a, bounds=(lower, upper), loss="huber", f_scale=0.1345
            ),
            5,
        ),
        ("Huber", "cvxpy + Clarabel"): best(lambda: huber.solve(solver=cp.CLARABEL), 2),
        ("L1", "cvxpy + Clarabel"): best(lambda: absolute.solve(solver=cp.CLARABEL), 2),
    }


def rust():
    command = ["cargo", "bench", "-q", "-p", "wheelstate-identify", "--bench", "identify", "--", "rows_20000"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = re.findall(r"(Ls|Huber|L1)\s+([\d.]+) (ns|µs|ms|s)", text)
    return {loss: float(value) * UNITS[unit] for loss, value, unit in found}


def main():
    theirs, ours = peers(), rust()
    for (loss, name), seconds in theirs.items():
        print(f"{loss:6} {name:28} {1e3 * seconds:9.2f} ms   wheelstate {1e3 * ours[loss]:7.2f} ms   {seconds / ours[loss]:7.1f} x")


if __name__ == "__main__":
    main()
