"""`identify run` against the FMU in fmpy: same log, same parameters, same estimates."""

import json
import re
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest
from support import make_log, period, write_log

COMMAND = {
    "HumanDynamics": "human-dynamics",
    "NursingRobot": "nursing-robot",
    "WheelLoader": "wheel-loader",
    "Wheelchair": "wheelchair",
    "WheeledRobot": "wheeled-robot",
}


@pytest.fixture
def run(program, model, tmp_path):
    """Runs `identify run` over a log and returns its table; warnings are allowed."""

    def run(log, *options):
        write_log(tmp_path / "log.csv", log)
        command = [program("identify"), "run", COMMAND[model], "log.csv", *map(str, options), "--out", "estimates.csv"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode in (0, 1), done.stderr
        return fmpy.read_csv(tmp_path / "estimates.csv")

    return run


def simulate(folder, log, dt, start_values=None):
    """What fmpy gives for a log, from its first row to a period after its last."""
    start = log["time"][0]
    return fmpy.simulate_fmu(
        folder, start_time=start, stop_time=log["time"][-1] + dt, output_interval=dt, input=log,
        start_values=start_values or {},
    )


def assert_same(run, fmu):
    """Every output of the FMU at every time that both have; fmpy also stops at the samples between the rows."""
    near = np.abs(run["time"][:, None] - fmu["time"][None, :])
    place = near.argmin(axis=1)
    assert near.min(axis=1).max() < 1e-9, "fmpy has not stopped at a row"
    assert len(run) > 50 and len(set(place)) == len(run)
    for name in fmu.dtype.names[1:]:
        wanted = fmu[name][place].astype(float)
        assert np.allclose(run[name], wanted, rtol=1e-12, atol=1e-12), name


def jittered(log, seed):
    """The same rows at times that scatter by a third of the period."""
    log = log.copy()
    dt = log["time"][1] - log["time"][0]
    log["time"][1:-1] += np.random.default_rng(seed).uniform(-0.33, 0.33, len(log) - 2) * dt
    return log


@pytest.mark.parametrize("seed, start", [(41, 0.0), (42, 1000.05)])
def test_a_run_gives_what_fmpy_gives_with_samples_missing(fmu, extracted, run, seed, start):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    log = make_log(description, rows=150, seed=seed, gaps=0.15, start=start)
    assert_same(run(log), simulate(folder, log, period(description)))


def test_a_run_gives_what_fmpy_gives_at_uneven_times(fmu, extracted, run):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    log = jittered(make_log(description, rows=150, seed=43, gaps=0.1, start=5.0), seed=1)
    # the last row of a run stands where the next row of the log was due, and fmpy's a period after its last
    assert_same(run(log, "--set", f"sample_period={dt}")[:-1], simulate(folder, log, dt))


def test_a_run_gives_what_fmpy_gives_across_a_gap(fmu, extracted, run):
    """Two gaps: of some samples, and of more than any machine bridges."""
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    log = make_log(description, rows=300, seed=44)
    log = log[np.r_[0:60, 66:150, 280:300]]
    assert_same(run(log), simulate(folder, log, period(description)))


def test_a_run_gives_what_fmpy_gives_with_inputs_that_are_never_set(fmu, extracted, run):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    log = make_log(description, rows=120, seed=45)
    kept = [name for k, name in enumerate(log.dtype.names) if k == 0 or k % 3]
    fewer = np.zeros(len(log), dtype=[(name, float) for name in kept])
    for name in kept:
        fewer[name] = log[name]
    assert_same(run(fewer), simulate(folder, fewer, period(description)))


def test_a_run_takes_the_parameters_that_pack_takes(fmu, extracted, run, program, model, tmp_path):
    """Those of a fit, known values and identified ones, are baked into an FMU and given to a run."""
    description = fmpy.read_model_description(extracted(fmu))
    names = [
        v.name for v in description.modelVariables
        if v.causality == "parameter" and v.type == "Real" and v.name.split(".")[-1] in ("mass", "measurement_std", "nominal_mass", "yaw_inertia")
    ][:2]
    starts = {v.name: float(v.start) for v in description.modelVariables if v.name in names}
    parameters = {name: {"value": 1.05 * starts[name], "unit": "kg", "std_error": 1.0, "ci95": [0, 1], "identified": True,
                         "at_bound": False} for name in names[:1]}
    parameters["sample_period"] = {"value": 0.5, "unit": "s", "std_error": 1.0, "ci95": [0, 1], "identified": False,
                                   "at_bound": False}
    fit = {"format_version": 1, "vehicle": COMMAND[model], "parameters": parameters, "loss": "ls", "logs": [],
           "settings": {name: 0.95 * starts[name] for name in names[1:]} | {"no.parameter": 1.0}}
    (tmp_path / "fit.json").write_text(json.dumps(fit))
    packed = tmp_path / "packed"
    packed.mkdir()
    done = subprocess.run([program("pack"), model, "--params", tmp_path / "fit.json", "--out", packed])
    assert done.returncode == 1  # what is not identified is told
    baked = packed / f"{model}.fmu"
    log = make_log(description, rows=120, seed=46)
    assert_same(run(log, "--params", tmp_path / "fit.json"), simulate(extracted(baked), log, period(description)))
    plain = run(log)
    with_fit = run(log, "--params", tmp_path / "fit.json")
    assert not parameters or len(names) == 0 or any(
        not np.array_equal(plain[name], with_fit[name]) for name in plain.dtype.names
    )


def test_a_run_takes_the_parameter_set_that_every_fmu_carries(fmu, extracted, run, model, tmp_path):
    """Copied and edited: with the start values nothing changes, with another period it does."""
    text = (Path(extracted(fmu)) / "resources" / f"{model}.ssv").read_text()
    log = make_log(fmpy.read_model_description(fmu), rows=80, seed=47)
    (tmp_path / "as_it_is.ssv").write_text(text)
    edited = re.sub(r'(name="sample_period".*?<ssv:Real value=")[^"]*(" unit=")s"', r'\g<1>0.011\g<2>s"', text, flags=re.S)
    assert edited != text
    (tmp_path / "edited.ssv").write_text(edited)
    assert run(log).tobytes() == run(log, "--params", "as_it_is.ssv").tobytes()
    slower = run(log, "--set", "sample_period=0.011").tobytes()
    assert run(log, "--params", "edited.ssv").tobytes() == slower != run(log).tobytes()
