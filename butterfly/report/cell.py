"""A result in a notebook: the first screen of its page, without scripts."""

from __future__ import annotations

import io
from base64 import b64encode

from matplotlib.backends.backend_agg import FigureCanvasAgg
from plotly.graph_objects import Figure

from butterfly.report.page import Page, environment
from butterfly.report.pictures import draw

_DOTS = 80  # of the picture, per inch


def cell_html(page: Page, figure: Figure | None = None) -> str:
    """Return verdict, tiles, the leading table and one figure of a page, the first if not given."""
    drawn = figure if figure is not None else next(iter(page.figures.values()), None)
    picture = "" if drawn is None else _picture(drawn)
    tables = next((part.tables for part in page.parts if part.tables), ())
    return (
        environment()
        .get_template("cell.html.j2")
        .render(page=page, tables=tables[:1], picture=picture)
    )


def _picture(figure: Figure) -> str:
    """Return a figure as a PNG in text."""
    still, file = draw(figure), io.BytesIO()
    FigureCanvasAgg(still).print_figure(file, format="png", dpi=_DOTS, bbox_inches="tight")
    return b64encode(file.getvalue()).decode("ascii")
