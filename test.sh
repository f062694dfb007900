#!/usr/bin/env bash
# Everything that must hold before a change is merged: format, lints, Rust tests, the FMUs in fmpy, the Python package.
# Needs Rust (rustup) and Python 3.11 or later with venv; makes its own virtual environment in .venv.
set -euo pipefail
cd "$(dirname "$0")"

step() { printf '\n\033[1m== %s\033[0m\n' "$*"; }

step "format"
cargo fmt --all --check

step "Python environment, beside the build"
source tests/fmpy/environment.sh
(.venv/bin/pip install --quiet --disable-pip-version-check -r tests/fmpy/requirements.txt && tests/python/run.sh --environment) &
environment=$!

step "lints"
cargo clippy "${workspace[@]}" --all-targets --quiet -- -D warnings

step "Rust tests"
cargo test "${workspace[@]}" --quiet

step "licences and sources of dependencies"
if cargo deny --version >/dev/null 2>&1; then
  cargo deny --workspace --log-level error check licenses bans sources # advisories need the network: the release workflow
else
  echo "SKIPPED: cargo-deny is not installed (cargo install --locked cargo-deny); tests/fmpy/test_dependencies.py reads the licences"
fi

step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc "${workspace[@]}" --no-deps --quiet

step "FMUs and commands from Python"
wait "$environment"
tests/fmpy/run.sh

step "Python package from its wheel, without Rust"
tests/python/run.sh

step "all passed"
