"""Print the true parameters of a simulated log as --set options, to simulate the same machine and person again."""

import csv
import sys

with open(sys.argv[1], newline="") as file:
    names, first = [row for row, _ in zip(csv.reader(file), range(2))]
prefix = "true_"
for name, value in zip(names, first):
    # Constants of the machine are named as its parameters, with a dot.
    if name.startswith(prefix) and "." in name:
        print(f"--set {name[len(prefix):]}={value}", end=" ")
