"""The page of a campaign: goal and next step, parameters, intervals by robot time, and runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from plotly.graph_objects import Figure

from butterfly.identification.design import OF_GOAL
from butterfly.report.figures import GREY, log_ticks, look, panel, rows_panel
from butterfly.report.page import Badge, Marked, Page, PageTable, Section
from butterfly.verdict import Level

_MARGIN = 0.1  # decades beyond the marks, for lines along them
_INTERVALS = "Half-width of the 95 % interval in % of the value; dashed: the goal."
_RATIOS = " All are ratios to p1."
_UNTIL_SCALE = " Until another mass gives the scale, they are of ratios to p1, whose goal is half."


def campaign_page(plain: Page) -> Page:
    """Return the page of a campaign, of its plain one."""
    figures, numbers, lead, sections = plain.figures, plain.numbers, None, []
    tables = [PageTable.of_plain(table) for table in numbers["tables"]]
    halved = any(row["goal in %"] < 100 * numbers["goal"] for row in numbers["rows"])
    text = f"{_INTERVALS}{_UNTIL_SCALE if halved else _RATIOS if numbers['ratios'] else ''}"
    if figures:
        shrunk, drawn = ({name: figures[name]} for name in ("shrinking", "played"))
        runs = tables.pop().on_page()
        sections = [
            Section(title="Intervals by robot time", text=text, figures=shrunk),
            Section(title=runs.title, figures=drawn, tables=(runs,)),
        ]
    if tables:
        named = _with_meanings(tables[0])._replace(name="parameters")
        lead = Section(title=named.title, tables=(named,))
    goal, summary = numbers["summary"][:2], numbers["summary"][2:]
    return replace(plain, badge=_badge(plain, goal), summary=summary, lead=lead, sections=sections)


def _with_meanings(table: PageTable) -> PageTable:
    """Return the table of parameters with their meanings below their names, as a phone needs it."""
    place = table.headers.index("meaning")
    lines = [
        (Marked(str(row[0]), meaning=str(row[place])), *row[1:place], *row[place + 1 :])
        for row in table.rows
    ]
    headers = (*table.headers[:place], *table.headers[place + 1 :])
    return table._replace(headers=headers, rows=lines, words=(headers.index("unit"),))


def _badge(plain: Page, goal: Sequence[str]) -> Badge:
    """Return whether the goal is reached, and what to do next."""
    if plain.numbers["reached"]:
        return Badge(Level.GOOD, "Goal reached", goal)
    usable = plain.verdict is not None and plain.verdict.level.usable
    return Badge(Level.CARE if usable else Level.WARNING, "Goal missed", goal)


def shrinking(numbers: Mapping[str, Any]) -> Figure | None:
    """Draw the half-widths in % of the values, by robot time, and the goal; None without a run."""
    rows = numbers["rows"]
    if not rows:
        return None
    figure = panel("robot time in s", "half-width of the 95 % interval", 380)
    goals = [row["goal in %"] for row in rows]
    sizes = list(goals)
    for number, name in enumerate(OF_GOAL):
        colour, symbol = look(number)
        drawn = [row for row in rows if row[f"{name} in %"]]
        widths = [row[f"{name} in %"] for row in drawn]
        sizes += widths
        style = {"line": {"color": colour}, "marker": {"color": colour, "symbol": symbol}}
        ends = [row["robot time in s"] for row in drawn]
        figure.add_scatter(x=ends, y=widths, mode="lines+markers", name=name, **style)
    spans = [(row["robot time in s"] - row["length in s"], row["robot time in s"]) for row in rows]
    figure.add_scatter(
        x=[time for span in spans for time in span],
        y=[goal for goal in goals for _ in range(2)],
        mode="lines",
        name="goal",
        line={"color": GREY, "dash": "dash"},
    )
    return figure.update_yaxes(_percent_axis(sizes))


def _percent_axis(sizes: Sequence[float]) -> dict[str, Any]:
    """Return a logarithmic axis about sizes in %, at least one decade, marked 0.1 %, 1 %, 10 %."""
    ticks = log_ticks(1)
    texts = [f"{np.format_float_positional(value, trim='-')} %" for value in ticks["tickvals"]]
    first, last = math.floor(math.log10(min(sizes))), math.ceil(math.log10(max(sizes)))
    ends = [first - _MARGIN, max(last, first + 1) + _MARGIN]
    return ticks | {"ticktext": texts, "range": ends}


def played(numbers: Mapping[str, Any]) -> Figure | None:
    """Draw each run as a bar over robot time, its colour that of the mounted mass."""
    rows = numbers["rows"]
    if not rows:
        return None
    names = [f"{row['run']}: {row['played']}".replace(", ", ",\n") for row in rows]
    figure = rows_panel(names, "robot time in s")
    masses = list(dict.fromkeys(row["added mass"] for row in rows))
    for number, mass in enumerate(masses):
        some = [k for k, row in enumerate(rows) if row["added mass"] == mass]
        ends = [(rows[k]["robot time in s"], rows[k]["length in s"]) for k in some]
        x = [time for end, length in ends for time in (end - length, end, math.nan)]
        y = [place for k in some for place in (k, k, math.nan)]
        line = {"color": look(number)[0], "width": 8}
        figure.add_scatter(x=x, y=y, mode="lines", name=mass, line=line)
    return figure
