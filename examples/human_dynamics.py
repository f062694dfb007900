"""Torque at the lumbar spine and force of the seat on a person who reaches forward while the seat brakes.

    identify simulate human-dynamics --scenario seated-braking --seed 1 --out human_dynamics.csv
    pack HumanDynamics --out .
    python human_dynamics.py HumanDynamics.fmu human_dynamics.csv
"""

import sys

import fmpy

fmu, path = sys.argv[1:]
log = fmpy.read_csv(path)
period = log["time"][1] - log["time"][0]
result = fmpy.simulate_fmu(
    fmu,
    input=log,
    start_values={"body.height": 1.7, "body.mass": 65.0, "use.seat_wrench": True, "use.hand_wrench": True, "use.foot_wrench": True},
    stop_time=log["time"][-1],
    output_interval=period,
)

for row in range(100, len(log), 100):
    for name in ("tau_lumbar_y", "seat_wrench_force_x"):
        estimate, std, truth = result[name][row], result[name + "_std"][row], log["true_" + name][row]
        print(f"{log['time'][row]:8.2f} s  {name:<20} {estimate:10.4f} +- {std:8.4f}   true {truth:10.4f}")
