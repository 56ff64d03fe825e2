"""The thesis beside what is obtained here: its tables, and figures with what agrees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from plotly.graph_objects import Figure

from butterfly.report.figures import GREY, look, panel, seen_samples
from butterfly.report.page import Page, PageTable, Section, write_page
from butterfly.report.pictures import write_pictures
from butterfly.thesis.claims import ThesisFigure

_MOST = 4000  # points of a curve
_MARKERS = {"dots": ("circle", 3), "circles": ("circle-open", 9), "crosses": ("x", 8)}
_DASHES = ("dash", "dot", "dashdot")


def write_thesis(
    folder: Path, table: PageTable, figures: Sequence[ThesisFigure], numbers: dict[str, Any]
) -> Path:
    """Write each figure as CSV, PNG and SVG, and all on one page, whose path is returned."""
    sections = [
        Section(title=each.title, text=each.sentence, figures={each.name: drawn(each)})
        for each in figures
    ]
    page = Page(
        name="The thesis, reproduced",
        description="What is printed, and what the same data and formulas give here.",
        kind="reproduction",
        summary=numbers["summary"],
        sections=[Section(title="Tables", tables=(table,)), *sections],
        numbers=numbers,
    )
    for each in figures:
        each.write(folder)
    write_pictures(page.figures, folder)
    write_page(page, folder / "thesis.html")
    return folder / "thesis.html"


def drawn(figure: ThesisFigure) -> Figure:
    """Draw a figure, with a line in grey at each abscissa that is printed."""
    found, heights = panel(*figure.axes), []
    for number, (name, (kind, columns)) in enumerate(figure.curves.items()):
        x, y = columns.values()
        colour, points = look(number)[0], kind in _MARKERS
        some = slice(None, None, -(-x.size // _MOST)) if points else seen_samples([y], _MOST)
        symbol, size = _MARKERS.get(kind, ("circle", 6))
        style = {"marker": {"color": colour, "symbol": symbol, "size": size}} if points else {}
        style |= {} if points else {"line": {"color": colour}}
        mode = "markers" if points else "lines"
        found.add_scatter(x=x[some], y=y[some], mode=mode, name=name, **style)
        heights += [np.nanmin(y), np.nanmax(y)]
    for (name, at), dash in zip(figure.marks.items(), _DASHES, strict=False):
        line, span = {"color": GREY, "dash": dash}, [min(heights), max(heights)]
        found.add_scatter(x=[at, at], y=span, mode="lines", line=line, name=f"{name}: {at:.4g}")
    found.update_layout({f"{axis}axis": {"type": "log"} for axis in figure.logarithmic})
    return found.update_xaxes(range=figure.shown)
