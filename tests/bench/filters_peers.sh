#!/usr/bin/env bash
# The filters beside Eigen by hand (GCC, -O3 -march=native), both in one run: nanoseconds per step and their ratio to
# Eigen's fastest form. Needs g++ and Eigen 3 (EIGEN: its folder, /usr/include/eigen3 if not set).
set -euo pipefail
cd "$(dirname "$0")/../.."
eigen=${EIGEN:-/usr/include/eigen3}
command -v g++ >/dev/null || { echo "SKIPPED: no g++"; exit 0; }
[ -d "$eigen/Eigen" ] || { echo "SKIPPED: no Eigen in $eigen"; exit 0; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
g++ -O3 -march=native -std=c++17 -I "$eigen" tests/bench/filters_peers.cpp -o "$work/peers"
cargo bench --quiet -p wheelstate --bench filters --no-run
"$work/peers" >"$work/theirs"
cargo bench --quiet -p wheelstate --bench filters -- --sample-count 1000 >"$work/ours"
python3 - "$work" <<'PRINT'
import re, sys
work = sys.argv[1]
units = {"ns": 1, "µs": 1e3}
ours = {name: float(value) * units[unit] for name, value, unit in re.findall(r"(\w+_\d+_\d+)\s+([\d.]+) (ns|µs)", open(f"{work}/ours").read())}
theirs = {}
for line in open(f"{work}/theirs"):
    problem, form, value = line.rstrip("\n").split("\t")
    theirs.setdefault(problem, []).append((float(value), form))
for problem, forms in theirs.items():
    best, form = min(forms)
    print(f"{problem:9} wheelstate {ours[problem]:7.1f} ns   Eigen {best:7.1f} ns ({form})   {best / ours[problem]:5.2f} x")
    for value, form in sorted(forms)[1:]:
        print(f"{'':47}{value:7.1f} ns ({form})")
PRINT
