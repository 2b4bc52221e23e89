import os
from pathlib import Path

import pytest
from conftest import ROOT

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

NOTEBOOKS = sorted((ROOT / "examples/notebooks").glob("*.ipynb"))
SHARED = Path(os.environ.get("EPLAT_SHARED", ROOT.parent / "shared"))


def test_both_are_there():
    assert [notebook.stem for notebook in NOTEBOOKS] == ["closing_the_loop", "erp_calibration"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_they_are_kept_without_outputs_and_short(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert len(notebook.cells) < 40
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert not cell.outputs and cell.execution_count is None, (
                f"{path.name}: clear the outputs before you commit it"
            )


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_they_run(path, tmp_path, monkeypatch):
    monkeypatch.setenv("EPLAT_SHARED", str(SHARED))
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = nbformat.read(path, as_version=4)
    if "data/cosmas" in str(notebook) and not (SHARED / "data/cosmas").is_dir():
        pytest.skip("reference data not found (cosmas)")
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    said = "".join(str(output) for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs)
    expected = {"erp_calibration": "Verdict: ", "closing_the_loop": "found: ['operator']"}
    assert expected[path.stem] in said
