"""The notebooks in examples/ run from their first cell to their last, as they are shipped."""

import json
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
LEFT = {
    "first-robot": {"report.html", "result.json", "twin.xml"},
    "servo": {"report.html", "result.json"},
    "orbit": {"orbit"},
}


@pytest.mark.parametrize("name", LEFT)
def test_a_notebook_is_kept_without_outputs(name):
    cells = json.loads((EXAMPLES / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    ran = [cell for cell in cells if cell["cell_type"] == "code"]
    assert ran
    assert all(cell["execution_count"] is None and not cell["outputs"] for cell in ran)


@pytest.mark.slow
@pytest.mark.parametrize("name", LEFT)
def test_a_notebook_runs_and_shows_what_it_says(name, tmp_path):
    nbformat = pytest.importorskip("nbformat", reason="extra 'docs'")
    client = pytest.importorskip("nbclient", reason="extra 'docs'")
    notebook = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)
    client.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert not any(output.get("name") == "stderr" for output in shown)
    pages = "".join(output.get("data", {}).get("text/html", "") for output in shown)
    assert "cdn.plot.ly" not in pages.replace("https://cdn.plot.ly/un/", "")
    assert "False" not in str([output.get("data", {}).get("text/plain") for output in shown])
    assert "butterfly-result" in pages
    assert {path.name for path in tmp_path.iterdir()} >= LEFT[name]
