"""The figures of a sweep's report, and the table of estimates that they are drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Heatmap, Scatter
from plotly.subplots import make_subplots

from butterfly.model.terms import TERMS
from butterfly.report.field_names import said_field
from butterfly.report.figures import PALETTE

if TYPE_CHECKING:
    import pyarrow as pa

_DISTINCT = 12  # values of a field, up to which each is drawn; beyond, they are put into bins
_BINS = 8
_CELLS = 8  # of a heat map, along either axis
_MAPS = 4  # heat maps at most
_ROW = 190  # pixels of a panel


@dataclass(frozen=True, eq=False)
class Estimates:
    """The table of estimates as columns; all (n,)."""

    columns: dict[str, NDArray[Any]]

    def take(self, rows: NDArray[np.bool_]) -> Estimates:
        """Return the rows that a mask selects."""
        return Estimates({name: column[rows] for name, column in self.columns.items()})

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether each interval holds the truth."""
        return np.asarray(
            (self["lower"] <= self["true"]) & (self["true"] <= self["upper"]), dtype=np.bool_
        )

    @property
    def coverage(self) -> float | None:
        """Share of the intervals that hold the truth; None if there is no interval."""
        there = np.isfinite(self["lower"]) & np.isfinite(self["upper"])
        return float(self.inside[there].mean()) if there.any() else None

    def distinct(self, name: str) -> list[Any]:
        """Different values of a column, in the order of their first row."""
        return list(dict.fromkeys(self[name].tolist()))


def column(table: pa.Table, name: str) -> NDArray[Any]:
    """Return a column as floats, NaN where there is nothing, or as objects."""
    column = table[name]
    if str(column.type) in {"double", "int64"}:
        floats = column.cast("double", safe=False)  # seeds have more digits than a float
        return np.asarray(floats.to_numpy(zero_copy_only=False), dtype=np.float64)
    coded = column.combine_chunks().dictionary_encode()  # few texts, each of them many times
    texts = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
    return np.asarray(texts[coded.indices.fill_null(-1).to_numpy()])


def axis_figure(table: Estimates, field: str) -> Figure | None:
    """Draw deviation against one field, a panel for each parameter."""
    names = table.distinct("parameter")
    if not names or len(table.distinct(field)) < 2:  # noqa: PLR2004 - nothing varies
        return None
    figure = make_subplots(rows=len(names), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for index, method in enumerate(table.distinct("estimator")):
        colour = PALETTE[index % len(PALETTE)]
        for row, name in enumerate(names, start=1):
            group = table.take((table["estimator"] == method) & (table["parameter"] == name))
            if not group["value"].size:
                continue
            where, parts = _binned(group[field])
            quartiles = np.array(
                [np.percentile(100 * group["deviation"][part], (25, 50, 75)) for part in parts]
            )
            low, middle, high = quartiles.T
            figure.add_trace(
                Scatter(
                    x=where,
                    y=middle,
                    error_y={
                        "array": high - middle,
                        "arrayminus": middle - low,
                        "symmetric": False,
                        "thickness": 1.2,
                    },
                    mode="lines+markers",
                    marker={"color": colour, "size": 6},
                    line={"color": colour, "width": 1.2},
                    name=method,
                    legendgroup=method,
                    showlegend=row == 1,
                ),
                row=row,
                col=1,
            )
            figure.update_yaxes(title=f"{TERMS[name].symbol} in %", row=row)
    figure.update_xaxes(title=escape(said_field(field)), row=len(names))
    if spans_decades(table[field]):
        figure.update_xaxes(type="log")
    figure.update_layout(height=_ROW * len(names) + 90)
    return figure


def _binned(values: NDArray[Any]) -> tuple[list[Any], list[NDArray[np.bool_]]]:
    """Return the values, or the middles of bins with equally many, and who belongs to each."""
    if values.dtype == object:
        kinds = list(dict.fromkeys(values.tolist()))
        return [_wrapped(str(kind)) for kind in kinds], [values == kind for kind in kinds]
    distinct = np.unique(values)
    if distinct.size <= _DISTINCT:
        return distinct.tolist(), [values == value for value in distinct]
    edges = np.quantile(values, np.linspace(0, 1, _BINS + 1))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _BINS - 1)
    parts = [place == k for k in range(_BINS) if (place == k).any()]
    return [float(np.median(values[part])) for part in parts], parts


def _wrapped(text: str) -> str:
    """Break a list of settings into lines."""
    return escape(text).replace(", ", "<br>")


def spans_decades(values: NDArray[Any]) -> bool:
    """Whether values ask for a logarithmic axis."""
    if values.dtype == object or not (values > 0).all():
        return False
    return bool(values.max() > 30 * values.min())


def heat_maps(table: Estimates, fields: Sequence[str]) -> dict[str, Figure]:
    """Draw the mean absolute deviation over pairs of fields, by the first estimator."""
    if not table["value"].size:
        return {}
    group = table.take(table["estimator"] == table.distinct("estimator")[0])
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
    labels = [[short(value) for value in values] for values in (x, y)]
    figure = Figure(
        Heatmap(
            z=cells,
            x=labels[0],
            y=labels[1],
            colorscale="Cividis",
            texttemplate="%{z:.3g}" if len(x) <= _CELLS else None,
            colorbar={"title": {"text": "%"}},
        )
    )
    figure.update_xaxes(title=escape(said_field(across)), type="category")
    figure.update_yaxes(title=escape(said_field(up)), type="category")
    figure.update_layout(height=420)
    return figure


def short(value: Any) -> str:  # noqa: ANN401 - a number or a text
    """Write a value in a few characters."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
