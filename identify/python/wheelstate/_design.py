"""What to drive next."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from . import _native
from ._fit import Fit, Logs, _natives
from ._log import Columns, Log, read_all
from ._progress import Bar, Progress
from ._values import Parameters, Value, start, texts


@dataclass(frozen=True)
class Interest:
    """A parameter of interest as it is known now; None is what the present logs do not tell."""

    name: str
    unit: str
    value: float | None
    std_error: float | None
    identified: bool
    supposed: tuple[float, float] | None
    """Range that the machines were drawn from where the logs do not tell it."""


@dataclass(frozen=True)
class Promise:
    """The standard error that a fit is expected to have."""

    std_error: float
    """Median over the drawn machines, in the parameter's unit."""
    low: float
    """Lower end of the range that it lies in with the plan's `probability`."""
    high: float
    by_noise: float
    """The part of it that more driving makes smaller."""
    limited_by: str | None
    """The largest cause of the rest."""
    identified: float
    """Share of the drawn machines whose fit identifies the parameter."""


@dataclass(frozen=True)
class Candidate:
    """A manoeuvre, driven so often."""

    scenario: str
    settings: dict[str, float]
    duration: float
    """Of all drives together, s."""
    times: int
    promises: dict[str, Promise | None]
    """By parameter, for a fit of the present logs and these; None if they do not tell it."""


class Plan:
    """Manoeuvres compared by the standard errors that a fit with them would have."""

    def __init__(self, told: str, table: str, inputs: Log | None) -> None:
        self._told: dict[str, Any] = json.loads(told)
        self._table, self._inputs = table, inputs

    @property
    def machine(self) -> str:
        """Name of the machine, as on the command line."""
        return str(self._told["vehicle"])

    @property
    def parameters(self) -> dict[str, Interest]:
        """The parameters of interest as they are known now."""
        return {told["name"]: Interest(**{**told, "supposed": _pair(told["supposed"])}) for told in self._told["parameters"]}

    @property
    def candidates(self) -> list[Candidate]:
        """The manoeuvres, driven once, the best first."""
        return [self._candidate(told, told, 1) for told in self._told["candidates"]]

    @property
    def best(self) -> Candidate | None:
        """The best manoeuvre; None if none could be simulated and fitted."""
        return self.candidates[0] if self._told["candidates"] else None

    @property
    def repeats(self) -> list[Candidate]:
        """The best manoeuvre driven more often."""
        return [self._candidate(self._told["candidates"][0], told, told["times"]) for told in self._told["repeats"]]

    @property
    def helps(self) -> bool:
        """Whether the best manoeuvre makes a standard error of interest at least 5 % smaller."""
        return bool(self._told["helps"])

    @property
    def probability(self) -> float:
        """With which a standard error lies in its range, if the real machine is one of those that were drawn."""
        return float(self._told["probability"])

    @property
    def notes(self) -> list[str]:
        """What the promises rest on and where driving stops helping."""
        return list(self._told["notes"])

    @property
    def inputs(self) -> Log | None:
        """The commanded inputs of the best manoeuvre, without noise."""
        return self._inputs

    def to_dict(self) -> dict[str, Any]:
        """All that `wheelstate design --json` prints."""
        told: dict[str, Any] = json.loads(json.dumps(self._told))
        return told

    def __str__(self) -> str:
        return self._table

    def __repr__(self) -> str:
        best = self.best
        return f"<Plan for {self.machine}: {best.scenario if best is not None and self.helps else 'nothing helps'}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self._table)}</pre>"

    def _candidate(self, of: dict[str, Any], told: dict[str, Any], times: int) -> Candidate:
        names = [parameter["name"] for parameter in self._told["parameters"]]
        promises = [None if promise is None else Promise(**promise) for promise in told["promises"]]
        return Candidate(of["scenario"], dict(of["settings"]), told["duration"], times, dict(zip(names, promises, strict=True)))


def _pair(told: list[float] | None) -> tuple[float, float] | None:
    return None if told is None else (told[0], told[1])


def design(
    machine: str,
    logs: Logs = (),
    *,
    columns: Columns = None,
    parameters: Parameters | None = None,
    interest: Sequence[str] = (),
    set: Mapping[str, Value] | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    limit: Mapping[str, tuple[float, float]] | None = None,
    scenario: Sequence[str] = (),
    sensor: Mapping[str, float] | None = None,
    exact: bool = False,
    allow: Sequence[str] = (),
    draws: int | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> Plan:
    """Which manoeuvre tells best what the present logs leave open, and the standard errors to expect of it.

    `wheelstate design --help` tells what each option does: `interest` is `--for`, `limit` the settings of a manoeuvre that
    are searched with their ends, `scenario` the manoeuvres that come into question. `parameters` is a fit, a file or values by
    name. Without logs the promises are those of the new log alone. Logs that nothing can be fitted to raise `Refused`.
    """
    read_logs = read_all(logs, columns, machine, progress)
    options = {
        "settings": texts(set),
        "known": [(name, *pair) for name, pair in (prior or {}).items()],
        "parameters": list(interest),
        "limits": [(name, *pair) for name, pair in (limit or {}).items()],
        "scenarios": list(scenario),
        "sensors": texts(sensor),
        "exact": exact,
        "allow": list(allow),
        "draws": draws,
        "seed": seed,
    }
    with Bar(progress) as tell:
        try:
            told, table, inputs = _native.design(machine, _natives(read_logs), start(parameters), options, tell)
        except _native.Refused as refused:
            refused.fit = Fit(refused.fit)
            raise
    return Plan(told, table, None if inputs is None else Log(inputs))
