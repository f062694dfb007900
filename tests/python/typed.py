"""Code as users write it, for the type checker; nothing here is run."""

from pathlib import Path
from typing import assert_type

import numpy as np
import pandas as pd
import polars as pl
import wheelstate


def ride(path: Path, frame: pd.DataFrame, table: pl.DataFrame) -> None:
    log = wheelstate.read(path, columns={"speed": {"column": "v", "unit": "km/h"}}, machine="wheelchair")
    arrays = {"time": np.arange(3.0), "speed": np.zeros(3)}
    findings = wheelstate.check("wheelchair", [log, frame, table, arrays], set={"chair.mass": 120})
    print([finding.code for finding in findings if finding.severity != "note"])
    fit = wheelstate.fit("wheelchair", [log, path], only=["chair.mass"], prior={"chair.mass": (100, 5)}, progress=False)
    mass = fit.parameters["chair.mass"]
    assert_type(mass.value, float)
    assert_type(fit["chair.mass"].ci95, tuple[float, float])
    covariance = fit.covariance
    if covariance is not None:
        assert_type(covariance.of("chair.mass", "chair.mass"), float)
    fit.report("fit.html")
    plan = wheelstate.design("wheelchair", log, parameters=fit, interest=["chair.mass"], limit={"plant.effort": (0.5, 1.5)})
    best = plan.best
    if best is not None:
        promise = best.promises["chair.mass"]
        print(best.scenario, best.duration, "unknown" if promise is None else (promise.low, promise.high))
    run = wheelstate.run("Wheelchair", log, parameters=fit, set={"filter.kind": "basic"})
    print(run.to_pandas()["slope"].max(), run["slope_std"].max(), run.units["slope"])
    assert_type(wheelstate.pack("Wheelchair", fit, out="out"), Path)
    try:
        wheelstate.tune("wheelchair", log, iterations=3)
    except wheelstate.LogError as error:
        print(error)
