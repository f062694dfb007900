"""The library under a host in C: a hundred loads and unloads, and a memory checker."""

import re
import shutil
import subprocess
from pathlib import Path

import fmpy
import pytest
from test_platforms import NATIVE, reference


@pytest.fixture(scope="session")
def driver(tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("SKIPPED: cc is missing")
    path = tmp_path_factory.mktemp("native") / "driver"
    subprocess.run(["cc", "-O1", "-o", path, NATIVE / "driver.c", "-ldl"], check=True)
    return path


@pytest.fixture
def host(fmu, model, extracted, driver, tmp_path):
    library = Path(extracted(fmu)) / "binaries" / "linux64" / f"{model}.so"
    guid = fmpy.read_model_description(fmu).guid

    def run(lines, *checker):
        (tmp_path / "plan").write_text("\n".join(lines) + "\n")
        done = subprocess.run([*checker, driver, library, guid, tmp_path / "plan"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stderr

    return run


def test_the_library_is_loaded_and_unloaded_a_hundred_times(host):
    host(["start 0", "step 0 0.01", "state", "again 99"])


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="SKIPPED: valgrind is missing")
def test_a_memory_checker_finds_no_error_and_no_leak(fmu, host):
    plan, *_ = reference(fmu)
    few = plan.splitlines()[:600]
    said = host(
        [*few, "state", "reset", "start 0", "again 3"],
        "valgrind", "--leak-check=full", "--error-exitcode=9", "--errors-for-leak-kinds=definite,indirect,possible",
    )
    assert "ERROR SUMMARY: 0 errors" in said
    # what the C library keeps once; nothing stays behind per load
    assert int(re.search(r"in use at exit: ([\d,]+) bytes", said).group(1).replace(",", "")) < 1000, said
