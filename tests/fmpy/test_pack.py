"""The packer: baked start values, refusals, reproducible archives."""

import ctypes
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest
from support import Slave, make_log, period


def command_name(model):
    return "".join("-" + c.lower() if c.isupper() else c for c in model).lstrip("-")


@pytest.fixture
def pack(program, tmp_path):
    def run(*arguments):
        command = [program("pack"), *map(str, arguments), "--out", str(tmp_path / "out")]
        return subprocess.run(command, capture_output=True, text=True)

    return run


@pytest.fixture
def fit(tmp_path):
    def write(vehicle, parameters, **more):
        path = tmp_path / "fit.json"
        entries = {
            name: {"value": value, "unit": "1", "std_error": None, "ci95": [None, None], "identified": identified, "at_bound": False}
            for name, (value, identified) in parameters.items()
        }
        path.write_text(json.dumps({"format_version": 1, "vehicle": vehicle, "parameters": entries, **more}))
        return path

    return write


def some_parameters(description):
    """Two Real parameters whose start value may be moved a little."""
    chosen = []
    for v in description.modelVariables:
        if v.causality == "parameter" and v.type == "Real" and v.name != "sample_period":
            value = float(v.start) * 1.03125 + (0.001 if float(v.start) == 0.0 else 0.0)
            if value != float(v.start) and (v.max is None or value < float(v.max)) and value > 1e-3:
                chosen.append((v.name, float(v.start), value))
    return chosen[:2]


def test_packing_again_gives_the_same_bytes(fmu, model, pack, tmp_path):
    assert pack(model).returncode == 0
    first = (tmp_path / "out" / f"{model}.fmu").read_bytes()
    assert pack(command_name(model)).returncode == 0
    assert (tmp_path / "out" / f"{model}.fmu").read_bytes() == first
    assert os.listdir(tmp_path / "out") == [f"{model}.fmu"]


def test_identified_values_become_start_values(fmu, model, extracted, pack, fit, tmp_path):
    default = fmpy.read_model_description(extracted(fmu))
    (one, _, new), (other, old, _) = some_parameters(default)
    path = fit(command_name(model), {one: (new, True), other: (old * 1.5 + 1.0, False)})
    done = pack(model, "--params", path)
    assert done.returncode == 1, done.stderr  # one was not taken over
    assert one in done.stdout and f"{other}: not identified" in done.stdout
    baked = tmp_path / "out" / f"{model}.fmu"
    description = fmpy.read_model_description(str(baked), validate=True)
    starts = {v.name: v.start for v in description.modelVariables}
    assert float(starts[one]) == new and float(starts[other]) == old
    assert description.guid != default.guid and description.guid[:19] == default.guid[:19]

    # and the FMU runs as the default one with that value set
    folder, dt = extracted(baked), period(description)
    log = make_log(description, rows=60, seed=21)
    with Slave(folder) as packed, Slave(extracted(fmu)) as plain:
        plain.set(one, new)
        packed.start()
        plain.start()
        assert packed.get(one) == new
        for k, row in enumerate(log):
            for slave in (packed, plain):
                slave.apply(row)
                slave.step(k * dt, dt)
        assert packed.all_outputs() == plain.all_outputs()

    # Reset goes back to the baked value, and the start values must be those of the GUID
    with Slave(folder) as packed:
        packed.set(one, old if False else new * 1.001)
        packed.fmu.reset()
        packed.fmu.setupExperiment()
        packed.fmu.enterInitializationMode()
        assert packed.get(one) == new
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken)
    library = broken / "binaries" / "linux64" / f"{model}.so"
    content, written = library.read_bytes(), f'"{one}": {new!r}'.encode()
    assert content.count(written) == 1
    library.write_bytes(content.replace(written, f'"{one}": {old!r}'.ljust(len(written)).encode()[: len(written)]))
    with pytest.raises(Exception, match="instantiate"):
        Slave(broken)


@pytest.mark.parametrize("location", [None, "", "resources", "file://host/resources", "file:///no/such/folder"])
def test_start_values_need_no_resource_location(fmu, model, extracted, pack, tmp_path, location):
    """Identified values are in the library, whatever a host gives as fmuResourceLocation."""
    (one, old, new), _ = some_parameters(fmpy.read_model_description(extracted(fmu)))
    assert pack(model, "--set", f"{one}={new!r}").returncode == 0
    folder = extracted(tmp_path / "out" / f"{model}.fmu")
    description = fmpy.read_model_description(folder)
    library = ctypes.CDLL(str(Path(folder) / "binaries" / "linux64" / f"{model}.so"))
    library.fmi2Instantiate.restype = ctypes.c_void_p
    text = None if location is None else location.encode()
    component = ctypes.c_void_p(
        library.fmi2Instantiate(b"one", 1, description.guid.encode(), text, None, 0, 0)
    )
    assert component.value
    assert library.fmi2EnterInitializationMode(component) == 0
    value, reference = ctypes.c_double(), ctypes.c_uint(next(v.valueReference for v in description.modelVariables if v.name == one))
    assert library.fmi2GetReal(component, ctypes.byref(reference), 1, ctypes.byref(value)) == 0
    assert value.value == new
    library.fmi2FreeInstance.restype = None
    library.fmi2FreeInstance(component)


def test_unidentified_values_are_packed_only_on_demand(fmu, model, extracted, pack, fit, tmp_path):
    (one, _, new), _ = some_parameters(fmpy.read_model_description(extracted(fmu)))
    path = fit(command_name(model), {one: (new, False)})
    done = pack("--params", path, "--include-unidentified")  # the fit knows the vehicle
    assert done.returncode == 1, done.stderr
    description = fmpy.read_model_description(str(tmp_path / "out" / f"{model}.fmu"))
    assert float(next(v.start for v in description.modelVariables if v.name == one)) == new


def test_values_given_to_the_fit_are_taken_over(fmu, model, extracted, pack, fit, tmp_path):
    (one, _, new), (other, _, given) = some_parameters(fmpy.read_model_description(extracted(fmu)))
    done = pack(model, "--params", fit(command_name(model), {one: (new, True)}, settings={other: given}))
    assert done.returncode == 0, done.stdout + done.stderr
    starts = {v.name: v.start for v in fmpy.read_model_description(str(tmp_path / "out" / f"{model}.fmu")).modelVariables}
    assert (float(starts[one]), float(starts[other])) == (new, given)


def test_the_preset_of_an_fmu_can_be_edited_and_packed(fmu, model, extracted, pack, tmp_path):
    """resources/<Model>.ssv: packed as it is nothing changes; an edited value, in another unit too, becomes the start."""
    folder = extracted(fmu)
    preset = (Path(folder) / "resources" / f"{model}.ssv").read_text()
    description = fmpy.read_model_description(folder)
    (one, old, new), _ = some_parameters(description)
    path = tmp_path / "values.ssv"
    path.write_text(preset)
    done = pack("--params", path)  # the set knows the model
    assert (done.returncode, done.stdout.count("\n")) == (0, 1), done.stdout + done.stderr
    assert (tmp_path / "out" / f"{model}.fmu").read_bytes() == Path(fmu).read_bytes()

    root = ElementTree.fromstring(preset)
    (value,) = (p[0] for p in root[0] if p.get("name") == one)
    (period,) = (p[0] for p in root[0] if p.get("name") == "sample_period")
    period_s = 0.9 * float(period.get("value"))
    value.set("value", repr(new))
    period.set("value", repr(period_s / 3600.0))
    period.set("unit", "h")
    path.write_bytes(ElementTree.tostring(root))
    assert pack(model, "--params", path).returncode == 0
    starts = {v.name: v.start for v in fmpy.read_model_description(str(tmp_path / "out" / f"{model}.fmu")).modelVariables}
    assert float(starts[one]) == new and abs(float(starts["sample_period"]) - period_s) < 1e-15

    for text, word in (
        ("no XML", "XML"),
        ("<a/>", "ParameterSet"),
        (preset.replace(f'name="{model}"', 'name="mine"'), "name the model"),
        (preset.replace('unit="s"', 'unit="kg"'), "its unit is kg; s is expected"),
        (preset.replace('"sample_period" description', '"sample_period" d').replace('<ssv:Real value="0', '<ssv:Real value="-1'), "allowed"),
    ):
        path.write_text(text)
        done = pack("--params", path)
        assert done.returncode == 2 and word in done.stderr and "values.ssv" in done.stderr, done.stderr
        assert done.stderr.count("\n") == 1


@pytest.fixture
def verify(program):
    def run(path):
        ours = subprocess.run([program("pack"), "verify", path], capture_output=True, text=True)
        script = Path(fmpy.extract(str(path))) / "extra/org.fmi-standard.fmi-ls-ref/verify.py"
        theirs = subprocess.run([sys.executable, script, path], capture_output=True, text=True)
        return ours, theirs

    return run


def test_an_fmu_proves_itself(fmu, model, pack, extracted, verify, tmp_path):
    """`pack verify` and the script in the FMU run its reference experiment, also with start values of its own."""
    (one, _, new), _ = some_parameters(fmpy.read_model_description(extracted(fmu)))
    assert pack(model, "--set", f"{one}={new!r}").returncode == 0
    for path in (fmu, tmp_path / "out" / f"{model}.fmu"):
        ours, theirs = verify(path)
        assert ours.returncode == 0 and "verified: 200 steps" in ours.stdout, ours.stderr
        assert theirs.returncode == 0 and "verified" in theirs.stdout, theirs.stdout + theirs.stderr


def test_an_fmu_that_differs_is_found(fmu, model, verify, tmp_path):
    with zipfile.ZipFile(fmu) as archive, zipfile.ZipFile(tmp_path / "other.fmu", "w") as other:
        for name in archive.namelist():
            content = archive.read(name)
            if name.endswith("reference_out.csv"):
                head, *rows = content.decode().splitlines()
                cells = rows[150].split(",")
                cells[1] = repr(float(cells[1]) + 1e-3)
                rows[150] = ",".join(cells)
                content = "\n".join([head, *rows, ""]).encode()
            other.writestr(name, content)
    ours, theirs = verify(tmp_path / "other.fmu")
    assert ours.returncode == 2 and "differs from the reference" in ours.stderr, ours
    assert theirs.returncode == 1 and "DIFFERS" in theirs.stdout, theirs
    (tmp_path / "empty.fmu").write_bytes(b"")
    done = subprocess.run([*ours.args[:2], tmp_path / "empty.fmu"], capture_output=True, text=True)
    assert done.returncode == 2 and "empty.fmu: it is not a zip archive" in done.stderr


def test_refusals_name_the_file_and_write_nothing(fmu, model, extracted, pack, fit, tmp_path):
    (one, _, new), _ = some_parameters(fmpy.read_model_description(extracted(fmu)))
    vehicle = command_name(model)
    cases = [
        (fit("bicycle", {one: (new, True)}), "bicycle"),
        (tmp_path / "absent.json", "absent.json"),
    ]
    for path, word in cases:
        done = pack(model, "--params", path)
        assert done.returncode == 2 and word in done.stderr and not (tmp_path / "out").exists(), done
    for text, word in (
        ("{", "JSON"),
        ("{}", "format_version"),
        ('{"format_version": 9}', "format_version 9"),
        (json.dumps({"format_version": 1, "vehicle": vehicle, "parameters": {one: {"value": None, "identified": True}}}), one),
        (json.dumps({"format_version": 1, "vehicle": vehicle, "parameters": {"sample_period": {"value": -1, "identified": True}}}), "allowed"),
        (json.dumps({"format_version": 1, "vehicle": vehicle, "parameters": {one: {"value": new}}}), "identified"),
    ):
        path = tmp_path / "bad.json"
        path.write_text(text)
        done = pack(model, "--params", path)
        assert done.returncode == 2 and word in done.stderr and "bad.json" in done.stderr, (text, done)
        assert done.stderr.count("\n") == 1 and not (tmp_path / "out").exists()


def test_unknown_models_are_refused(program):
    done = subprocess.run([program("pack"), "bicycle"], capture_output=True, text=True)
    assert done.returncode == 2 and "bicycle" in done.stderr and "nursing-robot" in done.stderr


def test_libraries_of_further_platforms_are_packed(fmu, model, pack, tmp_path):
    # the head of a DLL for 64-bit Windows: "MZ", and at 0x40 "PE" with the machine 0x8664
    library = tmp_path / "some.dll"
    content = b"MZ".ljust(0x3C, b"\0") + b"\x40\0\0\0PE\0\0\x64\x86" + bytes(64)
    library.write_bytes(content)
    assert pack(model, "--targets", f"win64={library}").returncode == 0
    with zipfile.ZipFile(tmp_path / "out" / f"{model}.fmu") as archive:
        assert archive.read(f"binaries/win64/{model}.dll") == content
        assert f"binaries/linux64/{model}.so" in archive.namelist()
    for target in ("amiga=x", "win64", "win64=/no/such/file", f"linux64={library}", f"win64={__file__}"):
        done = pack(model, "--targets", target)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr


def test_an_arm_library_also_stands_where_hosts_look_for_it(fmu, model, pack, tmp_path):
    """fmpy, OpenModelica and rust-fmi look into linux64 on ARM, too."""
    content = b"\x7fELF\x02\x01".ljust(18, b"\0") + bytes([183]) + bytes(64)
    (tmp_path / "libraries/aarch64-linux").mkdir(parents=True)
    (tmp_path / "libraries/aarch64-linux/libwheelstate_fmu.so").write_bytes(content)
    assert pack(model, "--libraries", tmp_path / "libraries").returncode == 0
    with zipfile.ZipFile(tmp_path / "out" / f"{model}.fmu") as archive:
        names = [name for name in archive.namelist() if name.startswith("binaries")]
        assert names == [f"binaries/aarch64-linux/{model}.so", f"binaries/linux64/{model}.so"]
        assert all(archive.read(name) == content for name in names)
    assert pack(model, "--libraries", tmp_path / "empty").returncode == 2
