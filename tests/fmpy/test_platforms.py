"""The libraries of every platform: what they export and need, and that they run as the packed reference says.

WHEELSTATE_LIBRARIES is the folder that `fmu/targets.sh` filled; without it, and without the programs that run a foreign
library here, tests are skipped, loudly."""

import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from conftest import FMUS

NATIVE = Path(__file__).parent / "native"
LIBRARIES = Path(os.environ.get("WHEELSTATE_LIBRARIES", "/none"))
PLATFORMS = {
    "linux64": ("libwheelstate_fmu.so", ["cc"], []),
    "aarch64-linux": ("libwheelstate_fmu.so", ["aarch64-linux-gnu-gcc"], ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"]),
    "win64": ("wheelstate_fmu.dll", ["x86_64-w64-mingw32-gcc"], ["/usr/lib/wine/wine64"]),
}
GLIBC = (2, 17)


@pytest.fixture(params=PLATFORMS)
def platform(request):
    name, compiler, runner = PLATFORMS[request.param]
    library = LIBRARIES / request.param / name
    if not library.is_file():
        pytest.skip(f"SKIPPED {request.param}: {library} is missing; fmu/targets.sh builds it, WHEELSTATE_LIBRARIES names the folder")
    return request.param, library, compiler, runner


def tool(*command):
    if shutil.which(command[0]) is None:
        pytest.skip(f"SKIPPED: {command[0]} is missing")
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def functions():
    """The functions of the standard, as fmu/tests/library.rs lists them."""
    text = (Path(__file__).parents[2] / "fmu/tests/library.rs").read_text()
    return set(re.findall(r'"(fmi2\w+)"', text))


def test_a_library_exports_the_standard_and_needs_the_system_only(platform, functions):
    name, library, *_ = platform
    if name == "win64":
        text = tool("x86_64-w64-mingw32-objdump", "-p", library)
        # the table of names at the end; the one of imports stands before it
        exported = set(re.findall(r"\bfmi2\w+", text))
        table = text[text.index("[Ordinal/Name Pointer] Table") :].split("\n\n")[0]
        names = re.findall(r"^\s*\[ *\d+\] (?:\+base\[ *\d+\] +\w+ )?(\w+)$", table, re.M)
        assert set(names) == functions == exported
        needed = {dll.lower() for dll in re.findall(r"DLL Name: (\S+)", text)}
        system = {"kernel32.dll", "advapi32.dll", "msvcrt.dll", "ntdll.dll", "ws2_32.dll", "userenv.dll", "bcryptprimitives.dll", "bcrypt.dll"}
        assert all(dll in system or dll.startswith("api-ms-win-") for dll in needed), needed
        return
    symbols = tool("readelf", "-W", "--dyn-syms", library)
    defined = {line.split()[7] for line in symbols.splitlines() if re.search(r"(GLOBAL|WEAK).*DEFAULT +\d+ ", line)}
    assert defined == functions
    versions = [tuple(map(int, v.split("."))) for v in re.findall(r"@GLIBC_([0-9.]+)", symbols)]
    assert versions and max(versions) <= GLIBC, max(versions)
    needed = set(re.findall(r"NEEDED.*\[(.*)\]", tool("readelf", "-d", library)))
    assert all(re.match(r"(libc|libm|libpthread|libdl|libgcc_s|librt|ld-linux-[\w-]+)\.so\.", n) for n in needed), needed
    sections = tool("readelf", "-W", "-S", library)
    assert ".symtab" not in sections and ".debug" not in sections, "not stripped"


def test_no_path_of_the_building_machine_stands_in_a_library(platform):
    _, library, *_ = platform
    content = library.read_bytes()
    for word in (b".cargo", str(Path.home()).encode() + b"/", str(Path(__file__).parents[2]).encode()):
        assert word not in content, word


def test_a_library_runs_the_reference_experiment(platform, model, tmp_path):
    name, library, compiler, runner = platform
    for program in (compiler[0], *runner[:1]):
        if shutil.which(program) is None:
            pytest.skip(f"SKIPPED {name}: {program} is missing")
    fmu = FMUS / f"{model}.fmu"
    driver = tmp_path / ("driver.exe" if name == "win64" else "driver")
    # the C library of Windows reads no "nan", that of mingw does
    options = ["-D__USE_MINGW_ANSI_STDIO=1"] if name == "win64" else ["-ldl"]
    tool(*compiler, "-O1", "-o", driver, NATIVE / "driver.c", *options)
    if name == "win64":
        tool(*compiler, "-shared", "-o", tmp_path / "bcryptprimitives.dll", NATIVE / "bcryptprimitives.c")
    shutil.copy(library, tmp_path)
    plan, expected, tolerance = reference(fmu)
    (tmp_path / "plan").write_text(plan)
    guid = fmpy.read_model_description(str(fmu)).guid
    done = subprocess.run(
        [*runner, str(driver), str(tmp_path / library.name) if name != "win64" else library.name, guid, "plan"],
        capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "WINEDEBUG": "-all", "WINEPREFIX": str(tmp_path.parent / "wine")},
    )
    assert done.returncode == 0, done.stderr
    got = np.array([float(line) for line in done.stdout.split()])
    assert len(got) == len(expected)
    deviation = np.abs(got - expected) / np.maximum(1.0, np.abs(expected))
    assert np.max(deviation) <= tolerance, np.max(deviation)
    print(f"{name} {model}: {np.max(deviation):.1e}")


def reference(fmu):
    """The reference experiment as a plan of calls, with what they must give."""
    folder = "extra/org.fmi-standard.fmi-ls-ref/"
    with zipfile.ZipFile(fmu) as archive:
        experiment = ElementTree.fromstring(archive.read(folder + "experiments.xml"))[0]
        tables = [archive.read(folder + experiment.find(kind).get("source")).decode().splitlines() for kind in ("Stimuli", "References")]
    (names, *inputs), (outputs, *rows) = [[line.split(",")[1:] for line in table] for table in tables]
    variables = {v.name: v for v in fmpy.read_model_description(str(fmu)).modelVariables}
    size, lines, expected = float(experiment.get("stepSize")), ["start 0"], []

    def read(row):
        for name, value in zip(outputs, row, strict=True):
            kind = {"Real": "real", "Boolean": "boolean"}.get(variables[name].type, "integer")
            lines.append(f"get-{kind} {variables[name].valueReference}")
            expected.append(float(value))

    for k, (row, after) in enumerate(zip(inputs, rows[1:], strict=True)):
        lines += [f"real {variables[name].valueReference} {value}" for name, value in zip(names, row) if variables[name].type == "Real"]
        lines.append(f"step {k * size!r} {size!r}")
        if k % 20 == 19:
            lines.append("state")
        read(after)
    return "\n".join(lines) + "\n", np.array(expected), float(experiment.get("tolerance"))
