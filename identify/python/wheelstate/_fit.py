"""Looking at logs, fitting, tuning, simulating."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from . import _native
from ._log import Columns, Log, LogLike, read_all
from ._progress import Bar, Progress
from ._values import Parameters, Value, start, texts

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Logs: TypeAlias = "LogLike | Sequence[LogLike]"
"""One log or several."""

Verdict: TypeAlias = Literal["identified", "weak", "not-identifiable", "at-bound", "prior-only", "per-log"]


@dataclass(frozen=True)
class Finding:
    """What a look at a log found before anything was fitted to it."""

    file: str
    """The log's file."""
    channel: str
    """The channel, or several with commas; empty if the log as a whole is meant."""
    time: float | None
    """Where it begins, s, if it has a place."""
    code: str
    """What kind of finding it is: a word that stays the same."""
    severity: Literal["note", "warning", "refusal"]
    """How much it matters; nothing is fitted to a log with a refusal unless its code is allowed."""
    message: str
    """What was found, in one sentence."""
    suggestion: str
    """What to do about it."""

    def __str__(self) -> str:
        at = "" if self.time is None else f"at {self.time:g} s: "
        channel = f"{self.channel}: " if self.channel and f"'{self.channel}'" not in self.message else ""
        return f"{self.severity}: {self.file}: {channel}{at}{self.message}; {self.suggestion} [{self.code}]"


@dataclass(frozen=True)
class Parameter:
    """One fitted parameter. Numbers that are not known are NaN."""

    name: str
    value: float
    unit: str
    std_error: float
    """Standard deviation of the value."""
    ci95: tuple[float, float]
    """95 % confidence interval."""
    identified: bool
    """The data determine it well enough to be used."""
    at_bound: bool
    verdict: Verdict
    contributions: dict[str, float] = field(default_factory=dict)
    """What the standard error is made of: standard deviation by cause, the largest first."""
    per_log: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Value and standard error of each log by its file, where each has its own."""
    start: float | None = None

    def __float__(self) -> float:
        return self.value


@dataclass(frozen=True)
class Profile:
    """How much worse the best fit becomes when a parameter is held away from its estimate. Ends that do not exist are NaN."""

    name: str
    estimate: float
    values: "NDArray[np.float64]"
    """Values at which it was held, ascending."""
    statistic: "NDArray[np.float64]"
    """Chi-squared with one degree of freedom at the truth, by noise alone: 3.84 at 95 %."""
    refitted: bool
    """Whether the others were fitted anew at each value; otherwise it is a parabola by the covariance."""
    noise95: tuple[float, float]
    """95 % interval by noise alone."""
    noise997: tuple[float, float]
    """99.7 % interval by noise alone."""
    ci95: tuple[float, float]
    """95 % interval with all that is considered."""
    ends: tuple[Literal["passed", "bound", "open"], Literal["passed", "bound", "open"]]
    """How the curve ends below and above: it passes 99.7 %, or a bound comes first, or it has no end."""


@dataclass(frozen=True)
class Covariance:
    """Covariance of the fitted parameters."""

    names: tuple[str, ...]
    matrix: "NDArray[np.float64]"

    def of(self, one: str, other: str) -> float:
        """Covariance of two parameters."""
        return float(self.matrix[self.names.index(one), self.names.index(other)])


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


class Fit:
    """The result of a fit or of a tuning: what `fit.json` holds."""

    def __init__(self, native: _native.Fit) -> None:
        self._native = native
        self._told: dict[str, Any] = json.loads(native.json())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Fit":
        """Reads a fit.json or tune.json."""
        try:
            text = Path(path).read_text(encoding="utf-8")
        except OSError as error:
            raise _native.Error(f"{fspath(path)}: {error.strerror}") from None
        return cls.parse(text, fspath(path))

    @classmethod
    def parse(cls, text: str, name: str = "fit.json") -> "Fit":
        """Reads the text of a fit.json; `name` is named in errors."""
        return cls(_native.Fit.parse(name, text))

    @property
    def machine(self) -> str:
        """Name of the machine, as on the command line."""
        return str(self._told["vehicle"])

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The fitted parameters by their FMU names."""
        return {name: _parameter(name, told) for name, told in self._told["parameters"].items()}

    def __getitem__(self, name: str) -> Parameter:
        return _parameter(name, self._told["parameters"][name])

    @property
    def values(self) -> dict[str, float]:
        """The values that may be used: those of identified parameters."""
        return {name: p.value for name, p in self.parameters.items() if p.identified}

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """How far the data determine each parameter."""
        return {name: p.verdict for name, p in self.parameters.items()}

    @property
    def covariance(self) -> Covariance | None:
        """Covariance of the fitted parameters, if there is one."""
        import numpy as np

        told = self._told.get("covariance")
        if told is None:
            return None
        rows = [[_number(value) for value in row] for row in told["matrix"]]
        return Covariance(tuple(told["parameters"]), np.array(rows, dtype=np.float64))

    @property
    def profiles(self) -> dict[str, Profile]:
        """The profiles that were asked for, by the parameters' FMU names."""
        return {told["parameter"]: _profile(told) for told in self._told.get("profiles", [])}

    @property
    def warnings(self) -> list[str]:
        """What you must know before using the result."""
        return list(self._told.get("warnings", []))

    @property
    def notes(self) -> list[str]:
        """What is good to know and no reason to worry."""
        return list(self._told.get("notes", []))

    @property
    def findings(self) -> list[Finding]:
        """What was found in the logs before the fit."""
        return [Finding(**told) for told in self._told.get("findings", [])]

    @property
    def refused(self) -> str | None:
        """Why there is no result, if there is none."""
        return self._told.get("refused")

    @property
    def exit_code(self) -> int:
        """What the command would end with: 0, or 1 if something must be told, or 2."""
        return 2 if self.refused else int(self._native.has_warnings)

    def to_json(self) -> str:
        """The text of fit.json."""
        return self._native.json()

    def to_dict(self) -> dict[str, Any]:
        """All that fit.json holds."""
        told: dict[str, Any] = json.loads(self._native.json())
        return told

    def save(self, path: str | PathLike[str]) -> None:
        """Writes fit.json, or with the ending .ssv the identified values as an SSP parameter set."""
        text = self._native.ssv() if fspath(path).lower().endswith(".ssv") else self._native.json()
        Path(path).write_text(text, encoding="utf-8")

    def html(self) -> str:
        """The page with plots: one file, no network. Plots of signals are there for a fit of this session only."""
        return self._native.html()

    def report(self, path: str | PathLike[str]) -> None:
        """Writes the page with plots, see `html`."""
        Path(path).write_text(self.html(), encoding="utf-8")

    def residuals(self, path: str | PathLike[str]) -> None:
        """Writes measured and predicted signals as CSV, after a fit with `residuals=True`."""
        Path(path).write_text(self._native.residuals(), encoding="utf-8")

    def __str__(self) -> str:
        return self._native.table()

    def __repr__(self) -> str:
        identified = sum(p.identified for p in self.parameters.values())
        return f"<Fit of {self.machine}: {identified} of {len(self.parameters)} parameters identified>"

    def _repr_html_(self) -> str:
        def row(p: Parameter) -> str:
            unit = "" if p.unit == "1" else p.unit
            cells = [p.name, f"{p.value:.6g}", f"{p.std_error:.2g}", f"{p.ci95[0]:.6g} .. {p.ci95[1]:.6g}", unit]
            return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in [*cells, p.verdict.replace("-", " ")]) + "</tr>"

        names = ["parameter", "value", "standard error", "95 % interval", "unit", "verdict"]
        head = "<tr>" + "".join(f"<th>{name}</th>" for name in names) + "</tr>"
        said = [*([self.refused] if self.refused else []), *self.warnings]
        told = "".join(f"<li>{escape(line)}</li>" for line in dict.fromkeys(said))
        rows = "".join(row(p) for p in self.parameters.values())
        return f"<table>{head}{rows}</table>" + (f"<p>Warnings</p><ul>{told}</ul>" if told else "")


def _parameter(name: str, told: dict[str, Any]) -> Parameter:
    return Parameter(
        name=name,
        value=_number(told["value"]),
        unit=told["unit"],
        std_error=_number(told["std_error"]),
        ci95=(_number(told["ci95"][0]), _number(told["ci95"][1])),
        identified=told["identified"],
        at_bound=told["at_bound"],
        verdict=told["verdict"],
        contributions={each["cause"]: _number(each["std"]) for each in told.get("contributions", [])},
        per_log={log: (_number(of["value"]), _number(of["std_error"])) for log, of in told.get("per_log", {}).items()},
        start=told.get("start"),
    )


def _profile(told: dict[str, Any]) -> Profile:
    import numpy as np

    def pair(name: str) -> tuple[float, float]:
        low, high = told[name]
        return _number(low), _number(high)

    return Profile(
        name=told["parameter"],
        estimate=_number(told["estimate"]),
        values=np.array(told["values"], dtype=np.float64),
        statistic=np.array(told["statistic"], dtype=np.float64),
        refitted=told["refitted"],
        noise95=pair("noise95"),
        noise997=pair("noise997"),
        ci95=pair("ci95"),
        ends=(told["ends"][0], told["ends"][1]),
    )


def fit(
    machine: str,
    logs: Logs,
    *,
    columns: Columns = None,
    parameters: Parameters | None = None,
    set: Mapping[str, Value] | None = None,
    set_of_log: Mapping[int, Mapping[str, Value]] | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    bound: Mapping[str, tuple[float, float]] | None = None,
    sensor: Mapping[str, float] | None = None,
    exact: bool = False,
    only: Sequence[str] = (),
    profile: Sequence[str] = (),
    per_log: Sequence[str] = (),
    varies: Mapping[str, str | None] | None = None,
    held_out: Logs = (),
    span: tuple[float, float] | None = None,
    exclude: Sequence[tuple[float, float]] = (),
    loss: Literal["huber", "ls", "l1"] = "huber",
    refine: bool = False,
    correct: bool = False,
    skip_bad: bool = False,
    allow: Sequence[str] = (),
    residuals: bool = False,
    progress: Progress = None,
) -> Fit:
    """Fits a machine's parameters to logs; `wheelstate fit --help` tells what each option does.

    `logs` are logs, files or tables; `columns` is the column map for files and tables. `set` holds values, `set_of_log`
    those of single logs by their index, `prior` has value and standard deviation, `bound` the ends of a range, `sensor`
    standard deviations as `{"drive_force.gain_std": 0.005}`, `varies` the channel that a parameter follows from log to log
    or None, `profile` the parameters that are held at values ever farther from their estimates (`Fit.profiles`),
    `span` and `exclude` times in s. Logs that nothing can be
    fitted to raise `Refused`, whose `fit` holds what was read and what is wrong.
    """
    read_logs = read_all(logs, columns, machine, progress)
    if span is not None or exclude:
        first, last = span if span is not None else (-math.inf, math.inf)
        read_logs = [log.within(first, last, exclude=exclude) for log in read_logs]
    judges = read_all(held_out, columns, machine, progress)
    options = {
        "settings": texts(set),
        "of_log": [(index, texts(values)) for index, values in (set_of_log or {}).items()],
        "known": [(name, *pair) for name, pair in (prior or {}).items()],
        "bounds": [(name, *pair) for name, pair in (bound or {}).items()],
        "sensors": texts(sensor),
        "only": list(only),
        "profile": list(profile),
        "per_log": list(per_log),
        "varies": list((varies or {}).items()),
        "allow": list(allow),
        "loss": loss,
        "exact": exact,
        "refine": refine,
        "correct": correct,
        "skip_bad": skip_bad,
        "residuals": residuals,
    }
    with Bar(progress) as tell:
        try:
            native = _native.fit(machine, _natives(read_logs), _natives(judges), start(parameters), options, tell)
        except _native.Refused as refused:
            refused.fit = Fit(refused.fit)
            raise
    return Fit(native)


def check(
    machine: str,
    logs: Logs,
    *,
    columns: Columns = None,
    parameters: Parameters | None = None,
    set: Mapping[str, Value] | None = None,
    allow: Sequence[str] = (),
    expect: bool | None = None,
    progress: Progress = None,
) -> list[Finding]:
    """What is wrong with logs before anything is fitted to them; a file that cannot be read raises `LogError`.

    `expect` says whether to tell the standard errors that a fit would have (None: for short logs).
    """
    read_logs = read_all(logs, columns, machine, progress)
    with Bar(progress) as tell:
        told = _native.check(machine, _natives(read_logs), texts(set), start(parameters), list(allow), expect, tell)
    return [Finding(**finding) for finding in json.loads(told)]


def tune(
    machine: str,
    logs: Logs,
    *,
    columns: Columns = None,
    parameters: Parameters | None = None,
    set: Mapping[str, Value] | None = None,
    objective: Literal["nll", "rmse"] = "nll",
    seed: int = 0,
    population: int = 30,
    iterations: int = 60,
    only: Sequence[str] = (),
    floors: bool | None = None,
    floor: Mapping[str, float] | None = None,
    held_out: Logs = (),
    skip: float = 1.0,
    threads: int = 0,
    progress: Progress = None,
) -> Fit:
    """Tunes the noise settings of a machine's estimator on logs; `wheelstate tune --help` tells what each option does."""
    read_logs, judges = (read_all(some, columns, machine, progress) for some in (logs, held_out))
    options = {
        "settings": texts(set),
        "floor": texts(floor),
        "floors": floors,
        "only": list(only),
        "objective": objective,
        "seed": seed,
        "population": population,
        "iterations": iterations,
        "skip": skip,
        "threads": threads,
    }
    with Bar(progress) as tell:
        return Fit(_native.tune(machine, _natives(read_logs), _natives(judges), start(parameters), options, tell))


def simulate(machine: str, scenario: str, seed: int = 0, *, set: Mapping[str, Value] | None = None) -> Log:
    """A log of a built-in plant; its `true_*` channels hold the truth. `scenarios` tells what there is."""
    return Log(_native.simulate(machine, scenario, seed, texts(set)))


def scenarios(machine: str) -> dict[str, str]:
    """The scenarios of a machine, with one line about each."""
    return dict(_native.scenarios(machine))


def _natives(logs: Sequence[Log]) -> list[_native.Log]:
    return [log._native for log in logs]
