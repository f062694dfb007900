"""The XML and the archive, as fmpy and the standard's rules see them."""

import re
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from conftest import FMUS, MODELS
from fmpy.validation import validate_fmu
from lxml import etree


def test_fmpy_finds_no_problem(fmu):
    assert validate_fmu(fmu) == []


def test_variables_are_complete(fmu):
    description = fmpy.read_model_description(fmu)
    names = [v.name for v in description.modelVariables]
    assert len(set(names)) == len(names)
    units = {u.name: u for u in description.unitDefinitions}
    for variable in description.modelVariables:
        assert variable.description and variable.description.strip().endswith((".", ":")), variable.name
        if variable.type == "Real":
            assert variable.unit in units, variable.name
            assert units[variable.unit].baseUnit is not None, variable.unit
        if variable.type == "Enumeration":
            values = [int(item.value) for item in variable.declaredType.items]
            assert values == list(range(1, len(values) + 1))
            assert variable.causality == "output" or int(variable.start) in values
        if variable.causality == "input":
            # a host may set a start as it stands, and FMI 2.0 knows finite ones only
            assert variable.type == "Boolean" or np.isfinite(float(variable.start)), variable.name
        assert variable.causality != "independent", "older FMI Libraries print an error at a variable for the time"
        if variable.min is not None and variable.start is not None:
            assert float(variable.min) <= float(variable.start), variable.name
        if variable.max is not None and variable.start is not None:
            assert float(variable.start) <= float(variable.max), variable.name


def test_every_model_has_what_the_contract_says(fmu):
    description = fmpy.read_model_description(fmu)
    variables = {v.name: v for v in description.modelVariables}
    assert description.fmiVersion == "2.0"
    assert description.coSimulation.modelIdentifier == description.modelName
    assert description.variableNamingConvention == "structured"
    for flag in (
        "canHandleVariableCommunicationStepSize",
        "canInterpolateInputs",
        "canGetAndSetFMUstate",
        "canSerializeFMUstate",
    ):
        assert getattr(description.coSimulation, flag) is True, flag
    assert variables["sample_period"].variability == "fixed"
    assert float(description.defaultExperiment.stepSize) == float(variables["sample_period"].start)
    assert variables["status"].type == "Integer"
    assert variables["healthy"].type == "Boolean"
    assert any(name == "nis" or name.startswith(("nis_", "chi2")) for name in variables)
    outputs = [v for v in description.modelVariables if v.causality == "output"]
    assert {unknown.variable.name for unknown in description.outputs} == {v.name for v in outputs}
    assert any(v.name.endswith("_std") for v in outputs)
    for v in outputs:
        if v.name.endswith("_std"):
            assert variables[v.name[: -len("_std")]].unit == v.unit, v.name
    for v in description.modelVariables:
        if v.causality in ("input", "output"):
            assert re.fullmatch(r"[a-z][A-Za-z0-9_]*", v.name), v.name


def test_the_archive_holds_what_the_standard_says(fmu, model):
    with zipfile.ZipFile(fmu) as archive:
        names = archive.namelist()
        assert names == sorted(names)
        for name in (
            "modelDescription.xml",
            "model.png",
            f"binaries/linux64/{model}.so",
            "documentation/index.html",
            "documentation/licenses/license.txt",
            "documentation/licenses/LICENSE-MIT.txt",
            "documentation/licenses/LICENSE-APACHE.txt",
            f"resources/{model}.ssv",
            "extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml",
            "extra/org.fmi-standard.fmi-ls-ref/experiments.xml",
            "terminalsAndIcons/terminalsAndIcons.xml",
        ):
            assert name in names
        # the defaults need no resources
        assert "resources/start_values.json" not in names
        assert all(info.date_time == (1980, 1, 1, 0, 0, 0) for info in archive.infolist())
        page = archive.read("documentation/index.html").decode()
    for variable in fmpy.read_model_description(fmu).modelVariables:
        assert f"<td>{variable.name}</td>" in page, variable.name


def test_every_model_has_a_picture_of_its_own():
    pictures = set()
    for path in FMUS.glob("*.fmu"):
        with zipfile.ZipFile(path) as archive:
            picture = archive.read("model.png")
        assert picture.startswith(b"\x89PNG") and len(picture) < 10_000
        pictures.add(picture)
    assert len(pictures) == len(MODELS)


def test_who_made_it_and_what_its_values_are(fmu):
    description = fmpy.read_model_description(fmu)
    assert description.author and description.copyright and description.license
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", description.generationDateAndTime)
    for v in description.modelVariables:
        if v.type == "Real":
            assert 0.0 < float(v.nominal) < 1e300, v.name
    quantities = {v.unit: v.quantity for v in description.modelVariables if v.type == "Real"}
    assert quantities["s"] == "Time" and {"Angle", "Velocity", "Force", "Torque"} & set(quantities.values())


def test_terminals_hold_every_input_and_output(fmu):
    with zipfile.ZipFile(fmu) as archive:
        document = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
    etree.XMLSchema(etree.parse(str(schema))).assertValid(document)
    variables = fmpy.read_model_description(fmu).modelVariables
    for terminal, causality in zip(document[0], ("input", "output"), strict=True):
        members = [member.get("variableName") for member in terminal]
        assert members == [v.name for v in variables if v.causality == causality]


@pytest.mark.parametrize("word", ["wheelstate", "NaN", "sample_period", "Bits of status"])
def test_the_page_explains_the_model(fmu, word):
    with zipfile.ZipFile(fmu) as archive:
        assert word in archive.read("documentation/index.html").decode()
