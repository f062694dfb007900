"""The examples, one per machine in Rust and in Python: run as their first lines say, they agree with each other and with
the truth of the plant."""

import re
import shlex
import subprocess
import sys

import numpy as np
import pytest

from conftest import BIN, FMUS, ROOT

EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.rs"))
LINE = re.compile(r" *(\S+) s  (\S+) +(\S+) \+- +(\S+) +true +(\S+)")


def commands(text):
    """The commands that an example's first lines show."""
    return [shlex.split(line) for line in re.findall(r"^(?://! |    )((?:identify|pack|cargo|python) .*)$", text, re.M)]


def estimates(command, folder):
    """Time and name of each line that an example prints, and its estimate, standard deviation and truth."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    lines = [match.groups() for match in map(LINE.fullmatch, done.stdout.splitlines()) if match]
    return [line[:2] for line in lines], np.array([line[2:] for line in lines], float)


def test_there_is_one_example_per_machine_in_both_languages():
    words = {re.sub(r"(?<!^)(?=[A-Z])", "_", path.stem).lower() for path in FMUS.glob("*.fmu")}
    examples = [{path.stem for path in (ROOT / "examples").glob(f"*.{ending}")} for ending in ("py", "rs")]
    assert set(EXAMPLES) == words == examples[0] - {"fleet"} == examples[1]


@pytest.mark.parametrize("example", EXAMPLES)
def test_both_languages_print_the_same_and_the_truth_lies_within_the_standard_deviations(example, program, tmp_path):
    rust = commands((ROOT / "examples" / f"{example}.rs").read_text())
    python = commands((ROOT / "examples" / f"{example}.py").read_text())
    assert rust[0] == python[0] and python[1][0] == "pack" and python[2][0] == "python"
    simulate, (*_, log), (_, script, fmu, same_log) = rust[0], rust[1], python[2]
    assert rust[1][:5] == ["cargo", "run", "--release", "--example", example] and log == same_log
    subprocess.run([program(simulate[0]), *simulate[1:]], cwd=tmp_path, check=True, capture_output=True)
    names, native = estimates([str(BIN / "examples" / example), log], tmp_path)
    same_names, through_fmu = estimates([sys.executable, str(ROOT / "examples" / script), str(FMUS / fmu), log], tmp_path)
    assert names == same_names and len(names) >= 10
    assert np.allclose(native, through_fmu, rtol=1e-4, atol=2e-4)
    estimate, std, truth = native.T
    assert (np.abs(estimate - truth) < 4 * std + 1e-3).all(), native
