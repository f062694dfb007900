"""Mass of the person on a nursing robot that stops and goes; another person sits down at 16 s. From the wheels alone.

    identify simulate nursing-robot --scenario new-patient --seed 6 --out nursing_robot.csv
    pack NursingRobot --out .
    python nursing_robot.py NursingRobot.fmu nursing_robot.csv
"""

import sys

import fmpy

fmu, path = sys.argv[1:]
log = fmpy.read_csv(path)
period = log["time"][1] - log["time"][0]
result = fmpy.simulate_fmu(
    fmu,
    input=log,
    start_values={"robot.mass": 160.0, "rolling.coefficient": 0.015},
    stop_time=log["time"][-1],
    output_interval=period,
)

for row in range(400, len(log), 400):
    for name in ("load_mass", "body_pitch"):
        estimate, std, truth = result[name][row], result[name + "_std"][row], log["true_" + name][row]
        print(f"{log['time'][row]:8.2f} s  {name:<20} {estimate:10.4f} +- {std:8.4f}   true {truth:10.4f}")
