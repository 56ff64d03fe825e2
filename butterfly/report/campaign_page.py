"""Figures of a campaign: intervals that shrink towards the goal, and what was played."""

from __future__ import annotations

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
    return figure.add_hline(y=1.0, line={"color": GREY, "dash": "dash", "width": 1})


def played(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw each run as a bar over robot time, its colour that of the mounted mass."""
    figure = rows_panel([row["played"] for row in rows], "robot time in s")
    masses = list(dict.fromkeys(row["added mass"] for row in rows))
    for number, mass in enumerate(masses):
        some = [k for k, row in enumerate(rows) if row["added mass"] == mass]
        lengths = [rows[k]["length in s"] for k in some]
        figure.add_bar(
            x=lengths,
            y=some,
            base=[rows[k]["robot time in s"] - rows[k]["length in s"] for k in some],
            orientation="h",
            name=mass,
            marker={"color": look(number)[0]},
        )
    return figure
