"""The page of one log: may it be used, what was found, what to do, and the log itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.logs.health import Health
from butterfly.logs.log import Log
from butterfly.report.figures import add, look, seen_samples
from butterfly.report.inspection import STATES, health_rows, hints
from butterfly.report.page import Badge, Page, PageTable, Section, write_html
from butterfly.verdict import Level

_MOST = 20_000  # samples drawn of each column
_ON_BADGE = ("state", "findings")
_SAID = {
    Level.GOOD: "nothing was found that speaks against this log.",
    Level.NOTE: "what was found needs nothing done.",
    Level.CARE: "look at what was found before you trust what this log tells.",
}


def write_inspection(log: Log, health: Health, path: Path) -> None:
    """Write the page of a log as one HTML file that opens offline."""
    write_html(inspection_page(log, health), path)


def inspection_page(log: Log, health: Health) -> Page:
    """Put together the page of a log that can be used."""
    remarks, state = health.remarks, health.condition
    found = [f"{remark.text}." for remark in remarks]
    rows = [row for row in health_rows(log, health) if row[0] not in _ON_BADGE]
    badge = Badge(state, STATES[state].capitalize(), [_SAID[state].capitalize(), *found])
    return Page(
        name=Path(log.source).name or log.label,
        description="",
        kind="log",
        badge=badge,
        summary=hints(remarks),
        lead=Section(
            title="In numbers",
            tables=(PageTable(headers=(), rows=rows, words=(1,)),),
        ),
        sections=[Section(title="The log", figures={"log": _log_figure(log)})],
        numbers={},
    )


def _log_figure(log: Log) -> Figure:
    """Draw a log against time, a panel for each column and one for the sampling intervals."""
    way = log.added_mass.joint.way
    titles = {
        "input": "input in its own unit",
        "angle": f"angle in {way}",
        "velocity": f"velocity in {way}/s",
    }
    panels = {titles[k]: (log.time, values) for k, values in log.columns().items() if k in titles}
    middles = (log.time[1:] + log.time[:-1]) / 2
    panels["interval in ms"] = (middles, 1e3 * np.diff(log.time))
    rows = len(panels)
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, (title, (x, y)) in enumerate(panels.items(), start=1):
        colour, _ = look(row - 1)
        style = {"mode": "lines", "line": {"color": colour, "width": 1}}
        if row == rows:
            style = {"mode": "markers", "marker": {"color": colour, "size": 2}}
        some = seen_samples([y], _MOST)
        add(figure, row, x[some], y[some].astype(np.float32), showlegend=False, **style)
        figure.update_yaxes(title=title, row=row)
    figure.update_xaxes(title="time in s", row=rows)
    figure.update_layout(height=220 * rows + 80)
    return figure
