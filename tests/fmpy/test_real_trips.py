"""The whole road on recordings of a real car: fit, pack, run the FMU. The recordings are not part of the
repository; without them (WHEELSTATE_DATA, default ../shared/data) the test is skipped, loudly."""

import json
import os
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("WHEELSTATE_DATA", ROOT / "../shared/data")) / "bmw_i3"
# The shorter trips are enough for every day; WHEELSTATE_ALL_TRIPS takes all.
TRIPS = sorted(DATA.glob("*.csv"), key=lambda path: path.stat().st_size)
TRIPS = TRIPS if "WHEELSTATE_ALL_TRIPS" in os.environ else TRIPS[:4]
MAP = ROOT / "tests/maps/bmw_i3.toml"

# Published constants of the car.
CAR = {
    "robot.wheel_radius": 0.3498,
    "robot.wheel_inertia": 0,
    "robot.rotating_mass": 102,
    "robot.drive_efficiency": 0.96,
    "aero.drag_area": 0.6902,
    "human.nominal_mass": 0,
}
# A car's limits, and what is on board is the load: the car itself is taken as 1250 kg.
ONLINE = {
    **CAR,
    "sample_period": 0.1,
    "robot.mass": 1250,
    "human.swaying_fraction": 0,
    "human.nominal_mass": 150,
    "mass.use_accelerometer": True,
    "limit.torque": 3000,
    "limit.speed": 70,
    "limit.load_mass": 1000,
    "limit.slip_residual": 10000,
}


def weigh(trip, program, folder):
    """Offline mass and rolling coefficient, online total mass and its standard deviation at the end."""
    settings = [word for name, value in CAR.items() for word in ("--set", f"{name}={value}")]
    subprocess.run([program("identify"), "fit", "nursing-robot", trip, "--columns", MAP, *settings, "--only",
                    "robot.mass,rolling.coefficient", "--out", folder / "fit.json"], check=True, capture_output=True)
    fit = json.loads((folder / "fit.json").read_text())["parameters"]
    mass, rolling = fit["robot.mass"], fit["rolling.coefficient"]
    assert mass["identified"] and rolling["identified"], trip.name

    subprocess.run([program("pack"), "NursingRobot", "--params", folder / "fit.json", "--out", folder], check=True,
                   capture_output=True)
    subprocess.run([program("identify"), "convert", "nursing-robot", trip, "--columns", MAP, "--out",
                    folder / "ride.csv"], check=True, capture_output=True)
    ride = fmpy.read_csv(folder / "ride.csv")
    signals = ride[["time", "torque_left", "torque_right", "speed", "accel_x"]]
    result = fmpy.simulate_fmu(
        str(folder / "NursingRobot.fmu"), input=signals, start_time=0, stop_time=ride["time"][-1],
        output_interval=0.1, start_values={**ONLINE, "yaw_rate": float("nan")},
        output=["load_mass", "load_mass_std", "healthy"])
    assert np.isfinite(result["load_mass"]).all()
    return mass["value"], rolling["value"], ONLINE["robot.mass"] + result["load_mass"][-1], result["load_mass_std"][-1]


@pytest.mark.skipif(not TRIPS, reason="SKIPPED: no recordings of a real car; set WHEELSTATE_DATA")
def test_a_real_car_is_weighed_offline_and_online(program, tmp_path):
    weighed = {trip.stem: weigh(trip, program, tmp_path) for trip in TRIPS}
    for name, (offline, rolling, online, std) in weighed.items():
        print(f"{name}: offline {offline:.0f} kg, rolling {rolling:.4f}, online {online:.0f} +- {std:.0f} kg")
        assert abs(online / offline - 1) < 0.06, name
    heavy = weighed.pop("TripB33", None)
    ordinary = [offline for offline, *_ in weighed.values()]
    assert all(1350 <= mass <= 1560 for mass in ordinary), ordinary
    if heavy is not None:
        # About 200 kg more on board; the median of a few trips says little about the usual load.
        assert heavy[0] > (np.median(ordinary) + 120 if len(ordinary) >= 8 else max(ordinary) + 50)
