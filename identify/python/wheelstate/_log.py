"""Logs: from files, tables and arrays, and back."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from . import _native
from ._progress import Bar, Progress

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import polars as pl
    import pyarrow as pa
    from numpy.typing import NDArray

Columns: TypeAlias = str | PathLike[str] | Mapping[str, Any] | None
"""A column map: a TOML file, or a mapping of the same shape."""


class Log:
    """A log: one time base and named channels in SI units, which never change. NaN is a missing sample.

    `log["speed"]` is a numpy array that looks at the log's own memory. Every library that knows Arrow's stream interface
    takes a log without copying a sample: `polars.DataFrame(log)`, `pyarrow.table(log)`, `duckdb.sql("from log")`.
    """

    def __init__(self, native: _native.Log) -> None:
        self._native = native

    @property
    def source(self) -> str:
        """The file's path, or what it was made from."""
        return self._native.source

    @property
    def sha256(self) -> str:
        """SHA-256 of the file, or of the samples of a table; empty for a simulated log."""
        return self._native.sha256

    @property
    def notes(self) -> list[str]:
        """What was guessed, repaired or left out while reading, one line each."""
        return self._native.notes

    @property
    def channels(self) -> list[str]:
        """Names of the channels, without `time`."""
        return self._native.channels

    @property
    def period(self) -> float:
        """The usual time between two samples, s."""
        return self._native.period

    @property
    def duration(self) -> float:
        """From the first sample to the last, s."""
        return self._native.duration

    @property
    def time(self) -> "NDArray[np.float64]":
        """Times of the samples, s."""
        return self["time"]

    def __len__(self) -> int:
        return len(self._native)

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __contains__(self, name: object) -> bool:
        return name == "time" or name in self._native.channels

    def keys(self) -> list[str]:
        """`time` and the names of the channels."""
        return ["time", *self._native.channels]

    def __getitem__(self, name: str) -> "NDArray[np.float64]":
        import numpy as np

        return np.asarray(self._native.samples(name))

    def within(
        self, start: float = float("-inf"), end: float = float("inf"), *, exclude: Sequence[tuple[float, float]] = ()
    ) -> "Log":
        """The samples from one time to another, s; those in the excluded spans are missing."""
        return Log(self._native.within((start, end), exclude))

    def write(self, path: str | PathLike[str]) -> None:
        """Writes .csv, .parquet or .mf4; every number reads back as the same bits."""
        self._native.write(path)

    def to_numpy(self) -> "NDArray[np.void]":
        """A structured array, as `fmpy.simulate_fmu(input=...)` takes it."""
        import numpy as np

        names = self.keys()
        table = np.empty(len(self), dtype=[(name, np.float64) for name in names])
        for name in names:
            table[name] = self[name]
        return table

    def to_pandas(self) -> "pd.DataFrame":
        """A pandas table."""
        import pandas as pd

        return pd.DataFrame({name: self[name] for name in self.keys()}, copy=False)

    def to_polars(self) -> "pl.DataFrame":
        """A polars table."""
        import polars as pl

        return pl.DataFrame(self)

    def to_arrow(self) -> "pa.Table":
        """A pyarrow table."""
        import pyarrow as pa

        return pa.table(self)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Arrow's stream interface: one batch of doubles; a missing sample is NaN."""
        return self._native.stream()

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpacked, (self._native.packed(),)

    def __repr__(self) -> str:
        return f"<Log {self.source}: {len(self)} samples, {self.duration:.2f} s, {len(self.channels)} channels>"

    def _repr_html_(self) -> str:
        rows = []
        for name in self.keys():
            values = self[name]
            known = values[values == values]
            span = f"{known.min():.6g} .. {known.max():.6g}" if len(known) else "missing"
            rows.append(f"<tr><td>{escape(name)}</td><td>{span}</td><td>{len(values) - len(known)}</td></tr>")
        head = "<tr><th>channel</th><th>range</th><th>missing samples</th></tr>"
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{head}{''.join(rows)}</table>"


LogLike: TypeAlias = "Log | str | PathLike[str] | Mapping[str, Any] | pd.DataFrame | _Stream"
"""Anything that becomes a log: a log, a file, a mapping of names to arrays, a table of pandas, polars or pyarrow."""


class _Stream(Protocol):
    """Anything with Arrow's stream interface."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...


def read(
    log: LogLike,
    columns: Columns = None,
    *,
    machine: str | None = None,
    name: str | None = None,
    progress: Progress = None,
) -> Log:
    """Reads a log from a file (its ending tells the format), or takes it from a table in memory.

    `columns` is a column map for logs with other names and units. With `machine` the units of its inputs are checked, and
    columns that are no inputs never refuse the log; without it every column of a text file must be numeric. `name` stands
    for the file where there is none.

    >>> import wheelstate
    >>> log = wheelstate.read({"t": [0.0, 0.01, 0.02], "v [km/h]": [3.6, 7.2, None]}, {"time": "t", "speed": "v"})
    >>> log["speed"].tolist()
    [1.0, 2.0, nan]
    """
    if isinstance(log, Log):
        if columns is None:
            return log
        name = name or log.source
    map_file = fspath(columns) if isinstance(columns, str | PathLike) else None
    map_json = json.dumps(columns) if isinstance(columns, Mapping) else None
    if isinstance(log, str | PathLike):
        with Bar(progress) as tell:
            return Log(_native.read(fspath(log), map_file, map_json, machine, tell))
    name = name or "table"
    if isinstance(log, Mapping) or type(log).__module__.split(".")[0] == "pandas":
        return Log(_native.from_columns(name, _columns(log), map_file, map_json, machine))
    if not hasattr(log, "__arrow_c_stream__"):
        raise TypeError(f"a file, a log, a table or a mapping of arrays is expected, not {type(log).__name__}")
    return Log(_native.from_arrow(name, log, map_file, map_json, machine))


def read_all(logs: "LogLike | Sequence[LogLike]", columns: Columns, machine: str, progress: Progress) -> list[Log]:
    """All logs of a call: one or several."""
    several = logs if isinstance(logs, list | tuple) else [logs]
    read_logs = []
    for index, log in enumerate(several):
        in_memory = not isinstance(log, Log | str | PathLike)
        name = f"table {index + 1}" if in_memory and len(several) > 1 else None
        read_logs.append(log if isinstance(log, Log) else read(log, columns, machine=machine, name=name, progress=progress))
    return read_logs


def _columns(table: Any) -> list[tuple[str, object | None, bool, str]]:
    """Columns of a mapping or of a pandas table as arrays of doubles; a named index is a column, as in Parquet files."""
    pairs = [(str(name), table[name]) for name in table]
    index = getattr(table, "index", None)
    if index is not None and not callable(index) and index.name is not None:
        pairs.insert(0, (str(index.name), index))
    return [_column(name, values) for name, values in pairs]


def _column(name: str, values: Any) -> tuple[str, object | None, bool, str]:
    import numpy as np

    try:
        if hasattr(values, "to_numpy") and type(values).__module__.split(".")[0] == "pandas" and values.dtype.kind in "iufb":
            array = values.to_numpy(dtype=np.float64, na_value=np.nan)
        else:
            array = np.asarray(values)
            if array.dtype.kind in "mM":
                missing = np.isnat(array)
                kind = "datetime64[ns]" if array.dtype.kind == "M" else "timedelta64[ns]"
                whole, rest = np.divmod(array.astype(kind).astype(np.int64), 1_000_000_000)
                seconds = np.where(missing, np.nan, whole + rest / 1e9)
                return name, np.ascontiguousarray(seconds, dtype=np.float64), True, ""
            if array.dtype.kind in "US" or (array.dtype.kind in "OT" and any(isinstance(value, str) for value in array[:9])):
                return name, None, False, "text"
            array = array.astype(np.float64)
    except (TypeError, ValueError):
        return name, None, False, "something that is no number"
    if array.ndim != 1:
        raise _native.LogError(f"{name}: one number per sample is expected, not an array of shape {array.shape}")
    return name, np.ascontiguousarray(array), False, ""


def _unpacked(data: bytes) -> Log:
    return Log(_native.Log.unpacked(data))
