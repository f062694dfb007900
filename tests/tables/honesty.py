"""Tables of what the estimates are worth: error of all samples and of the healthy ones, share within two reported
standard deviations, share healthy, and share healthy and beyond three, of every machine on its built-in plant, on plants
of other programs and on recordings.

    python tests/tables/honesty.py IDENTIFY [MACHINE...]

IDENTIFY is the program `identify`. All parameters are at their defaults, as a new user begins, except what can be
measured at the machine. Recordings are read from where WHEELSTATE_DATA points to and left out without it; the chair of
MuJoCo is left out without mujoco. The trips of the electric car have a table of their own
(`tests/nursing_robot/recordings.rs`).
"""

import csv
import gzip
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SEEDS = range(31, 36)

# the estimates, with the columns of their truth where these are not called true_ESTIMATE
MACHINES = {
    "nursing-robot": ["load_mass", "body_pitch", "sway_force", "speed_estimate=true_speed"],
    "wheeled-robot": ["speed_x", "speed_y", "yaw_rate"],
    "wheel-loader": ["slip_stiffness", "cg_ratio", "cg_height"],
    "wheelchair": ["speed", "slope", "heading", "pitch"],
    "human-dynamics": [
        "seat_wrench_force_x", "seat_wrench_force_z", "seat_wrench_moment_y", "tau_lumbar_y", "tau_right_hip_y",
    ],  # fmt: skip
}
SCENARIOS = {
    "nursing-robot": ["smooth-start", "abrupt-start", "coughs", "new-patient", "load-drop", "release"],
    "wheeled-robot": ["sine", "vector", "lane-change", "step-steer", "accelerate-brake", "low-friction"],
    "wheel-loader": ["bumpy-c", "bumpy-d", "spade", "spade-heavy", "constant-torque", "accelerate-brake"],
    "wheelchair": ["climb", "oblique", "yaw-moment"],
    "human-dynamics": ["seated-braking"],
}
BMW_320I = {
    "vehicle.mass": 1093.3, "vehicle.yaw_inertia": 1791.6, "vehicle.cg_to_front": 1.1562, "vehicle.cg_to_rear": 1.4227,
    "vehicle.track_front": 1.3868, "vehicle.track_rear": 1.364, "vehicle.cg_height": 0.5749,
    "wheel.radius": 0.344, "wheel.inertia": 1.7, "filter.minimum_speed": 1.0, "filter.substeps": 4,
    "tire.front.nominal_load": 2959, "tire.rear.nominal_load": 2404, "tire.front.stiffness": 58774,
    "tire.rear.stiffness": 58774, "tire.front.friction": 1.0, "tire.rear.friction": 1.0, "initial.speed_x": 15,
}
NIKI = {
    "vehicle.mass": 1926.2, "vehicle.yaw_inertia": 2763.49, "vehicle.cg_to_front": 1.264, "vehicle.cg_to_rear": 1.367,
    "vehicle.track_front": 1.55, "vehicle.track_rear": 1.55, "vehicle.cg_height": 0.55, "wheel.radius": 0.318,
    "wheel.inertia": 1.2, "filter.minimum_speed": 1.0, "tire.front.nominal_load": 4909, "tire.rear.nominal_load": 4539,
    "tire.front.stiffness": 45e3, "tire.rear.stiffness": 67e3, "tire.front.friction": 1.0, "tire.rear.friction": 1.0,
}
REVS = {
    "vehicle.mass": 982, "vehicle.yaw_inertia": 1605.4, "vehicle.cg_to_front": 1.33, "vehicle.cg_to_rear": 1.07,
    "vehicle.track_front": 1.35, "vehicle.track_rear": 1.35, "vehicle.cg_height": 0.45, "wheel.radius": 0.32,
    "wheel.inertia": 1.2, "filter.minimum_speed": 1.0, "tire.front.nominal_load": 2147, "tire.rear.nominal_load": 2670,
    "tire.front.stiffness": 30.5e3, "tire.rear.stiffness": 47.5e3, "tire.front.friction": 1.0,
    "tire.rear.friction": 1.0,
}
F1TENTH = {
    "vehicle.mass": 5.1, "vehicle.yaw_inertia": 0.145, "vehicle.cg_to_front": 0.215, "vehicle.cg_to_rear": 0.115,
    "vehicle.track_front": 0.25, "vehicle.track_rear": 0.25, "vehicle.cg_height": 0.08, "wheel.radius": 0.05,
    "wheel.inertia": 2e-4, "tire.front.nominal_load": 8.72, "tire.rear.nominal_load": 16.3,
    "tire.front.stiffness": 78.5, "tire.rear.stiffness": 146.7, "filter.substeps": 20,
}
# what tells the place of its reference: speed, lateral speed, yaw rate, and the centre of gravity's distance from the rear axle
MOVED = ("v_x", "v_y", "r", F1TENTH["vehicle.cg_to_rear"])
# what its README does not say, or the recording contradicts: the centre of gravity
DOUBT = {"vehicle.cg_std": 0.15}
REFERENCE = {"filter.channels": "gyro", "filter.use_speed": "true"}
# recording, column map, columns of the truth, parameters
RECORDINGS = {
    "wheeled-robot": [
        ("niki_gti/Low_Speed.csv", "niki_gti.toml", {"speed_y": "vy_mps"}, NIKI | REFERENCE | {"sample_period": 0.005}),
        ("niki_gti/AA273_data.csv", "niki_aa273.toml", {"speed_x": "vx_mps", "speed_y": "vy_mps"}, NIKI),
        ("revs_250lm/250lm_t150_400.csv", "revs_250lm.toml", {"speed_y": "vy_mps"}, REVS | REFERENCE),
        ("f1tenth_put/test.csv", "f1tenth.toml", {"speed_x": "v_x", "speed_y": "v_y"}, F1TENTH),
        ("f1tenth_put/test.csv", "f1tenth.toml", {"speed_x": "v_x", "speed_y": "v_y"}, F1TENTH | DOUBT),
        ("f1tenth_put/hoons_all_test.csv", "f1tenth.toml", {"speed_x": "v_x", "speed_y": "v_y"}, F1TENTH),
        ("f1tenth_put/hoons_all_test.csv", "f1tenth.toml", {"speed_x": "v_x", "speed_y": "v_y"}, F1TENTH | DOUBT),
    ],
}


def table(path):
    opened = gzip.open(path, "rt") if path.suffix == ".gz" else open(path)
    with opened as file:
        rows = csv.reader(file)
        head = next(rows)
        return head, list(rows)


def number(cell):
    if cell in ("true", "false"):
        return float(cell == "true")
    return float(cell) if cell else math.nan


def run(identify, machine, log, settings, columns=None, clock="log"):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.csv"
        command = [identify, "run", machine, log, "--out", out, "--clock", clock]
        command += ["--columns", columns] if columns else []
        for name, value in settings.items():
            command += ["--set", f"{name}={value}"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode not in (0, 1):
            sys.exit(done.stderr)
        return table(out)


def judge(estimates, truth, names):
    """Of each estimate, summed up: squared error of all samples and of the healthy ones, within two, healthy, healthy and
    beyond three; and the count."""
    (head, rows), (true_head, true_rows) = estimates, truth
    healthy = head.index("healthy")
    sums = {}
    for name, true_name in names.items():
        if true_name not in true_head:
            continue
        value, std, true_column = head.index(name), head.index(f"{name}_std"), true_head.index(true_name)
        sums[name] = [0.0] * 6
        for row, true_row in zip(rows, true_rows, strict=True):
            expected = number(true_row[true_column])
            if math.isnan(expected):
                continue
            error = abs(number(row[value]) - expected)
            if name == "heading":
                error = abs(math.remainder(error, math.tau))
            good, deviation = number(row[healthy]), number(row[std])
            one = [error * error, good * error * error, error < 2 * deviation, good, good and error > 3 * deviation, 1]
            sums[name] = [a + b for a, b in zip(sums[name], one)]
    return sums


def line(what, sums):
    for name, (squares, healthy_squares, within, healthy, wrong, count) in sums.items():
        share = [within / count, healthy / count, wrong / count]
        error = math.sqrt(squares / count)
        of_healthy = f"{math.sqrt(healthy_squares / healthy):.3g}" if healthy > 0 else "-"
        print(f"| {what} | `{name}` | {error:.3g} | {of_healthy} | {share[0]:.2f} | {share[1]:.2f} | {share[2]:.3f} |", flush=True)


def add(into, sums):
    for name, values in sums.items():
        into[name] = [a + b for a, b in zip(into.get(name, [0.0] * 6), values)]


def truths(machine):
    return dict(name.split("=") if "=" in name else (name, f"true_{name}") for name in MACHINES[machine])


def with_truth(estimates, truth):
    """All estimates with a standard deviation whose truth the log has, with its column; of the wheel loader the share of the
    load on the front axle without what bumps do to it."""
    (head, _), (true_head, _) = estimates, truth
    names = [name.removesuffix("_std") for name in head if name.endswith("_std") and name != "load_ratio_std"]
    columns = {name: f"true_{name.removesuffix('_estimate')}" for name in names}
    return {name: column for name, column in columns.items() if column in true_head}


def simulated(identify, machine, scenario, seed, settings=None, plant=None, change=None, clock="log"):
    """Estimates and truth of a simulated log, of a plant with these settings, of which `change` may spoil the rows: it takes
    each as a dictionary with its time in s, and gives none where the row is left out. With the clock of a host, `fmu`, the
    estimates at the time of a row are those at the end of a step that took the row before."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        command = [identify, "simulate", machine, "--scenario", scenario, "--seed", str(seed), "--out", log]
        for name, value in (plant or {}).items():
            command += ["--set", f"{name}={value}"]
        subprocess.run(command, check=True, capture_output=True)
        if change:
            head, rows = table(log)
            changed = [row for row in (change(dict(zip(head, row)), float(row[0])) for row in rows) if row]
            write(log, {name: [row[name] for row in changed] for name in head})
        head, rows = run(identify, machine, log, settings or {}, clock=clock)
        truth = table(log)
        times = {round(float(row[0]), 6) for row in truth[1]}
        return (head, [row for row in rows if round(float(row[0]), 6) in times]), truth


def own_plant(identify, machine):
    for scenario in SCENARIOS[machine]:
        whole, others = {}, {}
        for seed in SEEDS:
            estimates, truth = simulated(identify, machine, scenario, seed)
            names = truths(machine)
            add(whole, judge(estimates, truth, names))
            add(others, judge(estimates, truth, {k: v for k, v in with_truth(estimates, truth).items() if k not in names}))
        line(f"own plant, {scenario}", whole)
        if others:
            worst = max(others, key=lambda name: others[name][4] / others[name][5])
            line(f"own plant, {scenario}, the worst of {len(others)} others", {worst: others[worst]})


def multibody_car(identify):
    names = {"speed_x": "true_speed_x", "speed_y": "true_speed_y", "yaw_rate": "gyro_z"}
    for scenario in ["sine", "dlc", "step", "accel_brake", "low_mu", "launch", "stop", "slippery"]:
        packed = ROOT / f"tests/vectors/wheeled_robot/multibody_{scenario}.csv.gz"
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log.csv"
            log.write_bytes(gzip.decompress(packed.read_bytes()))
            line(f"multi-body car, {scenario}", judge(run(identify, "wheeled-robot", log, BMW_320I), table(log), names))


def write(path, columns):
    with open(path, "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows(zip(*columns.values()))


def chairs_of_mujoco(identify):
    """The worst chairs of tests/fmpy/test_wheelchair_mujoco.py, with biased sensors."""
    sys.path.append(str(ROOT / "tests/oracles"))
    try:
        from wheelchair_mujoco import CASES, VARIANTS, measured, simulate
    except ImportError as error:
        print(f"| MuJoCo: SKIPPED, {error} | | | | | |")
        return
    names = {name: f"true_{name}" for name in ("slope", "speed", "heading")}
    for case in ["climb", "oblique", "moment", "across"]:
        whole = {}
        for variant in ["plain", "sprung", "slippery", "resisted"]:
            time, inputs, truth = simulate(CASES[case], VARIANTS[variant])
            settings = {
                "initial.heading": CASES[case].heading, "chair.wheel_inertia": VARIANTS[variant].wheel_inertia,
            }  # fmt: skip
            for seed in SEEDS:
                columns = {"time": time, **measured(inputs, seed, True)}
                columns |= {f"true_{name}": values for name, values in truth.items()}
                with tempfile.TemporaryDirectory() as folder:
                    log = Path(folder) / "log.csv"
                    write(log, columns)
                    add(whole, judge(run(identify, "wheelchair", log, settings), table(log), names))
        line(f"MuJoCo, {case}, four chairs", whole)


def slope(values, half, dt):
    """Derivative by a straight line through the values around each, which go on beyond the ends as they are there."""
    padded = [values[0]] * half + values + [values[-1]] * half
    weight = sum((k * dt) ** 2 for k in range(-half, half + 1))
    return [
        sum(k * dt * padded[i + half + k] for k in range(-half, half + 1)) / weight for i in range(len(values))
    ]  # fmt: skip


def recorded_bow(identify):
    """Joint torques without the force plate against those with it."""
    data = os.environ.get("WHEELSTATE_DATA")
    if not data:
        print("| recording mapest_2dof: SKIPPED, set WHEELSTATE_DATA | | | | | |")
        return
    recording = Path(data) / "mapest_2dof"
    head, rows = table(recording / "bowing_t0_8s.csv")
    given = {name.strip(): [float(row[i]) for row in rows] for i, name in enumerate(head)}
    columns = {"time": given["t_s"]}
    for joint in ("ankle", "hip"):
        columns |= {f"q_{joint}": given[f"q_{joint}_rad"], f"qd_{joint}": given[f"dq_{joint}"]}
        columns[f"qdd_{joint}"] = slope(given[f"dq_{joint}"], 28, 0.01)
    columns |= {f"torso_accel_{axis}": given[f"acc_{axis}"] for axis in "xyz"}
    columns |= {f"foot_{part}": given[f"foot_{part}"] for part in ("fx", "fy", "fz", "mx", "my", "mz")}
    sensors = (ROOT / "tests/human_dynamics/mapest_2dof.toml").read_text()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        write(log := Path(folder) / "log.csv", columns)
        for used in (sensors, sensors[: sensors.rindex("[[sensor]]")]):
            (chosen := Path(folder) / "sensors.toml").write_text(used)
            out = Path(folder) / "out.csv"
            model = recording / "threeLinkHuman_subject1_sensorExt.urdf"
            command = [identify, "estimate", "human-dynamics", log, "--model", model, "--sensors", chosen, "--out", out]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode not in (0, 1):
                sys.exit(done.stderr)
            found.append(table(out))
    (with_plate, (head, rows)) = found
    status = head.index("status")
    estimates = (head + ["healthy"], [[*row, str(float(row[status]) == 0.0).lower()] for row in rows])
    names = {f"tau_{joint}": f"tau_{joint}" for joint in ("ankle", "hip")}
    line("recorded bow, no plate, against the same with it", judge(estimates, with_plate, names))


def moved(truth, names, columns):
    """The truth with the lateral speed of the centre of gravity, and how far before it the reference measures, m. In turns of at
    most 1 m/s2 the rear axle goes where it points: the lateral speed of a point is its distance from it times the yaw rate."""
    speed, lateral, turning, to_rear = columns
    head, rows = truth
    at = [head.index(name) for name in (speed, lateral, turning)]
    motion = [[number(row[i]) for i in at] for row in rows]
    slow = sorted(vy / r for vx, vy, r in motion if abs(r) > 0.6 and abs(r * vx) < 1)
    ahead = slow[len(slow) // 2] - to_rear
    place = head.index(names["speed_y"])
    rows = [[*row[:place], str(vy - ahead * r), *row[place + 1 :]] for row, (_, vy, r) in zip(rows, motion)]
    return (head, rows), ahead


def recordings(identify, machine):
    data = os.environ.get("WHEELSTATE_DATA")
    for name, columns, names, settings in RECORDINGS.get(machine, []):
        if not data:
            print(f"| recording {name}: SKIPPED, set WHEELSTATE_DATA | | | | | |")
            continue
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log.csv"
            recorded = (Path(data) / name).read_text()
            log.write_text("time" + recorded if recorded.startswith(",") else recorded)
            estimates = run(identify, machine, log, settings, ROOT / "tests/maps" / columns)
            doubt = ", its centre of gravity in doubt" if settings.items() >= DOUBT.items() else ""
            line(f"recording {name}{doubt}", judge(estimates, table(log), names))
            if settings.items() >= F1TENTH.items():
                truth, ahead = moved(table(log), names, MOVED)
                what = f"recording {name}{doubt}, reference {ahead:.2f} m before the centre of gravity"
                line(what, judge(estimates, truth, {"speed_y": names["speed_y"]}))


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for machine in sys.argv[2:] or MACHINES:
        print(f"\n{machine}\n\n| log | estimate | error | while healthy | within 2 std | healthy | healthy and beyond 3 std |")
        print("|---|---|---|---|---|---|---|")
        own_plant(sys.argv[1], machine)
        if machine == "wheeled-robot":
            multibody_car(sys.argv[1])
        if machine == "wheelchair":
            chairs_of_mujoco(sys.argv[1])
        if machine == "human-dynamics":
            recorded_bow(sys.argv[1])
        recordings(sys.argv[1], machine)


if __name__ == "__main__":
    main()
