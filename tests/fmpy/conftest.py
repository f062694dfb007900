"""Finds FMUs and programs; builds nothing (run.sh does).

WHEELSTATE_FMUS is the folder of the packed FMUs, WHEELSTATE_BIN that of the programs
`pack`, `replay` and `examples/native` (default: target/debug).
"""

import os
import shutil
from pathlib import Path

import fmpy
import pytest

ROOT = Path(__file__).resolve().parents[2]
FMUS = Path(os.environ.get("WHEELSTATE_FMUS", ROOT / "out"))
BIN = Path(os.environ.get("WHEELSTATE_BIN", ROOT / "target" / "debug"))
MODELS = sorted(path.stem for path in FMUS.glob("*.fmu"))

if not MODELS:
    raise pytest.UsageError(f"no .fmu in {FMUS}: run tests/fmpy/run.sh, or set WHEELSTATE_FMUS")


def pytest_generate_tests(metafunc):
    if "model" in metafunc.fixturenames:
        metafunc.parametrize("model", MODELS)


@pytest.fixture
def fmu(model):
    """The path of one model's FMU; a test that uses it runs for every model."""
    return str(FMUS / f"{model}.fmu")


@pytest.fixture(scope="session")
def extracted():
    """Unpacks an FMU once per session."""
    folders = {}

    def extract(path):
        path = str(path)
        if path not in folders:
            folders[path] = fmpy.extract(path)
        return folders[path]

    yield extract
    for folder in folders.values():
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def program():
    """The path of a program of this package."""

    def find(name):
        path = BIN / name
        assert path.is_file(), f"{path} is missing: run tests/fmpy/run.sh"
        return str(path)

    return find
