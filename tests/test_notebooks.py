"""The notebooks in examples/ run from top to bottom, draw, and are kept without outputs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
# Pictures of each notebook, and words that must be among its results.
NOTEBOOKS = {
    "paper_fig8.ipynb": (
        4,
        ("Verification: verified", "FELL", "1500 runs", "fallen: PID - Fuzzy-PID"),
    ),
}


def test_every_notebook_is_tested():
    assert {path.name for path in EXAMPLES.glob("*.ipynb")} == set(NOTEBOOKS)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_is_kept_without_outputs(name):
    """So that a change shows what was changed, and nothing in it is out of date."""
    book = json.loads((EXAMPLES / name).read_text(encoding="utf-8"))
    code = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert code
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert set(book["metadata"]) == {"kernelspec", "language_info"}


@pytest.mark.slow
@pytest.mark.one_in(8)
@pytest.mark.parametrize(("name", "expected"), NOTEBOOKS.items(), ids=NOTEBOOKS)
def test_a_notebook_runs_and_draws(name, expected, tmp_path, monkeypatch):
    nbformat = pytest.importorskip("nbformat", reason="requirements/notebook.txt")
    nbclient = pytest.importorskip("nbclient", reason="requirements/notebook.txt")
    pytest.importorskip("ipykernel", reason="requirements/notebook.txt")
    for place in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "MPLCONFIGDIR"):
        monkeypatch.setenv(place, str(tmp_path / "kernel"))
    work = tmp_path / "work"
    work.mkdir()
    book = nbformat.read(EXAMPLES / name, as_version=4)
    resources = {"metadata": {"path": str(work)}}
    # No time limit but the suite's: a busy machine takes as long as it needs.
    client = nbclient.NotebookClient(
        book, timeout=None, startup_timeout=3600, iopub_timeout=3600, resources=resources
    )
    client.execute()
    outputs = [one for cell in book.cells if cell.cell_type == "code" for one in cell.outputs]
    data = [one.get("data", {}) for one in outputs]
    pictures, words = expected
    assert sum("image/png" in one for one in data) == pictures
    told = "".join(one.get("text", "") for one in outputs)
    told += "".join(one.get("text/plain", "") + one.get("text/html", "") for one in data)
    assert [word for word in words if word not in told] == []
    assert [one for one in outputs if one.get("name") == "stderr"] == []
    assert list(work.iterdir()) == []
