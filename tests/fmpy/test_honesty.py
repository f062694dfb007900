"""Nothing that has a standard deviation is wrong and sure of it: on every simulated ride of every machine, all parameters at their
defaults, no estimate is healthy and beyond three of its standard deviations in more than a hundredth of the samples."""

import subprocess
import sys

import pytest
from conftest import ROOT

sys.path.append(str(ROOT / "tests/tables"))
from honesty import MACHINES, judge, simulated, with_truth  # noqa: E402

# People on two force plates come with a model of their own, which `identify run` does not take.
OF_ANOTHER_MODEL = {"bowing"}
# A load taken off between two accelerations is unknown until the second one: 0.4 s of 40 s. In the mean of many rides the heading
# of acceleration_input after a push is in 0.8 %, in one of them in more.
ALLOWED = {("nursing-robot", "load-drop", "load_mass"): 0.016, ("wheelchair", "yaw-moment", "heading"): 0.012}
WRONG = {
    "wheelchair": [{"chair.wheel_radius": 0.305 * 1.04}, {"chair.wheel_radius": 0.305 * 0.97}],
    "wheeled-robot": [{"wheel.radius": 0.15 * 1.08}, {"wheel.radius": 0.15 * 0.93}],
    "nursing-robot": [{"sway.use_tilt": "true", "sway.use_tilt_rate": "true"}],
}


def rides(identify, machine):
    listed = subprocess.run([identify, "simulate", machine, "--list"], check=True, capture_output=True, text=True).stdout
    return [line.split()[0] for line in listed.splitlines() if line.split()[0] not in OF_ANOTHER_MODEL]


def dishonest(identify, machine, ride, settings=None, plant=None, change=None, most=0.01):
    estimates, truth = simulated(identify, machine, ride, 91, settings, plant, change)
    sums = judge(estimates, truth, with_truth(estimates, truth))
    assert sums
    shares = {name: wrong / count for name, (*_, wrong, count) in sums.items()}
    return {name: share for name, share in shares.items() if share > ALLOWED.get((machine, ride, name), most)}


@pytest.mark.parametrize("machine", MACHINES)
def test_no_estimate_is_healthy_and_beyond_three_deviations_on_any_ride(machine, program):
    identify = program("identify")
    assert {ride: wrong for ride in rides(identify, machine) if (wrong := dishonest(identify, machine, ride))} == {}


@pytest.mark.parametrize("machine", WRONG)
def test_a_wrong_wheel_radius_or_more_sensors_make_no_estimate_dishonest(machine, program):
    # a plant whose every constant is another one, and coughs in a start that shakes the body
    identify = program("identify")
    tried = [ride for ride in rides(identify, machine) if ride not in ("identification", "restless-start", "load-drop")]
    which = [(ride, settings) for ride in tried for settings in WRONG[machine]]
    wrong = {(ride, str(settings)): dishonest(identify, machine, ride, settings) for ride, settings in which}
    assert {run: names for run, names in wrong.items() if names} == {}


@pytest.mark.parametrize("kind", ["basic", "acceleration_input", "gravity_vector"])
def test_no_kind_of_the_chairs_filter_is_healthy_and_beyond_three_deviations(kind, program):
    identify = program("identify")
    of_ride = {ride: dishonest(identify, "wheelchair", ride, {"filter.kind": kind}) for ride in rides(identify, "wheelchair")}
    assert {ride: wrong for ride, wrong in of_ride.items() if wrong} == {}


def missing(channels, start, end):
    """No samples of the channels whose names begin so, from `start` to `end`, s."""

    def change(row, time):
        return {name: "" if name.startswith(channels) and start <= time < end else value for name, value in row.items()}

    return change


def off(channel, by):
    def change(row, time):
        return row | {channel: str(float(row[channel]) + by)}

    return change


TILT = {"sway.use_tilt": "true", "sway.use_tilt_rate": "true"}
FAULTS = [
    # name, machine, ride, parameters, plant, what happens to the log
    ("sharp edge of a ramp, heading unknown", "wheelchair", "climb", {}, {"plant.slope_edge": 0.3}, None),
    ("force late", "wheelchair", "climb", {"filter.kind": "gravity_vector"}, {}, missing("drive_force", 0, 1)),
    ("no wheel speed", "wheeled-robot", "accelerate-brake", {}, {}, missing("wheel_speed_fl", 3, 4.5)),
    ("no torques", "wheeled-robot", "vector", {}, {}, missing("drive_torque", 3, 4.5)),
    ("no samples at all", "wheeled-robot", "sine", {}, {}, missing(("wheel", "drive", "steering", "gyro", "accel"), 4, 4.7)),
    ("gyro off", "wheeled-robot", "sine", {}, {}, off("gyro_z", 0.01)),
    ("loaded", "wheeled-robot", "lane-change", {"vehicle.mass": 54.0}, {}, None),
    ("no acceleration", "human-dynamics", "seated-braking", {}, {}, missing("base_accel", 1, 2)),
    ("tilt off", "nursing-robot", "coughs", TILT, {}, off("tilt", 0.01)),
    ("tilt rate off", "nursing-robot", "coughs", TILT, {}, off("tilt_rate", 0.003)),
]  # fmt: skip


@pytest.mark.parametrize(("machine", "ride", "settings", "plant", "change"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS])
def test_what_is_missing_or_off_makes_no_estimate_healthy_and_wrong(machine, ride, settings, plant, change, program):
    assert dishonest(program("identify"), machine, ride, settings, plant, change) == {}


def test_encoders_that_begin_late_leave_an_estimate_wrong_for_no_longer_than_the_filter_settles(program):
    late, settings = missing("encoder", 0, 1), {"filter.kind": "gravity_vector"}
    assert dishonest(program("identify"), "wheelchair", "climb", settings, {}, late, most=0.03) == {}


@pytest.mark.parametrize("begin", [3, 4, 5])
def test_a_log_that_begins_in_motion_makes_no_slope_of_the_speed(begin, program):
    """But for some tenths of a second, of the three to five that are left."""
    settings = {"filter.kind": "gravity_vector"}

    def rest(row, time):
        return row if time >= begin else None

    wrong = dishonest(program("identify"), "wheelchair", "oblique", settings, {}, rest, most=0.05)
    wrong.pop("distance", None)  # counts from the first sample
    assert wrong == {}
