"""The page and the figures of an answer, made of its numbers for programs.

A figure is None where there is nothing to draw.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from html import escape
from itertools import product
from textwrap import wrap
from typing import Any

from plotly.graph_objects import Figure

from butterfly.identification.trust import or_nan
from butterfly.report import campaign_page
from butterfly.report.corner import corner_figure, corner_of_draws
from butterfly.report.figures import GREY, PALETTE, add, log_ticks, look, panel, panels, rows_panel
from butterfly.report.format import fit_text, is_relative, label_of
from butterfly.report.inspection import inspection_page
from butterfly.report.page import Fact, Page, PageTable, Section
from butterfly.report.summary import medians_of
from butterfly.verdict import Verdict

_ROW = 52  # pixels of an estimator
_CHANGE = 40  # of a parameter that may have changed
_SIMULATORS = {"MuJoCo": ("-open", 12), "grey box": ("", 5)}  # symbol and size of their marks
_BROAD = 32  # letters of a line that names an experiment
_LEAST = 1e-3  # % that a FIT lacks at least, to be drawn


def fits(numbers: Mapping[str, Any]) -> Figure | None:
    """Draw every column of FITs, a point for each log."""
    names = [name for name in next(iter(numbers["rows"]), {}) if name.startswith("FIT ")]
    return _by_log(numbers["rows"], "FIT in %", names) if names else None


def shares(numbers: Mapping[str, Any]) -> Figure | None:
    """Draw the share of measured samples inside each band, a point for each log."""
    names = [name for name in next(iter(numbers["rows"]), {}) if name.endswith(": inside in %")]
    if not names:
        return None
    figure = _by_log(numbers["rows"], "measured samples inside the band, in %", names[::-1])
    figure.add_vline(x=95, line={"color": GREY, "width": 1, "dash": "dash"})
    return figure.update_layout(showlegend=True).update_xaxes(range=[-2, 102])


def _by_log(rows: Sequence[Mapping[str, Any]], title: str, columns: Sequence[str]) -> Figure:
    """Draw columns in per cent, a row for each log."""
    labels = [*map(label_of, rows)]
    figure = rows_panel(labels, title)
    for number, name in enumerate(columns):
        colour, symbol = look(number)
        marker = {"color": colour, "symbol": symbol + "-open" * (number % 2)}
        figure.add_scatter(
            x=[row[name] for row in rows],
            y=list(range(len(rows))),
            text=[*map(escape, labels)],
            name=name.removeprefix("FIT ").removesuffix(" in %"),
            mode="markers",
            marker=marker | {"size": 7 + 5 * (number % 2)},
            hovertemplate="%{text}: %{x:.1f} %",
        )
    return figure


def frequencies(numbers: Mapping[str, Any]) -> Figure | None:
    """Draw how the simulators' responses to sines differ from the logs', by added mass."""
    rows = [row for row in numbers["rows"] if row["phase error MuJoCo in °"] is not None]
    if not rows:
        return None
    figure = panels("frequency in rad/s", ("amplitude error in %", "phase error in °"), 480)
    masses = sorted({row["added mass in kg"] for row in rows})
    for (number, mass), name in product(enumerate(masses), _SIMULATORS):
        (colour, symbol), (mark, size) = look(number), _SIMULATORS[name]
        group = [row for row in rows if row["added mass in kg"] == mass]
        style: dict[str, Any] = {
            "name": f"{1e3 * mass:g} g, {name}",
            "mode": "markers",
            "marker": {"color": colour, "symbol": symbol + mark, "size": size},
        }
        omega = [row["frequency in rad/s"] for row in group]
        for row, (what, unit) in enumerate((("amplitude", " %"), ("phase", "°")), start=1):
            errors = [log[f"{what} error {name} in {unit.strip()}"] for log in group]
            hover = f"%{{x:.3g}} rad/s: %{{y:.4g}}{unit}"
            style |= {"showlegend": row == 1, "hovertemplate": hover}
            add(figure, row, omega, errors, **style)
    return figure


def corner(numbers: Mapping[str, Any]) -> Figure | None:
    """Draw the parameters of draws that vary: each alone, and below against each other."""
    drawn = corner_of_draws(numbers)
    return None if drawn is None else corner_figure(drawn)


def leaderboard(numbers: Mapping[str, Any]) -> Figure:
    """Draw 100 % minus the median FIT of each estimator on a logarithmic axis."""
    rows = numbers["entries"]
    several = len({row["data"] for row in rows}) > 1
    names = [f"{row['method']}, {row['data']}" if several else row["method"] for row in rows]
    title = "100 − median FIT in %: further left is better"
    figure = panel(title, "", _ROW * len(rows) + 110)
    kinds = (("held out", "held_out", "top", 9), ("in sample", "in_sample", "bottom", 15))
    for number, (name, field, place, size) in enumerate(kinds):
        fits = {
            label: row[field]["median"]
            for label, row in zip(names, rows, strict=True)
            if row[field] and math.isfinite(or_nan(row[field]["median"]))
        }
        colour, symbol = look(number)
        figure.add_scatter(
            x=[max(100 - fit, _LEAST) for fit in fits.values()],
            y=list(fits),
            text=[f"{fit_text(fit)} %" for fit in fits.values()],
            textposition=f"{place} center",
            mode="markers+text",
            name=f"{name}, median FIT",
            marker={"color": colour, "symbol": symbol + "-open" * number, "size": size},
            hovertemplate="%{y}: %{text}",
        )
    figure.update_xaxes(log_ticks(1, 2, 5))
    ends = [-0.6, len(names) - 0.4]
    figure.update_yaxes(categoryorder="array", categoryarray=names[::-1], range=ends)
    return figure


def choices(numbers: Mapping[str, Any]) -> Figure | None:
    """Draw the median FIT with each set of terms, in sample and held out; None of one set."""
    figure, rows = panel("fitted terms", "median FIT in %", 340), numbers["rows"]
    if len(rows) == 1:
        return None
    names = [", ".join(row["terms"]) or "none" for row in rows]
    fits = [*map(medians_of, rows)]
    for number, name in enumerate(fits[0]):
        colour, symbol = look(number)
        marker = {"color": colour, "symbol": symbol, "size": 9}
        values = [medians[name] for medians in fits]
        figure.add_scatter(x=names, y=values, mode="lines+markers", name=name, marker=marker)
    return figure


def ranking(numbers: Mapping[str, Any], count: int = 12) -> Figure:
    """Draw the robot time of each of the first candidates, with the half-width that it reaches."""
    rows = numbers["rows"][:count]
    names = [f"{row['input']}, {row['added mass']}" for row in rows]
    short = [wrap(name, _BROAD, max_lines=2, placeholder=" …") for name in names]
    across = "robot time in s, and the largest half-width that it reaches"
    figure = rows_panel(["\n".join(lines) for lines in short], across)
    times = [or_nan(row["robot time in s"]) for row in rows]
    return figure.update_xaxes(range=[-0.2 * max(times), 1.05 * max(times)]).add_scatter(
        x=times,
        y=list(range(len(rows))),
        text=[f"{or_nan(row['reached in %']):.2g} %" for row in rows],
        textposition="middle left",
        mode="markers+text",
        hovertext=[*map(escape, names)],
        hovertemplate="%{hovertext}: %{x:.3g} s<extra></extra>",
        marker={"color": PALETTE[0], "size": 9},
    )


def changes(numbers: Mapping[str, Any]) -> Figure:
    """Draw the changes of parameters in per cent, with their intervals."""
    rows = [row for row in numbers["rows"] if is_relative(row)]
    moved = [row["change in %"] for row in rows]
    upper = [100 * row["upper"] / abs(row["before"]) for row in rows]
    across = "change in % (95 % interval)"
    figure = rows_panel([row["parameter"] for row in rows], across, _CHANGE).add_scatter(
        x=moved,
        y=list(range(len(rows))),
        error_x={
            "array": [most - shift for most, shift in zip(upper, moved, strict=True)],
            "color": GREY,
        },
        mode="markers",
        marker={"color": [PALETTE[5 if row["changed"] else 0] for row in rows], "size": 9},
    )
    return figure.add_vline(x=0, line={"color": GREY, "width": 1, "dash": "dash"})


FIGURES: dict[str, Callable[[Mapping[str, Any]], Figure | None]] = {
    "changes": changes,
    "choices": choices,
    "corner": corner,
    "fits": fits,
    "frequency": frequencies,
    "inside": shares,
    "leaderboard": leaderboard,
    "played": campaign_page.played,
    "ranking": ranking,
    "shrinking": campaign_page.shrinking,
}
"""What draws a figure of an answer's numbers, by the figure's name in them."""

PAGES: dict[str, Callable[[Page], Page]] = {
    "campaign": campaign_page.campaign_page,
    "inspection": inspection_page,
}
"""What arranges the page of a kind of answer in its own way."""


def figures_of(numbers: Mapping[str, Any]) -> dict[str, Figure]:
    """Return the figures of an answer, by name."""
    made = {name: FIGURES[name](numbers) for name in numbers["figures"]}
    return {name: figure for name, figure in made.items() if figure is not None}


def answer_page(numbers: dict[str, Any]) -> Page:
    """Return the page of an answer: its figures, then its tables."""
    kind, verdict = numbers["schema"].removeprefix("butterfly."), Verdict.of_numbers(numbers)
    figures, lines = figures_of(numbers), () if verdict is None else verdict.lines
    tables = [PageTable.of_plain(table) for table in numbers["tables"]]
    summary = numbers["summary"]
    begin = summary.index(lines[0]) if lines and lines[0] in summary else 0
    page = Page(
        name=numbers["title"],
        description=(numbers.get("data") or {}).get("description", ""),
        kind=kind,
        summary=[sentence for sentence in summary if sentence not in lines],
        verdict=verdict,
        asked=summary[:begin],
        facts=[Fact(**fact) for fact in numbers["facts"]],
        lead=Section(title="At a glance", figures=figures) if figures else None,
        sections=[
            Section(title=table.title if number else "In numbers", tables=(table.on_page(),))
            for number, table in enumerate(tables)
        ],
        numbers=numbers,
    )
    return PAGES[kind](page) if kind in PAGES else page
