"""What the figures of all pages share: colours, axes, a figure of each log and its samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.arrays import Samples
from butterfly.model.parameters import AddedMass

PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
"""Okabe and Ito's colours, told apart by colour-blind readers; a page has darker paper's, too."""

GREY = "#888888"
"""Of what is no curve of its own: limits, errors, what was taken for comparison."""

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "star", "pentagon")
"""As many as colours, in the same order."""

_SEEN = 20_000  # quanta of the whole range of a curve: a pixel is ten or more
_ROW, _HIGHEST = 18, 900  # pixels of a row, and of all at most


def look(number: int) -> tuple[str, str]:
    """Return colour and symbol of one of several things that a figure tells apart."""
    return PALETTE[number % len(PALETTE)], SYMBOLS[number % len(SYMBOLS)]


def mass_looks(masses: Iterable[AddedMass]) -> dict[AddedMass, tuple[str, str]]:
    """Return colour and symbol of each added mass of a data set, the same in all its figures."""
    return {mass: look(number) for number, mass in enumerate(sorted({*masses}))}


def grams(mass: AddedMass) -> str:
    """Return an added mass as a legend names it."""
    return f"{1e3 * mass.mass:g} g"


def middle(fits: Sequence[float] | Samples) -> int:
    """Return the number of the log with the middle FIT."""
    return int(np.argsort(fits)[len(fits) // 2])


def panel(across: str, up: str, height: int = 420) -> Figure:
    """Return a figure to which curves are added; an axis without a title needs none."""
    figure = Figure()
    if across:
        figure.update_xaxes(title=across)
    if up:
        figure.update_yaxes(title=up)
    figure.update_layout(height=height)
    return figure


def panels(
    across: str,
    up: Sequence[str],
    height: int,
    *,
    spacing: float = 0.05,
    shares: Sequence[float] | None = None,
) -> Figure:
    """Return panels one below the other, each with its title beside, over one axis below."""
    figure = make_subplots(
        rows=len(up), cols=1, shared_xaxes=True, vertical_spacing=spacing, row_heights=shares
    )
    for row, title in enumerate(up, start=1):
        figure.update_yaxes(title=title, row=row)
    figure.update_xaxes(title=across, row=len(up))
    figure.update_layout(height=height)
    return figure


def add(figure: Figure, row: int, x: object, y: object, **style: object) -> None:
    """Add a line or points to a panel of a figure with one column of them."""
    figure.add_scatter(x=x, y=y, row=row, col=1, **style)


def log_ticks(*digits: int) -> dict[str, Any]:
    """Return what makes an axis logarithmic, with these first digits written out, as numbers."""
    powers = [(digit, power) for power in range(-9, 10) for digit in digits]
    values = [float(f"{digit}e{power}") for digit, power in powers]
    return {"type": "log", "tickvals": values, "ticktext": [f"{value:.9g}" for value in values]}


def rows_panel(names: Sequence[str], across: str, line: int = _ROW) -> Figure:
    """Return a figure with a row for each name, of lines, the first on top; their y is 0, 1, …."""
    count, high = len(names), line * max((name.count("\n") + 1 for name in names), default=1)
    figure = panel(across, "", min(high * count, _HIGHEST) + 110)
    rows = list(range(0, count, -(-high * count // _HIGHEST)))  # those whose names have room
    texts = [escape(names[row]).replace("\n", "<br>") for row in rows]
    return figure.update_yaxes(tickvals=rows, ticktext=texts, range=[count - 0.4, -0.6])


def seen_samples(columns: Sequence[Samples], most: int, *, every: int = 1) -> NDArray[np.intp]:
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
    numbers = [np.array([0, count - 1])]
    for first, last in pairwise(edges.tolist()):
        for values in columns:
            part = values[first:last]
            numbers.append(first + np.array([part.argmin(), part.argmax()]))
    return np.unique(np.concatenate(numbers))


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """A figure for each log, drawn for the chosen one.

    All logs share ``data``, the traces without points, and ``layout``. ``curves`` has for each log
    and each group of traces with a common x: that x, then the y of each trace (see `packable`).
    ``stretches`` has for each log the range of x that is drawn first, None for all of it.
    """

    data: list[dict[str, Any]]
    layout: dict[str, Any]
    curves: list[list[list[dict[str, Any]]]]
    stretches: Sequence[tuple[float, float] | None] = ()

    @classmethod
    def of(
        cls,
        figure: Figure,
        curves: Sequence[Sequence[Sequence[NDArray[Any]]]],
        stretches: Sequence[tuple[float, float] | None] = (),
    ) -> Series:
        """Take the style from the figure of one log; its axes are all logarithmic or all linear."""
        common = figure.to_dict()
        traces = [
            {k: v for k, v in trace.items() if k not in {"x", "y"}} for trace in common["data"]
        ]
        layout = {key: value for key, value in common["layout"].items() if key != "template"}
        powers = layout.get("xaxis", {}).get("type") == "log"
        packed = [
            [[packable(curve, logarithmic=powers) for curve in group] for group in log]
            for log in curves
        ]
        return cls(data=traces, layout=layout, curves=packed, stretches=stretches)

    @classmethod
    def of_figures(
        cls, figures: Sequence[Figure], stretches: Sequence[tuple[float, float] | None] = ()
    ) -> Series:
        """Take the points from the figure of each log."""
        curves = [[[*map(np.asarray, (t.x, t.y))] for t in figure.data] for figure in figures]
        return cls.of(figures[0], curves, stretches)

    @property
    def parted(self) -> bool:
        """Whether only a part of some log is drawn first."""
        return any(stretch is not None for stretch in self.stretches)


def packable(values: NDArray[np.floating[Any]], *, logarithmic: bool = False) -> dict[str, Any]:
    """Return (n,) numbers as integer differences, which pack into about a byte each.

    The first finite number is ``begin``; ``steps`` are the differences from there on in units of
    ``quantum``, finer than a screen resolves, None where a number is not finite. For a logarithmic
    axis they are of the numbers' decimal logarithms.
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
