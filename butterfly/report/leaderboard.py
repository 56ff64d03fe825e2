"""The report of estimators against each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plotly.graph_objects import Bar, Figure

from butterfly.report.figures import PALETTE
from butterfly.report.numbers.comparison_numbers import leaderboard_sentences, told_leaderboard
from butterfly.report.page import Page, Section, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.compare.leaderboard import Entry
    from butterfly.identify.predict import FitSummary


def leaderboard_page(entries: Sequence[Entry]) -> Page:
    """Put together the report of estimators over data sets, the best of each first."""
    sets = list(dict.fromkeys(entry.data for entry in entries))
    sections, told = [], told_leaderboard(entries)
    for number, name in enumerate(sets):
        own = [entry for entry in entries if entry.data == name]
        figure = {f"fit-{number}": _figure(own)}
        sections.append(Section(title=f"{name}: FIT in %", tables=(_table(own),), figures=figure))
    return Page(
        name="leaderboard",
        description="Estimators over data sets: " + ", ".join(sets),
        kind="leaderboard",
        summary=leaderboard_sentences(entries),
        sections=sections,
        numbers=told.document(),
        verdict=told.verdict,
    )


def _table(entries: Sequence[Entry]) -> Table:
    names = ("p1", "p2", "p3", "p4", "coulomb")
    rows = []
    for entry in entries:
        values = ["–"] * len(names)
        if entry.estimate is not None:
            found = entry.estimate
            estimated = {*found.names, *found.held} - found.unestimated
            values = [
                f"{getattr(found.parameters, name):.4g}" if name in estimated else "–"
                for name in names
            ]
        fits = [*_fit(entry.held_out), *_fit(entry.in_sample)]
        standing = "–" if entry.estimate is None else entry.estimate.verdict.standing
        told = (f"{entry.seconds:.2f}", *values, entry.error or "–")
        rows.append((entry.method, standing, *fits, *told))
    headers = (
        *("estimator", "verdict", "left out: median", "left out: worst"),
        *("in sample: median", "in sample: worst"),
        *("seconds", "p₁", "p₂", "p₃", "p₄", "T_c", "remark"),
    )
    return Table(headers=headers, rows=rows)


def _fit(fit: FitSummary | None) -> tuple[str, str]:
    return ("–", "–") if fit is None else (f"{fit.median:.1f}", f"{fit.worst:.1f}")


def _figure(entries: Sequence[Entry]) -> Figure:
    figure = Figure()
    kinds = {"left out": "held_out", "in sample": "in_sample"}
    for colour, (name, field) in zip(PALETTE, kinds.items(), strict=False):
        shown = [entry for entry in entries if getattr(entry, field) is not None]
        heights = [max(getattr(entry, field).median, 0.0) for entry in shown]
        methods = [entry.method for entry in shown]
        figure.add_trace(Bar(x=methods, y=heights, name=name, marker={"color": colour}))
    figure.update_yaxes(title="median FIT in %", range=[0, 100])
    figure.update_xaxes(title="estimator")
    figure.update_layout(height=340, barmode="group")
    return figure
