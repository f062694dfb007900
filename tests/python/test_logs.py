"""Logs from files, tables and arrays, and back."""

import datetime
import pickle

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet
import pytest
import wheelstate

MAP = {"time": "t", "speed": {"column": "v", "unit": "km/h"}, "tilt": {"column": "pitch", "unit": "deg", "optional": True}}


def columns(rows=50):
    time = 0.01 * np.arange(rows)
    speed = 3.6 * np.sin(time)
    speed[7] = np.nan
    return {"t": time, "v": speed, "gear": np.arange(rows) % 5}


def same(log, rows=50):
    given = columns(rows)
    assert log.keys()[:2] == ["time", "speed"]
    np.testing.assert_array_equal(log.time, given["t"])
    np.testing.assert_allclose(log["speed"], given["v"] / 3.6, rtol=1e-15)
    np.testing.assert_array_equal(log["gear"], given["gear"])


@pytest.mark.parametrize(
    "table",
    [
        columns,
        lambda: pd.DataFrame(columns()),
        lambda: pd.DataFrame(columns()).convert_dtypes(),
        lambda: pd.DataFrame(columns()).set_index("t"),
        lambda: pl.DataFrame(columns()),
        lambda: pa.table(columns()),
        lambda: pa.table({name: pa.chunked_array([values[:20], values[20:]]) for name, values in columns().items()}),
        lambda: {name: [None if np.isnan(v) else float(v) for v in values] for name, values in columns().items()},
    ],
    ids=["arrays", "pandas", "pandas with nullable types", "pandas with an index", "polars", "arrow", "arrow in pieces", "lists"],
)
def test_every_kind_of_table_gives_the_same_log(table):
    same(wheelstate.read(table(), MAP))


@pytest.mark.parametrize("ending", ["csv", "parquet", "mf4"])
def test_a_written_log_reads_back_as_the_same_bits(ending, tmp_path, drive):
    path = tmp_path / f"log.{ending}"
    drive.write(path)
    back = wheelstate.read(path)
    assert back.keys() == drive.keys() and back.source == str(path) and len(back.sha256) == 64
    for name in drive.keys():
        np.testing.assert_array_equal(back[name], drive[name])


def test_every_numeric_type_of_arrow_is_taken_and_a_null_is_a_missing_sample():
    numbers = {
        "f16": pa.array(np.array([1, 2, 3], dtype=np.float16)),
        **{name: pa.array([1, None, 3], type=getattr(pa, name)()) for name in ("float32", "float64")},
        **{name: pa.array([1, None, 3], type=getattr(pa, name)()) for name in ("int8", "int16", "int32", "int64")},
        **{name: pa.array([1, None, 3], type=getattr(pa, name)()) for name in ("uint8", "uint16", "uint32", "uint64")},
        "decimal": pa.array([1, None, 3], type=pa.decimal128(9, 2)),
    }
    log = wheelstate.read(pa.table({"time": [0.0, 1.0, 2.0], **numbers, "truth": [True, None, False]}))
    for name in numbers:
        expected = [1.0, 2.0, 3.0] if name == "f16" else [1.0, np.nan, 3.0]
        np.testing.assert_array_equal(log[name], expected, err_msg=name)
    np.testing.assert_array_equal(log["truth"], [1.0, np.nan, 0.0])


def test_times_by_type_become_seconds_from_every_library():
    start = datetime.datetime(2026, 5, 4, 12)
    stamps = [start + datetime.timedelta(milliseconds=10 * k) for k in range(5)]
    expected = start.replace(tzinfo=datetime.timezone.utc).timestamp() + 0.01 * np.arange(5)
    for table in (
        pd.DataFrame({"time": stamps, "speed": 1.0}),
        pl.DataFrame({"time": stamps, "speed": [1.0] * 5}),
        pa.table({"time": pa.array(stamps, type=pa.timestamp("us")), "speed": [1.0] * 5}),
        {"time": np.array(stamps, dtype="datetime64[us]"), "speed": np.ones(5)},
    ):
        np.testing.assert_allclose(wheelstate.read(table).time, expected, rtol=0, atol=3e-7)
    durations = pa.array([datetime.timedelta(milliseconds=10 * k) for k in range(5)], type=pa.duration("ms"))
    log = wheelstate.read(pa.table({"time": durations, "speed": [1.0] * 5}))
    np.testing.assert_allclose(log.time, 0.01 * np.arange(5), rtol=1e-15)


def test_text_beside_numbers_is_left_out_and_text_that_is_needed_is_refused():
    table = {"time": [0.0, 1.0], "speed": [1.0, 2.0], "driver": ["Ann", "Ben"]}
    for kind in (dict, pd.DataFrame, pl.DataFrame):
        assert wheelstate.read(kind(table)).channels == ["speed"]
        with pytest.raises(wheelstate.LogError, match="driver.*text"):
            wheelstate.read(kind(table), {"time": "time", "speed": "driver"})


def test_arrays_and_tables_look_at_the_logs_own_memory(drive):
    array = drive["speed"]
    address = array.__array_interface__["data"][0]
    assert drive["speed"].__array_interface__["data"][0] == address
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1.0
    arrow = pa.table(drive)
    assert arrow["speed"].chunk(0).buffers()[1].address == address
    polars = pl.DataFrame(drive)
    assert polars["speed"].to_numpy(allow_copy=False).__array_interface__["data"][0] == address
    assert np.shares_memory(drive.to_pandas()["speed"].to_numpy(), array)
    del drive, arrow
    assert np.isfinite(polars["speed"].sum()), "the memory stays as long as somebody looks"


def test_memory_outlives_its_log():
    log = wheelstate.read(columns(100_000), MAP)
    array, arrow = log["speed"], pa.table(log)
    expected = array.copy()
    del log
    for _ in range(20):
        wheelstate.read(columns(100_000), MAP)
    np.testing.assert_array_equal(array, expected)
    np.testing.assert_array_equal(arrow["speed"].to_numpy(), expected)


def test_what_cannot_be_a_log_is_refused_in_one_line(tmp_path):
    cases = [
        ({"time": [0.0, 0.0], "speed": [1.0, 2.0]}, None, "time"),
        ({"time": [0.0, 1.0], "speed": [1.0]}, None, "'time' has 2 samples and 'speed' has 1"),
        ({"speed": [1.0, 2.0]}, None, "time"),
        ({"time": [0.0, 1.0], "v": [1.0, 2.0]}, {"speed": {"column": "w"}}, "w"),
        ({"time": [0.0, 1.0], "v": [1.0, 2.0]}, {"speed": {"column": "v", "unit": "furlong"}}, "furlong"),
        ({"time": [0.0, 1.0], "v": np.zeros((2, 3))}, None, "one number per sample"),
    ]
    for table, mapping, words in cases:
        with pytest.raises(wheelstate.Error, match=words) as caught:
            wheelstate.read(table, mapping)
        assert "\n" not in str(caught.value) and isinstance(caught.value, ValueError)
    with pytest.raises(wheelstate.LogError, match="nowhere.csv: No such file"):
        wheelstate.read(tmp_path / "nowhere.csv")
    with pytest.raises(TypeError, match="not int"):
        wheelstate.read(3)
    with pytest.raises(KeyError, match="did you mean 'speed'"):
        wheelstate.read({"time": [0.0, 1.0], "speed": [1.0, 2.0]})["sped"]


def test_a_log_survives_pickling_and_shows_itself(drive):
    again = pickle.loads(pickle.dumps(drive))
    assert (again.source, again.sha256, again.notes) == (drive.source, drive.sha256, drive.notes)
    for name in drive.keys():
        np.testing.assert_array_equal(again[name], drive[name])
    assert "samples" in repr(drive) and "<table>" in drive._repr_html_()
    assert drive.to_numpy().dtype.names[0] == "time" and "speed" in drive and "velocity" not in drive
