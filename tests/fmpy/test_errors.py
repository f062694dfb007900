"""What is refused, and with which message."""

import re

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from support import Slave, is_measured, period


@pytest.fixture
def slave(fmu, extracted):
    with Slave(extracted(fmu)) as slave:
        yield slave


def refused(slave, action):
    count = len(slave.messages)
    with pytest.raises(FMICallException):
        action()
    assert len(slave.messages) == count + 1, "a refusal says why, once"
    return slave.last_message()


def parameters(slave):
    return [v for v in slave.description.modelVariables if v.causality == "parameter"]


def test_nan_and_infinity_in_a_parameter_are_refused(slave):
    for v in parameters(slave):
        if v.type == "Real":
            for value in (float("nan"), float("inf")):
                message = refused(slave, lambda: slave.set(v.name, value))
                assert v.name in message and "allowed" in message
                if v.min is not None and v.max is not None:
                    low, high = re.search(r"allowed: (\S+)\.\.=(\S+)", message).groups()
                    assert (float(low), float(high)) == (float(v.min), float(v.max)), message
            assert slave_value(slave, v) == float(v.start)


def slave_value(slave, variable):
    """Reads a value back; reading is allowed from initialisation on."""
    state = slave.fmu.getFMUState()
    slave.fmu.setupExperiment()
    slave.fmu.enterInitializationMode()
    value = slave.get(variable.name)
    slave.fmu.setFMUState(state)
    slave.fmu.freeFMUState(state)
    return value


def test_values_out_of_range_name_the_range(slave):
    for v in parameters(slave):
        if v.type not in ("Real", "Integer"):
            continue
        for bound, beyond in ((v.min, -1), (v.max, +1)):
            if bound is None or abs(float(bound)) > 1e9:
                continue
            value = float(bound) + beyond * max(1.0, abs(float(bound)))
            value = value if v.type == "Real" else int(value)
            message = refused(slave, lambda: slave.set(v.name, value))
            assert v.name in message and "allowed" in message, message


def test_unknown_choices_are_listed(slave):
    for v in parameters(slave):
        if v.type == "Enumeration":
            items = v.declaredType.items
            for value in (0, len(items) + 1):
                message = refused(slave, lambda: slave.set(v.name, value))
                assert v.name in message and all(item.name in message for item in items), message
            for item in items:
                slave.set(v.name, int(item.value))


def test_outputs_cannot_be_set(slave):
    for name in slave.outputs:
        message = refused(slave, lambda: slave.set(name, 1))
        assert f"{name} has causality output" in message


def test_fixed_parameters_cannot_be_set_while_running_and_tunable_can(slave):
    slave.start()
    for v in parameters(slave):
        value = {"Real": float, "Integer": int, "Enumeration": int, "Boolean": lambda b: b == "true"}[v.type](v.start)
        if v.variability == "fixed":
            message = refused(slave, lambda: slave.set(v.name, value))
            assert v.name in message and "fixed" in message
        else:
            slave.set(v.name, value)
    slave.step(0.0, period(slave.description))


def test_nan_is_a_sample_only_where_it_may_be(slave):
    slave.start()
    for v in slave.description.modelVariables:
        if v.causality != "input" or v.type != "Real":
            continue
        if is_measured(v):
            slave.set(v.name, float("nan"))
        else:
            assert v.name in refused(slave, lambda: slave.set(v.name, float("nan")))
    dt = period(slave.description)
    for k in range(20):
        slave.step(k * dt, dt)
    slave.all_outputs()


def test_unknown_value_references_and_types_are_refused(slave):
    slave.fmu.setupExperiment()
    slave.fmu.enterInitializationMode()
    assert "4711" in refused(slave, lambda: slave.fmu.getReal([4711]))
    assert "status" in refused(slave, lambda: slave.fmu.getReal([slave.vr["status"]]))
    assert "String" in refused(slave, lambda: slave.fmu.getString([0]))


def test_calls_out_of_order_are_refused(slave):
    assert "instantiated" in refused(slave, lambda: slave.step(0.0, 0.01))
    assert "instantiated" in refused(slave, lambda: slave.get("status"))
    slave.start()
    assert "step complete" in refused(slave, slave.fmu.enterInitializationMode)
    slave.fmu.terminate()
    assert "terminated" in refused(slave, lambda: slave.step(0.0, 0.01))
    slave.get("status")


def test_the_instance_survives_refusals(slave):
    slave.start()
    dt = period(slave.description)
    refused(slave, lambda: slave.step(5.0, dt))
    refused(slave, lambda: slave.step(0.0, -dt))
    slave.step(0.0, dt)
    assert slave.fmu.getRealStatus(2) == dt  # the last successful time


def test_no_step_goes_beyond_the_stop_time(slave):
    dt = period(slave.description)
    slave.start(0.0, stop=2 * dt)
    slave.step(0.0, dt)
    assert "stopTime" in refused(slave, lambda: slave.step(dt, 1.5 * dt))
    slave.step(dt, dt + 1e-12)


def test_a_wrong_guid_says_which_is_right(fmu, extracted):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    right = description.guid
    for wrong, word in (
        ("{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}", "no model"),
        ("nonsense", "not one of this library"),
        (right[:10] + "0000-0000" + right[19:], right),
        (right[:-5] + "abcd}", "start values"),
    ):
        messages = []
        try:
            Slave(folder, description, guid=wrong)
        except Exception as error:
            assert "instantiate" in str(error)
        else:
            pytest.fail(f"{wrong} was accepted")
        del messages


def test_logging_is_silent_on_success_and_honours_categories(fmu, extracted):
    folder = extracted(fmu)
    with Slave(folder) as slave:
        dt = period(slave.description)
        slave.start()
        for k in range(10):
            slave.step(k * dt, dt)
        slave.fmu.terminate()
        assert slave.messages == []
    with Slave(folder, logging=True) as slave:
        slave.start()
        assert [category for _, category, _ in slave.messages] == ["logEvents"]
        slave.fmu.setDebugLogging(True, ["logStatusFatal"])
        with pytest.raises(FMICallException):
            slave.step(9.0, 1.0)
        assert len(slave.messages) == 1
        slave.fmu.setDebugLogging(True, ["logStatusError"])
        with pytest.raises(FMICallException):
            slave.step(9.0, 1.0)
        assert slave.messages[-1][1] == "logStatusError"
        with pytest.raises(FMICallException):
            slave.fmu.setDebugLogging(True, ["logNothing"])
        assert "logNothing" in slave.last_message() and "logEvents" in slave.last_message()
