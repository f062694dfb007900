#!/usr/bin/env bash
# Builds and packs all FMUs and holds them against the native estimators with fmpy.
# Makes its own virtual environment in .venv; arguments go to pytest.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."

[ -x .venv/bin/python ] || python3 -m venv .venv
.venv/bin/pip install --quiet --disable-pip-version-check -r "$here/requirements.txt"

# bindgen, below the `fmi` crate, wants a libclang and the compiler's own headers
site=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
export LIBCLANG_PATH="${LIBCLANG_PATH:-$site/clang/native}"
export BINDGEN_EXTRA_CLANG_ARGS="${BINDGEN_EXTRA_CLANG_ARGS:--I$(cc -print-file-name=include)}"
cargo build --quiet -p wheelstate-fmu --features import --bins --lib --example native
cargo build --quiet -p wheelstate-identify

target=$(cargo metadata --format-version 1 --no-deps | .venv/bin/python -c 'import json,sys; print(json.load(sys.stdin)["target_directory"])')
fmus=$(mktemp -d)
trap 'rm -rf "$fmus"' EXIT
"$target/debug/pack" all --out "$fmus" >/dev/null

WHEELSTATE_FMUS="$fmus" WHEELSTATE_BIN="$target/debug" .venv/bin/python -m pytest -q "$here" "$@"
