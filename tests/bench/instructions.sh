#!/usr/bin/env bash
# Instructions per step, outputs included, of each machine on a log of its built-in plant, counted by callgrind: the same on
# every run, whatever else the machine does. Needs valgrind.
set -euo pipefail
cd "$(dirname "$0")/../.."
command -v valgrind >/dev/null || { echo "SKIPPED: valgrind is not installed"; exit 0; }

counter=$(cargo bench --quiet --bench instructions --no-run --message-format=json | sed -n 's/.*"executable":"\([^"]*instructions-[^"]*\)".*/\1/p' | tail -1)
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT

count() { valgrind --tool=callgrind --callgrind-out-file=/dev/null "$counter" "$@" 2>&1 | awk '/Collected/ { print $4 }'; }
few=200 many=700
while read -r estimator vehicle scenario; do
  cargo run --quiet -p wheelstate-identify --bin identify -- simulate "$vehicle" --scenario "$scenario" --seed 1 --out "$logs/$vehicle.csv" >/dev/null
  least=$(count "$estimator" "$logs/$vehicle.csv" $few)
  most=$(count "$estimator" "$logs/$vehicle.csv" $many)
  printf '%-14s %8d instructions per step\n' "$estimator" $(((most - least) / (many - few)))
done <<'MACHINES'
NursingRobot nursing-robot coughs
WheelLoader wheel-loader bumpy-c
WheeledRobot wheeled-robot sine
Wheelchair wheelchair climb
HumanDynamics human-dynamics seated-braking
MACHINES
