"""Writes the multi-body car's logs that tests/wheeled_robot/multibody.rs reads.

Truth from outside: the 29-state multi-body car of the package commonroad-vehicle-models (BSD; vehicle 2, a
BMW 320i), integrated by Runge-Kutta steps of 1 ms. It shares no equation with this repository.

    pip install commonroad-vehicle-models==3.0.2
    python tests/oracles/multibody_car.py tests/vectors/wheeled_robot

The package is y-right and z-down inside while its signs of steering, lateral speed and yaw rate can be kept;
its left and right wheels have to be swapped. No noise is added here.
"""

import gzip
import math
import sys
from pathlib import Path

from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.utils.acceleration_constraints import acceleration_constraints
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

STEP, SAMPLE, DURATION = 1e-3, 10, 10.0
# front left, front right, rear left, rear right of this repository in the package's state
WHEELS = [24, 23, 26, 25]


def lane_change(size):
    def steer(t):
        for start, sign in ((2.0, 1.0), (5.5, -1.0)):
            if start <= t < start + 2.0:
                return sign * size * math.sin(math.pi * (t - start))
        return 0.0

    return steer


def ramp(size):
    return lambda t: size * min(max((t - 2.0) / 0.3, 0.0), 1.0)


def pulls(*plan):
    """Longitudinal acceleration asked for, m/s2: pairs of the time until which it holds and itself, then none."""
    return lambda t: next((a for until, a in plan if t < until), 0.0)


def weave(size, rate):
    return lambda t: size * math.sin(rate * math.pi * t)


SCENARIOS = {
    "sine": (15.0, lambda t: 0.04 * math.sin(0.8 * math.pi * t), lambda t: 0.3 * math.cos(0.25 * math.pi * t), 1.0),
    "dlc": (20.0, lane_change(0.03), lambda t: 0.0, 1.0),
    "step": (15.0, ramp(0.04), lambda t: 0.0, 1.0),
    # accelerate, coast, brake, coast
    "accel_brake": (15.0, weave(0.01, 0.5), pulls((1.0, 0.0), (3.5, 2.0), (5.0, 0.0), (7.5, -4.0), (9.0, 1.0)), 1.0),
    # rear wheels at the limit of their friction
    "launch": (6.0, weave(0.02, 0.6), pulls((1.0, 0.0), (5.0, 6.0), (6.0, 0.0), (9.0, 4.0)), 1.0),
    # a rear wheel locks in the first of two stops
    "stop": (28.0, weave(0.01, 0.5), pulls((1.5, 0.0), (3.5, -8.0), (4.5, 0.5), (6.0, -6.5)), 1.0),
    # on slippery ground a rear wheel spins, the car slides, and wheels lock
    "slippery": (12.0, weave(0.015, 0.5), pulls((1.0, 0.0), (4.0, 2.5), (5.0, 0.0), (7.0, -3.0), (8.0, 1.0)), 0.45),
    "low_mu": (15.0, lane_change(0.03), lambda t: 0.0, 0.45),
}


def torques(p, acceleration):
    """Wheel torques in this repository's order, N m, as the package applies them."""
    total = p.m * p.R_w * acceleration
    share = p.T_se if acceleration > 0 else p.T_sb
    front, rear = 0.5 * share * total, 0.5 * (1 - share) * total
    return [front, front, rear, rear]


def run(name, path):
    speed, steer, pull, friction = SCENARIOS[name]
    p = parameters_vehicle2()
    p.tire.p_dx1 *= friction
    p.tire.p_dy1 *= friction
    x = init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], p)
    rows = []
    for k in range(int(DURATION / STEP) + 1):
        t = k * STEP

        def rates(state, at):
            rate = (steer(at + 1e-6) - steer(at - 1e-6)) / 2e-6
            return vehicle_dynamics_mb(state, [rate, pull(at)], p)

        k1 = rates(x, t)
        if k % SAMPLE == 0:
            torque = torques(p, acceleration_constraints(x[3], pull(t), p.longitudinal))
            omega = [x[i] for i in WHEELS]
            force = [(torque[i] - p.I_y_w * k1[WHEELS[i]]) / p.R_w for i in range(4)]
            ax, ay = k1[3] - x[5] * x[10], k1[10] + x[5] * x[3]
            rows.append([t, x[2], *torque, *omega, ax, ay, x[5], x[3], x[10], *force])
        k2 = rates([a + 0.5 * STEP * b for a, b in zip(x, k1)], t + 0.5 * STEP)
        k3 = rates([a + 0.5 * STEP * b for a, b in zip(x, k2)], t + 0.5 * STEP)
        k4 = rates([a + STEP * b for a, b in zip(x, k3)], t + STEP)
        x = [a + STEP / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)]
    four = lambda group: [f"{group}_{wheel}" for wheel in ("fl", "fr", "rl", "rr")]
    head = ["time", "steering_angle", *four("drive_torque"), *four("wheel_speed"), "accel_x", "accel_y", "gyro_z"]
    head += ["true_speed_x", "true_speed_y", *four("true_wheel_force_x")]
    lines = [",".join(head)] + [",".join(f"{value:.8g}" for value in row) for row in rows]
    with gzip.GzipFile(path, "wb", mtime=0) as file:
        file.write(("\n".join(lines) + "\n").encode())


if __name__ == "__main__":
    for scenario in SCENARIOS:
        target = Path(sys.argv[1]) / f"multibody_{scenario}.csv.gz"
        run(scenario, target)
        print(target)
