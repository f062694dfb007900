"""The notebooks of the examples run from the first cell to the last, as a user runs them."""

from concurrent.futures import ThreadPoolExecutor

import nbclient
import nbformat
import pytest
from conftest import ROOT

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """The notebooks, two at a time: most of the time a kernel starts."""

    def execute(path):
        notebook = nbformat.read(path, as_version=4)
        folder = tmp_path_factory.mktemp(path.stem)
        place = {"metadata": {"path": str(folder)}}
        client = nbclient.NotebookClient(notebook, timeout=300, startup_timeout=300, kernel_name="python3", resources=place)
        return client.execute()

    with ThreadPoolExecutor(2) as pool:
        return dict(zip([path.stem for path in NOTEBOOKS], pool.map(execute, NOTEBOOKS)))


def test_every_machine_has_a_notebook():
    assert [path.stem for path in NOTEBOOKS] == ["human_dynamics", "nursing_robot", "wheel_loader", "wheelchair", "wheeled_robot"]


@pytest.mark.parametrize("name", [path.stem for path in NOTEBOOKS])
def test_a_notebook_goes_from_a_log_to_fit_estimates_plots_and_fmu(name, executed):
    shown = [output for cell in executed[name].cells if cell.cell_type == "code" for output in cell.outputs]
    kinds = [kind for output in shown for kind in output.get("data", {})]
    text = "".join(output.get("text", "") for output in shown)
    assert "image/png" in kinds and kinds.count("text/html") >= 3, kinds
    assert "largest difference between fmpy and run" in text


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_what_it_printed(path):
    notebook = nbformat.read(path, as_version=4)
    assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in notebook.cells)
