"""The FMUs under a second master: libcosim, which reads and drives them through Modelon's FMI Library."""

import numpy as np
import pytest
from support import Slave, make_log, period

pytest.importorskip("libcosimpy", reason="libcosimpy has no wheel for this platform")

from libcosimpy.CosimExecution import CosimExecution  # noqa: E402
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level  # noqa: E402
from libcosimpy.CosimManipulator import CosimManipulator  # noqa: E402
from libcosimpy.CosimObserver import CosimObserver  # noqa: E402
from libcosimpy.CosimSlave import CosimLocalSlave  # noqa: E402


def run_libcosim(fmu, slave, log, step_nanoseconds):
    """The real outputs after every step."""
    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_step_size(step_size=step_nanoseconds)
    index = execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name="estimator"))
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    assert execution.add_manipulator(manipulator) and execution.add_observer(observer)
    # Estimators have no input that is not real.
    inputs = [name for name in slave.inputs if slave.type[name] == "Real"]
    outputs = [slave.vr[name] for name in slave.outputs if slave.type[name] == "Real"]
    rows = []
    for row in log:
        values = [float(row[name]) for name in inputs]
        assert manipulator.slave_real_values(index, [slave.vr[name] for name in inputs], values)
        assert execution.step()
        rows.append(list(observer.last_real_values(index, outputs)))
    return np.array(rows)


def test_libcosim_and_fmpy_agree(fmu, extracted):
    folder = extracted(fmu)
    with Slave(folder) as slave:
        step = round(period(slave.description) * 1e9)
        log = make_log(slave.description, rows=150, seed=41)
        theirs = run_libcosim(fmu, slave, log, step)
        slave.start()
        names = [name for name in slave.outputs if slave.type[name] == "Real"]
        ours = []
        for k, row in enumerate(log):
            slave.apply(row)
            slave.step(k * step * 1e-9, step * 1e-9)
            ours.append([slave.get(name) for name in names])
        assert np.isfinite(theirs).all() and np.ptp(theirs, axis=0).any()
        assert np.allclose(theirs, ours, rtol=1e-9, atol=1e-12)
