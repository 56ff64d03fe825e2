"""All varied fields of a sweep at once, and what came of them: parallel coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Scatter

from butterfly.report.field_names import said_field
from butterfly.report.figures import GREY
from butterfly.report.sweep_figures import Estimates, short, spans_decades

_COLOURS = ("#009E73", "#56B4E9", "#E69F00", "#D55E00")  # of quarters of the estimates, best first
_MOST = 400  # lines
_FEWEST = 2  # fields that a line goes through, and values that an axis has
_TICKS = 8  # values of an axis, up to which each is written
_MAIN = ("p1", "p3", "p4")
_MARGIN = 0.03  # of an axis, by which written values are off its ends


class _Axis(NamedTuple):
    """``title``; (n,) ``places`` of the estimates from 0 to 1; ``marks``, texts by their places."""

    title: str
    places: NDArray[np.float64]
    marks: dict[float, str]


def parallel_figure(table: Estimates, fields: Sequence[str]) -> Figure | None:
    """Draw each estimate as a line through the values of its fields, its deviation and its FIT.

    Parameters
    ----------
    table
        Estimates with their deviation from the truth.
    fields
        Of the experiment, that the sweep varied.

    Returns
    -------
    The figure; None where fewer than two fields vary.
    """
    rows, worst = _worst_of_each(table)
    varying = [field for field in fields if len(rows.distinct(field)) >= _FEWEST]
    if len(varying) < _FEWEST:
        return None
    axes = [_axis(said_field(field).replace(", ", "\nin "), rows[field]) for field in varying]
    axes.append(_axis("largest deviation\nin %", 100 * worst))
    axes.append(_axis("median FIT\nin %", rows["fit_median"]))
    rank = np.argsort(np.argsort(worst, kind="stable"), kind="stable")
    quarter = len(_COLOURS) * rank // max(worst.size, 1)
    some = np.unique(np.linspace(0, worst.size - 1, min(worst.size, _MOST)).round().astype(int))
    figure = Figure()
    steps = np.arange(len(axes), dtype=float)
    for number, colour in enumerate(_COLOURS):
        chosen = some[quarter[some] == number]
        lines = np.column_stack([axis.places[chosen] for axis in axes])
        gap = np.full((chosen.size, 1), np.nan)
        name = ("best quarter", "second", "third", "worst quarter")[number]
        drawn = Scatter(
            x=np.tile(np.append(steps, np.nan), chosen.size),
            y=np.hstack([lines, gap]).ravel().astype(np.float32),
            mode="lines",
            line={"color": colour, "width": 1},
            opacity=0.6,
            name=name,
            hoverinfo="skip",
        )
        figure.add_trace(drawn)
    for step, axis in enumerate(axes):
        figure.add_vline(x=step, line={"color": GREY, "width": 1})
        for place, text in axis.marks.items():
            figure.add_annotation(
                x=step, y=place, text=escape(text), showarrow=False, xanchor="left", xshift=4
            )
    titles = [escape(axis.title).replace("\n", "<br>") for axis in axes]
    figure.update_xaxes(
        tickvals=steps.tolist(), ticktext=titles, showgrid=False, range=[-0.1, len(axes) - 0.6]
    )
    figure.update_yaxes(visible=False, range=[-_MARGIN, 1 + _MARGIN])
    figure.update_layout(height=480)
    return figure


def _worst_of_each(table: Estimates) -> tuple[Estimates, NDArray[np.float64]]:
    """Return a row of each estimate, and (n,) its largest deviation, as a share."""
    main = table.take(np.isin(table["parameter"].astype(str), _MAIN))
    worst: dict[tuple[Any, Any], tuple[int, float]] = {}
    estimates = zip(main["number"].tolist(), main["estimator"].tolist(), strict=True)
    for row, (own, size) in enumerate(zip(estimates, np.abs(main["deviation"]), strict=True)):
        if own not in worst or size > worst[own][1]:
            worst[own] = row, float(size)
    rows = np.array([row for row, _ in worst.values()], dtype=np.intp)
    chosen = np.zeros(main["deviation"].size, dtype=np.bool_)
    chosen[rows] = True
    order = np.argsort(rows)
    return main.take(chosen), np.array([size for _, size in worst.values()])[order]


def _axis(title: str, values: NDArray[Any]) -> _Axis:
    if values.dtype == object:
        kinds = list(dict.fromkeys(values.tolist()))
        span = max(len(kinds) - 1, 1)
        spots = {kind: number / span for number, kind in enumerate(kinds)}
        marks = {spots[kind]: short(kind) for kind in kinds[:_TICKS]}
        return _Axis(title, np.array([spots[value] for value in values.tolist()]), marks)
    scaled = np.log(values) if spans_decades(values) else values
    finite = scaled[np.isfinite(scaled)]
    least, most = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    places = (scaled - least) / (most - least) if most > least else np.full(scaled.size, 0.5)
    distinct = np.unique(places[np.isfinite(places)])
    written = distinct if distinct.size <= _TICKS else distinct[[0, -1]]
    marks = {float(at): f"{values[np.argmax(places == at)]:.3g}" for at in written}
    return _Axis(title, places, marks)
