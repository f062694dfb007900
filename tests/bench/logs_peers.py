"""Reads an hour at 100 Hz with ten columns (360000 rows) in polars (one thread), pyarrow and asammdf, runs the Rust
benchmark beside them and prints the ratios.

    pip install numpy polars pyarrow asammdf
    python tests/bench/logs_peers.py
"""

import os
import re
import subprocess
import tempfile
import time
from pathlib import Path

os.environ["POLARS_MAX_THREADS"] = "1"

import numpy as np
import polars
import pyarrow
import pyarrow.parquet
from asammdf import MDF, Signal

UNITS = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0}
ROWS = 360_000


def best(function, repeats=5):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def select(path, names):
    with MDF(path) as file:
        file.select(names)


def peers(folder):
    time_ = np.arange(ROWS) * 0.01
    columns = {f"channel_{c}": np.sin(np.arange(ROWS) * 0.0137 + c) for c in range(9)}
    table = polars.DataFrame({"time": time_, **columns})
    table.write_csv(folder / "hour.csv")
    pyarrow.parquet.write_table(table.to_arrow(), folder / "hour.parquet")
    with MDF() as file:
        file.append([Signal(values, time_, name=name) for name, values in columns.items()])
        file.save(folder / "hour.mf4", overwrite=True)
    pyarrow.set_cpu_count(1)
    return {
        ("csv", "polars"): best(lambda: polars.read_csv(folder / "hour.csv")),
        ("parquet", "pyarrow"): best(lambda: pyarrow.parquet.read_table(folder / "hour.parquet", use_threads=False)),
        ("mf4", "asammdf select"): best(lambda: select(folder / "hour.mf4", list(columns))),
    }


def ours():
    text = subprocess.run(
        ["cargo", "bench", "--package", "wheelstate-log", "--bench", "logs"], check=True, capture_output=True, text=True
    ).stdout
    found = re.findall(r"[├╰]─ (csv|parquet|mf4) +([\d.]+) (\S+)", text)
    return {ending: float(value) * UNITS[unit] for ending, value, unit in found}


def main():
    with tempfile.TemporaryDirectory() as folder:
        there = peers(Path(folder))
    here = ours()
    print(f"{'format':8} {'here':>9} {'there':>9}  ratio  peer")
    for (ending, peer), seconds in there.items():
        print(f"{ending:8} {here[ending] * 1e3:6.0f} ms {seconds * 1e3:6.0f} ms {seconds / here[ending]:6.2f}  {peer}")


if __name__ == "__main__":
    main()
