"""The page of one log: may it be used, what was found, what to do, and the log itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from butterfly.logs.health import Health
from butterfly.logs.log import Log
from butterfly.report.figures import log_figure
from butterfly.report.inspection import STATES, health_rows, hints
from butterfly.report.page import Badge, Page, Section, Table, write_html
from butterfly.verdict import Level

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_ON_BADGE = ("state", "findings")
_SAID = {
    Level.GOOD: "nothing was found that speaks against this log.",
    Level.NOTE: "what was found needs nothing done.",
    Level.CARE: "look at what was found before you trust what this log tells.",
}


def write_inspection(log: Log, health: Health, path: Path) -> None:
    """Write the page of a log as one HTML file that opens offline.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
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
            tables=(Table(headers=(), rows=rows, words=(1,)),),
        ),
        sections=[Section(title="The log", figures={"log": _figure(log)})],
        numbers={},
    )


def _figure(log: Log) -> Figure:
    way = log.added_mass.joint.way
    titles = {
        "input": "input in its own unit",
        "angle": f"angle in {way}",
        "velocity": f"velocity in {way}/s",
    }
    columns = {titles[name]: values for name, values in log.columns().items() if name in titles}
    middles = (log.time[1:] + log.time[:-1]) / 2
    return log_figure(log.time, columns, (middles, 1e3 * np.diff(log.time)))
