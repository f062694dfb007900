"""Estimators for wheeled machines that carry people and loads: fit them to logs, run them, pack them as FMUs.

    log = wheelstate.read("ride.mf4", columns="map.toml")
    fit = wheelstate.fit("wheelchair", log)
    run = wheelstate.run("wheelchair", log, parameters=fit)
    wheelstate.pack("Wheelchair", fit, out=".")

Everything is done by the Rust packages; the command `wheelstate` is the same code. Errors are exceptions with the same
one-line messages.
"""

from ._design import Candidate, Interest, Plan, Promise, design
from ._fit import Covariance, Finding, Fit, Parameter, Profile, check, fit, scenarios, simulate, tune
from ._fleet import Block, Difference, compare, compress, merge
from ._fmu import fmu, pack
from ._log import Log, read
from ._native import Error, LogError, Refused, __version__, machines
from ._run import Run, run

__all__ = [
    "Block",
    "Candidate",
    "Covariance",
    "Difference",
    "Error",
    "Finding",
    "Fit",
    "Interest",
    "Log",
    "LogError",
    "Parameter",
    "Plan",
    "Profile",
    "Promise",
    "Refused",
    "Run",
    "__version__",
    "check",
    "compare",
    "compress",
    "design",
    "fit",
    "fmu",
    "machines",
    "merge",
    "pack",
    "read",
    "run",
    "scenarios",
    "simulate",
    "tune",
]
