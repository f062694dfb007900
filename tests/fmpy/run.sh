#!/usr/bin/env bash
# Builds and packs all FMUs and holds them against the native estimators with fmpy.
# Makes its own virtual environment in .venv; arguments go to pytest.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."

source "$here/environment.sh"
.venv/bin/pip install --quiet --disable-pip-version-check -r "$here/requirements.txt"
# The examples make Cargo choose the features as for tests.
cargo build --quiet "${workspace[@]}" --lib --bins --examples

target=$(cargo metadata --format-version 1 --no-deps | .venv/bin/python -c 'import json,sys; print(json.load(sys.stdin)["target_directory"])')
fmus=$(mktemp -d)
trap 'rm -rf "$fmus"' EXIT
"$target/debug/pack" all --out "$fmus" >/dev/null

WHEELSTATE_FMUS="$fmus" WHEELSTATE_BIN="$target/debug" .venv/bin/python -m pytest -q -n auto --dist worksteal "$here" "$@"
