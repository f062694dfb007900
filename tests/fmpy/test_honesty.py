"""Nothing that has a standard deviation is wrong and sure of it: on every simulated ride of every machine, all parameters at their
defaults, no estimate is healthy and beyond three of its standard deviations in more than a hundredth of the samples."""

import math
import subprocess
import sys
from fnmatch import fnmatch
from random import Random

import pytest
from conftest import ROOT

sys.path.append(str(ROOT / "tests/tables"))
from honesty import MACHINES, judge, simulated, with_truth  # noqa: E402

# People on two force plates come with a model of their own, which `identify run` does not take.
OF_ANOTHER_MODEL = {"bowing"}
# A load taken off between two accelerations is unknown until the second one: 0.4 s of 40 s. In the mean of many rides the heading
# of acceleration_input after a push is in 0.8 %, in one of them in more.
ALLOWED = {("nursing-robot", "load-drop", "load_mass"): 0.016, ("wheelchair", "yaw-moment", "heading"): 0.012}
ALL_WRENCHES = {"use.seat_wrench": "true", "use.hand_wrench": "true", "use.foot_wrench": "true"}
EXACT_BODY = {f"scatter.{name}_std": 0.0 for name in ("mass", "segment_mass", "segment_com", "segment_inertia", "inclination")}
WRONG = {
    "wheelchair": [{"chair.wheel_radius": 0.305 * 1.04}, {"chair.wheel_radius": 0.305 * 0.97}],
    "wheeled-robot": [{"wheel.radius": 0.15 * 1.08}, {"wheel.radius": 0.15 * 0.93}],
    "nursing-robot": [{"sway.use_tilt": "true", "sway.use_tilt_rate": "true"}],
    "human-dynamics": [
        ALL_WRENCHES,
        ALL_WRENCHES | {"use.imu": "true"} | EXACT_BODY,
    ],
}


def rides(identify, machine):
    listed = subprocess.run([identify, "simulate", machine, "--list"], check=True, capture_output=True, text=True).stdout
    return [line.split()[0] for line in listed.splitlines() if line.split()[0] not in OF_ANOTHER_MODEL]


def every(period):
    """The rows that a host gives whose step is so long, s."""
    return lambda row, time: row if abs(math.remainder(time, period)) < 1e-6 else None


def dishonest(identify, machine, ride, settings=None, plant=None, change=None, most=0.01, clock="log"):
    estimates, truth = simulated(identify, machine, ride, 91, settings, plant, change, clock)
    sums = judge(estimates, truth, with_truth(estimates, truth))
    assert sums
    shares = {name: wrong / count for name, (*_, wrong, count) in sums.items()}
    return {name: share for name, share in shares.items() if share > max(most, ALLOWED.get((machine, ride, name), 0.0))}


@pytest.mark.parametrize("clock", ["fmu", "log"])
@pytest.mark.parametrize("machine", MACHINES)
def test_no_estimate_is_healthy_and_beyond_three_deviations_on_any_ride(machine, clock, program):
    identify = program("identify")
    of_ride = {ride: dishonest(identify, machine, ride, clock=clock) for ride in rides(identify, machine)}
    assert {ride: wrong for ride, wrong in of_ride.items() if wrong} == {}


@pytest.mark.parametrize("clock", ["fmu", "log"])
@pytest.mark.parametrize("machine", WRONG)
def test_a_wrong_wheel_radius_or_more_sensors_make_no_estimate_dishonest(machine, clock, program):
    # a plant whose every constant is another one, and coughs in a start that shakes the body
    identify = program("identify")
    tried = [ride for ride in rides(identify, machine) if ride not in ("identification", "restless-start", "load-drop")]
    which = [(ride, settings) for ride in tried for settings in WRONG[machine]]
    wrong = {(ride, str(settings)): dishonest(identify, machine, ride, settings, clock=clock) for ride, settings in which}
    assert {run: names for run, names in wrong.items() if names} == {}


@pytest.mark.parametrize(("period", "most"), [(0.02, 0.02), (0.05, 0.02), (0.1, 0.03)])
@pytest.mark.parametrize("machine", ["nursing-robot", "wheeled-robot", "wheelchair"])
def test_a_host_that_takes_several_samples_a_step_makes_no_estimate_dishonest(machine, period, most, program):
    identify, settings = program("identify"), {"sample_period": 0.01}
    of_ride = {
        ride: dishonest(identify, machine, ride, settings, change=every(period), most=most, clock="fmu")
        for ride in rides(identify, machine)
    }
    assert {ride: wrong for ride, wrong in of_ride.items() if wrong} == {}


@pytest.mark.parametrize("kind", ["basic", "acceleration_input", "gravity_vector"])
def test_no_kind_of_the_chairs_filter_is_healthy_and_beyond_three_deviations(kind, program):
    identify = program("identify")
    of_ride = {ride: dishonest(identify, "wheelchair", ride, {"filter.kind": kind}) for ride in rides(identify, "wheelchair")}
    assert {ride: wrong for ride, wrong in of_ride.items() if wrong} == {}


def chosen(name, channels):
    return any(fnmatch(name, channel) for channel in channels.split())


def missing(channels, start, end):
    """No samples of these channels from `start` to `end`, s."""

    def change(row, time):
        return {name: "" if chosen(name, channels) and start <= time < end else value for name, value in row.items()}

    return change


def of(channels, value):
    """What becomes of each value of these channels."""

    def change(row, time):
        return {name: str(value(float(old))) if chosen(name, channels) else old for name, old in row.items()}

    return change


def off(channels, by):
    return of(channels, lambda value: value + by)


def scaled(channels, by):
    return of(channels, lambda value: value * by)


def repeated(channels, which):
    """The channels have the values of the row `which(time)`, of those so far: the number of a row, from the first one."""
    rows = []

    def change(row, time):
        rows.append(row)
        old = rows[max(which(len(rows) - 1, time), 0)]
        return {name: old[name] if chosen(name, channels) else value for name, value in row.items()}

    return change


def late(channels, samples):
    return repeated(channels, lambda row, time: row - samples)


def held(channels, samples):
    return repeated(channels, lambda row, time: row // samples * samples)


def frozen(channels, start, end, period=0.01):
    return repeated(channels, lambda row, time: round(start / period) if start <= time < end else row)


def swinging(channels, by, frequency, start):
    """From `start`, s, on the channels swing about what they are."""

    def change(row, time):
        swing = by * math.sin(math.tau * frequency * (time - start)) if time >= start else 0
        return {name: str(float(value) + swing) if chosen(name, channels) else value for name, value in row.items()}

    return change


def noisy(channels, std):
    """White noise in addition, of a law that repeats."""
    random = Random(5)
    return of(channels, lambda value: value + random.gauss(0, std))


TILT = {"sway.use_tilt": "true", "sway.use_tilt_rate": "true"}
FAULTS = [
    # name, machine, ride, parameters, plant, what happens to the log
    ("sharp edge of a ramp, heading unknown", "wheelchair", "climb", {}, {"plant.slope_edge": 0.3}, None),
    ("encoders freeze", "wheelchair", "oblique", {"filter.kind": "gravity_vector"}, {}, frozen("encoder_*", 4, 4.3)),
    ("never a gyro", "wheelchair", "climb", {"initial.heading": 1.5708}, {}, missing("gyro_pitch", 0, 60)),
    ("no gyro", "wheelchair", "climb", {"initial.heading": 1.5708}, {}, missing("gyro_pitch", 4.2, 6)),
    ("the chair's gyro freezes", "wheelchair", "climb", {"initial.heading": 1.5708}, {}, frozen("gyro_pitch", 4, 6)),
    ("accelerometer freezes", "wheelchair", "climb", {"initial.heading": 1.5708}, {}, frozen("accel_*", 4, 6)),
    ("one wheel smaller", "wheelchair", "climb", {"initial.heading": 1.5708}, {}, scaled("encoder_left", 0.99)),
    ("rolling resistance not said", "wheelchair", "oblique", {}, {"plant.rolling_coefficient": 0.015}, None),
    ("force late", "wheelchair", "climb", {"filter.kind": "gravity_vector"}, {}, missing("drive_force", 0, 1)),
    ("somebody rocks", "wheelchair", "climb", {}, {}, swinging("drive_force", 30, 0.8, 2)),
    ("somebody rocks fast", "wheelchair", "climb", {}, {}, swinging("drive_force", 40, 1.5, 2)),
    ("turns without their moment", "wheelchair", "identification", {"initial.heading": 1}, {}, missing("drive_moment", 0, 60)),
    ("hands steer", "wheelchair", "climb", {"initial.heading": 1.5708}, {}, swinging("drive_moment", 8, 0.33, 2)),
    ("hands steer, heading unknown", "wheelchair", "oblique", {"filter.kind": "gravity_vector"}, {},
     swinging("drive_moment", 8, 0.33, 2)),
    ("rolling resistance of robots not said", "wheeled-robot", "sine", {"rolling.coefficient": 0.02}, {}, None),
    ("somebody rocks, heading unknown", "wheelchair", "climb", {"filter.kind": "gravity_vector"}, {},
        swinging("drive_force", 40, 1, 2)),
    ("no wheel speed", "wheeled-robot", "accelerate-brake", {}, {}, missing("wheel_speed_fl", 3, 4.5)),
    ("no wheel speed while braking", "wheeled-robot", "accelerate-brake", {}, {}, missing("wheel_speed_fl", 4, 6)),
    ("never any torques", "wheeled-robot", "vector", {}, {}, missing("drive_torque_*", 0, 60)),
    ("never any torques in a slalom", "wheeled-robot", "sine", {}, {}, missing("drive_torque_*", 0, 60)),
    ("never a wheel speed", "wheeled-robot", "sine", {}, {}, missing("wheel_speed_fl", 0, 60)),
    ("no torques", "wheeled-robot", "vector", {}, {}, missing("drive_torque_*", 3, 4.5)),
    ("no samples at all", "wheeled-robot", "sine", {}, {}, missing("wheel_* drive_* steering_* gyro_* accel_*", 4, 4.7)),
    ("gyro off", "wheeled-robot", "sine", {}, {}, off("gyro_z", 0.01)),
    ("gyro late", "wheeled-robot", "sine", {}, {}, late("gyro_z", 3)),
    ("gyro held", "wheeled-robot", "sine", {}, {}, held("gyro_z", 5)),
    ("gyro freezes", "wheeled-robot", "lane-change", {}, {}, frozen("gyro_z", 4, 6)),
    ("gyro freezes on a straight", "wheeled-robot", "vector", {}, {}, frozen("gyro_z", 4, 6)),
    ("wheel speeds freeze", "wheeled-robot", "lane-change", {}, {}, frozen("wheel_speed_*", 4, 6)),
    ("everything freezes", "wheeled-robot", "lane-change", {}, {}, frozen("wheel_* drive_* steering_* gyro_* accel_*", 4, 6)),
    ("steering freezes", "wheeled-robot", "sine", {}, {}, frozen("steering_angle", 4, 6)),
    ("lateral accelerometer freezes", "wheeled-robot", "sine", {}, {}, frozen("accel_y", 4, 6)),
    ("torques freeze", "wheeled-robot", "sine", {}, {}, frozen("drive_torque_*", 4, 6)),
    ("torques off", "wheeled-robot", "lane-change", {}, {}, off("drive_torque_*", 0.1)),
    ("speed scaled", "wheel-loader", "accelerate-brake", {}, {}, scaled("speed", 0.98)),
    ("speed scaled the other way", "wheel-loader", "bumpy-c", {}, {}, scaled("speed", 1.01)),
    ("speed off", "wheel-loader", "accelerate-brake", {}, {}, off("speed", 0.02)),
    ("speed freezes", "wheel-loader", "constant-torque", {}, {}, frozen("speed", 4, 7)),
    ("speed held", "wheel-loader", "accelerate-brake", {}, {}, held("speed", 10)),
    ("loaded", "wheeled-robot", "lane-change", {"vehicle.mass": 54.0}, {}, None),
    ("joint accelerations late", "human-dynamics", "seated-braking", ALL_WRENCHES, {}, late("qdd_*", 3)),
    ("hands late", "human-dynamics", "seated-braking", ALL_WRENCHES, {}, late("*_hand_*", 3)),
    ("noisy joint accelerations", "human-dynamics", "seated-braking", {}, {}, noisy("qdd_*", 2.5)),
    ("noisy seat", "human-dynamics", "seated-braking", ALL_WRENCHES, {}, noisy("seat_force_*", 10)),
    ("positions freeze", "human-dynamics", "seated-braking", {}, {}, frozen("q_*", 3, 5)),
    ("no joint accelerations", "human-dynamics", "seated-braking", {}, {}, missing("qdd_*", 1, 2)),
    ("no acceleration", "human-dynamics", "seated-braking", {}, {}, missing("base_accel_*", 1, 2)),
    ("a floor that rolls harder", "nursing-robot", "coughs", TILT | {"rolling.coefficient": 0.0105}, {}, None),
    ("a floor that rolls easier", "nursing-robot", "smooth-start", TILT | {"rolling.coefficient": 0.0195}, {}, None),
    ("the robot's speed late", "nursing-robot", "coughs", {}, {}, late("speed", 2)),
    ("the robot's speed scaled", "nursing-robot", "coughs", TILT, {}, scaled("speed", 0.99)),
    ("torques off a little", "nursing-robot", "coughs", TILT, {}, off("torque_*", 0.5)),
    ("tilt off", "nursing-robot", "coughs", TILT, {}, off("tilt", 0.01)),
    ("tilt rate off", "nursing-robot", "coughs", TILT, {}, off("tilt_rate", 0.01)),
]  # fmt: skip


@pytest.mark.parametrize(("machine", "ride", "settings", "plant", "change"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS])
def test_what_is_missing_or_off_makes_no_estimate_healthy_and_wrong(machine, ride, settings, plant, change, program):
    assert dishonest(program("identify"), machine, ride, settings, plant, change) == {}


def test_encoders_that_begin_late_leave_an_estimate_wrong_for_no_longer_than_the_filter_settles(program):
    late, settings = missing("encoder_*", 0, 1), {"filter.kind": "gravity_vector"}
    assert dishonest(program("identify"), "wheelchair", "climb", settings, {}, late, most=0.03) == {}


def test_a_late_tilt_leaves_the_pitch_rate_wrong_for_no_longer_than_a_cough_begins(program):
    assert dishonest(program("identify"), "nursing-robot", "coughs", TILT, {}, late("tilt tilt_rate", 3), most=0.05) == {}


LATE = [
    # what is late by a tenth of a second, six times what is declared
    ("wheeled-robot", "sine", {}, "gyro_z"),
    ("wheeled-robot", "lane-change", {}, "gyro_z"),
    ("wheeled-robot", "accelerate-brake", {}, "drive_torque_*"),
    ("wheelchair", "climb", {}, "encoder_*"),
    ("wheelchair", "oblique", {"filter.kind": "gravity_vector"}, "encoder_*"),
    ("nursing-robot", "coughs", TILT, "tilt_rate"),
]


@pytest.mark.parametrize(("machine", "ride", "settings", "channel"), LATE, ids=[f"{x[0]} {x[1]} {x[3]}" for x in LATE])
def test_a_long_delay_is_seen_within_a_second_of_motion(machine, ride, settings, channel, program):
    """Of the ten to twenty seconds of a ride; until then nothing tells it."""
    assert dishonest(program("identify"), machine, ride, settings, {}, late(channel, 10), most=0.1) == {}


@pytest.mark.parametrize("begin", [3, 4, 5])
def test_a_log_that_begins_in_motion_makes_no_slope_of_the_speed(begin, program):
    """But for some tenths of a second, of the three to five that are left."""
    settings = {"filter.kind": "gravity_vector"}

    def rest(row, time):
        return row if time >= begin else None

    wrong = dishonest(program("identify"), "wheelchair", "oblique", settings, {}, rest, most=0.05)
    wrong.pop("distance", None)  # counts from the first sample
    assert wrong == {}
