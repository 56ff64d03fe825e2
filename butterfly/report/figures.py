"""What the figures of all pages share: colours, the samples that are drawn, curves in a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Scatter

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

_SEEN = 20_000  # quanta of the whole range: a pixel is ten or more


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
    """Return the numbers of the samples that a drawing needs of (n,) curves with one time axis.

    Each ``every``-th sample where ``most`` are not exceeded; else of each stretch of time those
    with the least and the largest value of each curve, so that no peak is lost (as LTTB keeps those
    of one curve: Steinarsson, Downsampling time series for visual representation, 2013).
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """A figure of which there is one for each log; that of the log that is chosen is drawn.

    ``data`` and ``layout`` are of all of them, the traces without points; ``curves`` for each log
    and each group of traces that share an x: that x, then the y of each (see `packable`).
    """

    data: list[dict[str, Any]]
    layout: dict[str, Any]
    curves: list[list[list[dict[str, Any]]]]

    @classmethod
    def of(cls, figure: Figure, curves: list[list[list[dict[str, Any]]]]) -> Series:
        """Take the look of all from the figure of one."""
        common = figure.to_dict()
        traces = [{k: v for k, v in each.items() if k not in {"x", "y"}} for each in common["data"]]
        layout = {key: value for key, value in common["layout"].items() if key != "template"}
        return cls(data=traces, layout=layout, curves=curves)

    @classmethod
    def of_figures(cls, figures: Sequence[Figure]) -> Series:
        """Take the points from the figure of each log."""
        curves = [
            [[packable(np.asarray(values)) for values in (trace.x, trace.y)] for trace in each.data]
            for each in figures
        ]
        return cls.of(figures[0], curves)


def packable(values: NDArray[np.floating[Any]], *, logarithmic: bool = False) -> dict[str, Any]:
    """Return (n,) numbers as steps from each to the next, which pack into a byte or so each.

    They are ``begin``, the first number, and ``steps`` from it in units of ``quantum``, less than a
    screen shows of their range; None stands for what is no number. For a logarithmic axis it is
    their logarithms that are packed.
    """
    if logarithmic:
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.log10(values)
    there = np.isfinite(values)
    finite = np.asarray(values[there], dtype=np.float64)
    begin = float(finite[0]) if finite.size else 0.0
    quantum = float(f"{(np.ptp(finite) if finite.size else 0.0) / _SEEN:.3g}") or 1.0
    steps = np.full(values.size, None, dtype=object)
    steps[there] = np.diff(np.rint((finite - begin) / quantum), prepend=0.0).astype(np.int64)
    packed = {"begin": begin, "quantum": quantum, "steps": steps.tolist()}
    return packed | {"logarithmic": True} if logarithmic else packed
