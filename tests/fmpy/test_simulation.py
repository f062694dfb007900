"""The FMUs against the native estimators, run over the same logs."""

import html
import re
import shutil
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest
from support import Slave, is_measured, make_log, period, write_log

# relative to max(1, |value|)
TOLERANCE = 1e-12


def close(actual, expected):
    return np.abs(actual - expected) <= TOLERANCE * np.maximum(1.0, np.abs(expected))


@pytest.fixture
def native(program, tmp_path):
    def run(model, log, *settings):
        source, result = tmp_path / "log.csv", tmp_path / "native.csv"
        write_log(source, log)
        subprocess.run([program("examples/native"), model, source, result, *settings], check=True)
        return fmpy.read_csv(result)

    return run


@pytest.mark.parametrize("start", [0.0, 1000.05])
@pytest.mark.parametrize("gaps", [0.0, 0.15])
def test_simulate_fmu_is_the_native_estimator(fmu, model, extracted, native, start, gaps):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    log = make_log(description, seed=3, gaps=gaps, start=start)
    expected = native(model, log)
    outputs = [v.name for v in description.modelVariables if v.causality == "output"]
    result = fmpy.simulate_fmu(
        folder,
        start_time=start,
        stop_time=start + len(log) * dt,
        output_interval=dt,
        input=log,
        output=outputs,
    )
    assert len(result) == len(log) + 1
    for name in outputs:
        same = close(result[name][1:].astype(float), expected[name])
        worst = np.argmin(same)
        assert same.all(), f"{name} row {worst}: {result[name][worst + 1]!r} instead of {expected[name][worst]!r}"


def test_a_log_from_a_file_with_nan_reads_the_same(fmu, model, extracted, native, tmp_path):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    log = make_log(description, rows=150, seed=5, gaps=0.3)
    write_log(tmp_path / "log.csv", log)
    read = fmpy.read_csv(tmp_path / "log.csv")
    expected = native(model, log)
    result = fmpy.simulate_fmu(folder, stop_time=len(log) * dt, output_interval=dt, input=read)
    for name in result.dtype.names[1:]:
        assert close(result[name][1:].astype(float), expected[name]).all(), name


def test_the_guides_recipe_for_long_logs_gives_the_same_in_linear_time(fmu, model, extracted, tmp_path, monkeypatch):
    """The code that the FMU's documentation shows, as it stands there."""
    folder = extracted(fmu)
    page = (Path(folder) / "documentation" / "index.html").read_text()
    recipe = html.unescape(re.search(r'<pre id="long-logs">(.*?)</pre>', page, re.S).group(1))
    description = fmpy.read_model_description(folder)
    dt = period(description)
    log = make_log(description, rows=120, seed=7, gaps=0.2, start=5.0)
    write_log(tmp_path / "log.csv", log)
    shutil.copy(fmu, tmp_path)
    monkeypatch.chdir(tmp_path)
    variables = {}
    exec(recipe, variables)
    expected = fmpy.simulate_fmu(folder, start_time=5.0, stop_time=5.0 + 120 * dt, output_interval=dt, input=log)
    result = variables["result"]
    assert len(result) == 121 and set(result.dtype.names) == set(expected.dtype.names)
    for name in expected.dtype.names[1:]:
        assert np.array_equal(result[name], expected[name]), name


def test_steps_longer_than_the_logs_rows_still_take_every_row(fmu, model, extracted, native):
    """fmpy stops at every change of a discrete input, so a coarse output grid loses no sample."""
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    if any(v.causality == "input" and v.variability == "continuous" for v in description.modelVariables):
        pytest.skip("has continuous inputs, which a host holds over its own steps")
    dt = period(description)
    log = make_log(description, rows=200, seed=6)
    expected = native(model, log)
    result = fmpy.simulate_fmu(folder, stop_time=200 * dt, output_interval=10 * dt, input=log)
    for name in result.dtype.names[1:]:
        last = float(result[name][-1])
        assert close(np.float64(last), np.float64(expected[name][-1])), name


def test_a_simulation_without_inputs_runs(fmu, extracted):
    result = fmpy.simulate_fmu(extracted(fmu), stop_time=1.0)
    for name in result.dtype.names:
        assert np.isfinite(result[name].astype(float)).all(), name


@pytest.mark.parametrize("start", [0.0, 1000.05])
@pytest.mark.parametrize("share", [1.0 / 3.0, 1.0, 7.3])
def test_step_sizes_take_the_same_samples(fmu, extracted, start, share):
    """However long the steps: a sample every period, with the inputs held since they were set."""
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    inputs = make_log(description, rows=2, seed=4)[0]
    rows = 73  # a multiple of all three step sizes
    with Slave(folder) as reference, Slave(folder) as other:
        reference.start(0.0)
        other.start(start)
        reference.apply(inputs)
        other.apply(inputs)
        for k in range(rows):
            reference.step(k * dt, dt)
        for i in range(round(rows / share)):
            other.step(start + i * share * dt, share * dt)
        names = reference.outputs
        pairs = zip(names, reference.all_outputs(), other.all_outputs())
        for name, expected, actual in pairs:
            assert close(np.float64(actual), np.float64(expected)), name


def test_infinite_samples_count_as_missing(fmu, extracted):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    measured = [v for v in description.modelVariables if v.causality == "input" and is_measured(v)]
    dt = period(description)
    log = make_log(description, rows=60, seed=8)
    for variable in measured[:: max(1, len(measured) // 12)]:
        with Slave(folder) as missing, Slave(folder) as infinite:
            missing.start()
            infinite.start()
            for k, row in enumerate(log):
                missing.apply(row)
                infinite.apply(row)
                if k % 3 == 0:
                    missing.set(variable.name, float("nan"))
                    infinite.set(variable.name, float("inf"))
                missing.step(k * dt, dt)
                infinite.step(k * dt, dt)
            ignored = {"status"}
            for name, a, b in zip(missing.outputs, missing.all_outputs(), infinite.all_outputs()):
                assert name in ignored or a == b, f"{variable.name}: {name}"


def test_input_derivatives_are_used(fmu, extracted):
    """One long step over a ramp with its derivative is as good as many short ones."""
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    reals = [v for v in description.modelVariables if v.causality == "input" and v.type == "Real"]
    begin = make_log(description, rows=2, seed=9)[0]
    slopes = {v.name: 0.3 for v in reals}
    with Slave(folder) as fine, Slave(folder) as coarse:
        fine.start()
        coarse.start()
        for k in range(50):
            for v in reals:
                fine.set(v.name, float(begin[v.name]) + slopes[v.name] * k * dt)
            fine.step(k * dt, dt)
        coarse.apply(begin)
        coarse.fmu.setRealInputDerivatives([coarse.vr[v.name] for v in reals], [1] * len(reals), list(slopes.values()))
        coarse.step(0.0, 50 * dt)
        for name, a, b in zip(fine.outputs, fine.all_outputs(), coarse.all_outputs()):
            # the two form the inputs by other roundings, which a filter may amplify
            assert abs(a - b) <= 1e-8 * max(1.0, abs(a)), name


def test_output_derivatives_follow_the_prediction(fmu, extracted):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    log = make_log(description, rows=50, seed=10)
    with Slave(folder) as slave:
        slave.start()
        for k, row in enumerate(log):
            slave.apply(row)
            slave.step(k * dt, dt if k < 49 else 0.4 * dt)
        reals = [v.name for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
        vrs = [slave.vr[name] for name in reals]
        before = slave.fmu.getReal(vrs)
        slave.step(49.4 * dt, 0.01 * dt)
        rates = slave.fmu.getRealOutputDerivatives(vrs, [1] * len(vrs))
        slave.step(49.41 * dt, 0.01 * dt)
        after = slave.fmu.getReal(vrs)
        for name, rate, a, b in zip(reals, rates, before, after):
            assert np.isfinite(rate), name
            assert abs(b - a - rate * 0.02 * dt) <= 1e-3 * abs(b - a) + 1e-9 * max(1.0, abs(a)), name
