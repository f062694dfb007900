"""Looking at logs, fitting, tuning and running them from Python."""

import contextlib
import io
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time

import fmpy
import numpy as np
import pandas as pd
import polars as pl
import pytest
import wheelstate


def test_a_fit_finds_the_truth_and_says_how_well_it_knows_it(drive, fitted):
    stiffness = fitted["human.stiffness_pitch"]
    assert stiffness.verdict == "identified" and stiffness.identified and fitted.verdicts["human.stiffness_pitch"] == "identified"
    assert abs(stiffness.value - drive["true_human.stiffness_pitch"][0]) < 3 * stiffness.std_error
    assert stiffness.ci95[0] < stiffness.value < stiffness.ci95[1] and stiffness.unit == "N.m/rad" and float(stiffness) == stiffness.value
    covariance = fitted.covariance
    assert covariance is not None and covariance.of("human.stiffness_pitch", "human.stiffness_pitch") > 0
    np.testing.assert_allclose(covariance.matrix, covariance.matrix.T)
    parts = stiffness.contributions.values()
    assert math.isclose(math.sqrt(sum(part**2 for part in parts)), stiffness.std_error, rel_tol=0.05)
    assert "human.stiffness_pitch" in str(fitted) and "<table>" in fitted._repr_html_() and "parameters identified" in repr(fitted)


def test_a_profile_is_the_parabola_of_the_interval_where_the_cost_is_quadratic(drive):
    # least squares, linear in the stiffness: the closed form is ((c - estimate)/std)^2
    fit = wheelstate.fit("nursing-robot", drive, loss="ls", profile=["human.stiffness_pitch", "human.rest_pitch"])
    assert sorted(fit.profiles) == ["human.rest_pitch", "human.stiffness_pitch"]
    profile = fit.profiles["human.stiffness_pitch"]
    assert profile.refitted and profile.ends == ("passed", "passed") and (np.diff(profile.values) > 0).all()
    std = (profile.noise95[1] - profile.estimate) / math.sqrt(3.841459)
    np.testing.assert_allclose(profile.statistic, ((profile.values - profile.estimate) / std) ** 2, rtol=2e-3, atol=1e-6)
    assert math.isclose(profile.noise997[0], profile.estimate - math.sqrt(8.807469) * std, rel_tol=1e-3)
    assert profile.ci95[0] <= profile.noise95[0] and profile.noise95[1] <= profile.ci95[1]
    with pytest.raises(wheelstate.Error, match="--profile human.height: cannot be fitted"):
        wheelstate.fit("nursing-robot", drive, profile=["human.height"])


def test_tables_files_and_logs_give_the_same_fit(drive, fitted, tmp_path):
    drive.write(tmp_path / "drive.csv")
    for log in (drive.to_pandas(), pl.DataFrame(drive), drive.to_arrow(), {n: drive[n] for n in drive}, tmp_path / "drive.csv"):
        other = wheelstate.fit("NursingRobot", log)
        assert {n: p.value for n, p in other.parameters.items()} == {n: p.value for n, p in fitted.parameters.items()}


def test_a_fit_is_saved_and_loaded_with_every_bit(fitted, tmp_path):
    fitted.save(tmp_path / "fit.json")
    again = wheelstate.Fit.load(tmp_path / "fit.json")
    assert again.to_json() == fitted.to_json() and again.parameters == fitted.parameters
    fitted.save(tmp_path / "fit.ssv")
    assert "ParameterSet" in (tmp_path / "fit.ssv").read_text()
    fitted.report(tmp_path / "fit.html")
    page = (tmp_path / "fit.html").read_text()
    assert page.count("<svg") > 3 and "http://" not in page.replace("http://www.w3.org", "")


def test_several_logs_have_values_of_their_own_where_that_was_asked_for():
    logs = [wheelstate.simulate("nursing-robot", "identification", seed=seed) for seed in (1, 2)]
    named = [wheelstate.read(log.to_pandas(), name=f"ride {k}") for k, log in enumerate(logs)]
    fit = wheelstate.fit("nursing-robot", named, per_log=["rolling.coefficient"], prior={"human.damping_pitch": (35.0, 10.0)})
    rolling = fit["rolling.coefficient"]
    assert rolling.verdict == "per-log" and sorted(rolling.per_log) == ["ride 0", "ride 1"]


def test_a_check_names_a_wrong_unit_and_the_fit_refuses_it(drive):
    table = drive.to_pandas()
    table["speed"] *= 3.6
    findings = wheelstate.check("nursing-robot", table)
    assert "unit-mismatch" in {finding.code for finding in findings if finding.severity != "note"}, findings
    assert not [f for f in wheelstate.check("nursing-robot", drive) if f.severity == "refusal"]
    table = drive.to_pandas()
    table["time"] *= 1000
    with pytest.raises(wheelstate.Refused, match="period-out-of-range") as caught:
        wheelstate.fit("nursing-robot", table)
    assert caught.value.fit.refused == str(caught.value) and caught.value.fit.exit_code == 2
    assert "period-out-of-range" in {finding.code for finding in caught.value.fit.findings}


@pytest.mark.parametrize(
    "options, words",
    [
        ({"only": ["robot.colour"]}, "--only robot.colour: cannot be fitted; there are"),
        ({"set": {"robot.mass": -1}}, "robot.mass"),
        ({"set": {"filter.kind": "none"}}, "none"),
        ({"bound": {"human.damping_pitch": (3, 2)}}, "is no range"),
        ({"loss": "l3"}, "none of ls, huber, l1"),
        ({"parameters": "nowhere.json"}, "nowhere.json"),
        ({"span": (900, 901)}, "no samples between"),
    ],
)
def test_what_cannot_be_asked_for_raises_with_one_line(drive, options, words):
    with pytest.raises(wheelstate.Error, match=words) as caught:
        wheelstate.fit("nursing-robot", drive, **options)
    assert "\n" not in str(caught.value)


def test_a_tuning_has_the_shape_of_a_fit():
    log = wheelstate.simulate("wheeled-robot", "sine", seed=1).within(0, 4)
    tuned = wheelstate.tune("wheeled-robot", log, population=6, iterations=2, seed=3)
    again = wheelstate.tune("wheeled-robot", log, population=6, iterations=2, seed=3, threads=1)
    assert tuned.to_dict()["tuning"]["seed"] == 3 and tuned.parameters == again.parameters


@pytest.mark.parametrize("machine, scenario", [("wheelchair", "climb"), ("nursing-robot", "identification"), ("wheel-loader", "bumpy-c"), ("wheeled-robot", "lane-change"), ("human-dynamics", None)])
def test_a_run_gives_the_numbers_of_the_fmu_in_fmpy(machine, scenario):
    log = wheelstate.simulate(machine, scenario or next(iter(wheelstate.scenarios(machine))), seed=2).within(0, 20)
    run = wheelstate.run(machine, log)
    table = log.to_numpy()[["time", *[n for n in log.channels if not n.startswith("true_")]]]
    inputs = {v.name for v in fmpy.read_model_description(str(wheelstate.fmu(machine))).modelVariables if v.causality == "input"}
    table = table[["time", *[n for n in table.dtype.names if n in inputs]]]
    result = fmpy.simulate_fmu(
        str(wheelstate.fmu(machine)), input=table, start_time=log.time[0], stop_time=log.time[-1], output_interval=log.period
    )
    rows = min(len(result), len(run))
    assert rows >= len(log) - 1
    for name in run.channels:
        if name in result.dtype.names:
            np.testing.assert_allclose(run[name][:rows], result[name][:rows], rtol=1e-12, atol=1e-12, err_msg=name)


def test_a_smoothed_run_errs_less_and_reports(tmp_path):
    log = wheelstate.simulate("wheelchair", "climb", seed=2)
    run = wheelstate.run("wheelchair", log, set={"initial.heading": np.pi / 2}, smooth=True)
    error = lambda name: np.sqrt(np.mean((np.asarray(run[name]) - np.asarray(log["true_slope"])) ** 2))
    assert error("slope_smoothed") < 0.9 * error("slope") and "innovation_accel_x_std" in run.channels
    run.report(tmp_path / "run.html")
    assert "<svg" in (tmp_path / "run.html").read_text() and isinstance(run.warnings, list)
    with pytest.raises(wheelstate.Error, match="WheeledRobot cannot be smoothed"):
        wheelstate.run("wheeled-robot", wheelstate.simulate("wheeled-robot", "sine", seed=2), smooth=True)


def test_a_run_takes_a_fit_and_knows_its_units(drive, fitted):
    run = wheelstate.run("NursingRobot", drive, parameters=fitted)
    assert run.units["load_mass"] == "kg" and isinstance(run.to_pandas(), pd.DataFrame)
    assert len(run.time) == len(run["load_mass_std"]) and np.isfinite(run["load_mass"]).all()
    with pytest.raises(wheelstate.Error, match="holds parameters of nursing-robot, not of wheelchair"):
        wheelstate.run("wheelchair", drive, parameters=fitted)


def test_a_packed_fit_stands_in_the_fmu(fitted, tmp_path):
    with pytest.warns() if any(not p.identified for p in fitted.parameters.values()) else contextlib.nullcontext():
        path = wheelstate.pack("NursingRobot", fitted, out=tmp_path, set={"sample_period": 0.02})
    starts = {v.name: v.start for v in fmpy.read_model_description(str(path)).modelVariables}
    stiffness = "human.stiffness_pitch"
    assert float(starts[stiffness]) == fitted[stiffness].value and float(starts["sample_period"]) == 0.02
    with pytest.raises(wheelstate.Error, match="has no parameter 'robot.colour'"):
        wheelstate.pack("NursingRobot", set={"robot.colour": 1}, out=tmp_path)


LONG = """
import sys, wheelstate
log = wheelstate.simulate("wheeled-robot", "sine", seed=1)
print("ready", flush=True)
try:
    wheelstate.tune("wheeled-robot", log, population=300, iterations=3000)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_stops_long_work_within_seconds():
    with subprocess.Popen([sys.executable, "-c", LONG], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout.readline() == "ready\n"
        time.sleep(0.5)
        program.send_signal(signal.SIGINT)
        began = time.monotonic()
        assert program.communicate(timeout=30)[0] == "interrupted\n" and time.monotonic() - began < 10


def test_other_threads_run_while_a_fit_does(drive):
    count, over = [0], threading.Event()

    def tick():
        while not over.is_set():
            count[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    began = time.monotonic()
    wheelstate.fit("nursing-robot", [drive, drive])
    took = time.monotonic() - began
    over.set()
    thread.join()
    assert count[0] > 50 * took, (count[0], took)


def test_progress_is_told_in_shares_and_shown_only_where_somebody_looks(drive, monkeypatch):
    told = []
    log = wheelstate.simulate("wheeled-robot", "sine", seed=1).within(0, 5)
    wheelstate.tune("wheeled-robot", log, population=20, iterations=20, progress=lambda what, share: told.append((what, share)))
    assert told and all(0 <= share <= 1 for _, share in told) and "tuning" in told[-1][0]
    screen = io.StringIO()
    monkeypatch.setattr(sys, "stderr", screen)
    wheelstate.fit("nursing-robot", drive)
    assert screen.getvalue() == ""

    def stop(what, share):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        wheelstate.tune("wheeled-robot", log, population=300, iterations=3000, progress=stop)


def test_json_of_a_fit_has_no_number_that_json_lacks(fitted):
    json.loads(fitted.to_json(), parse_constant=lambda name: pytest.fail(name))
