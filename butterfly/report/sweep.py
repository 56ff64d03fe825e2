"""The report of a sweep: how well the parameters were recovered, against each field that varied."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from plotly.graph_objects import Figure, Heatmap, Scatter
from plotly.subplots import make_subplots

from butterfly.report.figures import PALETTE
from butterfly.report.identification import SYMBOLS
from butterfly.report.page import Link, Page, Section, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pyarrow as pa
    from numpy.typing import NDArray

_DISTINCT = 12  # values of a field, up to which each is drawn; beyond, they are put into bins
_BINS = 8
_CELLS = 8  # of a heat map, along either axis
_MAPS = 4  # heat maps at most
_ROW = 190  # pixels of a panel


@dataclass(frozen=True, eq=False)
class _Estimates:
    """The table of estimates as columns; all (n,)."""

    columns: dict[str, NDArray[Any]]

    def take(self, rows: NDArray[np.bool_]) -> _Estimates:
        return _Estimates({name: column[rows] for name, column in self.columns.items()})

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether each interval holds the truth."""
        return np.asarray(
            (self["lower"] <= self["true"]) & (self["true"] <= self["upper"]), dtype=np.bool_
        )

    def distinct(self, name: str) -> list[Any]:
        """Different values of a column, in the order of their first row."""
        return list(dict.fromkeys(self[name].tolist()))


def sweep_page(about: dict[str, Any], runs: pa.Table, estimates: pa.Table) -> Page:
    """Put together the report of a sweep.

    Parameters
    ----------
    about
        What was run: ``name``, ``description``, ``fields``, ``worst``.
    runs, estimates
        The tables of a result store.
    """
    table = _Estimates({name: _column(estimates, name) for name in estimates.column_names})
    fields, status = about["fields"], _column(runs, "status")
    deviating = table.take(np.isfinite(table["deviation"]))
    sections = [
        Section(
            title="Recovery of the parameters",
            text="Deviation of the estimates from the truth over all runs, where it is not 0; "
            "coverage is the share of 95 % intervals that hold the truth.",
            tables=(_recovery_table(table),),
        )
    ]
    if len(table.distinct("estimator")) > 1:
        ranked = _ranking_table(table)
        sections.insert(0, Section(title="Estimators, the best first", tables=(ranked,)))
    for number, field in enumerate(fields):
        figure = _axis_figure(deviating, field)
        if figure is not None:
            section = Section(
                title=f"Against {field}",
                text="Median deviation, with the middle half of the runs.",
                figures={f"axis-{number}": figure},
            )
            sections.append(section)
    maps = _heat_maps(deviating, fields)
    if maps:
        text = "Median of the parameters' mean absolute deviation in %, over the other fields."
        sections.append(Section(title="Two fields at a time", text=text, figures=maps))
    worst = _worst_table(table, fields, about.get("worst", 10))
    if worst.rows:
        sections.append(Section(title="Worst runs", tables=(worst,)))
    if not np.isin(status.astype(str), ["ok", "missing"]).all():
        sections.append(Section(title="Runs without a result", tables=(_failures(runs),)))
    if "orbit_amplitude" in runs.column_names and runs["orbit_amplitude"].null_count < len(runs):
        sections.append(Section(title="Orbits", tables=(_orbits(runs),)))
    return Page(
        name=about["name"],
        description=about["description"],
        kind="sweep",
        summary=_summary(table, status, fields),
        sections=sections,
        numbers=_numbers(table, status),
    )


def _column(table: pa.Table, name: str) -> NDArray[Any]:
    """Return a column as floats, NaN where there is nothing, or as objects."""
    column = table[name]
    if str(column.type) in {"double", "int64"}:
        return np.asarray(column.cast("double").to_numpy(zero_copy_only=False), dtype=np.float64)
    return np.array(column.to_pylist(), dtype=object)


def _groups(table: _Estimates) -> list[tuple[str, str, _Estimates]]:
    return [
        (method, name, table.take((table["estimator"] == method) & (table["parameter"] == name)))
        for method in table.distinct("estimator")
        for name in table.distinct("parameter")
        if ((table["estimator"] == method) & (table["parameter"] == name)).any()
    ]


def _recovery_table(table: _Estimates) -> Table:
    rows = []
    for method, name, group in _groups(table):
        deviation = group["deviation"][np.isfinite(group["deviation"])]
        known = np.isfinite(group["lower"]) & np.isfinite(group["upper"])
        coverage = f"{100 * group.inside[known].mean():.1f}" if known.any() else "–"
        statistics: tuple[str, ...] = ("–", "–", "–")
        if deviation.size:
            rms, middle = math.sqrt(np.mean(deviation**2)), float(np.median(deviation))
            largest = float(np.abs(deviation).max())
            statistics = tuple(f"{100 * value:.3g}" for value in (middle, rms, largest))
        count = str(group["value"].size)
        rows.append((method, SYMBOLS.get(name, name), count, *statistics, coverage))
    headers = (
        *("estimator", "parameter", "runs", "median deviation in %", "rms in %"),
        *("largest in %", "coverage in %"),
    )
    return Table(headers=headers, rows=rows)


def _ranking_table(table: _Estimates) -> Table:
    rows = []
    for method in table.distinct("estimator"):
        group = table.take(table["estimator"] == method)
        size = np.abs(group["deviation"][np.isfinite(group["deviation"])])
        fits = group["fit_median"]
        rows.append((float(np.median(size)), method, float(np.median(fits)), group.inside.mean()))
    return Table(
        headers=("estimator", "median |deviation| in %", "median FIT in %", "coverage in %"),
        rows=[
            (method, f"{100 * size:.3g}", f"{fit:.2f}", f"{100 * share:.1f}")
            for size, method, fit, share in sorted(rows)
        ],
        caption="FIT is in sample. Deviations are over all parameters that are not 0.",
    )


def _axis_figure(table: _Estimates, field: str) -> Figure | None:
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
            figure.update_yaxes(title=f"{SYMBOLS.get(name, name)} in %", row=row)
    figure.update_xaxes(title=field, row=len(names))
    if _spans_decades(table[field]):
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
    return text.replace(", ", "<br>")


def _spans_decades(values: NDArray[Any]) -> bool:
    if values.dtype == object or not (values > 0).all():
        return False
    return bool(values.max() > 30 * values.min())


def _heat_maps(table: _Estimates, fields: Sequence[str]) -> dict[str, Figure]:
    """Draw the mean absolute deviation over pairs of fields, by the first estimator."""
    if not table["value"].size:
        return {}
    group = table.take(table["estimator"] == table.distinct("estimator")[0])
    varying = [field for field in fields if len(group.distinct(field)) > 1]
    pairs = [(a, b) for k, a in enumerate(varying) for b in varying[k + 1 :]][:_MAPS]
    return {f"map-{number}": _heat_map(group, *pair) for number, pair in enumerate(pairs)}


def _heat_map(group: _Estimates, across: str, up: str) -> Figure:
    (x, columns), (y, rows) = (_binned(group[field]) for field in (across, up))
    size = 100 * np.abs(group["deviation"])
    cells = [
        [float(np.median(size[row & col])) if (row & col).any() else np.nan for col in columns]
        for row in rows
    ]
    labels = [[_short(value) for value in values] for values in (x, y)]
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
    figure.update_xaxes(title=across, type="category")
    figure.update_yaxes(title=up, type="category")
    figure.update_layout(height=420)
    return figure


def _worst_table(table: _Estimates, fields: Sequence[str], count: int) -> Table:
    """List the runs with the largest deviation of p1, p3 or p4."""
    main = table.take(np.isin(table["parameter"].astype(str), ["p1", "p3", "p4"]))
    order = np.argsort(-np.nan_to_num(np.abs(main["deviation"])), kind="stable")
    rows: list[tuple[str | Link, ...]] = []
    seen: set[tuple[Any, Any]] = set()
    for k in order.tolist():
        run = (main["key"][k], main["estimator"][k])
        if run in seen or len(rows) == count:
            continue
        seen.add(run)
        key = str(main["key"][k])
        link = Link(f"{main['number'][k]:.0f}", f"runs/{key[:2]}/{key}.json")
        name = str(main["parameter"][k])
        deviation = f"{SYMBOLS.get(name, name)} {100 * main['deviation'][k]:+.3g}"
        values = (_short(main[field][k]) for field in fields)
        rows.append((link, run[1], deviation, f"{main['fit_median'][k]:.1f}", *values))
    headers = ("run", "estimator", "deviation in %", "median FIT in %", *fields)
    return Table(headers=headers, rows=rows, caption="The number leads to the run's record.")


def _failures(runs: pa.Table) -> Table:
    bad = [row for row in runs.to_pylist() if row["status"] not in {"ok", "missing"}]
    rows = [
        (
            Link(str(row["number"]), f"runs/{row['key'][:2]}/{row['key']}.json"),
            row["status"],
            row["error"],
        )
        for row in bad[:100]
    ]
    return Table(headers=("run", "status", "error"), rows=rows, caption=f"{len(bad)} in all.")


def _orbits(runs: pa.Table) -> Table:
    found = [row for row in runs.to_pylist() if row["orbit_amplitude"] is not None]
    names = ("orbit_target", "orbit_amplitude", "orbit_error_generic", "orbit_error_recalibrated")
    rows = [
        (
            str(row["number"]),
            *(f"{math.degrees(row[name]):.4g}" for name in names),
            str(row["orbit_rounds"]),
        )
        for row in found[:200]
    ]
    headers = ("run", "target in °", "reached in °", "generic, rms in °", "re-calibrated", "rounds")
    return Table(headers=headers, rows=rows)


def _summary(table: _Estimates, status: NDArray[Any], fields: Sequence[str]) -> list[str]:
    done = int((status == "ok").sum())
    varied = ", ".join(fields) or "nothing but the seed"
    sentences = [f"{status.size} runs, {done} of them with a result; varied: {varied}."]
    missing = int((status == "missing").sum())
    if missing:
        sentences.append(f"{missing} of them are still to be done.")
    size = np.abs(table["deviation"][np.isfinite(table["deviation"])])
    if size.size:
        share = 100 * np.mean(table.inside[np.isfinite(table["lower"])])
        sentences += [
            f"Half of all estimates are within {100 * np.median(size):.3g} % of the truth, "
            f"95 % of them within {100 * np.percentile(size, 95):.3g} %.",
            f"The 95 % intervals hold the truth in {share:.1f} % of the cases.",
            f"The models follow their logs with a median FIT of "
            f"{np.median(table['fit_median']):.2f} %.",
        ]
    return sentences


def _numbers(table: _Estimates, status: NDArray[Any]) -> dict[str, Any]:
    return {
        "runs": int(status.size),
        "ok": int((status == "ok").sum()),
        "recovery": [
            {
                "estimator": method,
                "parameter": name,
                "runs": int(group["value"].size),
                "rms_deviation": _rms(group["deviation"]),
                "coverage": float(group.inside.mean()),
            }
            for method, name, group in _groups(table)
        ],
    }


def _rms(values: NDArray[np.float64]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else None


def _short(value: Any) -> str:  # noqa: ANN401 - a number or a text
    return f"{value:.4g}" if isinstance(value, float) else str(value)
