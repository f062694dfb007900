#!/usr/bin/env bash
# From a log to a running FMU: simulates (or takes) an identification log, fits the person's
# parameters, packs them into NursingRobot.fmu, runs it in fmpy and compares with the truth.
#
#   ./demo.sh                      everything from the built-in plant
#   ./demo.sh --seed 7             another person
#   ./demo.sh --log ride.mf4       fit your own log (CSV, Parquet or MDF4), then run the FMU over it;
#                                  --columns MAP.toml for other names and units
#   ./demo.sh --out DIR            where the files go (default: demo-output)
#
# Needs Rust (rustup) and Python 3 with venv; makes its own virtual environment in .venv.
set -euo pipefail

here=$(cd "$(dirname "$0")" && pwd)
out="$PWD/demo-output" log="" columns="" seed=6
while [ $# -gt 0 ]; do
  case "$1" in
    --log) log=$(realpath "${2:?--log needs a file}"); shift 2 ;;
    --columns) columns=$(realpath "${2:?--columns needs a file}"); shift 2 ;;
    --seed) seed=${2:?--seed needs a number}; shift 2 ;;
    --out) mkdir -p "${2:?--out needs a folder}"; out=$(realpath "$2"); shift 2 ;;
    -h|--help) sed -n '2,12s/^# \{0,1\}//p' "$0"; exit 0 ;;
    *) echo "demo.sh: unknown option '$1' (see --help)" >&2; exit 2 ;;
  esac
done
mkdir -p "$out"

say() { printf '\n\033[1m%s\033[0m\n' "$*"; }

say "1/5 Python environment, beside the build"
cd "$here"
{
  python3 -m venv .venv
  .venv/bin/pip install --quiet --disable-pip-version-check -r tests/demo/requirements.txt
} &
environment=$!

say "2/5 Building (release)"
# Parquet and MDF4 readers double the build; CSV logs do without.
features=(--no-default-features)
case "$log" in *.csv|"") ;; *) features=() ;; esac
cargo build --release --quiet -p wheelstate-fmu -p wheelstate-identify "${features[@]}"
target=${CARGO_TARGET_DIR:-$here/target}/release
wait "$environment"

cd "$out"
if [ -z "$log" ]; then
  say "3/5 A ride to identify from: built-in plant, seed $seed"
  "$target/identify" simulate nursing-robot --scenario identification --seed "$seed" --out identification.csv
  # The same machine and floor, another ride: stop and go, and another person sits down at 16 s.
  # shellcheck disable=SC2046 # one word per option is wanted
  "$target/identify" simulate nursing-robot --scenario new-patient --seed "$seed" \
    $("$here/.venv/bin/python" "$here/tests/demo/same_machine.py" identification.csv) --out ride.csv
  fit_log=identification.csv ride=ride.csv
else
  say "3/5 Your log: $log"
  "$target/identify" convert nursing-robot "$log" ${columns:+--columns "$columns"} --out ride.csv
  fit_log=ride.csv ride=ride.csv
fi

say "4/5 Fitting and packing"
# Exit code 1 means "done, with warnings": some parameters stay at their defaults.
"$target/identify" fit nursing-robot "$fit_log" \
  --out fit.json --ssv fit.ssv --report fit.html || [ $? -eq 1 ]
"$target/pack" NursingRobot --params fit.json --out . || [ $? -eq 1 ]

say "5/5 Running NursingRobot.fmu in fmpy"
"$here/.venv/bin/python" "$here/tests/demo/demo.py" --fmu NursingRobot.fmu --log "$ride" --fit fit.json --fit-log "$fit_log" \
  --result result.csv --plot result.png --report report.html
say "Written to $out:"
ls -1 "$out"
