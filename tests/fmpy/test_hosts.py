"""The FMUs and their parameter sets under hosts other than fmpy's own loop: systems of the SSP standard in fmpy and
ecos, and a second checker."""

import ctypes
import importlib.util
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssv

SSP = "http://ssp-standard.org/SSP1/SystemStructure"


def write_ssp(path, fmu, model, parameters):
    """A system of one FMU whose Real outputs are connectors and whose parameters come from a parameter set."""
    outputs = [v.name for v in fmpy.read_model_description(fmu).modelVariables if v.causality == "output" and v.type == "Real"]
    connectors = "".join(f'<ssd:Connector name="{name}" kind="output"><ssc:Real/></ssd:Connector>' for name in outputs)
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="{SSP}Description" xmlns:ssc="{SSP}Common" version="1.0" name="one">
  <ssd:System name="system"><ssd:Elements>
    <ssd:Component name="estimator" type="application/x-fmu-sharedlibrary" source="resources/{model}.fmu">
      <ssd:Connectors>{connectors}</ssd:Connectors>
      <ssd:ParameterBindings><ssd:ParameterBinding source="resources/{model}.ssv"/></ssd:ParameterBindings>
    </ssd:Component>
  </ssd:Elements></ssd:System>
</ssd:SystemStructureDescription>"""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        archive.write(fmu, f"resources/{model}.fmu")
        archive.writestr(f"resources/{model}.ssv", parameters)


@pytest.fixture
def parameters(fmu, model):
    """The parameter set that the FMU carries, with one value changed."""
    with zipfile.ZipFile(fmu) as archive:
        text = archive.read(f"resources/{model}.ssv").decode()
    assert text.count('value="1e300"') == 1
    return text.replace('value="1e300"', 'value="-999.5"')


def test_simulate_ssp_takes_the_parameter_set(fmu, model, parameters, tmp_path):
    write_ssp(tmp_path / "one.ssp", fmu, model, parameters)
    # fmpy knows the parameters of a component by its name
    names = parameters.replace('<ssv:Parameter name="', '<ssv:Parameter name="estimator.')
    (tmp_path / "one.ssv").write_text(names)
    result = simulate_ssp(str(tmp_path / "one.ssp"), stop_time=0.2, step_size=0.01, parameter_set=read_ssv(str(tmp_path / "one.ssv")))
    assert len(result) > 18 and all(np.isfinite(result[name]).all() for name in result.dtype.names)


@pytest.mark.skipif(importlib.util.find_spec("ecospy") is None, reason="SKIPPED: ecospy has no wheel for this platform")
def test_ecos_takes_the_parameter_set(fmu, model, parameters, tmp_path):
    # ecos finds oneTBB, which its wheel lacks, once it is loaded
    ctypes.CDLL(str(Path(sysconfig.get_path("data")) / "lib" / "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosLib, EcosSimulation

    EcosLib.set_log_level("warn")
    write_ssp(tmp_path / "one.ssp", fmu, model, parameters)
    outputs = [v.name for v in fmpy.read_model_description(fmu).modelVariables if v.causality == "output" and v.type == "Real"]
    with EcosSimulation(0.01, ssp_path=str(tmp_path / "one.ssp")) as simulation:
        simulation.init(parameter_set=model)
        assert simulation.get_real("estimator::missing_value") == -999.5
        for _ in range(20):
            simulation.step()
        assert abs(simulation.get_time() - 0.2) < 1e-9
        assert all(np.isfinite(simulation.get_real(f"estimator::{name}")) for name in outputs)
        simulation.terminate()


def test_the_fmu_manipulation_toolbox_finds_no_fault(fmu):
    command = [sys.executable, "-c", "from fmu_manipulation_toolbox.cli.fmutool import fmutool; fmutool()"]
    done = subprocess.run([*command, "-input", fmu, "-check"], capture_output=True, text=True)
    text = done.stdout + done.stderr
    assert done.returncode == 0 and "seems to be compliant" in text and "No semantic error" in text, text
