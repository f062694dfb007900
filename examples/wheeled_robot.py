"""Lateral speed and yaw rate of a robot that changes lanes.

    identify simulate wheeled-robot --scenario lane-change --seed 1 --out wheeled_robot.csv
    pack WheeledRobot --out .
    python wheeled_robot.py WheeledRobot.fmu wheeled_robot.csv
"""

import sys

import fmpy

fmu, path = sys.argv[1:]
log = fmpy.read_csv(path)
period = log["time"][1] - log["time"][0]
result = fmpy.simulate_fmu(
    fmu,
    input=log,
    start_values={"vehicle.mass": 60.0, "tire.front.friction": 0.8},
    stop_time=log["time"][-1],
    output_interval=period,
)

for row in range(100, len(log), 100):
    for name in ("speed_y", "yaw_rate"):
        estimate, std, truth = result[name][row], result[name + "_std"][row], log["true_" + name][row]
        print(f"{log['time'][row]:8.2f} s  {name:<20} {estimate:10.4f} +- {std:8.4f}   true {truth:10.4f}")
