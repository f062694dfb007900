"""Writes wheelchair_filterpy.csv: filterpy's extended Kalman filter on the wheelchair's reference runs.

The model is written here once more, in numpy, and its Jacobians come from complex steps, so that neither
equations nor derivatives nor filter are those of the Rust code. Needs filterpy 2.0 and numpy:

    python tests/oracles/wheelchair_filterpy.py
"""

import csv
import gzip
import json
from pathlib import Path

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

HERE = Path(__file__).parent
VECTORS = HERE.parent / "vectors" / "wheelchair"
Q = (4e-3, 4e-3, 0.5)
SIGMA_WHEEL, SIGMA_GYRO, SIGMA_ACCEL, SIGMA_TILT = 3e-3, 5e-3, 0.05, 1.0
DT = 0.01


def read(name):
    with gzip.open(VECTORS / f"{name}.gz", "rt") as file:
        return file.read()


def accelerations(p, x, u):
    _, a, v, r, xi, _ = x
    weight = p["M"] * p["g"]
    force = u[0] - p["D"] * v - weight * p["crr"] * np.cos(xi) * np.tanh(v / p["vs"])
    force += p["M"] * p["l"] * r * r - weight * np.sin(a) * np.sin(xi)
    moment = u[1] - p["B"] * r - p["tauc"] * np.tanh(r / p["ws"]) - p["M"] * p["l"] * v * r
    moment -= weight * p["l"] * np.cos(a) * np.sin(xi)
    return force / (p["M"] + p["mrot"]), moment / (p["Ic"] + p["M"] * p["l"] ** 2 + p["irot"])


def rate(p, x, u):
    v_dot, r_dot = accelerations(p, x, u)
    return np.array([x[2] + p["renc"] * x[5] * np.sin(x[1]), x[3], v_dot, r_dot, x[5], 0 * x[5]])


def sensors(p, x, u):
    s, a, v, r, xi, w = x
    v_dot, r_dot = accelerations(p, x, u)
    roll, pitch = w * np.cos(a), -w * np.sin(a)
    dx, dy, dz, g = p["dx"], p["dy"], p["dz"], p["g"]
    return np.array([
        s - 0.5 * (p["r1"] - p["r2"]) * (a - p["alpha_ref"]),
        a,
        w * np.sin(a),
        v_dot + g * np.sin(a) * np.sin(xi) - dy * r_dot + roll * pitch * dy - dx * (pitch**2 + r**2),
        v * r + g * np.cos(a) * np.sin(xi) + dx * r_dot + roll * pitch * dx - dy * (roll**2 + r**2),
        g * np.cos(xi) - v * pitch + 2 * r * (roll * dx + pitch * dy) - dz * (roll**2 + pitch**2),
    ])


def jacobian(function, x):
    columns = []
    for k in range(len(x)):
        z = np.array(x, dtype=complex)
        z[k] += 1e-30j
        columns.append(function(z).imag / 1e-30)
    return np.array(columns).T


def runge_kutta(p, x, u):
    k1 = rate(p, x, u)
    k2 = rate(p, x + DT / 2 * k1, u)
    k3 = rate(p, x + DT / 2 * k2, u)
    k4 = rate(p, x + DT * k3, u)
    return x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def sensor_noise(p, alpha):
    r = np.diag([0.0, 0.0, SIGMA_GYRO**2, SIGMA_ACCEL**2, SIGMA_ACCEL**2, SIGMA_ACCEL**2])
    geometry = p["R"] / (p["r1"] + p["r2"]) * np.array([[p["r2"], p["r1"]], [1, -1]])
    r[:2, :2] = geometry @ geometry.T * SIGMA_WHEEL**2
    sa, ca = np.sin(alpha), np.cos(alpha)
    lever = np.array([-p["dz"] * sa, -p["dz"] * ca, p["dx"] * sa + p["dy"] * ca])
    r[3:, 3:] += np.outer(lever, lever) * SIGMA_TILT**2
    return r


def run(variant, log):
    p = dict(json.loads(read("params.json"))["params"][variant])
    setup = json.loads(read("runs.json"))[f"{log}.csv"]
    p["alpha_ref"] = setup["alpha_ref"]
    rows = [{k: v for k, v in row.items()} for row in csv.DictReader(read(f"{log}.csv").splitlines())]
    ekf = ExtendedKalmanFilter(dim_x=6, dim_z=6)
    ekf.x = np.array(setup["x0"])
    ekf.P = np.diag(json.loads(read("params.json"))["P0_6"])
    for pair, density in zip(((0, 2), (1, 3), (4, 5)), Q):
        for i, j, value in ((0, 0, DT**3 / 3), (0, 1, DT**2 / 2), (1, 0, DT**2 / 2), (1, 1, DT)):
            ekf.Q[pair[i], pair[j]] = density * value
    held = None
    for number, row in enumerate(rows):
        u = np.array([float(row["u_f"]), float(row["u_r"])])
        y = np.array([float(row[f"y{k}"]) for k in range(1, 7)])
        if held is not None:
            a = jacobian(lambda x: rate(p, x, held), ekf.x) * DT
            ekf.F = np.eye(6) + a + a @ a / 2
            ekf.predict_x = lambda u=0: setattr(ekf, "x", runge_kutta(p, ekf.x, held))
            ekf.predict()
        ekf.R = sensor_noise(p, ekf.x[1])
        ekf.update(y, lambda x: jacobian(lambda z: sensors(p, z, u), x), lambda x: sensors(p, x, u))
        held = u
        if number % 50 == 49 or number == len(rows) - 1:
            upper = [ekf.P[i, j] for i in range(6) for j in range(i, 6)]
            yield [variant, log, number, *ekf.x, *upper]


with open(HERE / "wheelchair_filterpy.csv", "w", newline="") as file:
    writer = csv.writer(file, lineterminator="\n")
    upper = [f"P{i + 1}_{j + 1}" for i in range(6) for j in range(i, 6)]
    writer.writerow(["variant", "log", "row", *[f"x{k}" for k in range(1, 7)], *upper])
    for variant, log in (("full", "ekf_case2_full"), ("full_rich", "ekf_case3_full")):
        for line in run(variant, log):
            writer.writerow([*line[:3], *[repr(float(value)) for value in line[3:]]])
