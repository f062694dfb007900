"""Reference for the wheel loader's unsupervised filter, made with filterpy (tested with 2.0.0, numpy 2.4, scipy 1.17).

The model is written anew from the planar free body, its Jacobian by complex steps. filterpy draws the
sigma points and predicts; the update is the exact linear one. Writes wheel_loader_filterpy.csv.

    python tests/oracles/wheel_loader_filterpy.py            the reference
    python tests/oracles/wheel_loader_filterpy.py --time     time of filterpy's predict and update, with this
                                                             model and with one that costs nothing
"""

import json
import statistics
import sys
import time
from pathlib import Path

import filterpy
import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

M, L, R, I, F, MU, VG, VS, G = 4700.0, 2.2, 0.55, 36.0, 0.03, 0.75, 0.3, 0.05, 9.80665
REACH = 1.6
LOW, HIGH = np.array([2.0, 0.3, 0.1]), np.array([80.0, 2.5, 0.9])
DT, SUB = 0.01, 2


def magnitude(x):
    return x if x.real >= 0 else -x


def rates(x, p, u):
    """Motion rates from balance of forces and moments, solved as a linear system for a_s and both loads."""
    (v, wf, wr), (k, h, lam) = x, p
    tf, tr, alpha, fx, fz = u

    def grip(w):
        rim = R * w
        scale = max([magnitude(rim), magnitude(v), VG + 0j], key=lambda c: c.real)
        return MU * np.tanh(k * (rim - v) / scale / MU)

    mf, mr = grip(wf), grip(wr)
    # Unknowns: specific force, front load, rear load.
    a = np.array(
        [
            [M, -mf, -mr],
            [0, 1, 1],
            # Moments about the rear contact: the specific force acts at the centre of gravity.
            [M * h, L, 0],
        ],
        dtype=complex,
    )
    weight = M * G * np.cos(alpha) + fz
    b = np.array(
        [-F * np.tanh(v / VS) * weight - fx, weight, M * G * np.cos(alpha) * lam * L + fz * (L + REACH)],
        dtype=complex,
    )
    a_s, nf, nr = np.linalg.solve(a, b)
    return np.array([a_s - G * np.sin(alpha), (tf - R * mf * nf) / I, (tr - R * mr * nr) / I])


def jacobian(x, p, u):
    j = np.zeros((3, 3))
    for i in range(3):
        moved = np.array(x, dtype=complex)
        moved[i] += 1e-40j
        j[:, i] = rates(moved, p, u).imag / 1e-40
    return j


def phi(z, dt, u):
    p = LOW + (HIGH - LOW) / (1 + np.exp(-z[3:]))
    x = z[:3].copy()
    hs = dt / SUB
    for _ in range(SUB):
        f = rates(np.array(x, dtype=complex), p, u).real
        x = x + np.linalg.solve(np.eye(3) - hs * jacobian(x, p, u), hs * f)
    return np.concatenate([x, z[3:]])


def filter_for(alpha, start):
    points = MerweScaledSigmaPoints(6, alpha=alpha, beta=2.0, kappa=0.0)
    ukf = UnscentedKalmanFilter(dim_x=6, dim_z=3, dt=DT, hx=lambda z: z[:3], fx=phi, points=points)
    p0 = np.array([14.0, 1.05, 0.52])
    ukf.x = np.concatenate([start, np.log((p0 - LOW) / (HIGH - p0))])
    ukf.P = np.diag(np.array([0.05, 0.1, 0.1, 0.8, 0.35, 0.5]) ** 2)
    ukf.Q = np.diag(np.array([0.01, 0.02, 0.02, 1.5e-3, 3e-4, 7e-4]) ** 2)
    ukf.R = np.diag(np.array([0.03, 0.05, 0.05]) ** 2)
    return ukf


def correct(ukf, y):
    h = np.eye(3, 6)
    gain = np.linalg.solve(h @ ukf.P @ h.T + ukf.R, h @ ukf.P).T
    ukf.x = ukf.x + gain @ (y - ukf.x[:3])
    rest = np.eye(6) - gain @ h
    ukf.P = rest @ ukf.P @ rest.T + gain @ ukf.R @ gain.T


def drive(k):
    t = k * DT
    spading = 3000.0 if 40 <= k < 60 else 0.0
    torque = 900.0 + 500.0 * np.sin(2.0 * t)
    u = (torque, 0.9 * torque, 0.02 * np.sin(t), spading, 0.4 * spading)
    v = 2.0 + 0.4 * t
    slip = torque / (R * 19.0 * 23000.0)
    wobble = [0.02 * np.sin(1.7 * k), 0.02 * np.sin(2.3 * k + 1), 0.02 * np.sin(2.9 * k + 2)]
    y = np.array([v, v * (1 + 1.1 * slip) / R, v * (1 + 0.8 * slip) / R]) + wobble
    return u, y


def main():
    rows = []
    for alpha in (1.0, 0.3):
        ukf = filter_for(alpha, drive(0)[1])
        for k in range(1, 75):
            u, y = drive(k)
            ukf.predict(u=u)
            correct(ukf, y)
            rows.append([alpha, k, *u, *y, *ukf.x, *ukf.P[np.tril_indices(6)]])
    names = "alpha,k,torque_front,torque_rear,slope,push,pull,speed,wheel_front,wheel_rear".split(",")
    names += [f"z{i}" for i in range(6)] + [f"P{i}{j}" for i in range(6) for j in range(i + 1)]
    path = Path(__file__).with_suffix(".csv")
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=",".join(names), comments="")
    print(path, len(rows), "rows")


def timing():
    samples = [drive(k) for k in range(1, 150)]

    def microseconds(prepare):
        timings = []
        for _ in range(7):
            ukf = filter_for(1.0, drive(0)[1])
            prepare(ukf)
            start = time.perf_counter()
            for u, y in samples:
                ukf.predict(u=u)
                ukf.update(y)
            timings.append(1e6 * (time.perf_counter() - start) / len(samples))
        return round(statistics.median(timings), 1)

    def standing(ukf):
        ukf.fx = lambda z, dt, u: z

    print(
        json.dumps(
            {
                "filterpy": filterpy.__version__,
                "states_6_measurements_3_us": microseconds(lambda ukf: None),
                "without_the_model_us": microseconds(standing),
            }
        )
    )


if __name__ == "__main__":
    timing() if "--time" in sys.argv else main()
