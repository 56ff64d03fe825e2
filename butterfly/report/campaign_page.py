"""Figures of a campaign: intervals that shrink towards the goal, and what was played."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from plotly.graph_objects import Figure

from butterfly.report.figures import GREY, look, panel, rows_panel


def shrinking(rows: Sequence[dict[str, Any]], names: Sequence[str]) -> Figure:
    """Draw the half-widths over what the goal asks, by robot time."""
    figure = panel("robot time in s", "half-width over what is wanted", 380)
    figure.update_yaxes(type="log")
    for number, name in enumerate(names):
        colour, symbol = look(number)
        points = [(row["robot time in s"], row[name]) for row in rows if row.get(name)]
        x, y = zip(*points, strict=True) if points else ((), ())
        style = {"line": {"color": colour}, "marker": {"color": colour, "symbol": symbol}}
        figure.add_scatter(x=x, y=y, mode="lines+markers", name=name, **style)
    ends = [0.0, max(row["robot time in s"] for row in rows)]
    line = {"color": GREY, "dash": "dash"}
    return figure.add_scatter(x=ends, y=[1.0, 1.0], mode="lines", name="goal", line=line)


def played(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw each run as a bar over robot time, its colour that of the mounted mass."""
    figure = rows_panel([row["played"] for row in rows], "robot time in s")
    masses = list(dict.fromkeys(row["added mass"] for row in rows))
    for number, mass in enumerate(masses):
        some = [k for k, row in enumerate(rows) if row["added mass"] == mass]
        ends = [(rows[k]["robot time in s"], rows[k]["length in s"]) for k in some]
        x = [each for end, length in ends for each in (end - length, end, math.nan)]
        y = [each for k in some for each in (k, k, math.nan)]
        line = {"color": look(number)[0], "width": 8}
        figure.add_scatter(x=x, y=y, mode="lines", name=mass, line=line)
    return figure
