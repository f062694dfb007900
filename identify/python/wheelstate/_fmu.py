"""The FMUs that the package carries, and FMUs with values of your own."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path

from . import _native
from ._values import Parameters, Value, texts

_FOLDER = Path(__file__).parent / "fmus"


def fmu(machine: str) -> Path:
    """The ready FMU of a machine, by either of its names: `Wheelchair` or `wheelchair`, `NursingRobot` or `nursing-robot`."""
    plain = machine.lower().replace("-", "").replace("_", "")
    for path in sorted(_FOLDER.glob("*.fmu")):
        if path.stem.lower() == plain:
            return path
    known = ", ".join(path.stem for path in sorted(_FOLDER.glob("*.fmu")))
    raise _native.Error(f"there is no FMU '{machine}'; there are: {known}")


def pack(
    machine: str,
    parameters: Parameters | None = None,
    *,
    set: Mapping[str, Value] | None = None,
    out: str | PathLike[str] = ".",
    include_unidentified: bool = False,
    libraries: str | PathLike[str] | None = None,
) -> Path:
    """Writes an FMU whose start values are yours, and gives its path.

    `parameters` is a `Fit`, a file (fit.json, tune.json or .ssv) or a mapping of names to values; `set` wins over it. A
    value of a fit that is not identified is left at its default, and a `UserWarning` says so. `libraries` is a folder that
    `fmu/targets.sh` filled, for other platforms than those of the FMUs in this package.
    """
    file, json = None, None
    settings = []
    if isinstance(parameters, Mapping):
        settings += texts(parameters)
    elif isinstance(parameters, str | PathLike):
        file = fspath(parameters)
    elif parameters is not None:
        json = parameters.to_json()
    settings += texts(set)
    ready = fmu(machine)
    path, _, said = _native.pack(machine, file, json, include_unidentified, settings, out, ready, libraries)
    for line in said:
        warnings.warn(line, stacklevel=2)
    return Path(path)
