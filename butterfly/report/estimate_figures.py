"""What an estimate is like at a glance: its intervals, how they go together, FIT log by log."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from plotly.graph_objects import Figure, Heatmap, Scatter
from plotly.subplots import make_subplots

from butterfly.identification.estimate import Estimate
from butterfly.identification.identification import Identification
from butterfly.model.terms import TERMS
from butterfly.report.figures import GREY, PALETTE, add, grams, look, rank_by_fit
from butterfly.report.parameter_table import ParameterRow

_ROW = 64  # pixels of a panel and what is below it
_GAP = 0.6  # of a panel and what is below it, that is below
_FEWEST = 2  # parameters that can hang together
_CELL = 44  # pixels of a cell of the map
_MOST_NUMBERED = 12  # parameters, up to which the cells of the map have numbers


def parameter_figure(rows: Sequence[ParameterRow]) -> Figure:
    """Draw estimates with their intervals, each on a scale of its own: a forest plot.

    Thick: 95 %; thin: what leaving one added mass out would give; a diamond: the truth, where it is
    known.
    """
    count = len(rows)
    figure = make_subplots(rows=count, cols=1, vertical_spacing=_GAP / max(count, 1))
    for number, row in enumerate(rows, start=1):
        whisker, named = row.whisker, number == 1
        wide = {"mode": "lines", "hoverinfo": "x", "showlegend": named}
        marks = {"mode": "markers", "showlegend": named}
        for limits, height, colour, width, name in (
            (whisker.limits, 0.0, PALETTE[0], 6, "95 % interval"),
            (whisker.left_out, -0.6, GREY, 3, "one mass left out"),
        ):
            if limits is not None:
                line = {"color": colour, "width": width}
                add(figure, number, limits, [height] * 2, name=name, line=line, **wide)
        dot = {"color": PALETTE[5], "size": 9, "symbol": "circle"}
        add(figure, number, [whisker.value], [0], name="estimate", marker=dot, **marks)
        if whisker.true is not None:
            diamond = {"color": PALETTE[2], "size": 9, "symbol": "diamond"}
            add(figure, number, [whisker.true], [0.6], name="truth", marker=diamond, **marks)
        label = f"{row.symbol} in {row.unit}"
        figure.update_yaxes(row=number, tickvals=[0], ticktext=[label], range=[-1, 1])
        ends = whisker.scale if np.isfinite(whisker.scale).all() else None
        figure.update_xaxes(row=number, range=ends, nticks=6)
    figure.update_layout(height=_ROW * count + 80)
    return figure


def correlation_map(estimate: Estimate) -> Figure | None:
    """Draw how the errors of an estimate's parameters go together; None without a covariance."""
    numbered = len(estimate.names) <= _MOST_NUMBERED
    symbols = [TERMS[name].symbol for name in estimate.names]
    errors = estimate.standard_errors
    if len(symbols) < _FEWEST or not np.isfinite(estimate.covariance).all():
        return None
    sizes = np.where(errors > 0, errors, 1.0)
    correlation = estimate.covariance / np.outer(sizes, sizes)
    figure = Figure(
        Heatmap(
            z=correlation[::-1],
            x=symbols,
            y=symbols[::-1],
            zmin=-1,
            zmax=1,
            colorscale="RdBu",
            texttemplate="%{z:.2f}" if numbered else None,
            showscale=not numbered,
            hovertemplate="%{y} and %{x}: %{z:.3f}",
            colorbar={"title": {"text": "correlation"}},
        )
    )
    figure.update_layout(height=_CELL * len(symbols) + 110)
    return figure


def ranked_figure(identification: Identification) -> Figure:
    """Draw the FIT of every log, the worst first, by added mass; a point's number is its log's."""
    data, fits = identification.data, identification.fits
    order = np.argsort(fits)
    figure = Figure()
    for index, mass in enumerate(data.masses):
        colour, symbol = look(index)
        ranks = [k for k, number in enumerate(order) if data.logs[number].added_mass == mass]
        numbers = order[ranks]
        figure.add_trace(
            Scatter(
                x=[rank + 1 for rank in ranks],
                y=fits[numbers],
                text=[escape(data.logs[number].label) for number in numbers],
                customdata=numbers.tolist(),
                mode="markers",
                name=grams(mass),
                marker={"color": colour, "symbol": symbol, "size": 9},
                hovertemplate="%{text}: %{y:.1f} %<extra></extra>",
            )
        )
    rank_by_fit(figure, len(fits))
    return figure
