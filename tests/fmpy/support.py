"""A thin master around fmpy's calls, and logs that every model can be run over."""

import ctypes
import itertools

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

_names = itertools.count()
# fmpy hands the library a pointer to these; they must outlive every instance
_keep = []


class Slave:
    """One instance; `messages` collects what the FMU logs."""

    def __init__(self, folder, description=None, guid=None, logging=False):
        self.description = description or fmpy.read_model_description(folder)
        self.messages = []
        self.vr = {v.name: v.valueReference for v in self.description.modelVariables}
        self.type = {v.name: v.type for v in self.description.modelVariables}
        self.outputs = [v.name for v in self.description.modelVariables if v.causality == "output"]
        self.inputs = [v.name for v in self.description.modelVariables if v.causality == "input"]
        self.fmu = FMU2Slave(
            guid=guid or self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName=f"instance{next(_names)}",
        )

        def log(environment, instance, status, category, message):
            self.messages.append((status, category.decode(), message.decode()))

        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(log)
        _keep.append((callbacks, log))
        self.fmu.instantiate(callbacks=callbacks, loggingOn=logging)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.free()

    def free(self):
        if self.fmu is not None:
            self.fmu.freeInstance()
            self.fmu = None

    def start(self, time=0.0, stop=None):
        self.fmu.setupExperiment(startTime=time, stopTime=stop)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def set(self, name, value):
        setter = {
            "Real": self.fmu.setReal,
            "Integer": self.fmu.setInteger,
            "Enumeration": self.fmu.setInteger,
            "Boolean": self.fmu.setBoolean,
        }[self.type[name]]
        setter([self.vr[name]], [value])

    def get(self, name):
        getter = {
            "Real": self.fmu.getReal,
            "Integer": self.fmu.getInteger,
            "Enumeration": self.fmu.getInteger,
            "Boolean": self.fmu.getBoolean,
        }[self.type[name]]
        return getter([self.vr[name]])[0]

    def apply(self, row):
        """Sets all inputs that the row of a log has."""
        for name in self.inputs:
            if name in row.dtype.names:
                value = row[name]
                self.set(name, float(value) if self.type[name] == "Real" else int(value))

    def step(self, time, size):
        self.fmu.doStep(time, size)

    def all_outputs(self):
        """Every output; equal tuples are equal bit for bit (no output is ever NaN)."""
        values = tuple(self.get(name) for name in self.outputs)
        assert all(np.isfinite(values)), dict(zip(self.outputs, values))
        return values

    def last_message(self):
        return self.messages[-1][2] if self.messages else ""


def period(description):
    """The default sample period."""
    return float(next(v.start for v in description.modelVariables if v.name == "sample_period"))


def is_measured(variable):
    """Whether NaN is allowed in an input."""
    return variable.type == "Real" and variable.variability == "discrete"


def make_log(description, rows=400, seed=0, gaps=0.0, start=0.0, dt=None):
    """Smooth signals around the inputs' start values; every machine must cope with any input."""
    random = np.random.default_rng(seed)
    dt = dt or period(description)
    time = start + dt * np.arange(rows)
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    log = np.zeros(rows, dtype=[("time", float)] + [(v.name, float) for v in inputs])
    log["time"] = time
    for variable in inputs:
        if variable.type != "Real":
            log[variable.name] = float(variable.start)
            continue
        centre = float(variable.start)
        centre = 0.0 if np.isnan(centre) else centre
        size = {"rad": 0.1, "rad/s": 0.5, "m/s": 0.8, "m/s2": 0.5, "N.m": 8.0, "N": 30.0}.get(variable.unit, 0.1)
        phase, rate = random.uniform(0.0, 6.0), random.uniform(0.5, 4.0)
        values = centre + size * np.sin(rate * (time - start) + phase) + 0.02 * size * random.standard_normal(rows)
        if gaps and is_measured(variable):
            values[random.uniform(size=rows) < gaps] = np.nan
        log[variable.name] = values
    return log


def write_log(path, log):
    names = log.dtype.names
    with open(path, "w") as file:
        file.write(",".join(names) + "\n")
        for row in log:
            file.write(",".join(repr(float(row[name])) for name in names) + "\n")


def serialized(slave):
    """The present state as bytes."""
    state = slave.fmu.getFMUState()
    data = slave.fmu.serializeFMUState(state)
    slave.fmu.freeFMUState(state)
    return bytes(data)


def deserialize(slave, data):
    """Reads a state; fmpy's own wrapper does not report refusals."""
    state = ctypes.c_void_p()
    buffer = ctypes.create_string_buffer(data, len(data))
    slave.fmu.fmi2DeSerializeFMUstate(slave.fmu.component, buffer, len(data), ctypes.byref(state))
    return state
