"""`identify` against other programs: fmpy, asammdf and pyarrow read what it writes and it reads what they write."""

import json
import shlex
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from fmpy import read_csv, read_model_description, write_csv
from fmpy.ssp.ssd import read_ssv

from conftest import FMUS


@pytest.fixture
def identify(program, tmp_path):
    """Runs `identify` in the test's folder and returns its output; `expect` are the allowed exit codes."""

    def run(*arguments, expect=(0,)):
        done = subprocess.run([program("identify"), *map(str, arguments)], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode in expect, done.stderr
        return done.stdout

    return run


def columns(path):
    """A CSV file as a dictionary of arrays, read without fmpy and without `identify`."""
    with open(path) as file:
        names = file.readline().strip().split(",")
        values = np.array([[float(cell) for cell in line.split(",")] for line in file])
    return dict(zip(names, values.T))


def same(a, b):
    return np.array_equal(np.asarray(a, float), np.asarray(b, float), equal_nan=True)


# --- fmpy ---------------------------------------------------------------------------------------


def test_fmpy_reads_a_simulated_log(identify, tmp_path):
    identify("simulate", "nursing-robot", "--scenario", "coughs", "--seed", 3, "--out", "log.csv")
    read, plain = read_csv(tmp_path / "log.csv"), columns(tmp_path / "log.csv")
    assert list(read.dtype.names) == list(plain)
    assert all(same(read[name], plain[name]) for name in plain)


def test_missing_samples_reach_fmpy_as_nan(identify, tmp_path):
    (tmp_path / "gaps.csv").write_text("time,speed,torque_left\n0,,1\n0.01,nan,\n0.02,3,4\n")
    identify("convert", "nursing-robot", "gaps.csv", "--out", "log.csv")
    read = read_csv(tmp_path / "log.csv")
    assert same(read["speed"], [np.nan, np.nan, 3]) and same(read["torque_left"], [1, np.nan, 4])


def test_what_fmpy_writes_is_read_unchanged(identify, tmp_path):
    rng = np.random.default_rng(1)
    kinds = [("time", float), ("load_mass", float), ("mass_valid", bool), ("status", np.int32)]
    result = np.zeros(200, dtype=kinds)
    result["time"] = 1000.05 + np.arange(200) * 0.01
    result["load_mass"] = rng.normal(size=200) * 10.0 ** rng.integers(-300, 300, size=200)
    result["load_mass"][5] = np.nan
    result["mass_valid"] = rng.random(200) > 0.5
    result["status"] = rng.integers(-5, 1 << 20, size=200)
    write_csv(tmp_path / "result.csv", result)
    identify("convert", "nursing-robot", "result.csv", "--out", "back.csv")
    back = columns(tmp_path / "back.csv")
    assert list(back) == list(result.dtype.names)
    assert all(same(back[name], result[name]) for name in back)


def test_the_fit_reaches_fmpy(identify, tmp_path):
    identify("simulate", "nursing-robot", "--scenario", "identification", "--seed", 2, "--out", "log.csv")
    table = identify("fit", "nursing-robot", "log.csv", "--out", "fit.json", "--ssv", "fit.ssv", expect=(0, 1))
    fit = json.loads((tmp_path / "fit.json").read_text())
    identified = {name: p for name, p in fit["parameters"].items() if p["identified"]}
    assert identified
    read = read_ssv(tmp_path / "fit.ssv", validate=True)
    assert {p.name: (float(p.value), p.unit) for p in read.parameters} == {
        name: (p["value"], p["unit"]) for name, p in identified.items()
    }
    # Every unit that is used is also defined.
    root = ElementTree.parse(tmp_path / "fit.ssv").getroot()
    defined = {element.get("name") for element in root.iter("{http://ssp-standard.org/SSP1/SystemStructureCommon}Unit")}
    assert {p.unit for p in read.parameters} <= defined
    # The last line of the table is an option of fmpy's command line.
    line = shlex.split(table.strip().splitlines()[-1])
    assert line[:2] == ["fmpy", "--start-values"]
    assert dict(zip(line[2::2], map(float, line[3::2]))) == {name: p["value"] for name, p in identified.items()}
    command = [sys.executable, "-m", "fmpy", "simulate", str(FMUS / "NursingRobot.fmu"), "--stop-time", "0.05"]
    command += ["--input-file", "log.csv", "--output-file", "result.csv", *line[1:]]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    # fmpy's own reader stops at the Booleans of fmpy's own file.
    identify("convert", "nursing-robot", "result.csv", "--out", "plain.csv")
    assert set(columns(tmp_path / "plain.csv")["mass_valid"]) <= {0.0, 1.0}


@pytest.mark.parametrize("vehicle, scenario", [("wheeled-robot", "sine"), ("wheelchair", "climb"), ("nursing-robot", "coughs")])
def test_the_tuning_reaches_the_fmu(identify, program, tmp_path, vehicle, scenario):
    def starts(path):
        variables = read_model_description(str(path)).modelVariables
        return {v.name: float(v.start) for v in variables if v.causality == "parameter" and v.type == "Real"}

    model = "".join(word.capitalize() for word in vehicle.split("-"))
    identify("simulate", vehicle, "--scenario", scenario, "--seed", 1, "--out", "log.csv")
    identify("tune", vehicle, "log.csv", "--pop", 5, "--iters", 1, "--out", "tune.json", expect=(0, 1))
    tuned = json.loads((tmp_path / "tune.json").read_text())["parameters"]
    default = starts(FMUS / f"{model}.fmu")
    for options in ([], ["--include-unidentified"]):
        command = [program("pack"), "--params", "tune.json", *options, "--out", "out"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode in (0, 1), done.stderr
        taken = {name: p["value"] for name, p in tuned.items() if options or p["identified"]}
        assert taken and taken != {name: default[name] for name in taken}
        assert starts(tmp_path / "out" / f"{model}.fmu") == default | taken


# --- asammdf ------------------------------------------------------------------------------------


def placed(times, values, at):
    """Each value at the nearest of some even times, NaN in between."""
    result = np.full(len(at), np.nan)
    step = at[1] - at[0]
    place = np.rint((times - at[0]) / step).astype(int)
    inside = (place >= 0) & (place < len(at))
    result[place[inside]] = np.asarray(values, float)[inside]
    return result


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_files_of_asammdf_are_read(identify, tmp_path, compression):
    asammdf = pytest.importorskip("asammdf")
    fast, slow = np.arange(3000) * 0.01, 0.003 + np.arange(240) * 0.1
    speed, torque = np.sin(fast), np.round(100 * np.cos(fast)).astype("i2")
    counts = np.arange(240, dtype="u1")
    file = asammdf.MDF(version="4.10")
    linear = {"a": 0.25, "b": -3.0}
    file.append([
        asammdf.Signal(speed, fast, name="speed", unit="m/s"),
        asammdf.Signal(torque, fast, name="torque_left", unit="N.m"),
    ])
    file.append([
        asammdf.Signal(counts, slow, name="yaw_rate", unit="rad/s", conversion=linear),
        asammdf.Signal(np.array([b"go"] * 240), slow, name="note", encoding="utf-8"),
    ])
    file.save(tmp_path / "log.mf4", overwrite=True, compression=compression)
    identify("convert", "nursing-robot", "log.mf4", "--out", "log.csv")
    read = columns(tmp_path / "log.csv")
    assert set(read) == {"time", "speed", "torque_left", "yaw_rate"}
    assert same(read["time"], fast) and same(read["speed"], speed) and same(read["torque_left"], torque)
    assert same(read["yaw_rate"], placed(slow, 0.25 * counts - 3.0, fast))
    assert np.isnan(read["yaw_rate"]).sum() == 3000 - 240


def test_units_and_invalid_samples_of_a_measurement_file_are_read(identify, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    times = np.arange(100) * 0.1
    invalid = np.arange(100) % 7 == 0
    file = asammdf.MDF(version="4.10")
    file.append([
        asammdf.Signal(np.full(100, 36.0), times, name="speed", unit="km/h", invalidation_bits=invalid),
        asammdf.Signal(np.arange(100.0), times, name="engine", unit="squirrels"),
    ])
    file.save(tmp_path / "log.mf4", overwrite=True)
    identify("convert", "nursing-robot", "log.mf4", "--out", "log.csv")
    read = columns(tmp_path / "log.csv")
    assert np.array_equal(np.isnan(read["speed"]), invalid)
    assert np.allclose(read["speed"][~invalid], 10.0, rtol=1e-15)
    assert same(read["engine"], np.arange(100.0))
    # A map speaks for itself: the file's units are not applied a second time.
    (tmp_path / "map.toml").write_text('speed = { column = "speed", unit = "km/h" }\n')
    identify("convert", "nursing-robot", "log.mf4", "--columns", "map.toml", "--out", "mapped.csv")
    assert np.allclose(columns(tmp_path / "mapped.csv")["speed"][~invalid], 10.0, rtol=1e-15)


def test_asammdf_reads_what_identify_writes(identify, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    identify("simulate", "nursing-robot", "--scenario", "coughs", "--out", "log.csv")
    identify("simulate", "nursing-robot", "--scenario", "coughs", "--out", "log.mf4")
    plain, file = columns(tmp_path / "log.csv"), asammdf.MDF(tmp_path / "log.mf4")
    for name, values in plain.items():
        signal = file.get(name)
        assert same(signal.samples, values) and same(signal.timestamps, plain["time"])


# --- pyarrow ------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "zstd", "lz4", "brotli"])
def test_files_of_pyarrow_are_read(identify, tmp_path, compression):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    count = 5000
    values = np.sin(np.arange(count))
    some = [None if k % 11 == 3 else float(v) for k, v in enumerate(values)]
    table = pyarrow.table({
        "time": np.arange(count) * 0.01,
        "speed": pyarrow.array(some, pyarrow.float64()),
        "torque_left": values.astype(np.float32),
        "torque_right": (1000 * values).astype(np.int16),
        "yaw_rate": np.arange(count) * (1 << 33),
        "gear": np.arange(count) % 2 == 0,
        "nothing": pyarrow.array([None] * count, pyarrow.float64()),
    })
    parquet.write_table(table, tmp_path / "log.parquet", compression=compression, row_group_size=700)
    identify("convert", "nursing-robot", "log.parquet", "--out", "log.csv")
    read = columns(tmp_path / "log.csv")
    assert list(read) == table.column_names
    assert all(same(read[name], np.array(table[name].to_pylist(), float)) for name in read)


def test_identify_writes_parquet_for_pyarrow(identify, tmp_path):
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    (tmp_path / "gaps.csv").write_text("time,speed,torque_left\n0,,1\n0.01,nan,\n0.02,3,4\n")
    identify("convert", "nursing-robot", "gaps.csv", "--out", "log.parquet")
    table = parquet.read_table(tmp_path / "log.parquet").to_pydict()
    assert table == {"time": [0.0, 0.01, 0.02], "speed": [None, None, 3.0], "torque_left": [1.0, None, 4.0]}


def test_times_of_a_table_may_be_time_stamps(identify, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    stamps = pyarrow.array([1_700_000_000_000, 1_700_000_000_250], pyarrow.timestamp("ms"))
    table = pyarrow.table({"time": stamps, "speed": [1.0, 2.0], "note": ["a", "b"]})
    parquet.write_table(table, tmp_path / "log.parquet")
    (tmp_path / "map.toml").write_text('time = "time"\n')
    identify("convert", "nursing-robot", "log.parquet", "--columns", "map.toml", "--out", "log.csv")
    assert same(columns(tmp_path / "log.csv")["time"], [1_700_000_000.0, 1_700_000_000.25])


# --- a long log ---------------------------------------------------------------------------------


# Exit code, user time in s and largest memory in MB of a command. A process counts as its own the memory of the one that
# started it, so that it is started by one that has little.
COST = """
import json, resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([code, usage.ru_utime, usage.ru_maxrss / 1024]))
"""


def test_an_hour_fits_in_seconds_and_five_in_little_memory(identify, program, tmp_path):
    def fit(name):
        command = [program("identify"), "fit", "nursing-robot", name, "--out", "fit.json"]
        began = time.monotonic()
        done = subprocess.run([sys.executable, "-c", COST, *command], cwd=tmp_path, capture_output=True, text=True, check=True)
        code, work, memory = json.loads(done.stdout)
        assert code in (0, 1), done.stderr
        return work, time.monotonic() - began, memory

    sizes = {}
    for name, seconds in [("quarter.csv", 900), ("hour.csv", 3600)]:
        identify("simulate", "nursing-robot", "--scenario", "identification", "--set", f"plant.duration={seconds}", "--out", name)
        sizes[name] = fit(name)
    (_, _, quarter), (work, elapsed, hour) = sizes["quarter.csv"], sizes["hour.csv"]
    print(f"an hour at 100 Hz: {work:.1f} s of work, {elapsed:.1f} s elapsed, {hour:.0f} MB (a quarter: {quarter:.0f} MB)")
    assert work < 15, "user time, not the waiting on a busy machine"
    assert hour < 4.4 * quarter
    for name, hours in [("two.csv", 2), ("five.csv", 5)]:
        repeat(tmp_path / "hour.csv", hours, tmp_path / name)
        sizes[name] = fit(name)
    (_, _, two), (_, _, five) = sizes["two.csv"], sizes["five.csv"]
    print(f"two hours take {two:.0f} MB, five {five:.0f} MB")
    # Columns would take 8 bytes for each of 11 channels and more: 160 MB for five hours, and 95 for the last three of them.
    assert five < 140
    assert five - two < 50


def repeat(log, times, to):
    """A log again and again, at 100 Hz."""
    header, *rows = log.read_text().splitlines()
    rows = [row.partition(",")[2] for row in rows]
    with to.open("w") as file:
        print(header, file=file)
        for k in range(times * len(rows)):
            print(f"{k / 100:.2f},{rows[k % len(rows)]}", file=file)
