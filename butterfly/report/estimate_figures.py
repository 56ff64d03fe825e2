"""What an estimate is like at a glance: its intervals, how they go together, FIT log by log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from plotly.graph_objects import Figure, Heatmap, Scatter
from plotly.subplots import make_subplots

from butterfly.model.terms import TERMS
from butterfly.report.figures import GREY, PALETTE, add, look

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.identify.identification import Identification
    from butterfly.report.parameter_rows import ParameterRow

_ROW = 62  # pixels of a panel
_FEWEST = 2  # parameters that can hang together
_CELL = 44  # pixels of a cell of the map
_MOST_NUMBERED = 12  # parameters, up to which the cells of the map have numbers


def parameter_figure(rows: Sequence[ParameterRow]) -> Figure:
    """Draw estimates with their intervals, each on a scale of its own: a forest plot.

    Thick: 95 %; thin: what leaving one added mass out would give; a diamond: the truth, where it is
    known.
    """
    figure = make_subplots(rows=len(rows), cols=1, vertical_spacing=0.3 / max(len(rows), 1))
    for number, row in enumerate(rows, start=1):
        whisker, named = row.whisker, number == 1
        wide = {"mode": "lines", "hoverinfo": "x"}
        for limits, colour, width, name in (
            (whisker.left_out, GREY, 2, "one mass left out"),
            (whisker.limits, PALETTE[0], 6, "95 % interval"),
        ):
            if limits is not None:
                line = {"color": colour, "width": width}
                add(figure, number, limits, [0, 0], name=name, line=line, showlegend=named, **wide)
        dot = {"color": PALETTE[0], "size": 11, "symbol": "circle"}
        add(
            figure,
            number,
            [whisker.value],
            [0],
            name="estimate",
            mode="markers",
            marker=dot,
            showlegend=named,
        )
        if whisker.true is not None:
            diamond = {"color": PALETTE[5], "size": 10, "symbol": "diamond"}
            add(
                figure,
                number,
                [whisker.true],
                [0.4],
                name="truth",
                mode="markers",
                marker=diamond,
                showlegend=named,
            )
        title = f"{row.symbol}<br>{row.unit}"
        figure.update_yaxes(row=number, title=title, showticklabels=False, range=[-1, 1])
        figure.update_xaxes(row=number, range=list(whisker.scale), nticks=6)
    figure.update_layout(height=_ROW * len(rows) + 80)
    return figure


def correlation_map(estimate: ParameterEstimate) -> Figure | None:
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
                text=[data.logs[number].label for number in numbers],
                customdata=numbers.tolist(),
                mode="markers",
                name=f"{1e3 * mass.mass:g} g",
                marker={"color": colour, "symbol": symbol, "size": 9},
                hovertemplate="%{text}: %{y:.1f} %<extra></extra>",
            )
        )
    figure.update_xaxes(title="log, the worst first")
    figure.update_yaxes(title="FIT in %")
    figure.update_layout(height=320)
    return figure
