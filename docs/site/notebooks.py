"""The notebooks of examples/notebooks: run, and made into pages that show what they answered.

They are kept without outputs. `make docs` runs each, and again where it or the program has changed;
what was run last lies in build/notebooks.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
from base64 import b64decode
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from html import escape
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
from nbclient import NotebookClient
from plotly.graph_objects import Figure

from butterfly.report.pictures import png_text

CHECKOUT = Path(__file__).parents[2]
NOTEBOOKS = CHECKOUT / "examples/notebooks"
RAN = CHECKOUT / "build/notebooks"
USED = ("butterfly", "examples", "experiments", "models")
"""What answers depend on."""
AT_A_TIME = 2
LONGEST = 1800  # s that a cell may take, on a machine that others share
PLOTLY = "application/vnd.plotly.v1+json"
ANSWER = "butterfly-result"
"""What the cell of an answer is marked with; other HTML loads plotly, for a notebook."""
PICTURE = re.compile(r'src="data:image/png;base64,([^"]+)"')
STYLE = re.compile(r"<style>(.*?)</style>", re.DOTALL)

Notebook = Any
"""A node of nbformat, which has no types."""


def run(source: Path, folder: Path) -> Notebook:
    """Run a notebook in a copy of what stands beside it; return it with its outputs.

    Raises
    ------
    CellExecutionError
        If a cell raises.
    ValueError
        If a cell warns, or a claim that it shows is false.
    """
    unused = shutil.ignore_patterns("results", "__pycache__", ".ipynb_checkpoints")
    for name in ("examples", "models"):
        shutil.copytree(CHECKOUT / name, folder / name, ignore=unused)
    notebook = nbformat.read(source, as_version=4)
    place = {"metadata": {"path": folder / source.parent.relative_to(CHECKOUT)}}
    quiet = ["--IPKernelApp.log_level=ERROR"]  # of how it is connected
    NotebookClient(
        notebook,
        timeout=LONGEST,
        kernel_name="python3",
        resources=place,
        extra_arguments=quiet,
    ).execute()
    for output in outputs_of(notebook):
        if output.get("name") == "stderr":
            raise ValueError(f"{source.name} warns: {output['text']}")
        claim = output.get("data", {}).get("text/plain", "")
        if re.search(r"\bFalse\b", claim):
            raise ValueError(f"{source.name} shows what is not so: {claim}")
    return notebook


def outputs_of(notebook: Notebook) -> list[Any]:
    """Return what all cells of a notebook show."""
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def as_written() -> dict[str, Notebook]:
    """Return all notebooks without outputs, by name."""
    return {path.stem: nbformat.read(path, as_version=4) for path in NOTEBOOKS.glob("*.ipynb")}


def executed() -> dict[str, Notebook]:
    """Return all notebooks with outputs, by name; those that have changed are run."""
    sources = sorted(NOTEBOOKS.glob("*.ipynb"))
    with ThreadPoolExecutor(AT_A_TIME) as workers:
        ran = workers.map(_executed, sources)
        return {source.stem: notebook for source, notebook in zip(sources, ran, strict=True)}


def _executed(source: Path) -> Notebook:
    """Return a notebook as it was run last, or run it."""
    digest, path = _digest(source), RAN / source.name
    if path.exists():
        notebook = nbformat.read(path, as_version=4)
        if notebook.metadata.get("digest") == digest:
            return notebook
    with tempfile.TemporaryDirectory() as folder:
        notebook = run(source, Path(folder))
    notebook.metadata["digest"] = digest
    RAN.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, path)
    return notebook


def _digest(source: Path) -> str:
    """Return what changes with a notebook, and with the program that it calls."""
    files = (path for name in USED for path in (CHECKOUT / name).rglob("*"))
    program = (path for path in files if path.suffix in {".j2", ".py", ".yaml", ".xml"})
    content = hashlib.sha256(source.read_bytes())
    for path in sorted(program):
        if "results" not in path.parts:
            content.update(path.read_bytes())
    return content.hexdigest()


def as_page(notebook: Notebook, name: str, folder: Path) -> str:
    """Return a notebook as a page in Markdown; its pictures are written into the folder."""
    pictures = iter(range(1, 100))

    def picture(text: str) -> str:
        """Write a PNG in text; return its name."""
        path = folder / f"{name}-{next(pictures)}.png"
        path.write_bytes(b64decode(text))
        return path.name

    def parts() -> Iterator[str]:
        for number, cell in enumerate(notebook.cells):
            if cell.cell_type == "markdown":
                yield cell.source
            else:
                yield f"```python\n{cell.source}\n```"
                for output in cell.outputs:
                    yield _shown(output, picture)
            if number == 0:
                yield f'To run it: <a href="{name}.ipynb" download>{name}.ipynb</a>.'

    return "\n\n".join(filter(None, parts())) + "\n"


def style() -> str:
    """Return the style sheet of answers in cells."""
    cell = CHECKOUT / "butterfly/report/templates/cell.html.j2"
    return "".join(STYLE.findall(cell.read_text(encoding="utf-8")))


def _shown(output: Any, picture: Any) -> str:  # noqa: ANN401 - nbformat's; writes a picture
    """Return an output of a cell in Markdown and HTML."""
    data = output.get("data", {})
    if PLOTLY in data:
        figure = Figure(_with_numbers({key: data[PLOTLY][key] for key in ("data", "layout")}))
        return f"![The figure of this cell]({picture(png_text(figure))})"
    if ANSWER in data.get("text/html", ""):
        html = STYLE.sub("", data["text/html"])  # which the site has once
        html = PICTURE.sub(lambda match: f'src="{picture(match[1])}"', html)
        return "\n".join(line for line in html.splitlines() if line.strip())
    text = output.get("text", data.get("text/plain", ""))
    return f'<pre class="output">{escape(text.rstrip())}</pre>' if text.strip() else ""


def _with_numbers(value: Any) -> Any:  # noqa: ANN401 - plain values of JSON
    """Return a figure's values with its arrays, which JSON has as bytes in text, and its gaps."""
    if isinstance(value, dict) and "bdata" in value:
        flat = np.frombuffer(b64decode(value["bdata"]), dtype=value["dtype"])
        sizes = str(value.get("shape", flat.size)).split(",")
        return flat.reshape([int(size) for size in sizes]).tolist()
    if isinstance(value, dict):
        return {key: _with_numbers(below) for key, below in value.items()}
    if isinstance(value, list) and all(isinstance(below, int | float | None) for below in value):
        return np.array(value, dtype=float).tolist()  # with nan for null
    return [_with_numbers(below) for below in value] if isinstance(value, list) else value
