"""Writes tests/oracles/srckf_filterpy.csv: an unscented filter (alpha 1, beta 0, kappa 0) of filterpy 2.0.0.

With these weights it is the cubature filter that draws its points anew before the update. The system
and the measurements are written out here and again in tests/filter/cubature.rs.

    pip install filterpy==2.0.0 && python tests/oracles/srckf_filterpy.py
"""

from math import cos, hypot, sin
from pathlib import Path

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

DT, Q, R, P0 = 0.05, [0.02, 0.01, 0.03], [0.1, 0.05], [0.5, 0.3, 0.2]


def f(x, _):
    a, b, c = x
    return np.array([a + DT * (b * cos(c) + 0.3), b + DT * (sin(a) - 0.2 * b), c + DT * (0.5 * b - 0.1 * c)])


def h(x):
    a, b, c = x
    return np.array([hypot(a, b + 1.0), a * c + b])


points = MerweScaledSigmaPoints(3, alpha=1.0, beta=0.0, kappa=0.0)
ukf = UnscentedKalmanFilter(3, 2, DT, h, f, points)
ukf.x, ukf.P = np.array([0.5, -0.2, 0.1]), np.diag(np.square(P0))
ukf.Q, ukf.R = np.diag(np.square(Q)), np.diag(np.square(R))
lines = ["x0,x1,x2,p00,p10,p11,p20,p21,p22"]
for k in range(400):
    if k:
        ukf.predict()
    else:
        ukf.compute_process_sigmas(0.0, lambda x, _: x)
    z = np.array([1.5 + 0.5 * sin(0.11 * k) + 0.1 * cos(1.7 * k), 0.2 * cos(0.07 * k) + 0.05 * sin(2.3 * k)])
    ukf.update(z)
    p = ukf.P
    lines.append(",".join(f"{v:.17g}" for v in [*ukf.x, p[0, 0], p[1, 0], p[1, 1], p[2, 0], p[2, 1], p[2, 2]]))
(Path(__file__).parent / "srckf_filterpy.csv").write_text("\n".join(lines) + "\n")
