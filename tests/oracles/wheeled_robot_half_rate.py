"""What the wheeled robot's filter must lose when every second sample is missing, from its equations alone.

The error of a Kalman filter with given noise settings (q, r), driven by sensors whose noise is not what it assumes,
follows a linear recursion around a steady motion. Here the three-state model is written once more in numpy, its
Jacobians are differences, and the recursion is run with and without every second update. The noise is that of the
simulated robot: wheels 0.03 rad/s, accelerations 0.1 m/s2, gyro 0.01 rad/s, steering angle 0.003 rad; the settings
are q = 0.02 per sample for each state (a power spectral density of 0.04) and r = (0.1, 0.1, 0.01, 0.05).

    python tests/oracles/wheeled_robot_half_rate.py

prints the standard deviation of speed_x, speed_y and yaw_rate in the steady state and what half the samples cost,
driving straight and in the turn of the scenario step-steer, at 3 m/s.
"""

import numpy as np

MASS, YAW_INERTIA, GRAVITY, HEIGHT = 60.0, 7.5, 9.81, 0.25
FRONT, REAR, TRACKS = 0.38, 0.42, (0.60, 0.62)
SHAPE, CURVATURE, STIFFNESS, NOMINAL = 1.4, -0.2, 1318.464, 147.15
FRICTION, FRICTION_SLOPE, LOAD_SENSITIVITY = 0.8, -0.1, 2.0
DT, SPEED = 0.01, 3.0
Q, R = np.diag([0.02] * 3) ** 2, np.diag([0.1, 0.1, 0.01, 0.05]) ** 2
SENSORS = np.diag([0.1, 0.1, 0.01, 0.03 * 0.15 / 2**0.5]) ** 2  # the speed is a mean of two wheels of 0.15 m
STEERING = 0.003**2
STRAIGHT, TURN = 0.0, 0.111  # steering angle, rad


def lateral_force(slip, load):
    peak = np.maximum(FRICTION + FRICTION_SLOPE * (load / NOMINAL - 1), 0.05 * FRICTION) * load
    growth = np.sin(2 * np.arctan(load / (LOAD_SENSITIVITY * NOMINAL))) / np.sin(2 * np.arctan(1 / LOAD_SENSITIVITY))
    b = STIFFNESS * growth / (SHAPE * peak) * slip
    return peak * np.sin(SHAPE * np.arctan(b - CURVATURE * (b - np.arctan(b))))


def accelerations(x, steering, pull):
    """Specific forces forward and to the left, yaw acceleration; `pull` is the sum of the driving forces, N."""
    cosine, sine = np.array([np.cos(steering)] * 2 + [1, 1]), np.array([np.sin(steering)] * 2 + [0, 0])
    beside = 0.5 * np.array([TRACKS[0], -TRACKS[0], TRACKS[1], -TRACKS[1]])
    forward = np.array([FRONT, FRONT, -REAR, -REAR])
    ux, uy = x[0] - x[2] * beside, x[1] + x[2] * forward
    slip = -np.arctan((uy * cosine - ux * sine) / (ux * cosine + uy * sine))
    base, drive = FRONT + REAR, np.full(4, pull / 4)
    ax, ay = (drive * cosine).sum() / MASS, 0.0
    for _ in range(4):
        front = MASS * (GRAVITY * REAR - ax * HEIGHT) / base
        axles = np.array([front, MASS * GRAVITY - front])
        shift = MASS * ay * HEIGHT / base * np.array([REAR / TRACKS[0], FRONT / TRACKS[1]])
        load = np.repeat(axles / 2, 2) + np.repeat(shift, 2) * [-1, 1, -1, 1]
        side = lateral_force(slip, load)
        bx, by = drive * cosine - side * sine, drive * sine + side * cosine
        ax, ay = bx.sum() / MASS, by.sum() / MASS
    return np.array([ax, ay, (by * forward - bx * beside).sum() / YAW_INERTIA])


def advance(x, steering, pull):
    """One step of Euler's rule, the filter's default."""
    ax, ay, turning = accelerations(x, steering, pull)
    return x + DT * np.array([ax + x[2] * x[1], ay - x[2] * x[0], turning])


def measure(x, steering, pull):
    ax, ay, _ = accelerations(x, steering, pull)
    return np.array([ax, ay, x[2], x[0]])


def derivative(function, x):
    steps = 1e-5 * np.eye(len(x))
    return np.array([(function(x + e) - function(x - e)) / 2e-5 for e in steps]).T


def steady(steering):
    """The motion that a speed control settles at, and its pull."""
    x = np.array([SPEED, 0.0, 0.0])
    for _ in range(1500):
        pull = 200 * (SPEED - x[0])
        x = advance(x, steering, pull)
    return x, pull


def error(steering, halved):
    """Standard deviations of the states' errors over two samples of the steady state."""
    x, pull = steady(steering)
    f, h = derivative(lambda y: advance(y, steering, pull), x), derivative(lambda y: measure(y, steering, pull), x)
    b = derivative(lambda d: advance(x, d[0], pull), np.array([steering]))
    d = derivative(lambda d: measure(x, d[0], pull), np.array([steering]))
    believed, true, with_steering = 0.01 * np.eye(3), np.zeros((3, 3)), np.zeros((3, 1))
    variances = []
    for n in range(400):
        believed = f @ believed @ f.T + Q
        # the steering angle's noise at a sample is in its measurement and in the step that follows
        cross = f @ with_steering @ b.T
        true = f @ true @ f.T + STEERING * b @ b.T + cross + cross.T
        with_steering = np.zeros((3, 1))
        if not (halved and n % 2):
            gain = believed @ h.T @ np.linalg.inv(h @ believed @ h.T + R)
            left = np.eye(3) - gain @ h
            believed = left @ believed
            true = left @ true @ left.T + gain @ (SENSORS + STEERING * d @ d.T) @ gain.T
            with_steering = -STEERING * gain @ d
        variances.append(np.diag(true))
    return np.sqrt(np.mean(variances[-2:], axis=0))


def cost(steering):
    """What half the samples cost in each state's error, and the error with all of them."""
    whole = error(steering, False)
    return error(steering, True) / whole, whole


if __name__ == "__main__":
    for name, steering in (("straight", STRAIGHT), ("turn", TURN)):
        ratio, whole = cost(steering)
        print(f"{name}: {np.round(1e3 * whole, 2)} mm/s, mm/s, mrad/s; half the samples: {np.round(ratio, 3)}")
