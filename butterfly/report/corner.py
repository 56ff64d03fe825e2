"""A corner plot: parameter draws in pairs, and each alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.arrays import Samples
from butterfly.report.figures import PALETTE
from butterfly.report.format import with_error

_MOST = 6  # parameters in a figure
_CELL = 140  # pixels of a panel
_BINS = 24  # of a histogram


def corner_figure(rows: Sequence[Mapping[str, float]], units: Mapping[str, str]) -> Figure | None:
    """Draw the first parameters that vary: each alone, and below against each other.

    None if nothing varies. ``units`` are those of the parameters.
    """
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    names = [name for name, values in columns.items() if np.ptp(values) > 0][:_MOST]
    if not names:
        return None
    size = len(names)
    figure = make_subplots(size, size, horizontal_spacing=0.02, vertical_spacing=0.02)
    looks = {name: _axis(columns[name], f"{name} in {units[name]}") for name in names}
    for row, up in enumerate(names, start=1):
        for column, across in enumerate(names[:row], start=1):
            place, x, y = {"row": row, "col": column}, columns[across], columns[up]
            style = {"mode": "markers", "marker": {"color": PALETTE[0], "size": 3}}
            look = looks[up] if column == 1 else {}
            if row == column:
                counts, edges = np.histogram(x, _BINS)
                x, y = np.repeat(edges, 2), np.concatenate([[0], np.repeat(counts, 2), [0]])
                style, look = {"mode": "lines", "line": {"color": PALETTE[0], "width": 1.4}}, {}
            figure.add_scatter(x=x, y=y, **style, **place)
            figure.update_xaxes(showticklabels=row == size, **place)
            figure.update_xaxes(looks[across] if row == size else {}, **place)
            figure.update_yaxes({"showticklabels": bool(look), **look}, **place)
    return figure.update_layout(height=_CELL * size + 110, showlegend=False)


def _axis(values: Samples, title: str) -> dict[str, Any]:
    """Return the look of an axis, which names the mean and the standard deviation."""
    mean, spread = float(np.mean(values)), float(np.std(values))
    text = f"{with_error(mean, spread)}<br>± {spread:.2g}"
    return {"title": {"text": title}, "tickvals": [mean], "ticktext": [text]}
