"""Fits nursing robot logs of 1e5, 1e6 and, with --large, 1e7 rows of ten columns, and with --logs N as many logs of
40 s in one fit; prints processor time (user and system) and the largest memory, and beside them what polars and pyarrow take
only to read the same file, each in a process of its own. The rows are a simulated ride again and again with fresh noise.

    pip install numpy polars pyarrow
    cargo build --release -p wheelstate-identify
    python tests/bench/scaling.py target/release/identify [--large] [--logs 1000]
"""

import argparse
import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path

CHANNELS = ["torque_left", "torque_right", "speed", "yaw_rate", "tilt", "tilt_rate", "roll", "roll_rate", "accel_x"]
READ = {
    "csv": "import os; os.environ['POLARS_MAX_THREADS'] = '1'; import polars; polars.read_csv({path!r})",
    "parquet": "import pyarrow.parquet as p; p.read_table({path!r}, use_threads=False)",
}


def cost(command):
    """Processor time in s and largest memory in MB of a command; a fit may end with warnings."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    process.returncode = code
    if code not in (0, 1):
        sys.exit(f"{command}: exit code {code}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3


def write(ride, rows, paths):
    """The ride as often as it takes, with a third of its own noise on top, as CSV and Parquet."""
    import numpy as np
    import polars

    ride = polars.read_csv(ride, infer_schema_length=None)
    rng = np.random.default_rng(0)
    columns = {"time": np.round(np.arange(rows) * 0.01, 2)}
    for name in CHANNELS:
        values = ride[name].to_numpy()[:-1]
        noise = rng.standard_normal(rows) * np.median(np.abs(np.diff(values))) / 3
        columns[name] = np.round(np.resize(values, rows) + noise, 5)
    frame = polars.DataFrame(columns)
    frame.write_csv(paths["csv"])
    frame.write_parquet(paths["parquet"])


def simulate(identify, path, seed):
    scenario = ["nursing-robot", "--scenario", "identification", "--seed", str(seed)]
    command = [identify, "simulate", *scenario, "--out", path]
    subprocess.run(command, check=True, capture_output=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("identify")
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--logs", type=int, default=0)
    arguments = parser.parse_args()
    print(f"{'log':12} {'fit':>8} {'memory':>9} {'only read':>10} {'memory':>9}  peer")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        ride = str(folder / "ride.csv")
        simulate(arguments.identify, ride, 1)
        for rows in [100_000, 1_000_000, 10_000_000][: 3 if arguments.large else 2]:
            paths = {ending: str(folder / f"{rows:.0e}.{ending}") for ending in READ}
            # A process counts as its own the memory of the one that started it: this one stays small.
            maker = multiprocessing.get_context("spawn").Process(target=write, args=(ride, rows, paths))
            maker.start()
            maker.join()
            for ending, path in paths.items():
                seconds, memory = cost([arguments.identify, "fit", "nursing-robot", path])
                peer, peak = cost([sys.executable, "-c", READ[ending].format(path=path)])
                name = "polars" if ending == "csv" else "pyarrow"
                here, there = f"{seconds:6.2f} s {memory:6.0f} MB", f"{peer:8.2f} s {peak:6.0f} MB"
                print(f"{Path(path).name:12} {here} {there}  {name}", flush=True)
                os.remove(path)
        if arguments.logs:
            paths = [str(folder / f"{seed}.csv") for seed in range(arguments.logs)]
            for seed, path in enumerate(paths):
                simulate(arguments.identify, path, seed)
            seconds, memory = cost([arguments.identify, "fit", "nursing-robot", *paths])
            print(f"{arguments.logs} logs {seconds:9.2f} s {memory:6.0f} MB")


if __name__ == "__main__":
    main()
