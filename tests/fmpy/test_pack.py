"""The packer: baked start values, refusals, reproducible archives."""

import json
import os
import shutil
import subprocess
import zipfile

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
    values = broken / "resources" / "start_values.json"
    values.write_text(values.read_text().replace(repr(new), repr(new * 1.01)))
    with pytest.raises(Exception, match="instantiate"):
        Slave(broken)
    values.unlink()
    with pytest.raises(Exception, match="instantiate"):
        Slave(broken)


def test_unidentified_values_only_on_demand(fmu, model, extracted, pack, fit, tmp_path):
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


def test_further_platforms(fmu, model, pack, tmp_path):
    library = tmp_path / "some.dll"
    library.write_bytes(b"MZ not really")
    assert pack(model, "--targets", f"win64={library}").returncode == 0
    with zipfile.ZipFile(tmp_path / "out" / f"{model}.fmu") as archive:
        assert archive.read(f"binaries/win64/{model}.dll") == b"MZ not really"
        assert f"binaries/linux64/{model}.so" in archive.namelist()
    for target in ("amiga=x", "win64", "win64=/no/such/file"):
        assert pack(model, "--targets", target).returncode == 2
