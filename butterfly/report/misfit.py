"""What free runs leave over, as sentences, a table and a figure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from butterfly.identification.diagnostics.misfit import LEVELS, Curve, LogMisfit, Misfit
from butterfly.identification.diagnostics.residuals import LeftOver
from butterfly.report.figures import GREY, PALETTE, add
from butterfly.report.page import Table
from butterfly.report.series import Series, packable
from butterfly.report.words import said_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

HEADERS = (
    *("log", "error in % of motion", "after small changes", "of sensors", "times sensors", "bands"),
    "looks like",
)

_CAPTION = (
    "Error: rms of measured less simulated angle, averaged over steps of the simulation, over the "
    "rms motion. The next column is what no small change of the parameters takes away, the one "
    "after what encoder and noise make of it. Bands: whether autocorrelation and cross-correlation "
    "with the input stay where those of such sensors do; of good logs one in twenty leaves."
)
_SHADES = ("rgba(128,128,128,0.15)", "rgba(128,128,128,0.25)")  # of outer and inner band


def misfit_sentences(misfit: Misfit) -> list[str]:
    """Say what the free runs of all logs leave over, and what that looks like."""
    return [
        f"{misfit.outside} of {_logs_leave(len(misfit.logs))} sensors explain "
        f"(95 % bands); over all logs the error is {100 * misfit.relative:.2g} % of the motion, "
        f"{100 * misfit.left:.2g} % after small changes of the parameters, and the sensors' is "
        f"{100 * misfit.explained:.2g} %.",
        *said_of(misfit.findings, {}),
    ]


def _logs_leave(count: int) -> str:
    leave = "log leaves over more than its" if count == 1 else "logs leave over more than their"
    return f"{count} {leave}"


def misfit_table(logs: Iterable[LogMisfit], picks: Sequence[int] = ()) -> Table:
    """Make a table with a row per log, each of which may choose a log by its number."""
    rows, likeness = [_row(log) for log in logs], len(HEADERS) - 1
    return Table(
        name="misfit", headers=HEADERS, rows=rows, caption=_CAPTION, words=(likeness,), picks=picks
    )


def correlation_figure(log: LogMisfit) -> Figure:
    """Draw autocorrelation and cross-correlation of what is left of a log, with their bands."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    titles = ("autocorrelation", "cross-correlation<br>with the input")
    for row, (title, curve) in enumerate(zip(titles, _curves(log), strict=True), start=1):
        x, *lines = _lines(curve)
        for number, y in enumerate(lines):
            add(figure, row, x, y, mode="lines", **_style(number, named=row == 1))
        figure.update_yaxes(title=title, row=row)
    figure.update_xaxes(title="lag in s", row=2)
    figure.update_layout(height=480)
    return figure


def correlation_series(logs: Sequence[LogMisfit]) -> Series:
    """Return what a page needs to draw `correlation_figure` of each log."""
    return Series.of(
        correlation_figure(logs[0]),
        [[[packable(line) for line in _lines(curve)] for curve in _curves(log)] for log in logs],
    )


def _row(log: LogMisfit) -> tuple[str, ...]:
    shares = [100 * each / log.motion for each in (log.error, log.left, log.explained)]
    numbers = [f"{share:.2g}" if np.isfinite(share) else "–" for share in shares]
    times = f"{log.times:.1f}" if np.isfinite(log.times) else "–"
    return (log.label, *numbers, times, bands_left(log), _likeness(log.left_over))


def _likeness(left_over: LeftOver) -> str:
    """Name the missing terms that it looks like, and the share of the likeliest."""
    if not left_over.terms:
        return "–"
    share = left_over.shares[left_over.terms[0]]
    return f"{' or '.join(left_over.terms)}, {100 * share:.0f} % of its variance"


def bands_left(log: LogMisfit) -> str:
    """Say whether the correlations of a log stay inside their bands."""
    inner, outer = log.excess
    if inner <= 1:
        return "inside"
    return "outside 99 %" if outer > 1 else "outside 95 %"


def _curves(log: LogMisfit) -> tuple[Curve | None, Curve | None]:
    return log.autocorrelation, log.cross_correlation


def _lines(curve: Curve | None) -> list[NDArray[np.float32]]:
    """Return (l,) lags, and the limits of outer and inner band before the values; none of none."""
    if curve is None:
        return [np.empty(0, dtype=np.float32)] * (2 + 2 * len(LEVELS))
    inner, outer = curve.reach
    centre = curve.centre
    limits = (centre - outer, centre + outer, centre - inner, centre + inner)
    return [each.astype(np.float32) for each in (curve.lag, *limits, curve.value)]


def _style(number: int, *, named: bool) -> dict[str, Any]:
    """Return the look of one of `_lines`: limits of the bands, filled, and the curve."""
    if number == len(LEVELS) * 2:
        return {"line": {"color": PALETTE[0], "width": 1.4}, "name": "the log", "showlegend": named}
    line = {"color": GREY, "width": 1, "dash": ("dot", "dash")[number // 2]}
    style: dict[str, Any] = {"line": line, "hoverinfo": "skip", "showlegend": False}
    if number % 2:
        level = LEVELS[1 - number // 2]
        style |= {"fill": "tonexty", "fillcolor": _SHADES[number // 2], "showlegend": named}
        style["name"] = f"{100 * level:.0f} % band of the sensors"
    return style
