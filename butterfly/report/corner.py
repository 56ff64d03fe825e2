"""Corner plots: parameters against each other, and in words which of them move together.

An ellipse contains both true values with a probability of 95 %, if errors are normal with the
joint covariance: (x - m)' S^-1 (x - m) = -2 ln(1 - 0.95) (chi squared with two degrees of freedom).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.arrays import Samples, unit_diagonal
from butterfly.errors import IdentifiabilityError
from butterfly.identification.identified import Identified
from butterfly.identification.predict import honest_covariance
from butterfly.identification.trust import or_nan
from butterfly.report.figures import PALETTE
from butterfly.report.format import upwards
from butterfly.verdict import CONFIDENCE, SPREADS

MOST = 6
"""Parameters against each other; of more, those that are most correlated."""

STRONG = 0.9
"""Correlation from which parameters are said to move together."""

REACH = math.sqrt(-2 * math.log(1 - CONFIDENCE))
"""Standard deviations that an ellipse reaches from the values, along either axis."""

_FEWEST = 2  # parameters that can be correlated
_CELL, _AROUND = 105, 130  # pixels of a panel, and of all that is beside the panels
_POINTS = 73  # of an ellipse, whose first is its last
_BINS = 24  # of a histogram
_ROOM = 1.12  # times what a panel has to show
_SMALL = 10  # of marks, in pixels
_LONG = 10  # letters of a mark, from which all are turned
_TURN = -35  # degrees
_CLEARLY = 0.5  # of the smaller error of two parameters, below which that of a ratio is smaller
_ROUND = 0.995  # correlation that two decimals would show as 1
_MARKS = {"true value": (PALETTE[2], "diamond"), "given value": (PALETTE[3], "square")}


class CornerAxis(NamedTuple):
    """A parameter of a corner plot: its value, its 95 % interval, and what else is known of it."""

    name: str
    unit: str
    value: float
    lower: float
    upper: float
    marks: Mapping[str, float] = {}  # by names of `_MARKS`

    @property
    def mark(self) -> str:
        """Its name, and half its interval: in per cent of the value if that is clearly not 0."""
        half = max(self.upper - self.value, self.value - self.lower)
        if not half > 0:
            return self.name
        size = abs(self.value)
        width = upwards(half / size) if half < size else f"{half:.1g} {self.unit}"
        return f"{self.name}<br>±{width}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Corner:
    """Parameters with an (n, n) covariance, and (m, n) draws of them, if there are any."""

    axes: tuple[CornerAxis, ...]
    covariance: Samples
    draws: Samples | None = field(default=None)

    @property
    def correlation(self) -> Samples:
        """(n, n) correlations."""
        return unit_diagonal(self.covariance)[0]

    def chosen(self, most: int = MOST) -> Corner:
        """Return it with the parameters that are most correlated, in their order."""
        count, sizes = len(self.axes), np.abs(self.correlation)
        if count <= most:
            return self
        pairs = sorted(combinations(range(count), 2), key=lambda pair: -sizes[pair])
        some = dict.fromkeys(k for pair in pairs for k in pair)
        few = sorted([*some][:most])
        return replace(
            self,
            axes=tuple(self.axes[k] for k in few),
            covariance=self.covariance[np.ix_(few, few)],
            draws=None if self.draws is None else self.draws[:, few],
        )


def corner_of(identification: Identified) -> Corner | None:
    """Return the corner plot of an identification; None of fewer than two parameters with errors.

    Its covariance is that from which parameters are drawn (see `identification.predict`).
    """
    estimate = identification.estimate
    try:
        covariance = honest_covariance(estimate)
    except IdentifiabilityError:
        return None
    given, rows = estimate.known.uncertain, estimate.table(identification.truth)
    axes = {
        row.name: CornerAxis(
            row.name,
            row.unit,
            row.value,
            or_nan(row.lower),
            or_nan(row.upper),
            ({} if row.true is None else {"true value": row.true})
            | ({"given value": given[row.name].value} if row.name in given else {}),
        )
        for row in rows
        if row.value is not None and not row.known
    }
    spread = np.diag(covariance)
    some = [k for k, name in enumerate(estimate.names) if name in axes and spread[k] > 0]
    if len(some) < _FEWEST:
        return None
    return Corner(
        axes=tuple(axes[estimate.names[k]] for k in some), covariance=covariance[np.ix_(some, some)]
    )


def corner_of_draws(numbers: Mapping[str, Any]) -> Corner | None:
    """Return that of draws, by their rows and units; None where nothing varies."""
    rows, units = numbers["rows"], numbers["units"]
    columns = {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}
    names = [name for name, values in columns.items() if np.ptp(values) > 0]
    if not names:
        return None
    draws = np.column_stack([columns[name] for name in names])
    covariance, means = np.atleast_2d(np.cov(draws.T)), draws.mean(axis=0)
    halves = SPREADS * np.sqrt(np.diag(covariance))
    axes = (
        CornerAxis(name, units[f"rows.{name}"], float(mean), float(mean - half), float(mean + half))
        for name, mean, half in zip(names, means, halves, strict=True)
    )
    return Corner(axes=tuple(axes), covariance=covariance, draws=draws)


def ellipse(centre: Samples, covariance: Samples) -> Samples:
    """Return (2, m) points on the 95 % ellipse of two values with a (2, 2) covariance."""
    turn = np.linspace(0, 2 * math.pi, _POINTS)
    correlation, spread = unit_diagonal(covariance)
    sizes, axes = np.linalg.eigh(correlation)  # of one scale, however different the units are
    circle = np.sqrt(np.maximum(sizes, 0.0))[:, None] * np.array([np.cos(turn), np.sin(turn)])
    return np.asarray(centre[:, None] + REACH * spread[:, None] * (axes @ circle))


def corner_figure(whole: Corner) -> Figure:
    """Draw parameters alone, below against each other, and above as numbers their correlations."""
    corner = whole.chosen()
    count, spread = len(corner.axes), np.sqrt(np.diag(corner.covariance))
    specs: list[list[dict[str, Any] | None]] = [
        [{} if column <= row else None for column in range(count)] for row in range(count)
    ]
    figure = make_subplots(
        count, count, specs=specs, horizontal_spacing=0.012, vertical_spacing=0.012
    )
    reaches = [_reach(axis, size) for axis, size in zip(corner.axes, spread, strict=True)]
    for column, row in combinations(range(count), 2):
        _pair(figure, corner, column, row, first=(column, row) == (0, 1))
        _say(figure, count, column, row, float(corner.correlation[row, column]))
    turned = any(
        len(line) > _LONG for axis in corner.axes for line in axis.mark.split("<br>") if line
    )
    for k, axis in enumerate(corner.axes):
        _alone(figure, corner, k)
        marks: dict[str, Any] = {
            "tickvals": [axis.lower, axis.value, axis.upper],
            "range": reaches[k],
        }
        marks |= {"zeroline": False, "tickfont": {"size": _SMALL}}
        text = escape(axis.mark).replace("&lt;br&gt;", "<br>")
        for row in range(k, count):
            below = {"ticktext": ["", text, ""], "tickangle": _TURN * turned}
            last = row == count - 1
            figure.update_xaxes({**marks, **below, "showticklabels": last}, row=row + 1, col=k + 1)
        for column in range(k):
            names = {"ticktext": ["", escape(axis.name), ""], "showticklabels": column == 0}
            figure.update_yaxes({**marks, **names}, row=k + 1, col=column + 1)
        alone = {"tickvals": [0.5], "ticktext": [escape(axis.name)], "showticklabels": k == 0}
        figure.update_yaxes(alone | {"range": [0, 1.1]}, row=k + 1, col=k + 1)
    return figure.update_layout(height=_CELL * count + _AROUND)


def _reach(axis: CornerAxis, spread: float) -> list[float]:
    """Return the range of an axis: all of the ellipse, the interval and the marks is in it."""
    ends = [axis.lower, axis.upper, *axis.marks.values()]
    far = [abs(end - axis.value) for end in ends if math.isfinite(end)]
    half = _ROOM * max(REACH * spread, *far)
    return [axis.value - half, axis.value + half]


def _pair(figure: Figure, corner: Corner, column: int, row: int, *, first: bool) -> None:
    """Draw two parameters against each other; the ``first`` pair explains the marks."""
    both, place = [column, row], {"row": row + 1, "col": column + 1}
    one, other = (corner.axes[k] for k in both)
    if corner.draws is not None:
        marker = {"color": PALETTE[0], "size": 3}
        x, y = corner.draws[:, both].T
        style = {"mode": "markers", "marker": marker, "name": "draw", "legendgroup": "draw"}
        figure.add_scatter(x=x, y=y, showlegend=first, **style, **place)
    x, y = ellipse(np.array([one.value, other.value]), corner.covariance[np.ix_(both, both)])
    line = {"color": PALETTE[5 if corner.draws is not None else 0], "width": 1.6}
    style = {"mode": "lines", "line": line, "name": "95 % region", "legendgroup": "region"}
    figure.add_scatter(x=x, y=y, showlegend=first, hoverinfo="skip", **style, **place)
    for name, (colour, symbol) in _MARKS.items():
        if name in one.marks and name in other.marks:
            marker = {"color": colour, "symbol": symbol, "size": 7}
            style = {"mode": "markers", "marker": marker, "name": name, "legendgroup": name}
            x, y = [one.marks[name]], [other.marks[name]]
            figure.add_scatter(x=x, y=y, showlegend=first, **style, **place)


def _alone(figure: Figure, corner: Corner, k: int) -> None:
    """Draw the distribution of one parameter, and what else is known of it."""
    axis, spread = corner.axes[k], math.sqrt(corner.covariance[k, k])
    if corner.draws is not None:
        counts, edges = np.histogram(corner.draws[:, k], _BINS)
        shares = counts / counts.max()
        x, y = np.repeat(edges, 2), np.concatenate([[0], np.repeat(shares, 2), [0]])
    else:
        steps = np.linspace(-REACH, REACH, _POINTS)
        x, y = axis.value + spread * steps, np.exp(-0.5 * steps**2)
    place = {"row": k + 1, "col": k + 1}
    common = {"showlegend": False, "hoverinfo": "skip", "mode": "lines"}
    figure.add_scatter(x=x, y=y, line={"color": PALETTE[0], "width": 1.6}, **common, **place)
    for name, value in axis.marks.items():
        line = {"color": _MARKS[name][0], "width": 2}
        figure.add_scatter(x=[value, value], y=[0, 1], line=line, **common, **place)


def _say(figure: Figure, count: int, column: int, row: int, correlation: float) -> None:
    """Write a correlation into the cell above the diagonal that mirrors its panel."""
    strong = abs(correlation) >= STRONG
    text = correlation_text(correlation)
    figure.add_annotation(
        x=(row + 0.5) / count,
        y=1 - (column + 0.5) / count,
        xref="paper",
        yref="paper",
        text=f"<b>{text}</b>" if strong else text,
        font={"size": 12, **({"color": PALETTE[5]} if strong else {})},
        showarrow=False,
    )


def correlation_text(correlation: float) -> str:
    """Return a correlation with two decimals, with four where it is next to 1."""
    digits = 2 if abs(correlation) < _ROUND else 4
    return f"{correlation:z.{digits}f}".replace("-", "\N{MINUS SIGN}")


def corner_sentences(corner: Corner) -> list[str]:
    """Say in plain words which parameters move together, and what is known nevertheless."""
    correlation, names = corner.correlation, [axis.name for axis in corner.axes]
    pairs = [*combinations(range(len(names)), 2)]
    groups = _groups([pair for pair in pairs if abs(correlation[pair]) >= STRONG])
    if not groups:
        pair = max(pairs, key=lambda two: abs(correlation[two]))
        both, size = " and ".join(names[k] for k in pair), correlation_text(correlation[pair])
        return [f"No two parameters move together: the largest correlation is {size}, of {both}."]
    return [*(_together(corner, group) for group in groups), _REMEDY]


_REMEDY = "If that is too little, add a run that tells them apart: `butterfly design` proposes one."


def _groups(pairs: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Join pairs that share a member, in order."""
    groups: list[set[int]] = []
    for pair in pairs:
        joined = set(pair).union(*(group for group in groups if group & {*pair}))
        groups = [group for group in groups if not group & joined] + [joined]
    return sorted(sorted(group) for group in groups)


def _together(corner: Corner, group: Sequence[int]) -> str:
    """Say how parameters go together, by the pairs among them."""
    names, pairs = [corner.axes[k].name for k in group], [*combinations(group, 2)]
    known = {_better_known(corner, pair) for pair in pairs}
    better = known.pop() if len(known) == 1 else "combination"
    *first, last = names
    who = f"{', '.join(first)} and {last}"
    strong = [size for pair in pairs if abs(size := float(corner.correlation[pair])) >= STRONG]
    if len(pairs) > 1:
        least = correlation_text(min(map(abs, strong)))
        what = "their ratios" if better == "ratio" else "combinations of them"
        return (
            f"{who} move together (correlations of \N{PLUS-MINUS SIGN} {least} and beyond): {what} "
            "are better known than any of them."
        )
    (size,) = strong
    how = "move together" if size > 0 else "trade off"
    what = "a combination of them" if better == "combination" else f"their {better}"
    correlation = correlation_text(size)
    return f"{who} {how} (correlation {correlation}): {what} is better known than either."


def _better_known(corner: Corner, pair: tuple[int, int]) -> str:
    """Return what of two parameters has clearly less of an error than either, in its own size."""
    values: NDArray[np.float64] = np.array([corner.axes[k].value for k in pair])
    if not values.all():
        return "combination"
    share = corner.covariance[np.ix_(pair, pair)] / np.outer(values, values)
    least = _CLEARLY * math.sqrt(min(share[0, 0], share[1, 1]))
    of_ratio, of_product = (share[0, 0] + share[1, 1] + s * 2 * share[0, 1] for s in (-1, 1))
    if math.sqrt(max(of_ratio, 0.0)) < least:
        return "ratio"
    return "product" if math.sqrt(max(of_product, 0.0)) < least else "combination"


def corner_caption(corner: Corner) -> str:
    """Explain a corner plot."""
    few = corner.chosen()
    of_all = f"The {len(few.axes)} most correlated of {len(corner.axes)} parameters. " * (
        few is not corner
    )
    marks = {name for axis in few.axes for name in axis.marks}
    shown = "".join(
        f" {what}: {name}."
        for name, what in (("true value", "Green"), ("given value", "Pink"))
        if name in marks
    )
    return (
        f"{of_all}An ellipse contains both true values with a probability of 95 %. Grid lines: "
        "each value and its own 95 % interval. Numbers above the diagonal: correlations of the "
        "errors."
        f"{shown}"
    )
