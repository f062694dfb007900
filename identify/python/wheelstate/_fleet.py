"""Many logs on many machines: blocks that travel, and two fits beside each other."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from . import _native
from ._fit import Fit, Logs, fit
from ._log import Columns, Log, LogLike, read
from ._progress import Progress


@dataclass(frozen=True)
class Block:
    """What the fit of a machine reads of one log, without loss and packed; small enough to travel, and picklable.

    A fit goes over the samples several times (robust loss, errors of sensors, validation), so that no sums over them would
    do: a block is the samples that the fit reads, and a fit to merged blocks is the fit to the logs to the last bit.
    """

    machine: str
    source: str
    """The log that it is of."""
    samples: int
    data: bytes

    @property
    def sha256(self) -> str:
        """Of the block's bytes."""
        return hashlib.sha256(self.data).hexdigest()

    def __repr__(self) -> str:
        return f"<Block of {self.source}: {self.samples} samples in {len(self.data)} bytes>"


def compress(machine: str, log: LogLike, *, columns: Columns = None, progress: Progress = None) -> Block:
    """The block of one log; nothing that the fit does not read is in it."""
    data = read(log, columns, machine=machine, progress=progress)
    return Block(machine, data.source, len(data), _native.compress(machine, data._native))


def merge(blocks: Iterable[Block], **options: Any) -> Fit:
    """The fit to the logs of these blocks; `options` are those of `fit`.

    Neither the order of the blocks matters nor whether one came twice.
    """
    machine, logs = _native.merge([block.data for block in blocks])
    read_logs: Logs = [Log(log) for log in logs]
    return fit(machine, read_logs, **options)


@dataclass(frozen=True)
class Difference:
    """What two fits say of one parameter."""

    name: str
    unit: str
    difference: float
    """The second value minus the first."""
    std: float
    """Its standard deviation."""
    p: float
    """Probability of a difference at least as large if both are the same."""


def compare(one: Fit, other: Fit, *, same_sensors: bool = False) -> list[Difference]:
    """Compares the parameters that both fits identified.

    With `same_sensors` what the standard errors hold of sensors and known values drops out: right for two rides of one
    machine with its own sensors.
    """
    return [Difference(**told) for told in json.loads(_native.compare(one._native, other._native, same_sensors))]
