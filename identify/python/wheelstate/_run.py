"""Logs through an estimator."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from . import _native
from ._log import Columns, Log, LogLike, read
from ._progress import Bar, Progress
from ._values import Parameters, Value, start, texts


class Run(Log):
    """The estimates of a log, which are read like the channels of a log: the outputs of the FMU over time, then
    `measured_x`, `innovation_x` and `innovation_x_std` of each measured channel; `x_smoothed` and `x_smoothed_std`."""

    def __init__(
        self,
        native: _native.Log,
        units: dict[str, str],
        sample_period: float,
        notes: list[str],
        warnings: list[str],
        page: str,
    ) -> None:
        super().__init__(native)
        self._units, self._sample_period, self._notes = units, sample_period, notes
        self._warnings, self._page = warnings, page

    @property
    def units(self) -> dict[str, str]:
        """The unit of each output in the FMI spelling, `1` if it has none."""
        return dict(self._units)

    @property
    def sample_period(self) -> float:
        """The estimator's sample period, s."""
        return self._sample_period

    @property
    def notes(self) -> list[str]:
        """What is good to know of log, parameters and estimates, one line each."""
        return list(self._notes)

    @property
    def warnings(self) -> list[str]:
        """What must be known before the estimates are used, one line each: contradictions, overconfidence, gaps."""
        return list(self._warnings)

    def report(self, path: str | os.PathLike[str]) -> None:
        """Writes verdicts and plots as one HTML file."""
        Path(path).write_text(self._page, encoding="utf-8")


def run(
    machine: str,
    log: LogLike,
    *,
    columns: Columns = None,
    parameters: Parameters | None = None,
    set: Mapping[str, Value] | None = None,
    clock: Literal["fmu", "log"] = "fmu",
    smooth: bool = False,
    progress: Progress = None,
) -> Run:
    """Runs a machine's estimator over a log at native speed, without an FMU.

    The estimates are those of the FMU in a host that sets the inputs of each row; with `clock="log"` every row is one
    sample at its own time. `smooth` adds the best estimates once a ride is over, from samples before and after, and
    implies `clock="log"`; what cannot be smoothed raises with the reason. `parameters` is a `Fit`, a file or values by name; `set` wins over it.
    """
    with Bar(progress) as tell:
        data = read(log, columns, machine=machine, progress=progress)
        told = _native.run(machine, data._native, start(parameters), texts(set), clock, smooth, tell)
    native, units, sample_period, notes, verdicts, page = told
    return Run(native, dict(units), sample_period, notes, verdicts, page)
