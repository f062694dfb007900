# Compilers for other platforms; to be sourced in the repository's root by targets.sh and identify/python/wheels.sh, which set
# `work`, the folder for downloads.

# The linker for old glibc.
zig() {
  [ -x "$work/zig/bin/cargo-zigbuild" ] && return
  python3 -m venv "$work/zig" && "$work/zig/bin/pip" install --quiet --disable-pip-version-check \
    ziglang==0.17.1 cargo-zigbuild==0.24.1
}

# A compiler with the sources of its standard library, if rustup has none of this platform.
debian_rust() {
  [ -x "$work/debian/usr/bin/rustc" ] && return
  command -v apt-get dpkg >/dev/null || return
  mkdir -p "$work/packages" && chmod 777 "$work/packages" && (
    cd "$work/packages"
    version=$(apt-cache show rustc-web 2>/dev/null | sed -n 's/^Version: \([0-9]*\.[0-9]*\)\..*/\1/p' | head -1)
    llvm=$(apt-cache show rustc-web | grep -om1 'libllvm[0-9]*')
    apt-get download --quiet rustc-web cargo-web libstd-rust-web-dev "libstd-rust-web-$version" rust-web-src "$llvm" >&2 &&
      for package in *.deb; do dpkg -x "$package" "$work/debian"; done
  ) || { rm -rf "$work/debian"; return 1; }
}

# Makes `cargo` and `flags` able to build for the triple $1.
standard_library() {
  cargo=(cargo) flags=()
  unset RUSTC RUSTC_BOOTSTRAP
  sysroot=$(rustc --print sysroot)
  [ -d "$sysroot/lib/rustlib/$1/lib" ] && return
  if command -v rustup >/dev/null && timeout 120 rustup target add "$1" >/dev/null 2>&1; then return; fi
  debian_rust || return
  sysroot=$work/debian/usr
  cat >"$work/rustc" <<END
#!/bin/sh
LD_LIBRARY_PATH='$work/debian/usr/lib/x86_64-linux-gnu' exec '$work/debian/usr/bin/rustc' "\$@"
END
  chmod +x "$work/rustc"
  cargo=("$work/debian/usr/bin/cargo") flags=(-Zbuild-std=std,panic_unwind)
  export RUSTC=$work/rustc RUSTC_BOOTSTRAP=1
}
