"""`replay`, the FMUs' second master, against fmpy over the same logs."""

import subprocess

import asammdf
import fmpy
import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from support import make_log, period, write_log


@pytest.fixture
def replay(program, tmp_path):
    def run(*arguments, check=True):
        command = [program("replay"), *map(str, arguments), "--out", str(tmp_path / "result.csv")]
        done = subprocess.run(command, capture_output=True, text=True)
        assert not check or done.returncode == 0, done.stderr
        return done

    return run


def test_replay_and_fmpy_agree(fmu, extracted, replay, tmp_path):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    log = make_log(description, rows=120, seed=31, gaps=0.1, start=1000.05)
    write_log(tmp_path / "log.csv", log)
    replay(fmu, tmp_path / "log.csv")
    result = fmpy.read_csv(tmp_path / "result.csv")
    expected = fmpy.simulate_fmu(
        folder, start_time=1000.05, stop_time=1000.05 + 120 * dt, output_interval=dt, input=log
    )
    assert set(result.dtype.names) == set(expected.dtype.names) and len(result) == len(expected)
    for name in result.dtype.names[1:]:
        wanted = expected[name].astype(float)
        assert np.allclose(result[name], wanted, rtol=1e-12, atol=1e-12), name


def test_a_column_map_with_units_and_conditions_is_applied(fmu, extracted, replay, tmp_path):
    """The same log in other names and units gives the same result."""
    description = fmpy.read_model_description(extracted(fmu))
    log = make_log(description, rows=60, seed=32)
    names = log.dtype.names
    write_log(tmp_path / "log.csv", log)
    replay(fmu, tmp_path / "log.csv")
    expected = fmpy.read_csv(tmp_path / "result.csv")
    renamed = ["t_ms" if name == "time" else f"X {name} [2]" for name in names]
    foreign = np.zeros(len(log), dtype=[(name, float) for name in renamed])
    foreign["t_ms"] = log["time"] * 1000.0
    for name in names[1:]:
        foreign[f"X {name} [2]"] = log[name] / 2.0
    write_log(tmp_path / "foreign.csv", foreign)
    lines = ['time = { column = "t_ms", scale = 0.001 }']
    lines += [f'{name} = {{ column = "X {name} [2]", scale = 2.0 }}' for name in names[1:]]
    (tmp_path / "map.toml").write_text("\n".join(lines))
    replay(fmu, tmp_path / "foreign.csv", "--columns", tmp_path / "map.toml")
    result = fmpy.read_csv(tmp_path / "result.csv")
    for name in result.dtype.names:
        assert np.allclose(result[name], expected[name], rtol=1e-9, atol=1e-9), name


def test_parquet_and_mdf4_are_read_as_csv_is(fmu, extracted, replay, tmp_path):
    """Files of pyarrow and asammdf, missing and infinite samples among them, give the bytes that CSV gives."""
    log = make_log(fmpy.read_model_description(extracted(fmu)), rows=60, seed=35, gaps=0.1)
    names = log.dtype.names
    log[names[1]][7] = np.inf
    write_log(tmp_path / "log.csv", log)
    parquet.write_table(pyarrow.table({name: log[name] for name in names}), tmp_path / "log.parquet")
    measured = [asammdf.Signal(log[name], log["time"], name=name) for name in names[1:]]
    with asammdf.MDF(version="4.10") as file:
        file.append(measured)
        file.save(tmp_path / "log.mf4", overwrite=True)
    replay(fmu, tmp_path / "log.csv")
    expected = (tmp_path / "result.csv").read_bytes()
    for ending in ["parquet", "mf4"]:
        (tmp_path / "result.csv").unlink()
        replay(fmu, tmp_path / f"log.{ending}")
        assert (tmp_path / "result.csv").read_bytes() == expected, ending


def test_the_result_may_be_parquet(fmu, extracted, replay, program, tmp_path):
    write_log(tmp_path / "log.csv", make_log(fmpy.read_model_description(extracted(fmu)), rows=20, seed=36))
    replay(fmu, tmp_path / "log.csv")
    expected = fmpy.read_csv(tmp_path / "result.csv")
    out = tmp_path / "result.parquet"
    subprocess.run([program("replay"), str(fmu), str(tmp_path / "log.csv"), "--out", str(out)], check=True)
    table = parquet.read_table(out)
    assert set(table.column_names) == set(expected.dtype.names)
    for name in table.column_names:
        assert np.array_equal(table[name].to_numpy(), expected[name].astype(float)), name


def test_the_sample_period_follows_a_slower_log(fmu, extracted, replay, tmp_path):
    description = fmpy.read_model_description(extracted(fmu))
    dt = 1.25 * period(description)
    log = make_log(description, rows=50, seed=33, dt=dt)
    write_log(tmp_path / "log.csv", log)
    done = replay(fmu, tmp_path / "log.csv")
    assert "sample_period" in done.stderr
    alone = fmpy.read_csv(tmp_path / "result.csv")
    done = replay(fmu, tmp_path / "log.csv", "--set", f"sample_period={dt}")
    assert "sample_period" not in done.stderr
    given = fmpy.read_csv(tmp_path / "result.csv")
    assert alone.tobytes() == given.tobytes()


def test_refusals_are_one_line_and_write_nothing(fmu, extracted, replay, tmp_path):
    description = fmpy.read_model_description(extracted(fmu))
    log = make_log(description, rows=5)
    write_log(tmp_path / "good.csv", log)
    rows = (tmp_path / "good.csv").read_text().splitlines()
    cases = [
        ("\n".join(rows[:1]), [], "no sample"),
        ("", [], "bad.csv"),
        ("\n".join(rows[:2]), [], "at least 2"),
        ("\n".join([rows[0].replace("time", "t"), *rows[1:]]), [], "no column 'time'"),
        ("\n".join([*rows[:3], rows[2]]), [], "bad.csv:4"),
        ("\n".join([*rows[:2], rows[2].rsplit(",", 1)[0] + ",oops"]), [], "bad.csv:3"),
        ("\n".join([*rows[:2], rows[2] + ",1"]), [], "bad.csv:3"),
        ("\n".join(rows), ["--set", "nonsense=1"], "nonsense"),
        ("\n".join(rows), ["--set", "sample_period=-1"], "allowed: "),
        ("\n".join(rows), ["--set", "sample_period"], "name=value"),
        ("\n".join(rows), ["--columns", str(tmp_path / "absent.toml")], "absent.toml"),
    ]
    for text, options, word in cases:
        (tmp_path / "bad.csv").write_text(text)
        done = replay(fmu, tmp_path / "bad.csv", *options, check=False)
        assert done.returncode == 2 and word in done.stderr, (word, done)
        errors = [line for line in done.stderr.splitlines() if line.startswith("replay:")]
        assert len(errors) == 1 and not (tmp_path / "result.csv").exists(), done
    done = replay(tmp_path / "absent.fmu", tmp_path / "good.csv", check=False)
    assert done.returncode == 2 and "absent.fmu" in done.stderr
