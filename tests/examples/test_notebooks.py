"""The notebooks in examples/notebooks run from their first cell to their last, as shipped."""

import json

import pytest

pytest.importorskip("nbclient", reason="extra 'docs'")
from tests.pages.scripts import script

notebooks = script("notebooks")

SOURCES = sorted(notebooks.NOTEBOOKS.glob("*.ipynb"))
NAMES = [path.stem for path in SOURCES]
WRITTEN = {
    "1-first-robot": {"first-robot/page.html", "first-robot/result.json", "first-robot/twin.xml"},
    "2-servo": {"servo/page.html", "servo/result.json", "servo/actuator.json"},
    "3-arm": {"arm/arm_identified.xml", "arm/elbow.json", "arm/shoulder.json", "arm/wrist.json"},
    "4-orbit": {"orbit/orbit.html"},
    "5-campaign": {"campaign/result.json", "campaign/twin.xml", "campaign/compensation.h"},
}
CLAIMS = {"1-first-robot": 7, "2-servo": 8, "3-arm": 9, "4-orbit": 6, "5-campaign": 5}
"""What is shown to be true: that an interval holds the truth, most of all."""
FIGURES = {"1-first-robot": 1, "2-servo": 1, "3-arm": 1, "4-orbit": 1, "5-campaign": 2}
ANSWERS = {"1-first-robot": 3, "2-servo": 2, "3-arm": 2, "4-orbit": 0, "5-campaign": 1}
"""Answers that are shown as cells."""
INSTALL = (
    "Install: `pip install . jupyterlab` in a clone of the repository (from its first release on: "
    "`pip install butterfly-testbed jupyterlab`)."
)


def _cells(path):
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_a_notebook_is_kept_without_outputs(path):
    ran = [cell for cell in _cells(path) if cell["cell_type"] == "code"]
    assert ran
    assert all(cell["execution_count"] is None and not cell["outputs"] for cell in ran)


@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_a_notebook_opens_with_its_question_and_one_line_of_installation_and_ends_with_more(path):
    first, *others = ["".join(cell["source"]) for cell in _cells(path)]
    assert first.startswith("# ")
    assert "?**\n" in first
    assert INSTALL in first.splitlines()
    assert not any("pip install" in text for text in others)
    assert any("../../docs/" in text for text in others[-2:])
    assert len(others) < 20


@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_a_notebook_calls_nothing_but_what_is_public(path):
    text = "\n".join(
        "".join(cell["source"]) for cell in _cells(path) if cell["cell_type"] == "code"
    )
    assert "import butterfly as bf" in text
    assert "from butterfly" not in text
    assert "import butterfly." not in text


@pytest.mark.slow
@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_a_notebook_runs_without_a_warning_and_its_claims_are_true(path, tmp_path):
    notebook = notebooks.run(path, tmp_path)  # which refuses a warning, and a claim that is false
    outputs = notebooks.outputs_of(notebook)
    shown = [output.get("data", {}) for output in outputs]
    texts = "".join(data.get("text/plain", "") for data in shown)
    assert texts.count("True") == CLAIMS[path.stem]
    assert sum(notebooks.PLOTLY in data for data in shown) == FIGURES[path.stem]
    cells = [notebooks.ANSWER in data.get("text/html", "") for data in shown]
    assert sum(cells) == ANSWERS[path.stem]
    html = "".join(data.get("text/html", "") for data in shown)
    assert "cdn.plot.ly" not in html.replace("https://cdn.plot.ly/un/", "")
    written = {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*") if file.is_file()}
    folder = "examples/notebooks/results"
    assert {f"{folder}/{name}" for name in WRITTEN[path.stem]} <= written


def _notebook(*outputs):
    output = notebooks.nbformat.v4.new_output
    cell = notebooks.nbformat.v4.new_code_cell(
        "f()", outputs=[output("display_data", data) for data in outputs]
    )
    title = notebooks.nbformat.v4.new_markdown_cell("# A title")
    return notebooks.nbformat.v4.new_notebook(cells=[title, cell])


def test_a_page_shows_code_texts_and_pictures_of_its_notebook(tmp_path):
    one = {"dtype": "f8", "bdata": "AAAAAAAA8D8="}
    figure = {"data": [{"type": "scatter", "x": one, "y": [None]}]}
    picture = '<img src="data:image/png;base64,QUI=">'
    cell = f'<div class="butterfly-result"><style>p {{}}</style>\n\n{picture}</div>'
    made = _notebook(
        {notebooks.PLOTLY: figure | {"layout": {}}}, {"text/html": cell}, {"text/plain": "a < b"}
    )
    page = notebooks.as_page(made, "x", tmp_path)
    assert page.startswith('# A title\n\nTo run it: <a href="x.ipynb" download>')
    assert "```python\nf()\n```\n\n![The figure of this cell](x-1.png)\n" in page
    assert '<div class="butterfly-result">\n<img src="x-2.png"></div>' in page
    assert '<pre class="output">a &lt; b</pre>' in page
    assert (tmp_path / "x-1.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "x-2.png").read_bytes() == b"AB"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "refused"),
    [("1 > 2", "shows what is not so"), ("import warnings; warnings.warn('w')", "warns")],
)
def test_a_claim_that_is_false_and_a_warning_are_refused(code, refused, tmp_path, monkeypatch):
    (tmp_path / "examples").mkdir()
    (tmp_path / "models").mkdir()
    monkeypatch.setattr(notebooks, "CHECKOUT", tmp_path)
    path = tmp_path / "examples/x.ipynb"
    cell = notebooks.nbformat.v4.new_code_cell(code)
    notebooks.nbformat.write(notebooks.nbformat.v4.new_notebook(cells=[cell]), path)
    with pytest.raises(ValueError, match=refused):
        notebooks.run(path, tmp_path / "copy")
