# To be sourced in the repository's root: makes the virtual environment .venv and tells bindgen, below
# the `fmi` crate that `replay` uses, where libclang and the compiler's own headers are.
[ -x .venv/bin/python ] || python3 -m venv .venv
if [ -z "${LIBCLANG_PATH:-}" ]; then
  .venv/bin/pip install --quiet --disable-pip-version-check "libclang>=16"
  LIBCLANG_PATH=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/clang/native
fi
BINDGEN_EXTRA_CLANG_ARGS=${BINDGEN_EXTRA_CLANG_ARGS:--I$(cc -print-file-name=include)}
export LIBCLANG_PATH BINDGEN_EXTRA_CLANG_ARGS

# The whole workspace with the same features at every step: with another choice Cargo would compile
# parquet, nalgebra, Clarabel and what uses them once more.
workspace=(--workspace --features wheelstate-fmu/import)
