"""What the figures of all pages have in common: colours, packed curves, a log against time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from butterfly.model.parameters import AddedMass

PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
"""Okabe and Ito's colours, told apart by colour-blind readers; a page has darker paper's, too."""

GREY = "#888888"
"""Of what is no curve of its own: limits, errors, what was taken for comparison."""

SHADE = "rgba(128,128,128,0.22)"
"""Of a band."""

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "star", "pentagon")
"""As many as colours, in the same order."""

MARKS = 10
"""Numbers of logs that an axis shows, or about so many."""

_MOST_OF_A_LOG = 20_000  # samples drawn of each column


def look(number: int) -> tuple[str, str]:
    """Return colour and symbol of one of several things that a figure tells apart."""
    return PALETTE[number % len(PALETTE)], SYMBOLS[number % len(SYMBOLS)]


def grams(mass: AddedMass) -> str:
    """Return an added mass as a legend names it."""
    return f"{1e3 * mass.mass:g} g"


def middle(fits: Sequence[float] | NDArray[np.float64]) -> int:
    """Return the number of the log with the middle FIT."""
    return int(np.argsort(fits)[len(fits) // 2])


def rank_by_fit(figure: Figure, count: int) -> None:
    """Give a figure of the FITs of so many logs, the worst first, its axes."""
    figure.update_xaxes(title="log, the worst first", dtick=max(1, round(count / MARKS)))
    figure.update_yaxes(title="FIT in %")
    figure.update_layout(height=320)


def add(figure: Figure, row: int, x: object, y: object, **style: object) -> None:
    """Add a line or points to a panel of a figure with one column of them."""
    figure.add_trace(Scatter(x=x, y=y, **style), row=row, col=1)


def seen_samples(
    columns: Sequence[NDArray[np.float64]], most: int, *, every: int = 1
) -> NDArray[np.intp]:
    """Return the numbers of the samples that a drawing needs of curves with one time axis.

    Each ``every``-th sample where that is few enough; else of each stretch of time those with the
    least and the largest value of each curve, so that no peak is lost (as LTTB keeps those of one
    curve: Steinarsson, Downsampling time series for visual representation, 2013).

    Parameters
    ----------
    columns
        (n,) values of each curve.
    most
        Samples that are few enough.
    every
        Samples that a step of the drawing holds.
    """
    count = columns[0].size
    if count // every <= most:
        return np.arange(0, count, every)
    stretches = max(most // (2 * len(columns)), 1)
    edges = np.linspace(0, count, stretches + 1).astype(np.intp)
    kept = [np.array([0, count - 1])]
    for first, last in pairwise(edges.tolist()):
        for values in columns:
            part = values[first:last]
            kept.append(first + np.array([part.argmin(), part.argmax()]))
    return np.unique(np.concatenate(kept))


def log_figure(
    time: NDArray[np.float64],
    columns: dict[str, NDArray[np.float64]],
    intervals: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> Figure:
    """Draw a log against time, a panel for each column and one for the sampling intervals.

    Parameters
    ----------
    time
        (n,) stamps in s.
    columns
        (n,) values by axis title.
    intervals
        (n - 1,) instants in s and (n - 1,) lengths in ms of the sampling intervals.
    """
    panels = {title: (time, values) for title, values in columns.items()}
    panels["interval in ms"] = intervals
    rows = len(panels)
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, (title, (x, y)) in enumerate(panels.items(), start=1):
        colour, _ = look(row - 1)
        style = {"mode": "lines", "line": {"color": colour, "width": 1}}
        if row == rows:
            style = {"mode": "markers", "marker": {"color": colour, "size": 2}}
        some = seen_samples([y], _MOST_OF_A_LOG)
        add(figure, row, x[some], y[some].astype(np.float32), showlegend=False, **style)
        figure.update_yaxes(title=title, row=row)
    figure.update_xaxes(title="time in s", row=rows)
    figure.update_layout(height=220 * rows + 80)
    return figure
