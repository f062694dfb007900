"""Tests of the Python package as a user has it: from a built wheel (run.sh), with no Rust around."""

import shutil
from pathlib import Path

import pytest
import wheelstate

ROOT = Path(__file__).resolve().parents[2]

if ROOT / "identify" / "python" in Path(wheelstate.__file__).parents:
    raise pytest.UsageError(f"{wheelstate.__file__}: this is the source and not the built wheel; run tests/python/run.sh")


@pytest.fixture(scope="session")
def drive():
    """40 s of stop and go of a nursing robot, which excite everything."""
    return wheelstate.simulate("nursing-robot", "identification", seed=6)


@pytest.fixture(scope="session")
def fitted(drive):
    """Its fit."""
    return wheelstate.fit("nursing-robot", drive)


@pytest.fixture(scope="session")
def command():
    """The program that the wheel installs."""
    found = shutil.which("wheelstate")
    assert found, "the wheel installs a command"
    return found
