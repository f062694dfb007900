#!/usr/bin/env bash
# Builds the wheel and tests it as a user has it: in a clean virtual environment, with no Rust on the path.
# Arguments go to pytest; `--environment` alone only makes the virtual environment.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."

source tests/fmpy/environment.sh
target=$(cargo metadata --format-version 1 --no-deps | .venv/bin/python -c 'import json,sys; print(json.load(sys.stdin)["target_directory"])')
clean=$target/wheel
[ -x "$clean/venv/bin/python" ] || python3 -m venv "$clean/venv"
"$clean/venv/bin/pip" install --quiet --disable-pip-version-check -r "$here/requirements.txt"
.venv/bin/pip install --quiet --disable-pip-version-check "maturin>=1.9,<2" wheel
[ "${1:-}" != --environment ] || exit 0

# What the wheel holds is built with the others, with the same choice of features.
cargo build --quiet "${workspace[@]}" --lib --bins --examples
fmus=$(mktemp -d)
trap 'rm -rf "$fmus"' EXIT
"$target/debug/pack" all --out "$fmus" >/dev/null
rm -f "$clean"/*.whl
for name in libwheelstate_python.so libwheelstate_python.dylib wheelstate_python.dll; do
  [ -f "$target/debug/$name" ] && library=$target/debug/$name
done
PATH="$PWD/.venv/bin:$PATH" WHEELSTATE_FMUS="$fmus" WHEELSTATE_EXTENSION="$library" \
  .venv/bin/pip wheel --quiet --disable-pip-version-check --no-build-isolation --no-deps --wheel-dir "$clean" identify/python
"$clean/venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --force-reinstall "$clean"/wheelstate-*.whl

env -u CARGO_HOME -u RUSTUP_HOME PATH="$clean/venv/bin" "$clean/venv/bin/python" -m pytest -q -n auto --dist worksteal "$here" "$@"
