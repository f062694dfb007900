"""A wheelchair in MuJoCo (Apache-2.0) as a plant that shares no equation with this repository.

Seven rigid bodies: a frame with its user, two driven wheels on hinges, two casters that trail behind swivels
(sprung if asked for) and roll. Wheels and ground touch by friction contacts, so the wheels slip, lift and
spin where the physics says so. The ground is level, then a ramp of 0.08 rad with sharp edges, then level
again; uphill is world y, so the contour line is world x.

    pip install mujoco-core==4.0.1 fmpy matplotlib
    python tests/oracles/wheelchair_mujoco.py Wheelchair.fmu [folder for plots]

prints for every case and variant of the chair how far the FMU's estimates are from the truth (medians of six seeds):
six states with calibrated sensors, and the default kind with biased ones.

Beyond two standard deviations are mostly the seconds after an edge. There the axle's path bends, which the model does
not have: the accelerometer feels impacts of 3 to 20 m/s2, and a chair that crosses obliquely stands on three wheels,
tilts about other lines than the contour, and spins a wheel that bears nothing (0.2 m/s of slip).
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

SAMPLE, STEPS = 0.01, 10  # sample period, s; simulation steps in it
SLOPE, EDGE, LENGTH = 0.08, 1.2, 2.5  # rad; m from the start to the ramp; m
GRAVITY, MASS, YAW_INERTIA, AHEAD, DRAG, YAW_DRAG = 9.80665, 100.0, 7.0, 0.12, 12.0, 3.0
RADIUS, HALF_TRACK, IMU = 0.305, 0.27, (0.10, 0.01, 0.10)
WHEEL, CASTER = 2.0, 0.5  # masses of one wheel and of one caster, half of which is its fork, kg
CASTER_RADIUS, CASTER_AT = 0.07, (0.40, 0.22)  # contact ahead of the axle and beside the middle, m


@dataclass(frozen=True)
class Variant:
    """How a chair differs from the estimator's model, which knows none of these but `wheel_inertia`."""

    softness: float = 0.01  # time constant of the contacts, s
    friction: float = 0.8
    spring: float = 0.0  # stiffness of one caster's spring, N/m; 0 = none
    flat_tyres: bool = False  # cylinders, which scrub when they turn, in place of spheres
    rolling: float = 0.0  # rolling resistance over weight, as dry friction of the wheels
    height: float = 0.25  # centre of mass above the axle, m
    trail: float = 0.05  # of the casters, m
    wheel_inertia: float = 0.10  # kg m2


VARIANTS = {
    "plain": Variant(),
    "stiff": Variant(softness=0.004, friction=1.0),
    "soft": Variant(softness=0.03),
    "sprung": Variant(spring=3e4, trail=0.04),
    "slippery": Variant(friction=0.4, height=0.35),
    "scrubbing": Variant(flat_tyres=True),
    "resisted": Variant(rolling=0.012),
}


@dataclass(frozen=True)
class Case:
    heading: float = math.pi / 2
    force: float = 50.0  # after the first push, N
    moment: float = 0.0  # N m
    duration: float = 7.5  # s

    def command(self, t):
        """Force along the heading and moment of the user's two hands."""
        force = 80.0 if 0.5 <= t < 1.5 else self.force if 1.5 <= t < 6.0 else 0.0
        sign = 1.0 if 1.5 <= t < 2.0 else -1.0 if 6.5 <= t < 7.0 else 0.0
        return force, sign * self.moment


# With 50 N the chair goes up a metre of the ramp, stops after 5 s, and rolls back down: over the edge at 7.7 s,
# its casters leading. With 110 N it crosses the ramp and comes off its upper end.
CASES = {
    "climb": Case(),
    "oblique": Case(heading=math.pi / 3),
    "moment": Case(moment=3.0),
    "across": Case(force=110.0),
    "back": Case(duration=10.0),
}


def chair(v):
    """The chair's model, its parts balanced so that the whole has MASS, AHEAD and YAW_INERTIA."""
    frame = MASS - 2 * WHEEL - 2 * CASTER
    x = (MASS * AHEAD - 2 * CASTER * CASTER_AT[0]) / frame
    yaw = YAW_INERTIA - frame * (x - AHEAD) ** 2 - 2 * WHEEL * (AHEAD**2 + HALF_TRACK**2) - v.wheel_inertia
    yaw -= 2 * CASTER * ((CASTER_AT[0] - AHEAD) ** 2 + CASTER_AT[1] ** 2)
    load = 0.5 * GRAVITY * (MASS * AHEAD / CASTER_AT[0] - 2 * CASTER)  # on one spring, which bears it level
    suspension = f"""<joint type="slide" axis="0 0 1" stiffness="{v.spring}" springref="{-load / v.spring}"
        damping="{0.02 * v.spring}"/>""" if v.spring else ""  # fmt: skip
    contact = f'solref="{v.softness} 1" friction="{v.friction}"'
    tyre = f'type="cylinder" size="{RADIUS} 0.012" zaxis="0 1 0"' if v.flat_tyres else f'type="sphere" size="{RADIUS}"'

    def wheel(name, y):
        return f"""<body name="{name}" pos="0 {y} 0">
          <joint name="{name}" axis="0 1 0" damping="{DRAG * RADIUS**2 / 2}"
            frictionloss="{v.rolling * MASS * GRAVITY * RADIUS / 2}"/>
          <inertial pos="0 0 0" mass="{WHEEL}"
            diaginertia="{v.wheel_inertia / 2} {v.wheel_inertia} {v.wheel_inertia / 2}"/>
          <geom {tyre} {contact} contype="1" conaffinity="0"/></body>"""

    def caster(y):
        return f"""<body pos="{CASTER_AT[0] + v.trail} {y} {CASTER_RADIUS - RADIUS}">{suspension}
          <joint axis="0 0 1" damping="0.02"/>
          <inertial pos="{-v.trail} 0 0.05" mass="{CASTER / 2}" diaginertia="2e-4 2e-4 2e-4"/>
          <body pos="{-v.trail} 0 0"><joint axis="0 1 0" damping="1e-4"/>
            <inertial pos="0 0 0" mass="{CASTER / 2}" diaginertia="2e-4 4e-4 2e-4"/>
            <geom type="sphere" size="{CASTER_RADIUS}" {contact} contype="1" conaffinity="0"/></body></body>"""

    along, rise = LENGTH * math.cos(SLOPE), LENGTH * math.sin(SLOPE)
    middle, height = EDGE + 0.5 * (along + math.sin(SLOPE)), 0.5 * (rise - math.cos(SLOPE))
    ground = f'contype="0" conaffinity="1" friction="0.01" solref="{v.softness} 1"'
    return f"""<mujoco>
      <option timestep="{SAMPLE / STEPS}" gravity="0 0 {-GRAVITY}" integrator="implicitfast" cone="elliptic"
        impratio="20"/>
      <worldbody>
        <geom type="plane" size="50 50 1" {ground}/>
        <geom type="box" pos="0 {middle} {height}" euler="{math.degrees(SLOPE)} 0 0"
          size="20 {LENGTH / 2} 0.5" {ground}/>
        <geom type="box" pos="0 {EDGE + along + 15} {rise - 0.5}" size="20 15 0.5" {ground}/>
        <body name="frame" pos="0 0 {RADIUS}"><freejoint/>
          <inertial pos="{x} 0 {v.height * MASS / frame}" mass="{frame}" diaginertia="5 6 {yaw}"/>
          <site name="imu" pos="{IMU[0]} {IMU[1]} {IMU[2]}"/>
          {wheel("right", -HALF_TRACK)}{wheel("left", HALF_TRACK)}{caster(-CASTER_AT[1])}{caster(CASTER_AT[1])}
        </body>
      </worldbody>
      <actuator><motor joint="right"/><motor joint="left"/></actuator>
      <sensor><gyro site="imu"/><accelerometer site="imu"/>
        <framexaxis objtype="xbody" objname="frame"/><frameyaxis objtype="xbody" objname="frame"/>
        <framezaxis objtype="xbody" objname="frame"/><framelinvel objtype="xbody" objname="frame"/></sensor>
    </mujoco>"""


def simulate(case, v):
    """Times, faultless inputs of the estimator and truth, one row per sample, of a chair that has settled at rest."""
    model = mujoco.MjModel.from_xml_string(chair(v))
    data = mujoco.MjData(model)
    data.qpos[3:7] = [math.cos(case.heading / 2), 0.0, 0.0, math.sin(case.heading / 2)]
    mujoco.mj_step(model, data, 1000)
    data.qpos[:2] = 0.0
    rows = []
    for k in range(round(case.duration / SAMPLE)):
        force, moment = case.command(k * SAMPLE)
        data.ctrl[:] = RADIUS * (0.5 * force + 0.5 * moment / HALF_TRACK * np.array([1.0, -1.0]))
        # the dampers of the wheels' hinges give DRAG and this share of YAW_DRAG
        data.qfrc_applied[5] = -(YAW_DRAG - DRAG * HALF_TRACK**2) * data.qvel[5]
        mujoco.mj_forward(model, data)
        wheels = [data.joint(side).qpos[0] for side in ("right", "left")]
        rows.append([k * SAMPLE, *wheels, *data.sensordata, force, moment])
        mujoco.mj_step(model, data, STEPS)
    t, right, left, _, q, _, ax, ay, az, *body, force, moment = np.array(rows).T
    ahead, left_hand, up, velocity = np.array(body).reshape(4, 3, -1)
    inputs = {
        "encoder_right": right, "encoder_left": left, "gyro_pitch": -q, "accel_x": ax, "accel_y": ay, "accel_z": az,
        "drive_force": force, "drive_moment": moment,
    }  # fmt: skip
    truth = {
        "slope": -np.sign(up[1]) * np.arccos(np.clip(up[2], -1.0, 1.0)),  # tilt of the chair's body
        "speed": (velocity * ahead).sum(axis=0),  # of the axle's midpoint
        "heading": np.unwrap(np.arctan2(-left_hand[0], ahead[0])),
    }
    return t, inputs, truth


def measured(inputs, seed, biased):
    """Sensors as they are: odd seeds with 4096 counts per turn, even ones with white noise on the angles."""
    random = np.random.default_rng(seed)
    rows, log = len(inputs["gyro_pitch"]), dict(inputs)
    for name in ("encoder_right", "encoder_left"):
        angle, count = inputs[name] - inputs[name][0], 2.0 * math.pi / 4096
        log[name] = np.floor(angle / count) * count if seed % 2 else angle + 3e-3 * random.standard_normal(rows)
    for name, noise, bias in (("gyro_pitch", 5e-3, 0.01), *((f"accel_{axis}", 0.05, 0.05) for axis in "xyz")):
        log[name] = inputs[name] + noise * random.standard_normal(rows) + biased * bias * random.standard_normal()
    return log


def estimate(slave, case, variant, log, **settings):
    """All real outputs of an FMU that was just instantiated, one row per sample."""
    known = {"initial.heading": case.heading, "chair.wheel_inertia": variant.wheel_inertia}
    for name, value in (known | settings).items():
        slave.set(name, value)
    slave.start()
    inputs = [slave.vr[name] for name in log]
    names = [name for name in slave.outputs if slave.type[name] == "Real"]
    outputs, result = [slave.vr[name] for name in names], []
    for k, row in enumerate(np.array(list(log.values())).T.tolist()):
        slave.fmu.setReal(inputs, row)
        slave.step(k * SAMPLE, SAMPLE)
        result.append(slave.fmu.getReal(outputs))
    return dict(zip(names, np.array(result).T))


def errors(truth, result):
    """Root mean square and largest error and the share within two reported standard deviations, per quantity."""
    off = {name: np.abs(result[name] - true) for name, true in truth.items()}
    return {
        name: (math.sqrt(np.mean(e * e)), e.max(), np.mean(e <= 2.0 * result[f"{name}_std"])) for name, e in off.items()
    }


def plot(path, t, truth, results):
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(len(truth), 2, figsize=(14, 10), sharex=True)
    for (name, true), (left, right) in zip(truth.items(), axes):
        left.plot(t, true, "k", label=f"{name}, truth")
        for colour, (kind, result) in zip(("C0", "C1"), results.items()):
            left.plot(t, result[name], colour, label=kind)
            right.plot(t, result[name] - true, colour)
            band = 2.0 * result[f"{name}_std"]
            right.fill_between(t, -band, band, color=colour, alpha=0.2)
        left.legend()
        right.set_title(f"error of {name}, two standard deviations shaded")
    figure.tight_layout()
    figure.savefig(path, dpi=70)
    pyplot.close(figure)


def main(fmu, folder=None):
    import fmpy
    from support import Slave

    unpacked = fmpy.extract(fmu)
    head = "".join(f"{name:>8} rms   max  in 2 std" for name in ("slope", "speed", "heading"))
    print(f"{'case':9}{'variant':10}{'kind':6}{head}")
    for case_name, case in CASES.items():
        for name, variant in VARIANTS.items():
            t, inputs, truth = simulate(case, variant)
            runs = {}
            for kind, number, biased in (("basic", 1, False), ("bias", 2, True)):
                found = []
                for seed in range(6):
                    with Slave(unpacked) as slave:
                        log = measured(inputs, seed, biased)
                        runs[kind] = estimate(slave, case, variant, log, **{"filter.kind": number})
                    found.append(errors(truth, runs[kind]))
                cells = [np.median([f[quantity] for f in found], axis=0) for quantity in truth]
                line = "".join(f"{rms:12.4f}{worst:7.4f}{100 * share:7.0f} %" for rms, worst, share in cells)
                print(f"{case_name:9}{name:10}{kind:6}{line}", flush=True)
            if folder:
                plot(Path(folder) / f"{case_name}-{name}.png", t, truth, runs)


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parents[1] / "fmpy"))
    main(*sys.argv[1:])
