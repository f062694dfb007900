#!/usr/bin/env bash
# Builds the FMU's library for every platform into OUT/<platform>/ and says which it had to skip.
#
#   fmu/targets.sh OUT                       linux64, aarch64-linux, win64 (darwin64, aarch64-darwin: on a Mac)
#   fmu/targets.sh OUT linux64 win64         these only
#
# Then `pack all --libraries OUT --out DIR` puts what is there into the FMUs.
#
# The Linux libraries need no glibc newer than 2.17: they are linked with zig (PyPI: ziglang, cargo-zigbuild). The
# standard library of another platform comes from rustup where rustup can fetch it; otherwise it is built from the
# sources that Debian packages beside a compiler (rustc-web, rust-web-src), unpacked aside. win64 is linked with
# gcc-mingw-w64-x86-64. All downloads and builds stay below target/platforms (WHEELSTATE_PLATFORMS: another folder).
set -euo pipefail

case "${1:-}" in
  -h|--help|"") sed -n '2,14s/^# \{0,1\}//p' "$0"; [ -n "${1:-}" ]; exit ;;
esac
mkdir -p "$1"
out=$(realpath "$1")
shift
cd "$(dirname "$0")/.."
root=$PWD
work=${WHEELSTATE_PLATFORMS:-$root/target/platforms}
mkdir -p "$work"
export CARGO_TARGET_DIR=$work/build CARGO_INCREMENTAL=0 CARGO_PROFILE_RELEASE_STRIP=symbols

say() { printf '%s\n' "$*" >&2; }
skip() { say "SKIPPED $platform: $*"; skipped+=("$platform"); }

source fmu/toolchains.sh

# Builds for the triple $2 with the cargo command $1 and puts the file $3 into OUT/$platform.
build() {
  local command=$1 triple=$2 file=$3
  # no path of this machine stays in the library
  export RUSTFLAGS="--remap-path-prefix=$root=wheelstate --remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}/registry/src=crates"
  RUSTFLAGS+=" --remap-path-prefix=$sysroot=rust --remap-path-prefix=$work=build"
  [ "$command" = zigbuild ] && export PATH="$work/zig/bin:$PATH"
  CARGO=${cargo[0]} "${cargo[0]}" "$command" "${flags[@]}" --release --locked --quiet --package wheelstate-fmu --lib --target "$triple" >&2 ||
    { skip "it does not build"; failed=1; return; }
  mkdir -p "$out/$platform"
  # the glibc version behind the triple is no part of the folder's name
  cp "$CARGO_TARGET_DIR/${triple%.2.17}/release/$file" "$out/$platform/$file"
  say "$out/$platform/$file"
}

make_linux64() {
  zig || { skip "ziglang and cargo-zigbuild cannot be installed from PyPI"; return; }
  standard_library x86_64-unknown-linux-gnu || { skip "no standard library for x86_64-unknown-linux-gnu"; return; }
  build zigbuild x86_64-unknown-linux-gnu.2.17 libwheelstate_fmu.so
}

make_aarch64_linux() {
  zig || { skip "ziglang and cargo-zigbuild cannot be installed from PyPI"; return; }
  standard_library aarch64-unknown-linux-gnu || { skip "no standard library for aarch64-unknown-linux-gnu: neither rustup nor Debian's rust-web-src gives it"; return; }
  build zigbuild aarch64-unknown-linux-gnu.2.17 libwheelstate_fmu.so
}

make_win64() {
  command -v x86_64-w64-mingw32-gcc >/dev/null || { skip "x86_64-w64-mingw32-gcc is missing (Debian: gcc-mingw-w64-x86-64)"; return; }
  standard_library x86_64-pc-windows-gnu || { skip "no standard library for x86_64-pc-windows-gnu: neither rustup nor Debian's rust-web-src gives it"; return; }
  CARGO_TARGET_X86_64_PC_WINDOWS_GNU_LINKER=x86_64-w64-mingw32-gcc build build x86_64-pc-windows-gnu wheelstate_fmu.dll
}

make_darwin() {
  [ "$(uname -s)" = Darwin ] || { skip "Apple's linker and SDK are on Macs only"; return; }
  standard_library "$1" || { skip "no standard library for $1"; return; }
  build build "$1" libwheelstate_fmu.dylib
}

skipped=() failed=0
[ $# -gt 0 ] || set -- linux64 aarch64-linux win64 darwin64 aarch64-darwin
for platform; do
  case "$platform" in
    linux64) make_linux64 ;;
    aarch64-linux) make_aarch64_linux ;;
    win64) make_win64 ;;
    darwin64) make_darwin x86_64-apple-darwin ;;
    aarch64-darwin) make_darwin aarch64-apple-darwin ;;
    *) say "targets.sh: '$platform' is no platform; there are linux64, aarch64-linux, win64, darwin64, aarch64-darwin"; exit 2 ;;
  esac
done
[ ${#skipped[@]} -eq 0 ] || say "not built: ${skipped[*]}"
exit "$failed"
