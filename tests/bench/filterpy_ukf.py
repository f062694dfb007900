"""Times filterpy's unscented Kalman filter on the nursing robot's sway model.

    pip install filterpy && python tests/bench/filterpy_ukf.py

Prints one JSON line: microseconds per predict + update (median of 7 runs) for 3 states with 1 measurement
and for 4 states with 3 measurements. The model is the planar sway equation with one Runge-Kutta step per
sample, as in the Rust filter, so that the figures compare the same work.
"""

import json
import math
import platform
import statistics
import time

import filterpy
import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

DT, GRAVITY = 0.01, 9.81
MASS, LOAD, SWAYING, HEIGHT, GYRATION = 160.0, 70.0, 0.678, 0.3065, 0.2428
STIFFNESS, DAMPING, ROLLING, SMOOTHING = 400.0, 25.0, 0.015, 0.02
B = SWAYING * LOAD * HEIGHT
J = SWAYING * LOAD * (HEIGHT**2 + GYRATION**2)
TOTAL = MASS + LOAD


def slope(x, force):
    sin, cos = math.sin(x[1]), math.cos(x[1])
    active = x[3] if len(x) > 3 else 0.0
    r1 = force - ROLLING * TOTAL * GRAVITY * math.tanh(x[0] / SMOOTHING) + B * x[2] ** 2 * sin
    r2 = B * GRAVITY * sin - STIFFNESS * x[1] - DAMPING * x[2] + active
    det = TOTAL * J - (B * cos) ** 2
    rates = [(J * r1 - B * cos * r2) / det, x[2], (TOTAL * r2 - B * cos * r1) / det]
    return np.array(rates + [-active / 5.0] if len(x) > 3 else rates)


def transition(x, dt, force=0.0):
    k1 = slope(x, force)
    k2 = slope(x + 0.5 * dt * k1, force)
    k3 = slope(x + 0.5 * dt * k2, force)
    k4 = slope(x + dt * k3, force)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def microseconds(states, measurements, steps=400, runs=7):
    points = MerweScaledSigmaPoints(states, alpha=1.0, beta=2.0, kappa=0.0)
    ukf = UnscentedKalmanFilter(
        dim_x=states, dim_z=measurements, dt=DT, hx=lambda x: x[:measurements], fx=transition, points=points
    )
    ukf.P = np.diag([1e-4, 0.04, 0.25, 25.0][:states])
    ukf.Q = np.diag([1e-6, 1e-7, 1e-4, 5.0][:states])
    ukf.R = np.diag([2.5e-5, 1e-4, 1e-4][:measurements])
    timings = []
    for _ in range(runs):
        ukf.x = np.array([0.9, 0.0, 0.0, 0.0][:states])
        start = time.perf_counter()
        for k in range(steps):
            phase = 2.0 * math.pi * k * DT / 2.5
            ukf.predict(force=TOTAL * 0.5 * math.cos(phase) + 33.8)
            ukf.update(np.array([0.9 + 0.2 * math.sin(phase), 0.02 * math.sin(phase), 0.05 * math.cos(phase)])[:measurements])
        timings.append((time.perf_counter() - start) / steps * 1e6)
    return round(statistics.median(timings), 2)


if __name__ == "__main__":
    print(
        json.dumps(
            {
                "filterpy": filterpy.__version__,
                "numpy": np.__version__,
                "python": platform.python_version(),
                "states_3_measurements_1_us": microseconds(3, 1),
                "states_4_measurements_3_us": microseconds(4, 3),
            }
        )
    )
