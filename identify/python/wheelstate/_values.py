"""Values of parameters as the Rust packages take them: as texts by name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from os import PathLike, fspath
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from . import _native
    from ._fit import Fit

Value: TypeAlias = float | bool | str
"""A number, a truth value, or one of a parameter's choices."""

Parameters: TypeAlias = "Fit | str | PathLike[str] | Mapping[str, Value]"
"""Known values: a fit, a file (fit.json), or values by name."""


def text(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(float(value))


def texts(values: Mapping[str, Value] | None) -> list[tuple[str, str]]:
    return [(name, text(value)) for name, value in (values or {}).items()]


def start(parameters: "Parameters | None") -> "_native._Start":
    """Where known values are to be taken from."""
    if parameters is None:
        return {"file": None, "text": None}
    if isinstance(parameters, str | PathLike):
        return {"file": fspath(parameters), "text": None}
    if isinstance(parameters, Mapping):
        values = {name: value if isinstance(value, bool | str) else float(value) for name, value in parameters.items()}
        return {"file": None, "text": json.dumps(values)}
    return {"file": None, "text": parameters.to_json()}
