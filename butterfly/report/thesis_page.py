"""The thesis's tables and figures, each with what agrees with it and what does not."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from plotly.graph_objects import Figure

from butterfly.report.figures import GREY, look, panel, seen_samples
from butterfly.report.page import Page, PageTable, Section, write_page
from butterfly.report.pictures import write_pictures
from butterfly.thesis.tables import ThesisFigure

_MOST = 4000  # points of a curve
_MARKERS = {"dots": ("circle", 3), "circles": ("circle-open", 9), "crosses": ("x", 8)}
_DASHES = ("dash", "dot", "dashdot")


def write_thesis(
    folder: Path,
    figures: Sequence[ThesisFigure],
    table: PageTable,
    notes: Sequence[str],
    numbers: dict[str, Any],
) -> Path:
    """Write figures as CSV, PNG and SVG, and with the table on one page, whose path is returned."""
    page = Page(
        name="The thesis's tables and figures",
        description="What the thesis says of them, and what the same data and formulas give here.",
        kind="reproduction",
        summary=numbers["summary"],
        sections=[
            Section(title=table.title, text="\n".join(notes), tables=(table,)),
            *(
                Section(
                    title=f.title, text=f"{f.about}\n{f.sentence}".strip(), figures={f.name: plot}
                )
                for f, plot in zip(figures, map(drawn, figures), strict=True)
            ),
        ],
        numbers=numbers,
    )
    for figure in figures:
        figure.write(folder)
    write_pictures(page.figures, folder)
    write_page(page, folder / "thesis.html")
    return folder / "thesis.html"


def drawn(figure: ThesisFigure) -> Figure:
    """Draw a figure, with a line in grey at each abscissa that is printed."""
    plot, heights = panel(*figure.axes), []
    for number, (name, (kind, columns)) in enumerate(figure.curves.items()):
        (x, y), colour = columns.values(), look(number)[0]
        if kind in _MARKERS:
            some, (symbol, size) = np.arange(0, x.size, -(-x.size // _MOST)), _MARKERS[kind]
            style = {"mode": "markers", "marker": {"color": colour, "symbol": symbol, "size": size}}
        else:
            some, style = seen_samples([y], _MOST), {"mode": "lines", "line": {"color": colour}}
        plot.add_scatter(x=x[some], y=y[some], name=name, **style)
        heights += [y.min(), y.max()]
    for (name, at), dash in zip(figure.marks.items(), _DASHES, strict=False):
        line, span = {"color": GREY, "dash": dash}, [min(heights), max(heights)]
        plot.add_scatter(x=[at, at], y=span, mode="lines", line=line, name=f"{name}: {at:.5g}")
    plot.update_layout({f"{axis}axis": {"type": "log"} for axis in figure.logarithmic})
    return plot.update_xaxes(range=figure.shown)
