"""A corner plot: parameter draws in pairs, and each alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.report.figures import PALETTE

_MOST = 6  # parameters in a figure
_CELL = 140  # pixels of a panel
_BINS = 24  # of a histogram


def corner_figure(rows: Sequence[Mapping[str, float]]) -> dict[str, Figure]:
    """Draw the first parameters that vary: histograms, and below them each against each other."""
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    names = [name for name, values in columns.items() if np.ptp(values) > 0][:_MOST]
    if not names:
        return {}
    size, place = len(names), dict(enumerate(names, start=1))
    figure = make_subplots(size, size, horizontal_spacing=0.02, vertical_spacing=0.02)
    for row, up in place.items():
        for column, across in list(place.items())[:row]:
            at = {"row": row, "col": column}
            if row == column:
                counts, edges = np.histogram(columns[up], _BINS)
                x, y = np.repeat(edges, 2), np.concatenate([[0], np.repeat(counts, 2), [0]])
                line = {"color": PALETTE[0], "width": 1.4}
                figure.add_scatter(x=x, y=y, mode="lines", line=line, hoverinfo="x", **at)
            else:
                marker = {"color": PALETTE[0], "size": 3, "opacity": 0.5}
                x, y = columns[across], columns[up]
                figure.add_scatter(x=x, y=y, mode="markers", marker=marker, **at)
            figure.update_xaxes(
                title=across if row == size else None, showticklabels=row == size, nticks=3, **at
            )
            named, marked = up if column == 1 and row > 1 else None, column == 1 and row > 1
            figure.update_yaxes(title=named, showticklabels=marked, nticks=3, **at)
    return {"corner": figure.update_layout(height=_CELL * size + 110, showlegend=False)}
