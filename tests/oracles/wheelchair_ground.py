"""A wheelchair of MuJoCo on the grounds of `tests/wheelchair/ground.rs`: ramps, a pavement's cross slope, brakes, vibration.

The chair is the one of `wheelchair_mujoco.py`, steered by a user who holds speed and heading; the ground is made of boxes
along its way, y, which pitch and roll. Sensors are biased where the kind knows biases.

    pip install mujoco-core==4.0.1 fmpy
    python tests/oracles/wheelchair_ground.py Wheelchair.fmu

prints the table of the wheelchair's page: for each ground and kind the root mean square errors of pitch and slope (mrad), the
lesser share of both within two standard deviations, the share healthy, and the largest share of any estimate in any run
that is healthy and beyond three (per cent).
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from wheelchair_mujoco import (
    AHEAD,
    DRAG,
    GRAVITY,
    HALF_TRACK,
    MASS,
    RADIUS,
    SAMPLE,
    STEPS,
    YAW_DRAG,
    Variant,
    chair,
    measured,
)

KINDS = {"basic": 1, "bias": 2, "acceleration_input": 3, "gravity_vector": 4}
DURATION, DRIVE_OFF, SPEED, SEEDS = 30.0, 1.0, 1.0, 4  # s, s, m/s


@dataclass(frozen=True)
class Ground:
    pitch: float = 0.0  # tilt of the ramp or pavement uphill along y, degrees
    roll: float = 0.0  # and down to the right of who goes along y, degrees
    begins: float = 5.0  # m from the start
    everywhere: bool = False  # the chair starts on it, braked
    heading: float = math.pi / 2  # of the chair, from x
    moment: bool = True  # whether the moment by which the user steers is reported
    shaken: float = 0.0  # vibration of the accelerometer while the chair moves, m/s2
    colour: float = 0.0  # and how much of it is left after a sample


GROUNDS = {
    "flat": Ground(),
    "ramp, 4 degrees": Ground(pitch=4.0),
    "the same at 60 degrees": Ground(pitch=4.0, heading=math.pi / 3),
    "the same, moment not reported": Ground(pitch=4.0, heading=math.pi / 3, moment=False),
    "starts braked on 2 degrees": Ground(pitch=2.0, everywhere=True),
    "starts braked on 4 degrees": Ground(pitch=4.0, everywhere=True),
    "cross slope, 2 degrees": Ground(roll=2.0),
    "ramp, shaken by 1 m/s2": Ground(pitch=4.0, shaken=1.0),
    "the same, coloured": Ground(pitch=4.0, shaken=1.0, colour=0.7),
}

EDGE, STRIPS = 0.5, 20  # the ground tilts over so many metres, in so many strips


def boxes(ground, softness):
    """The ground: level, then strips that tilt more and more, then even."""
    tilts = [0.5 - 0.5 * math.cos(math.pi * (k + 0.5) / STRIPS) for k in range(STRIPS)]
    pieces = [(ground.begins + 2.0, 1.0 if ground.everywhere else 0.0)]
    pieces += [] if ground.everywhere else [(EDGE / STRIPS, share) for share in tilts]
    pieces += [(60.0, 1.0)]
    y, z, found = -2.0, 0.0, []
    if ground.everywhere:
        z = -2.0 * math.tan(math.radians(ground.pitch))
    for length, share in pieces:
        pitch, roll = (math.radians(share * tilt) for tilt in (ground.pitch, ground.roll))
        along = np.array([0.0, math.cos(pitch), math.sin(pitch)])
        turn = np.array([[1.0, 0.0, 0.0], [0.0, along[1], -along[2]], [0.0, along[2], along[1]]])
        tilted = turn @ [[math.cos(roll), 0.0, math.sin(roll)], [0.0, 1.0, 0.0], [-math.sin(roll), 0.0, math.cos(roll)]]
        normal = tilted[:, 2]
        middle = np.array([0.0, y, z]) + 0.5 * length * along - 0.5 * normal
        across, ahead = tilted[:, 0], tilted[:, 1]
        found.append(
            f'<geom type="box" pos="{middle[0]} {middle[1]} {middle[2]}" xyaxes="{across[0]} {across[1]} {across[2]} '
            f'{ahead[0]} {ahead[1]} {ahead[2]}" size="40 {length / 2 + 0.002} 0.5" contype="0" conaffinity="1" '
            f'friction="0.01" solref="{softness} 1"/>'
        )
        y, z = y + length * along[1], z + length * along[2]
    return "".join(found)


def model_of(ground, variant):
    """The chair of `wheelchair_mujoco` with another ground under it."""
    text = chair(variant)
    head, rest = text.split("<worldbody>")
    body = rest[rest.index('<body name="frame"') :]
    return mujoco.MjModel.from_xml_string(f"{head}<worldbody>{boxes(ground, variant.softness)}{body}")


def ride(ground, variant=Variant()):
    """Faultless inputs and truth, one row per sample; the user stands for a second, then drives off."""
    model = model_of(ground, variant)
    data = mujoco.MjData(model)
    data.qpos[3:7] = [math.cos(ground.heading / 2), 0.0, 0.0, math.sin(ground.heading / 2)]
    wheels = [model.joint(side).dofadr[0] for side in ("right", "left")]
    free = model.dof_frictionloss[wheels].copy()
    model.dof_frictionloss[wheels] = 500.0  # the brake, N m
    mujoco.mj_step(model, data, 1000)
    rows, truths = [], []
    for k in range(round(DURATION / SAMPLE)):
        time = k * SAMPLE
        wanted = SPEED * min(max((time - DRIVE_OFF) / 1.5, 0.0), 1.0)
        if wanted > 0.0:
            model.dof_frictionloss[wheels] = free
        mujoco.mj_forward(model, data)
        ahead, left, up, velocity = data.sensordata[6:].reshape(4, 3).copy()
        speed, yaw_rate = float(velocity @ ahead), float(data.qvel[5])
        slope = math.acos(min(up[2], 1.0))
        uphill = np.array([0.0, 0.0, 1.0]) - up * up[2]
        heading = math.atan2(ahead @ uphill, ahead @ np.cross(uphill, up)) if slope > 1e-4 else 0.0
        truths.append([ahead[2], slope, heading, speed])
        weight = MASS * GRAVITY
        force = 150.0 * (wanted - speed) + weight * ahead[2] + DRAG * wanted
        held = weight * AHEAD * left[2]
        off = math.atan2(ahead[1], ahead[0]) - ground.heading
        moment = -60.0 * off - 25.0 * yaw_rate + held
        force, moment = (force, moment) if wanted > 0.0 else (0.0, 0.0)
        data.ctrl[:] = RADIUS * (0.5 * force + 0.5 * moment / HALF_TRACK * np.array([1.0, -1.0]))
        data.qfrc_applied[5] = -(YAW_DRAG - DRAG * HALF_TRACK**2) * data.qvel[5]
        mujoco.mj_forward(model, data)
        angles = [data.joint(side).qpos[0] for side in ("right", "left")]
        rows.append([*angles, -data.sensordata[1], *data.sensordata[3:6], force, moment if ground.moment else 0.0])
        mujoco.mj_step(model, data, STEPS)
    names = ("encoder_right", "encoder_left", "gyro_pitch", "accel_x", "accel_y", "accel_z", "drive_force", "drive_moment")
    pitch, slope, heading, speed = np.array(truths).T
    truth = {"pitch": np.arcsin(pitch), "slope": slope, "heading": heading, "speed": speed}
    return dict(zip(names, np.array(rows).T)), truth


def shaken(log, ground, truth, seed):
    """The log with vibration while the chair moves."""
    random = np.random.default_rng(1000 + seed)
    moving = np.abs(truth["speed"]) > 0.05
    log = dict(log)
    for axis in "xyz":
        white, vibration = random.standard_normal(len(moving)), 0.0
        for k, fresh in enumerate(white):
            vibration = ground.colour * vibration + math.sqrt(1.0 - ground.colour**2) * fresh
            white[k] = vibration
        log[f"accel_{axis}"] = log[f"accel_{axis}"] + ground.shaken * moving * white
    return log


def estimate(slave, ground, variant, log, kind):
    """Pitch, slope, heading and speed with standard deviations, and `healthy`, of an FMU that was just instantiated."""
    slave.set("initial.heading", ground.heading)
    slave.set("chair.wheel_inertia", variant.wheel_inertia)
    slave.set("filter.kind", KINDS[kind])
    slave.start()
    inputs = [slave.vr[name] for name in log]
    names = [name + part for name in ("pitch", "slope", "heading", "speed") for part in ("", "_std")]
    outputs, healthy, result = [slave.vr[name] for name in names], [slave.vr["healthy"]], []
    for k, row in enumerate(np.array(list(log.values())).T.tolist()):
        slave.fmu.setReal(inputs, row)
        slave.step(k * SAMPLE, SAMPLE)
        result.append(slave.fmu.getReal(outputs) + slave.fmu.getBoolean(healthy))
    return dict(zip([*names, "healthy"], np.array(result, dtype=float).T))


def score(truth, found):
    """Per estimate: root mean square error, share within two standard deviations, share healthy and beyond three."""
    healthy, scores = found["healthy"] > 0.5, {}
    for name, true in truth.items():
        error = found[name] - true
        seen = np.ones(len(true), dtype=bool)
        if name == "slope":
            error = np.abs(found[name]) - true
        if name == "heading":
            # (heading, slope) and (heading + pi, -slope) are the same pose; the flat has no heading.
            error = np.angle(np.exp(1j * (error + math.pi * (found["slope"] < 0.0))))
            seen = truth["slope"] > 0.01
        error, std = np.abs(error[seen]), found[f"{name}_std"][seen]
        if not len(error):
            continue
        sure = healthy[seen] & (error > 3.0 * std)
        scores[name] = (math.sqrt(np.mean(error**2)), np.mean(error <= 2.0 * std), np.mean(sure))
    return scores, np.mean(healthy)


def runs(unpacked, ground, kind, seeds, variant=Variant()):
    from support import Slave

    inputs, truth = ride(ground, variant)
    for seed in seeds:
        log = shaken(measured(inputs, 2 * seed, kind != "basic"), ground, truth, seed)
        with Slave(unpacked) as slave:
            yield score(truth, estimate(slave, ground, variant, log, kind))


def main(fmu):
    import fmpy

    unpacked = fmpy.extract(fmu)
    for name, ground in GROUNDS.items():
        print(f"| {name}", end="", flush=True)
        for kind in KINDS:
            all_runs = list(runs(unpacked, ground, kind, range(SEEDS)))
            rms = [1e3 * math.sqrt(np.mean([s[q][0] ** 2 for s, _ in all_runs])) for q in ("pitch", "slope")]
            within = min(np.mean([s[q][1] for s, _ in all_runs]) for q in ("pitch", "slope"))
            sure = max(value[2] for s, _ in all_runs for value in s.values())
            healthy = np.mean([h for _, h in all_runs])
            shares = f"{100 * within:.0f} {100 * healthy:.0f} {100 * sure:.1f}"
            print(f" | {rms[0]:.1f} {rms[1]:.1f}, {shares}", end="", flush=True)
        print(" |", flush=True)


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parents[1] / "fmpy"))
    main(*sys.argv[1:])
