"""What the wheel installs: command, FMUs, types."""

import importlib.metadata
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import pytest
import wheelstate
from conftest import ROOT

MACHINES = ["HumanDynamics", "NursingRobot", "WheelLoader", "Wheelchair", "WheeledRobot"]


def run(*words, cwd=None):
    return subprocess.run([str(word) for word in words], cwd=cwd, capture_output=True, text=True)


def test_there_is_no_rust_where_these_tests_run():
    assert shutil.which("cargo") is None and shutil.which("rustc") is None


def test_the_wheel_installs_one_command_and_no_name_of_another_program():
    files = importlib.metadata.files("wheelstate")
    scripts = {Path(str(file)).name for file in files if "bin/" in str(file)}
    assert scripts == {"wheelstate"}


def test_the_version_is_that_of_the_workspace():
    (line,) = [line for line in (ROOT / "Cargo.toml").read_text().splitlines() if line.startswith('version = "')]
    assert wheelstate.__version__ == importlib.metadata.version("wheelstate") == line.split('"')[1]


def test_the_licences_of_everything_in_the_module_come_with_it():
    text = (Path(wheelstate.__file__).parent / "licenses.txt").read_text()
    for crate in ("pyo3", "arrow-array", "clarabel", "parquet", "nalgebra", "clap", "wheelstate-python"):
        assert re.search(f"^{crate} [0-9.]+: .*(MIT|Apache)", text, re.M), crate
    assert text.count("Permission is hereby granted") > 10 and "Apache License" in text
    for tool in ("proptest", "divan", "pyo3-macros-backend"):
        assert not re.search(f"^{tool} ", text, re.M), f"{tool} is not linked into it"


@pytest.mark.parametrize("model", MACHINES)
def test_every_ready_fmu_is_found_by_both_of_its_names(model):
    kebab = {fmu: name for name, fmu, _ in wheelstate.machines()}[model]
    path = wheelstate.fmu(model)
    assert path == wheelstate.fmu(kebab)
    with zipfile.ZipFile(path) as archive:
        assert ET.fromstring(archive.read("modelDescription.xml")).get("modelName") == model


def test_another_name_is_refused_with_the_names_that_there_are():
    with pytest.raises(wheelstate.Error, match="there is no FMU 'Tram'; there are: .*Wheelchair"):
        wheelstate.fmu("Tram")
    with pytest.raises(wheelstate.Error, match="there is no machine 'tram'; there are: .*wheelchair"):
        wheelstate.scenarios("tram")


def test_help_and_messages_name_the_command_that_was_called(command, tmp_path):
    shown = run(command, "--help")
    assert shown.returncode == 0 and "identify " not in shown.stdout
    for word in ("fit", "check", "tune", "simulate", "convert", "estimate", "run", "design", "pack"):
        assert f"\n  {word} " in shown.stdout, word
        told = run(command, word, "--help")
        assert told.returncode == 0 and f"wheelstate {word}" in told.stdout, told.stdout + told.stderr
        assert "identify " not in told.stdout, word
    assert run(command, "--version").stdout.split() == ["wheelstate", wheelstate.__version__]
    for words in (["fit", "nursing-robot", "nowhere.csv"], ["fit"], ["pack", "Tram"], ["nonsense"]):
        refused = run(command, *words, cwd=tmp_path)
        assert refused.returncode == 2 and refused.stdout == ""
        assert refused.stderr.startswith("wheelstate") and refused.stderr.count("\n") == 1, refused.stderr


def test_the_command_goes_from_a_log_to_an_fmu(command, tmp_path):
    made = run(command, "simulate", "nursing-robot", "--scenario", "identification", "--seed", 6, "--out", "log.csv", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert run(command, "check", "nursing-robot", "log.csv", cwd=tmp_path).returncode in (0, 1)
    fit = run(command, "fit", "nursing-robot", "log.csv", "--out", "fit.json", "--report", "fit.html", cwd=tmp_path)
    assert fit.returncode in (0, 1) and "rolling.coefficient" in fit.stdout, fit.stderr
    packed = run(command, "pack", "NursingRobot", "--params", "fit.json", "--out", ".", cwd=tmp_path)
    assert packed.returncode in (0, 1), packed.stderr
    verified = run(command, "pack", "verify", "NursingRobot.fmu", cwd=tmp_path)
    assert verified.returncode == 0 and "verified" in verified.stdout, verified.stderr
    # the same code: the same bytes as through the API
    log = wheelstate.read(tmp_path / "log.csv")
    result = wheelstate.fit("nursing-robot", log)
    assert Path(tmp_path / "fit.json").read_text() == result.to_json().replace(str(tmp_path) + "/", "")
    wheelstate.pack("NursingRobot", result, out=tmp_path / "api")
    assert (tmp_path / "api" / "NursingRobot.fmu").read_bytes() == (tmp_path / "NursingRobot.fmu").read_bytes()


def test_the_package_is_a_program_too():
    assert run(sys.executable, "-m", "wheelstate", "--version").stdout.split()[0] == "wheelstate"


def test_importing_it_imports_nothing_that_takes_long():
    code = "import sys, wheelstate; print(*[m for m in ('numpy', 'pandas', 'polars', 'pyarrow') if m in sys.modules])"
    assert run(sys.executable, "-c", code).stdout.strip() == ""


def test_the_type_checker_is_silent_over_package_and_examples(tmp_path):
    package = Path(wheelstate.__file__).parent
    assert (package / "py.typed").is_file()
    users = [ROOT / "tests" / "python" / "typed.py", *sorted((ROOT / "examples").glob("fleet.py"))]
    mypy = [sys.executable, "-m", "mypy", "--strict", "--config-file", ROOT / "identify" / "python" / "pyproject.toml"]
    cache = ["--cache-dir", tmp_path / "cache"]
    checked = run(*mypy, *cache, *users, cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout
    checked = run(*mypy, *cache, "-p", "wheelstate", cwd=ROOT / "identify" / "python")
    assert checked.returncode == 0, checked.stdout
