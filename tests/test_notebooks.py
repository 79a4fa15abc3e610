"""The notebooks in examples/ run from top to bottom, and draw."""

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


@pytest.mark.slow
@pytest.mark.one_in(8)
@pytest.mark.parametrize(("name", "expected"), NOTEBOOKS.items(), ids=NOTEBOOKS)
def test_a_notebook_runs_and_draws(name, expected, tmp_path, monkeypatch):
    nbformat = pytest.importorskip("nbformat", reason="requirements/notebook.txt")
    nbclient = pytest.importorskip("nbclient", reason="requirements/notebook.txt")
    pytest.importorskip("ipykernel", reason="requirements/notebook.txt")
    for place in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "MPLCONFIGDIR"):
        monkeypatch.setenv(place, str(tmp_path / "kernel"))
    # The command sets them for its process: here, that of a test before.
    for setting in ("MPLBACKEND", "MATPLOTLIBRC"):
        monkeypatch.delenv(setting, raising=False)
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
    errors = "".join(one["text"] for one in outputs if one.get("name") == "stderr")
    lines = errors.splitlines()  # whether code is compiled depends on what ran before
    assert [line for line in lines if not line.startswith("trunk: compiling ")] == []
    assert list(work.iterdir()) == []
