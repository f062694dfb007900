"""Many logs: blocks that travel, their merged fit, and the example on two processes of which one is killed."""

import json
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import wheelstate
from conftest import ROOT

SCENARIOS = {
    "human-dynamics": "seated-braking",  # the first seconds only: a whole body takes long
    "nursing-robot": "identification",
    "wheel-loader": "accelerate-brake",
    "wheelchair": "identification",
    "wheeled-robot": "sine",
}


def named(machine, scenario, seed, end=float("inf")):
    """A simulated log with a name of its own."""
    log = wheelstate.simulate(machine, scenario, seed).within(end=end)
    return wheelstate.read({**{n: log[n] for n in log}, "noise": np.random.default_rng(seed).normal(size=len(log))}, name=f"ride {seed}")


@pytest.mark.parametrize("machine", SCENARIOS)
def test_merged_blocks_give_the_bytes_of_the_fit_in_one_run(machine):
    end = 3.0 if machine == "human-dynamics" else float("inf")
    logs = [named(machine, SCENARIOS[machine], seed, end) for seed in (1, 2)]
    blocks = [pickle.loads(pickle.dumps(wheelstate.compress(machine, log))) for log in logs]
    whole = wheelstate.fit(machine, logs).to_json()
    assert wheelstate.merge(blocks).to_json() == whole
    assert wheelstate.merge([blocks[1], blocks[0], blocks[1]]).to_json() == whole
    assert sum(len(block.data) for block in blocks) < sum(8 * len(log) * len(log.keys()) for log in logs)


def test_blocks_of_other_machines_and_damaged_blocks_are_refused(drive):
    block = wheelstate.compress("nursing-robot", drive)
    with pytest.raises(wheelstate.Error, match="is a block of wheelchair, not of nursing-robot"):
        wheelstate.merge([block, wheelstate.compress("wheelchair", wheelstate.simulate("wheelchair", "climb"))])
    with pytest.raises(wheelstate.Error, match="no block was given"):
        wheelstate.merge([])
    for data in (b"", block.data[:-9], b"x" + block.data):
        with pytest.raises(wheelstate.Error, match="block 1: "):
            wheelstate.merge([wheelstate.Block(block.machine, block.source, block.samples, data)])


def test_two_machines_that_differ_are_told_apart_and_two_rides_of_one_are_not():
    def fit(seed, **set):
        return wheelstate.fit("wheelchair", wheelstate.simulate("wheelchair", "identification", seed, set=set))

    same = wheelstate.compare(fit(1), fit(2), same_sensors=True)
    heavy = {d.name: d for d in wheelstate.compare(fit(1), fit(3, **{"chair.mass": 160}), same_sensors=True)}
    assert min(difference.p for difference in same) > 1e-3, same
    assert heavy["chair.mass"].p < 1e-6 and heavy["chair.mass"].difference > 0 and heavy["chair.mass"].unit == "kg"


LOGS = 200


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """200 short logs of two machines, the second one's user heavier from the middle on."""
    folder = tmp_path_factory.mktemp("fleet")
    for k in range(LOGS):
        machine = folder / f"robot {k % 2}"
        machine.mkdir(exist_ok=True)
        wheelstate.simulate("nursing-robot", "smooth-start", seed=k).write(machine / f"{k:03}.parquet")
    return folder


def children(pid):
    """The processes below one, as Linux tells them."""
    return [int(child) for of_thread in Path(f"/proc/{pid}/task").glob("*/children") for child in of_thread.read_text().split()]


def workers(pid):
    """The nannies' workers: processes that Python's multiprocessing spawned."""
    below = [pid]
    for parent in below:
        below += children(parent)
    return [child for child in below[1:] if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks for the workers in /proc")
def test_a_fleet_survives_a_killed_worker_with_the_same_bytes(folder, tmp_path):
    fleet = [sys.executable, str(ROOT / "examples" / "fleet.py"), "nursing-robot", str(folder), "--workers", "2", "--no-alone"]
    undisturbed = subprocess.run([*fleet, "--out", str(tmp_path / "a")], capture_output=True, text=True)
    assert undisturbed.returncode in (0, 1), undisturbed.stderr
    with subprocess.Popen([*fleet, "--out", str(tmp_path / "b")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        first = program.stderr.readline()
        assert first.endswith(f" of {LOGS} logs\n"), first
        os.kill(workers(program.pid)[0], signal.SIGKILL)
        _, said = program.communicate(timeout=300)
    assert program.returncode == undisturbed.returncode, said
    for name in ("robot 0.json", "robot 1.json", "fleet.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    # and those of one process that has all logs
    logs = [wheelstate.read(path, machine="nursing-robot") for path in sorted((folder / "robot 0").glob("*.parquet"))]
    assert wheelstate.fit("nursing-robot", logs).to_json() == (tmp_path / "a" / "robot 0.json").read_text()
    assert len(json.loads((tmp_path / "a" / "robot 0.json").read_text())["logs"]) == LOGS / 2
    assert "<svg" in (tmp_path / "a" / "fleet.html").read_text()
