"""The report of estimators against each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from plotly.graph_objects import Bar, Figure

from butterfly.identify.judgement.verdict import Standing
from butterfly.report.figures import PALETTE
from butterfly.report.page import Page, Section, Table
from butterfly.report.verdict import SaidVerdict
from butterfly.report.words import verdict_on

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.compare.leaderboard import Entry
    from butterfly.identify.predict import FitSummary


def leaderboard_page(entries: Sequence[Entry]) -> Page:
    """Put together the report of estimators over data sets, the best of each first."""
    sets = list(dict.fromkeys(entry.data for entry in entries))
    sections, verdict = [], _verdict(entries, sets)
    for number, name in enumerate(sets):
        own = [entry for entry in entries if entry.data == name]
        figure = {f"fit-{number}": _figure(own)}
        sections.append(Section(title=f"{name}: FIT in %", tables=(_table(own),), figures=figure))
    return Page(
        name="leaderboard",
        description="Estimators over data sets: " + ", ".join(sets),
        kind="leaderboard",
        summary=_summary(entries, sets),
        sections=sections,
        numbers=verdict.numbers() | {"entries": [_numbers(entry) for entry in entries]},
        verdict=verdict,
    )


def _verdict(entries: Sequence[Entry], sets: Sequence[str]) -> SaidVerdict:
    """Say the worst verdict on the first of each data set, and all reasons, by their data set."""
    firsts = {name: next(entry for entry in entries if entry.data == name) for name in sets}
    standings, reasons = [], []
    for name, first in firsts.items():
        if first.estimate is None:
            standings.append(Standing.NOT)
            reasons.append(f"{name}: {first.error}")
            continue
        said = verdict_on(first.estimate)
        standings.append(said.standing)
        reasons += [f"{name}, {first.method}: {reason}" for reason in said.reasons]
    return SaidVerdict(Standing.worst(standings) or Standing.NOT, tuple(reasons))


def _summary(entries: Sequence[Entry], sets: Sequence[str]) -> list[str]:
    sentences = []
    for name in sets:
        best = next(entry for entry in entries if entry.data == name)
        if best.held_out is None:
            sentences.append(f"{name}: no estimator could predict what was left out.")
            continue
        sentences.append(
            f"{name}: {best.method} predicts best what it has not seen ({best.left_out} at a "
            f"time), with a median FIT{best.held_out.over} of {best.held_out.median:.1f} %."
        )
    return sentences


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


def _numbers(entry: Entry) -> dict[str, Any]:
    fits = {"held_out": entry.held_out, "in_sample": entry.in_sample}
    said = {"verdict": None} if entry.estimate is None else verdict_on(entry.estimate).numbers()
    return {
        "data": entry.data,
        "method": entry.method,
        "left_out": entry.left_out or None,
        **said,
        "seconds": entry.seconds,
        "error": entry.error,
    } | {name: None if fit is None else fit.numbers() for name, fit in fits.items()}
