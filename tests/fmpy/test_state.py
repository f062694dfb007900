"""Copying, restoring and serialising the state; Reset."""

import random
import subprocess
import sys
from pathlib import Path

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from support import Slave, deserialize, make_log, period, serialized

HERE = str(Path(__file__).parent)


def drive(slave, log, dt, first, last):
    """Runs rows first..last; gives the outputs after every step."""
    results = []
    for k in range(first, last):
        slave.apply(log[k])
        slave.step(k * dt, dt)
        results.append(slave.all_outputs())
    return results


@pytest.fixture
def setting(fmu, extracted):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    return folder, period(description), make_log(description, rows=120, seed=11, gaps=0.1)


def test_rollback_at_random_steps_repeats_every_bit(setting):
    folder, dt, log = setting
    choose = random.Random(1)
    with Slave(folder) as slave:
        slave.start()
        whole = drive(slave, log, dt, 0, len(log))
    with Slave(folder) as slave:
        slave.start()
        position, results, state = 0, [], slave.fmu.getFMUState()
        for _ in range(15):
            slave.fmu.fmi2GetFMUstate(slave.fmu.component, state)  # into the same handle
            ahead = choose.randint(1, 30)
            tried = drive(slave, log, dt, position, min(position + ahead, len(log)))
            slave.fmu.setFMUState(state)
            kept = choose.randint(0, len(tried))
            results += drive(slave, log, dt, position, position + kept)
            position += kept
        results += drive(slave, log, dt, position, len(log))
        slave.fmu.freeFMUState(state)
        assert results == whole


def test_a_state_is_restored_in_another_process_bit_for_bit(setting, tmp_path):
    folder, dt, log = setting
    with Slave(folder) as slave:
        slave.start()
        drive(slave, log, dt, 0, 60)
        (tmp_path / "state.bin").write_bytes(serialized(slave))
        expected = drive(slave, log, dt, 60, len(log))
    script = f"""
import sys
sys.path.insert(0, {HERE!r})
import fmpy
from support import Slave, deserialize, make_log
from test_state import drive
folder, dt = {str(folder)!r}, {dt!r}
log = make_log(fmpy.read_model_description(folder), rows=120, seed=11, gaps=0.1)
with Slave(folder) as slave:   # neither set up nor initialised
    slave.fmu.setFMUState(deserialize(slave, open({str(tmp_path / "state.bin")!r}, "rb").read()))
    print(drive(slave, log, dt, 60, len(log)))
"""
    output = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    assert output.strip() == repr(expected)


def test_serialising_is_deterministic_and_lossless(setting):
    folder, dt, log = setting
    with Slave(folder) as one, Slave(folder) as other:
        for slave in (one, other):
            slave.start()
            drive(slave, log, dt, 0, 40)
        data = serialized(one)
        assert data == serialized(other)
        state = deserialize(other, data)
        assert other.fmu.serializeFMUState(state) == data
        other.fmu.freeFMUState(state)


def test_foreign_cut_and_altered_states_are_refused(setting):
    folder, dt, log = setting
    with Slave(folder) as slave:
        slave.start()
        drive(slave, log, dt, 0, 20)
        data = serialized(slave)
        before = slave.all_outputs()
        choose = random.Random(2)
        spoilt = [b"", b"WSFMU", data[:-1], data + b"\0", b"\0" * len(data), data[: len(data) // 2]]
        for _ in range(60):
            position, bit = choose.randrange(len(data)), 1 << choose.randrange(8)
            spoilt.append(data[:position] + bytes([data[position] ^ bit]) + data[position + 1 :])
        for other in spoilt:
            with pytest.raises(FMICallException):
                deserialize(slave, other)
            assert "state" in slave.last_message()
        assert slave.all_outputs() == before
        drive(slave, log, dt, 20, 40)


def test_reset_is_a_fresh_instance(setting):
    folder, dt, log = setting
    with Slave(folder) as slave:
        fresh = serialized(slave)
        slave.start(3.0)
        for k in range(30):
            slave.apply(log[k])
            slave.step(3.0 + k * dt, dt)
        slave.fmu.reset()
        assert serialized(slave) == fresh
        slave.start()
        again = drive(slave, log, dt, 0, 50)
    with Slave(folder) as slave:
        slave.start()
        assert drive(slave, log, dt, 0, 50) == again


def test_a_foreign_handle_is_refused(setting):
    folder, _, _ = setting
    with Slave(folder) as one, Slave(folder) as other:
        one.start()
        other.start()
        state = one.fmu.getFMUState()
        one.fmu.freeFMUState(state)
        state = one.fmu.getFMUState()
        with pytest.raises(FMICallException):
            other.fmu.setFMUState(state)
        assert "not an FMU state of this instance" in other.last_message()
        one.fmu.freeFMUState(state)


def test_fmpy_continues_from_serialised_bytes(setting):
    folder, dt, log = setting
    with Slave(folder) as slave:
        slave.start()
        drive(slave, log, dt, 0, 60)
        data = serialized(slave)
        expected = drive(slave, log, dt, 60, len(log))
        outputs = slave.outputs
    result = fmpy.simulate_fmu(
        folder,
        fmu_state=data,
        start_time=60 * dt,
        stop_time=len(log) * dt,
        output_interval=dt,
        input=log,
        output=outputs,
    )
    for k, row in enumerate(expected):
        for name, value in zip(outputs, row):
            assert abs(float(result[name][k + 1]) - value) <= 1e-12 * max(1.0, abs(value)), name
