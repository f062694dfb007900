"""The code of README, of the package's guide and of the example workflow, as it stands there."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
import wheelstate
import yaml
from conftest import ROOT

GUIDES = ["README.md", "identify/python/README.md"]


def blocks(guide):
    """Language and text of every code block."""
    return re.findall(r"^```(\w*)\n(.*?)^```$", (ROOT / guide).read_text(), re.S | re.M)


def run(language, code, folder):
    """Runs a block; a fit may say that some parameters stay at their defaults."""
    steps = [[sys.executable, "-c", code]] if language == "python" else [[*line.split("#")[0].split()] for line in code.splitlines()]
    for step in steps:
        done = subprocess.run(step, cwd=folder, capture_output=True, text=True)
        allowed = (0, 1) if step[:2] == ["wheelstate", "fit"] else (0,)
        assert done.returncode in allowed, f"{step}\n{done.stdout}{done.stderr}"
    return done.stdout


def test_the_readmes_first_fit_estimates_and_fmu_weigh_the_person(tmp_path):
    printed = [run(language, code, tmp_path) for language, code in blocks("README.md") if language in ("sh", "python")]
    assert len(printed) == 3
    truth = wheelstate.read(tmp_path / "log.csv")["true_load_mass"][-1]
    for text in printed[1:]:
        mass, std = map(float, re.search(r"(\S+) \+- (\S+) kg\n", text).groups())
        assert abs(mass - truth) < 3 * std and std < 0.1 * truth


@pytest.mark.parametrize("code", [code for language, code in blocks(GUIDES[1]) if language == "python"])
def test_a_block_of_the_packages_guide_runs(code, tmp_path):
    run("python", code, tmp_path)


def test_every_block_says_what_it_is():
    assert all(language in ("sh", "python", "text") for guide in GUIDES for language, _ in blocks(guide))


@pytest.fixture
def repository(tmp_path):
    """What the example workflow expects of a repository."""
    (tmp_path / "logs").mkdir()
    wheelstate.simulate("nursing-robot", "identification", seed=6).write(tmp_path / "logs" / "drive.csv")
    acceptance = wheelstate.simulate("nursing-robot", "new-patient", seed=6)
    fit = wheelstate.fit("nursing-robot", wheelstate.simulate("nursing-robot", "identification", seed=6))
    mass = wheelstate.run("nursing-robot", acceptance, parameters=fit)["load_mass"]
    acceptance.write(tmp_path / "logs" / "acceptance.csv")
    rows = "".join(f"{time},{value}\n" for time, value in list(zip(acceptance.time, mass, strict=False))[400:3000:50])
    (tmp_path / "reference.csv").write_text("time,load_mass\n" + rows)
    return tmp_path


def work(folder):
    """Runs the steps of the workflow up to the first that fails, and gives its name."""
    workflow = yaml.safe_load((ROOT / "examples" / "ci" / "calibration.yml").read_text())
    steps = [step for step in workflow["jobs"]["calibration"]["steps"] if "run" in step and step["name"] != "Install"]
    for step in steps:
        done = subprocess.run(["/bin/bash", "-e", "-c", step["run"]], cwd=folder, capture_output=True, text=True, env=os.environ)
        if done.returncode:
            return step["name"], done.stdout + done.stderr
    return None, len(steps)


@pytest.mark.skipif(os.name != "posix", reason="a workflow for Linux")
def test_the_example_workflow_passes_and_each_gate_can_fail(repository):
    assert work(repository) == (None, 4)
    reference = (repository / "reference.csv").read_text()
    shifted = np.genfromtxt(repository / "reference.csv", delimiter=",", names=True)["load_mass"][-1] + 5
    (repository / "reference.csv").write_text(reference + f"29.9,{shifted}\n")
    assert work(repository)[0] == "The FMU gives what the reference says, within tolerance"
    log = wheelstate.simulate("nursing-robot", "lean", seed=1)
    log.write(repository / "logs" / "drive.csv")
    log.write(repository / "logs" / "acceptance.csv")
    assert work(repository)[0] == "Every parameter is identified"
    table = log.to_pandas()
    table["time"] *= 1000
    wheelstate.read(table).write(repository / "logs" / "drive.csv")
    assert work(repository)[0] == "The logs are usable"
