"""Slope and speed of a wheelchair that climbs a ramp and rolls down again.

    identify simulate wheelchair --scenario climb --seed 1 --out wheelchair.csv
    pack Wheelchair --out .
    python wheelchair.py Wheelchair.fmu wheelchair.csv
"""

import math
import sys

import fmpy

fmu, path = sys.argv[1:]
log = fmpy.read_csv(path)
period = log["time"][1] - log["time"][0]
result = fmpy.simulate_fmu(
    fmu,
    input=log,
    start_values={"initial.heading": math.pi / 2},
    stop_time=log["time"][-1],
    output_interval=period,
)

for row in range(100, len(log), 100):
    for name in ("slope", "speed"):
        estimate, std, truth = result[name][row], result[name + "_std"][row], log["true_" + name][row]
        print(f"{log['time'][row]:8.2f} s  {name:<20} {estimate:10.4f} +- {std:8.4f}   true {truth:10.4f}")
