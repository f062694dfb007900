"""Centre of gravity of a wheel loader that accelerates, brakes and coasts, from the slip of its axles.

    identify simulate wheel-loader --scenario accelerate-brake --seed 1 --out wheel_loader.csv
    pack WheelLoader --out .
    python wheel_loader.py WheelLoader.fmu wheel_loader.csv
"""

import sys

import fmpy

fmu, path = sys.argv[1:]
log = fmpy.read_csv(path)
period = log["time"][1] - log["time"][0]
result = fmpy.simulate_fmu(
    fmu,
    input=log,
    start_values={"loader.mass": 4700.0, "initial.cg_ratio": 0.5},
    stop_time=log["time"][-1],
    output_interval=period,
)

for row in range(500, len(log), 500):
    for name in ("cg_ratio", "cg_height"):
        estimate, std, truth = result[name][row], result[name + "_std"][row], log["true_" + name][row]
        print(f"{log['time'][row]:8.2f} s  {name:<20} {estimate:10.4f} +- {std:8.4f}   true {truth:10.4f}")
