#!/usr/bin/env bash
# Builds a wheel for every platform into OUT and says which it had to skip.
#
#   identify/python/wheels.sh OUT                         linux64, aarch64-linux, win64
#   identify/python/wheels.sh OUT linux64                 this one only
#
# The FMUs in each wheel hold the libraries of all these platforms, as far as fmu/targets.sh can build them here. The Linux
# wheels are manylinux2014: their module needs no glibc newer than 2.17, which maturin checks. Compilers as in
# fmu/targets.sh; all downloads and builds stay below target/platforms (WHEELSTATE_PLATFORMS: another folder).
set -euo pipefail

case "${1:-}" in
  -h|--help|"") sed -n '2,9s/^# \{0,1\}//p' "$0"; [ -n "${1:-}" ]; exit ;;
esac
mkdir -p "$1"
out=$(realpath "$1")
shift
cd "$(dirname "$0")/../.."
root=$PWD
work=${WHEELSTATE_PLATFORMS:-$root/target/platforms}
mkdir -p "$work"
[ $# -gt 0 ] || set -- linux64 aarch64-linux win64

say() { printf '%s\n' "$*" >&2; }
skip() { say "SKIPPED $platform: $*"; skipped+=("$platform"); }
source fmu/toolchains.sh

[ -x "$work/maturin/bin/maturin" ] || { python3 -m venv "$work/maturin" &&
  "$work/maturin/bin/pip" install --quiet --disable-pip-version-check "maturin>=1.9,<2" ziglang==0.17.1; }

# The FMUs and licences, once for all wheels.
rm -rf "$work/libraries" identify/python/wheelstate/fmus
WHEELSTATE_PLATFORMS=$work fmu/targets.sh "$work/libraries" "$@"
CARGO_TARGET_DIR=$work/build cargo run --quiet --package wheelstate-fmu --bin pack -- \
  all --libraries "$work/libraries" --out identify/python/wheelstate/fmus >/dev/null
(cd identify/python && "$work/maturin/bin/python" -c 'import build_wheel as b; (b.PACKAGE / "licenses.txt").write_text(b.licences())')

# Builds the wheel for the triple $1 with maturin's further arguments.
build() {
  local triple=$1
  shift
  standard_library "$triple" || { skip "no standard library for $triple: neither rustup nor Debian's rust-web-src gives it"; return; }
  # maturin hands no options to Cargo, which takes this one from the environment, too
  unset CARGO_UNSTABLE_BUILD_STD
  [ ${#flags[@]} -eq 0 ] || export CARGO_UNSTABLE_BUILD_STD=std,panic_unwind
  # no path of this machine stays in the module
  local remap="--remap-path-prefix=$root=wheelstate --remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}/registry/src=crates"
  remap+=" --remap-path-prefix=$sysroot=rust --remap-path-prefix=$work=build"
  # The stable interface needs no Python of the platform.
  env CARGO="${cargo[0]}" CARGO_TARGET_DIR="$work/build" CARGO_INCREMENTAL=0 CARGO_PROFILE_RELEASE_STRIP=symbols RUSTFLAGS="$remap" \
    PATH="$work/maturin/bin:$PATH" PYO3_CROSS_PYTHON_VERSION=3.11 \
    "$work/maturin/bin/maturin" build --quiet --release --locked --manifest-path identify/python/Cargo.toml --target "$triple" \
    --out "$out" "$@" >&2 || { skip "it does not build"; failed=1; }
}

skipped=() failed=0
for platform; do
  case "$platform" in
    linux64) build x86_64-unknown-linux-gnu --zig --compatibility manylinux2014 ;;
    aarch64-linux) build aarch64-unknown-linux-gnu --zig --compatibility manylinux2014 ;;
    win64) build x86_64-pc-windows-gnu ;;
    *) say "wheels.sh: '$platform' is no platform; there are linux64, aarch64-linux, win64"; exit 2 ;;
  esac
done
[ ${#skipped[@]} -eq 0 ] || say "not built: ${skipped[*]}"
ls "$out"/*.whl
exit "$failed"
