"""Figures of a sweep: deviation from the truth against what was varied, one by one and at once."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure

from butterfly.experiment.sweep_tables import Estimates
from butterfly.report.figures import GREY, PALETTE, add, log_ticks, panel, panels, rows_panel
from butterfly.report.format import cell_text, field_label
from butterfly.report.page import MOST

_DISTINCT = 12  # values of a field, up to which each is drawn; beyond, they are put into bins
_BINS = 8
_CELLS = 8  # of a heat map, along either axis
_MAPS = 4  # heat maps at most
_ROW = 190  # pixels of a panel
_LINE = 46  # pixels of a parameter
_SPREAD = (2.5, 25, 50, 75, 97.5)  # per cent of the runs
_FLAT, _UNSEEN = 0.1, 0.01  # of the largest change, and %: no change that a figure shows
_COLOURS = ("#009E73", "#56B4E9", "#E69F00", "#D55E00")  # of quarters of the estimates, best first
_LINES = 400  # at most, of all fields at once
_FEWEST = 2  # fields that a line goes through, and values that an axis has
_TICKS = 8  # values of an axis, up to which each is written
_MARK = "mark"  # what is written along an axis, which a narrow page turns upright
_MARGIN = 0.03  # of an axis, by which written values are off its ends


def recovery_figure(table: Estimates) -> Figure | None:
    """Draw the deviations of all estimates on one axis: median, middle half, and 95 % of them."""
    names = table.distinct("parameter")
    if not names:
        return None
    figure, reach = rows_panel(names, "deviation from the truth in %", _LINE), 0.0
    count = len(table.estimators)
    for index, method in enumerate(table.estimators):
        colour = PALETTE[index % len(PALETTE)]
        estimates = table.where(estimator=method)
        groups = [100 * estimates.where(parameter=name)["deviation"] for name in names]
        rows = [k for k, group in enumerate(groups) if group.size]
        spread = np.clip([np.percentile(groups[k], _SPREAD) for k in rows], -MOST, MOST)
        reach = max(reach, float(np.abs(spread).max(initial=0.0)))
        places = [k + (index - (count - 1) / 2) * 0.6 / count for k in rows]
        for (low, high), width in (((0, 4), 2), ((1, 3), 7)):
            ends = np.column_stack([spread[:, low], spread[:, high], np.full(len(rows), np.nan)])
            line = {"color": colour, "width": width}
            y = np.repeat(places, 3)
            style = {"mode": "lines", "line": line, "legendgroup": method, "showlegend": False}
            figure.add_scatter(x=ends.ravel(), y=y, hoverinfo="skip", **style)
        dots = {"color": colour, "size": 9, "line": {"color": "#ffffff", "width": 1}}
        style = {"mode": "markers", "marker": dots, "legendgroup": method, "name": method}
        figure.add_scatter(x=spread[:, 2], y=places, hovertemplate="%{x:.3g} %", **style)
    return figure.update_xaxes(range=[-1.05 * (reach or 1), 1.05 * (reach or 1)])


def affected(table: Estimates, field: str) -> dict[str, float]:
    """Return the parameters whose deviation a field changes, with the largest change in %."""
    changes = dict.fromkeys(table.distinct("parameter"), 0.0)
    for method in table.estimators:
        for name in changes:
            group = table.where(estimator=method, parameter=name)
            _, parts = _binned(group[field])
            middles = [np.median(100 * group["deviation"][part]) for part in parts]
            changes[name] = max(changes[name], float(np.ptp(middles)) if middles else 0.0)
    least = max(_FLAT * max(changes.values(), default=0.0), _UNSEEN)
    return {name: change for name, change in changes.items() if change > least}


def axis_figure(table: Estimates, field: str, names: Sequence[str]) -> Figure | None:
    """Draw deviation against one field, a panel for each of some parameters."""
    if not names or len(table.distinct(field)) < 2:  # noqa: PLR2004 - nothing varies
        return None
    titles = [f"{name} error<br>in %" for name in names]
    figure = panels(escape(field_label(field)), titles, _ROW * len(names) + 90, spacing=0.03)
    for index, method in enumerate(table.estimators):
        colour = PALETTE[index % len(PALETTE)]
        style: dict[str, Any] = {"mode": "lines+markers", "name": method, "legendgroup": method}
        style |= {"marker": {"color": colour, "size": 6}, "line": {"color": colour, "width": 1.2}}
        for row, name in enumerate(names, start=1):
            group = table.where(estimator=method, parameter=name)
            if not group["value"].size:
                continue
            where, parts = _binned(group[field])
            quartiles = np.array(
                [np.percentile(100 * group["deviation"][part], (25, 50, 75)) for part in parts]
            )
            low, middle, high = quartiles.T
            spread = {"array": high - middle, "arrayminus": middle - low}
            spread |= {"symmetric": False, "thickness": 1.2}
            add(figure, row, where, middle, error_y=spread, showlegend=row == 1, **style)
    if spans_decades(table[field]):
        figure.update_xaxes(log_ticks(1, 2, 5))
    return figure


def _binned(values: NDArray[Any]) -> tuple[list[Any], list[NDArray[np.bool_]]]:
    """Return distinct values, or medians of equally filled bins, and (n,) masks of their rows."""
    if values.dtype == object:
        kinds = list(dict.fromkeys(values.tolist()))
        labels = [escape(str(kind)).replace(", ", "<br>") for kind in kinds]  # lists of settings
        return labels, [values == kind for kind in kinds]
    distinct = np.unique(values)
    if distinct.size <= _DISTINCT:
        return distinct.tolist(), [values == value for value in distinct]
    edges = np.quantile(values, np.linspace(0, 1, _BINS + 1))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _BINS - 1)
    parts = [place == k for k in range(_BINS) if (place == k).any()]
    return [float(np.median(values[part])) for part in parts], parts


def spans_decades(values: NDArray[Any]) -> bool:
    """Whether values ask for a logarithmic axis."""
    return values.dtype != object and bool((values > 0).all() and values.max() > 30 * values.min())


def heat_maps(table: Estimates, fields: Sequence[str]) -> dict[str, Figure]:
    """Draw the deviation of each estimate's worst parameter over pairs of fields.

    It is that of the first estimator: the median of all estimates in a cell.
    """
    if not table["value"].size:
        return {}
    group = table.where(estimator=table.estimators[0]).worst()
    varying = [field for field in fields if len(group.distinct(field)) > 1]
    pairs = [(a, b) for k, a in enumerate(varying) for b in varying[k + 1 :]][:_MAPS]
    return {f"map-{number}": _heat_map(group, *pair) for number, pair in enumerate(pairs)}


def _heat_map(group: Estimates, across: str, up: str) -> Figure:
    (x, columns), (y, rows) = (_binned(group[field]) for field in (across, up))
    size = 100 * np.abs(group["deviation"])
    cells = [
        [float(np.median(size[row & col])) if (row & col).any() else np.nan for col in columns]
        for row in rows
    ]
    figure = panel(escape(field_label(across)), escape(field_label(up)))
    figure.add_heatmap(
        z=cells,
        x=[*map(cell_text, x)],
        y=[*map(cell_text, y)],
        colorscale="Cividis",
        texttemplate="%{z:.3g}" if len(x) <= _CELLS else None,
        colorbar={"title": {"text": "%"}},
    )
    figure.update_xaxes(type="category").update_yaxes(type="category")
    return figure


class _Axis(NamedTuple):
    """``title``; (n,) ``places`` of the estimates from 0 to 1; ``marks``, texts by their places."""

    title: str
    places: NDArray[np.float64]
    marks: dict[float, str]


def parallel_figure(table: Estimates, fields: Sequence[str]) -> Figure | None:
    """Draw each estimate as a line through the values of its fields, its deviation and its FIT."""
    rows = table.worst()
    worst = np.abs(rows["deviation"])
    varying = [field for field in fields if len(rows.distinct(field)) >= _FEWEST]
    if len(varying) < _FEWEST:
        return None
    axes = [_axis(field_label(field).replace(" in ", "\nin "), rows[field]) for field in varying]
    axes.append(_axis("largest deviation\nin %", 100 * worst))
    axes.append(_axis("median FIT\nin %", rows["fit_median"]))
    rank = np.argsort(np.argsort(worst, kind="stable"), kind="stable")
    quarter = len(_COLOURS) * rank // max(worst.size, 1)
    some = np.unique(np.linspace(0, worst.size - 1, min(worst.size, _LINES)).round().astype(int))
    figure = Figure()
    steps = np.arange(len(axes), dtype=float)
    names = ("best quarter", "second", "third", "worst quarter")
    for number, (name, colour) in enumerate(zip(names, _COLOURS, strict=True)):
        chosen = some[quarter[some] == number]
        lines = np.column_stack([axis.places[chosen] for axis in axes])
        gap = np.full((chosen.size, 1), np.nan)
        figure.add_scatter(
            x=np.tile(np.append(steps, np.nan), chosen.size),
            y=np.hstack([lines, gap]).ravel().astype(np.float32),
            mode="lines",
            line={"color": colour, "width": 1},
            opacity=0.6,
            name=name,
            hoverinfo="skip",
        )
    style = {"showarrow": False, "xanchor": "left", "xshift": 4}
    for step, axis in enumerate(axes):
        figure.add_vline(x=step, line={"color": GREY, "width": 1})
        for place, text in axis.marks.items():
            figure.add_annotation(x=step, y=place, text=escape(text), name=_MARK, **style)
    titles = [escape(axis.title).replace("\n", "<br>") for axis in axes]
    figure.update_xaxes(
        tickvals=steps.tolist(), ticktext=titles, showgrid=False, range=[-0.1, len(axes) - 0.6]
    )
    figure.update_yaxes(visible=False, range=[-_MARGIN, 1 + _MARGIN])
    figure.update_layout(height=480)
    return figure


def _axis(title: str, values: NDArray[Any]) -> _Axis:
    if values.dtype == object:
        kinds = list(dict.fromkeys(values.tolist()))
        span = max(len(kinds) - 1, 1)
        spots = {kind: number / span for number, kind in enumerate(kinds)}
        marks = {spots[kind]: cell_text(kind) for kind in kinds[:_TICKS]}
        return _Axis(title, np.array([spots[value] for value in values.tolist()]), marks)
    scaled = np.log(values) if spans_decades(values) else values
    finite = scaled[np.isfinite(scaled)]
    least, most = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    places = (scaled - least) / (most - least) if most > least else np.full(scaled.size, 0.5)
    distinct = np.unique(places[np.isfinite(places)])
    written = distinct if distinct.size <= _TICKS else distinct[[0, -1]]
    marks = {float(at): cell_text(float(values[np.argmax(places == at)])) for at in written}
    return _Axis(title, places, marks)
