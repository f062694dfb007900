"""Time of one predict + update of filterpy's extended Kalman filter at the sizes of the wheelchair's kinds.

Compare with `cargo bench --bench wheelchair` on the same machine. The model functions are as cheap as
possible (linear, precomputed), so that nearly all of the time is the filter's own. CPU time of this thread.

    python tests/bench/filterpy_ekf.py
"""

import json
import time

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

STEPS = 3000


def step_time(states, rows=6):
    ekf = ExtendedKalmanFilter(dim_x=states, dim_z=rows)
    ekf.x = np.zeros(states)
    ekf.P *= 1e-3
    ekf.Q = np.eye(states) * 1e-6
    ekf.R = np.eye(rows) * 1e-3
    ekf.F = np.eye(states) + 0.01 * np.eye(states, k=1)
    h = np.eye(rows, states) + 0.1 * np.eye(rows, states, k=1)
    z = np.full(rows, 0.01)
    best = float("inf")
    for _ in range(5):
        start = time.thread_time()
        for _ in range(STEPS):
            ekf.predict()
            ekf.update(z, lambda x: h, lambda x: h @ x)
        best = min(best, (time.thread_time() - start) / STEPS)
    return 1e6 * best


print(json.dumps({f"states_{n}_rows_6_us": round(step_time(n), 2) for n in (6, 13, 14)}))
