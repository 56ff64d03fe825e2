"""The page of estimators ranked by prediction (a leaderboard), and figures of tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from textwrap import wrap

from plotly.graph_objects import Figure

from butterfly.comparison.leaderboard import Entry, equals
from butterfly.identification.free_run import FitSummary
from butterfly.report.figures import PALETTE, log_ticks, logs_panel, look, panel
from butterfly.report.format import fit_text
from butterfly.report.page import Badge, Fact, Marked, Page, PageTable, Section
from butterfly.report.summary import medians_of
from butterfly.result import Result
from butterfly.verdict import Level, Verdict

_HEADERS: tuple[str, ...] = (
    *("estimator", "verdict", "held out: median", "held out: worst"),
    *("in sample: median", "in sample: worst"),
    *("time in s", "p1", "p2", "p3", "p4", "coulomb", "remark"),
)
_ROW = 52  # pixels of an estimator
_BROAD = 32  # letters of a line that names an experiment
_LEAST = 1e-3  # % that a FIT lacks at least, to be drawn


def leaderboard_page(entries: Sequence[Entry], result: Result) -> Page:
    """Put together the page of estimators over data sets, the best of each first."""
    sets = list(dict.fromkeys(entry.data for entry in entries))
    sections = []
    for number, name in enumerate(sets):
        own = [entry for entry in entries if entry.data == name]
        figures, tables = {f"fit-{number}": _leaderboard_figure(own)}, (_leaderboard_table(own),)
        sections.append(Section(title=f"{name}: FIT in %", tables=tables, figures=figures))
    return Page(
        name="leaderboard",
        description=result.title,
        kind="leaderboard",
        facts=_leaderboard_facts(entries),
        summary=result.notes,
        sections=sections,
        numbers=result.to_dict(),
        badge=None if result.judged is None else _leaderboard_badge(entries, result.judged),
        verdict=result.judged,
    )


def _leaderboard_badge(entries: Sequence[Entry], judged: Verdict) -> Badge:
    """Say what may be done with the estimates, if all agree; else that each row has its verdict."""
    levels = {Level.WARNING if e.estimate is None else e.estimate.level for e in entries}
    if len(levels) == 1:
        return Badge(judged.level, f"All: {judged.level.verdict}", judged.reasons)
    return Badge(Level.NOTE, "Verdicts differ: see each row", judged.reasons)


def _leaderboard_facts(entries: Sequence[Entry]) -> list[Fact]:
    sets = dict.fromkeys(entry.data for entry in entries)
    facts = []
    for name in sets:
        own = [each for each in entries if each.data == name]
        best = own[0]
        if best.held_out is None:
            continue
        equal = equals(own)
        label = "predict best, no clear winner" if len(equal) > 1 else "predicts best"
        fit = f"held out: median FIT {fit_text(best.held_out.median)} %, {name}"
        facts.append(Fact(label, ", ".join(each.method for each in equal), fit))
    methods = dict.fromkeys(entry.method for entry in entries)
    return [*facts, Fact("methods", str(len(methods))), Fact("data sets", str(len(sets)))]


def _leaderboard_table(entries: Sequence[Entry]) -> PageTable:
    names = ("p1", "p2", "p3", "p4", "coulomb")
    rows: list[tuple[str | Marked, ...]] = []
    for entry in entries:
        values, found, level = dict.fromkeys(names, "–"), entry.estimate, Marked("–")
        if found is not None:
            level = Marked(found.level.verdict, level=found.level)
            estimated = {*found.names, *found.fixed} - {*found.unestimated}
            for name in estimated & values.keys():
                values[name] = f"{getattr(found.parameters, name):#.4g}"
        fits = [*_fit(entry.held_out), *_fit(entry.in_sample)]
        rest = (f"{entry.seconds:.2f}", *values.values(), entry.error or "–")
        rows.append((entry.method, level, *fits, *rest))
    last = len(_HEADERS) - 1
    shown = slice(None if any(entry.error for entry in entries) else last)
    return PageTable(headers=_HEADERS[shown], rows=[row[shown] for row in rows], words=(1, last))


def _fit(fit: FitSummary | None) -> tuple[str, str]:
    return ("–", "–") if fit is None else (fit_text(fit.median), fit_text(fit.worst))


def _leaderboard_figure(entries: Sequence[Entry]) -> Figure:
    """Draw what each estimator lacks of a FIT of 100 %, so that good ones are told apart."""
    figure = panel("100 − median FIT in %: further left is better", "", _ROW * len(entries) + 110)
    kinds = (("held out", "held_out", "top", 9), ("in sample", "in_sample", "bottom", 15))
    for number, (name, field, place, size) in enumerate(kinds):
        fits = {each.method: getattr(each, field) for each in reversed(entries)}
        medians = {method: fit.median for method, fit in fits.items() if fit is not None}
        finite = {method: fit for method, fit in medians.items() if math.isfinite(fit)}
        colour, symbol = look(number)
        figure.add_scatter(
            x=[max(100 - fit, _LEAST) for fit in finite.values()],
            y=list(finite),
            text=[f"{fit_text(fit)} %" for fit in finite.values()],
            textposition=f"{place} center",
            mode="markers+text",
            name=f"{name}, median FIT",
            marker={"color": colour, "symbol": symbol + "-open" * number, "size": size},
            hovertemplate="%{y}: %{text}",
        )
    figure.update_xaxes(log_ticks(1, 2, 5))
    methods = [each.method for each in entries]
    ends = [-0.6, len(methods) - 0.4]
    figure.update_yaxes(categoryorder="array", categoryarray=methods[::-1], range=ends)
    return figure


@dataclass(frozen=True)
class TablePlots:
    """Figures of a table."""

    result: Result

    def fits(self) -> Figure:
        """Draw every column of FITs, a point for each log."""
        rows = self.result.rows()
        columns = [name for name in (rows[0] if rows else ()) if name.startswith("FIT")]
        labels = [str(row.get("log", number)) for number, row in enumerate(rows, start=1)]
        figure = logs_panel([label.rsplit("/", maxsplit=1)[-1] for label in labels], "FIT in %")
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

    def choices(self) -> Figure:
        """Draw the median FIT with each set of terms, in sample and held out."""
        figure, rows = panel("fitted terms", "median FIT in %", 340), self.result.rows()
        names = [", ".join(row["terms"]) or "none" for row in rows]
        fits = [*map(medians_of, rows)]
        for number, name in enumerate(fits[0]):
            colour, symbol = look(number)
            marker = {"color": colour, "symbol": symbol, "size": 9}
            values = [each[name] for each in fits]
            figure.add_scatter(x=names, y=values, mode="lines+markers", name=name, marker=marker)
        return figure

    def ranking(self, count: int = 12) -> Figure:
        """Draw the mean of the standard errors after each of the first candidates, over now's."""
        rows = self.result.rows()[:count]
        names = [f"{row['input']}, {row['added mass']}" for row in rows]
        short = [wrap(name, _BROAD, max_lines=2, placeholder=" …") for name in names]
        across = "standard errors after this run<br>in % of the present ones"
        figure = logs_panel(["\n".join(lines) for lines in short], across)
        ends = [min(0.0, *(100 * row["mean"] for row in rows)), 105.0]
        return figure.update_xaxes(range=ends).add_scatter(
            x=[100 * row["mean"] for row in rows],
            y=list(range(len(rows))),
            text=[f"{100 * row['mean']:.3g} %" for row in rows],
            textposition="middle left",
            mode="markers+text",
            hovertext=[*map(escape, names)],
            hovertemplate="%{hovertext}: %{x:.3g} %<extra></extra>",
            marker={"color": PALETTE[0], "size": 9},
        )
