"""A campaign: what it says at its end, and its page."""

from __future__ import annotations

import itertools
import math
import shlex
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from plotly.graph_objects import Figure

from butterfly.campaigns.campaign import CampaignOptions, CampaignResult
from butterfly.campaigns.folder import Journal
from butterfly.identification.design import OF_GOAL
from butterfly.identification.estimate import Estimate
from butterfly.identification.physical import judge_fit
from butterfly.identification.trust import or_nan
from butterfly.model.terms import TERMS
from butterfly.report.figures import GREY, log_ticks, look, panel, rows_panel
from butterfly.report.format import counted, percent, upwards
from butterfly.report.page import Badge, Fact, Marked, Page, PageTable, Section
from butterfly.report.parameter_table import values_table
from butterfly.report.summary import held_out_sentences
from butterfly.verdict import Level

_OF_RUNS = (
    *("run", "played", "added mass", "robot time in s", "ended early", "verdict"),
    "the model misses",
)
"""Columns of the table of runs."""

_RATIOS_ONLY = "ratios only"
_CAPTION = (
    "Of the goal: half-width of the 95 % interval, in % of the half-width that is the goal; up to "
    "100 % is within it."
)


def changes_of_mass(journal: Journal) -> int:
    """Return how often another mass was mounted."""
    return sum(a.added_mass != b.added_mass for a, b in itertools.pairwise(journal.steps))


def campaign_estimate(ended: CampaignResult) -> Estimate | None:
    """Return the estimate from all runs, of ratios to p1 while the scale is open; None if none.

    Such an estimate was made with p1 = 1, which was not given.
    """
    if ended.identified is None:
        return None
    estimate = ended.identified.estimate
    if not _are_ratios(estimate.names, ended.journal.known):
        return estimate
    fixed = {name: value for name, value in estimate.fixed.items() if name != "p1"}
    known = estimate.known.within(estimate.known.parameters.keys() - {"p1"})
    return replace(estimate, fixed=fixed, known=known)


def _are_ratios(names: Collection[str], known: Mapping[str, Any]) -> bool:
    """Return whether values are ratios to p1, which is neither among ``names`` nor known."""
    return "p1" not in names and "p1" not in known


def parameter_numbers(ended: CampaignResult) -> dict[str, dict[str, Any]]:
    """Return the parameters for programs, by name, with half-widths and goals in % of the value."""
    estimate = campaign_estimate(ended)
    if estimate is None:
        return {}
    fitted = [step for step in ended.journal.steps if not step.held_out]
    shares = fitted[-1].shares if fitted else {}  # empty if a kill came before them
    numbers = {}
    for row in estimate.table():
        half = None
        if row.farther is not None and row.value and not row.known:
            half = 100 * row.farther / abs(row.value)
        share = shares.get(row.name)
        goal = half / share if half is not None and share else None
        numbers[row.name] = asdict(row) | {"half_width": half, "wanted": goal}
    return numbers


def run_rows(journal: Journal, wish: CampaignOptions) -> list[dict[str, Any]]:
    """Return a row for each run; half-widths and goal in % of the value."""
    rows, begin, goal = [], 0.0, 100 * wish.goal
    for number, step in enumerate(journal.steps):
        ratios = bool(step.shares) and _are_ratios(step.shares, journal.known)
        if step.shares:  # half of it of ratios, where another mass is to come: see `wanted`
            goal = 100 * wish.goal / (1 + (ratios and len(wish.masses) > 1))
        widths = {name: goal * share for name, share in step.shares.items()}
        verdict = step.verdict or "no estimate"
        if step.held_out:
            verdict = "held out"
        elif ratios and verdict == Level.GOOD.verdict:
            verdict = _RATIOS_ONLY
        rows.append(
            {
                "run": number,
                "played": step.what,
                "added mass": str(step.added_mass),
                "robot time in s": step.seconds,
                "length in s": step.seconds - begin,
                "why": step.why,
                "ended early": step.cut,
                "verdict": verdict,
                "the model misses": step.misses,
                "goal in %": goal,
                **{f"{name} in %": widths.get(name) for name in OF_GOAL},
            }
        )
        begin = step.seconds
    return rows


def runs_table(title: str, rows: Sequence[Mapping[str, Any]]) -> PageTable:
    """Tabulate `run_rows`, each with the widest interval after it; no column that is empty."""
    names = [name for name in _OF_RUNS if any(row[name] != "" for row in rows)]
    columns: dict[str, Callable[[Mapping[str, Any]], object]] = {
        name: itemgetter(name) for name in names
    }
    return PageTable.of(title, rows, columns | {"widest interval": widest})


def widest(row: Mapping[str, Any]) -> str:
    """Return the widest interval after a run, as its table shows it."""
    widths = {name: or_nan(row[f"{name} in %"]) for name in OF_GOAL}
    widths = {name: width for name, width in widths.items() if math.isfinite(width)}
    if not widths:
        return "–"
    name = max(widths, key=lambda parameter: widths[parameter])
    return f"{name} ± {upwards(widths[name] / 100)}"


def parameters_table(
    title: str, estimate: Estimate, numbers: Mapping[str, Mapping[str, Any]]
) -> PageTable:
    """Tabulate parameters as `identify` does, beside the share of the goal in their `numbers`."""
    rows, shares = estimate.table(), []
    for fields in numbers.values():
        half, goal = fields["half_width"], fields["wanted"]
        shares.append(percent(half / goal) if half is not None and goal else "–")
    if estimate.ratios:
        title = f"{title}, ratios to p1"
        rows = tuple(replace(row, name=_ratio_name(row.name)) for row in rows)
    more = {"of the goal": shares}
    return values_table(title, rows, more, caption=_CAPTION, name="parameters")


def _ratio_name(name: str) -> str:
    """Return NAME/p1; NAME for one that is no ratio to p1, such as the delay."""
    return name if TERMS[name].of_gain else f"{name}/p1"


def breakaway_fact(command: float, unit: str, gain: Mapping[str, Any] | None) -> Fact:
    """Return at what torque the joint breaks away; at what command without a ``gain``."""
    shown = f"{command:.2g} {unit}" if unit != "unit" else f"{command:.2g}"
    if gain is None:
        return Fact("breaks away at", shown, "command")
    torque = f"{abs(gain['value']) * command:.2g} {gain['unit'].partition('/')[0]}"
    return Fact("breaks away at", torque, f"a command of {shown}")


def headline(ended: CampaignResult, wish: CampaignOptions, folder: Path) -> tuple[str, str]:
    """Say whether the goal is reached, with what; then what to do next."""
    journal, goal = ended.journal, f"{100 * wish.goal:.3g} %"
    changes = changes_of_mass(journal)
    cost = f"{_seconds(journal):.0f} s of robot time, {counted(len(journal.steps), 'run')}"
    cost += f", {changes or 'no'} change{'s' if changes > 1 else ''} of mass"
    reached = "is reached" if ended.reached else "is not reached"
    return f"The goal of {goal} {reached}: {cost}.", _next(ended, wish, folder)


def _seconds(journal: Journal) -> float:
    """Return the robot time so far in s."""
    return journal.steps[-1].seconds if journal.steps else 0.0


def _next(ended: CampaignResult, wish: CampaignOptions, folder: Path) -> str:
    """Return what is missing, if anything, and what to do."""
    place = shlex.quote(_folder_text(folder))
    if ended.reached:
        return (
            f"Next: `butterfly identify {place} --report page.html` shows how the model fits; "
            f"`butterfly export {place} --out twin.xml` writes a twin."
        )
    missing, estimate = f"{ended.ending[:1].upper()}{ended.ending[1:]}", campaign_estimate(ended)
    if _lacks_scale(estimate, wish) and not _too_wide(ended):
        missing = "Without a second mass or a known value only ratios to p1 are known"
    return f"{missing}. Next: {_remedy(ended, estimate, wish, place)}."


def _folder_text(folder: Path) -> str:
    """Return a folder as a command takes it here; only its name if it is elsewhere.

    What is said is part of the JSON, which has no path of this machine.
    """
    if not folder.is_absolute():
        return str(folder)
    here = Path.cwd()
    return str(folder.relative_to(here)) if here in folder.parents else folder.name


def _lacks_scale(estimate: Estimate | None, wish: CampaignOptions) -> bool:
    """Return whether ratios are all that the masses at hand allow."""
    return estimate is not None and estimate.ratios and len(wish.masses) == 1


def _remedy(
    ended: CampaignResult, estimate: Estimate | None, wish: CampaignOptions, place: str
) -> str:
    """Return what leads on from a goal that is not reached."""
    steps, limits = ended.journal.steps, wish.limits
    again = "the same command continues from these runs"
    lengths = [b - a for a, b in itertools.pairwise([0.0, *(step.seconds for step in steps)])]
    is_short = limits.seconds - _seconds(ended.journal) < max(lengths, default=math.inf)
    more_time = f"give more robot time, `--seconds {2 * limits.seconds:g}`: {again}"
    if steps and estimate is None:
        return f"`butterfly inspect {place}` checks the logs; then start again with another `--out`"
    if _lacks_scale(estimate, wish):
        return (
            f"add a mass, `--masses 0,KG --arm M`, or a known value, `--known p4=VALUE`: {again}; "
            f"`butterfly identify {place} --known p1=1` shows the ratios"
        )
    if estimate is None or is_short:  # for one more run
        return more_time
    if _missed(ended) or _unpredicted(ended):
        return (
            f"`butterfly residual {place}` shows the residual torque; "
            f"`butterfly identify {place} --terms NAME` fits a term"
        )
    if not _too_wide(ended) and estimate.level is not Level.GOOD:
        return f"`butterfly identify {place}` says what to check"
    share = next((step.largest for step in reversed(steps) if step.shares), 1.0)
    goal = upwards(wish.goal * share).replace(" ", "")
    return (
        f"accept a wider goal, `--goal {goal}`: {again}; or start again with another `--out` and a "
        "larger `--angle`, `--command` or mass"
    )


def _missed(ended: CampaignResult) -> str:
    """Return what the model misses by the last estimate; empty if nothing."""
    return next((step.misses for step in reversed(ended.journal.steps) if step.verdict), "")


def _unpredicted(ended: CampaignResult) -> bool:
    """Return whether the model fails to predict a run that was not fitted."""
    held_out = ended.identified.held_out if ended.identified else {}
    return any(judge_fit(np.array([fit])) for fit in held_out.values())


def _too_wide(ended: CampaignResult) -> list[str]:
    """Return the parameters whose intervals exceed the goal, with both in %."""
    estimate, texts = campaign_estimate(ended), []
    for name, fields in parameter_numbers(ended).items():
        half, goal = fields["half_width"], fields["wanted"]
        if half is not None and goal is not None and half > goal:
            shown = _ratio_name(name) if estimate is not None and estimate.ratios else name
            texts.append(f"{shown} ± {upwards(half / 100)} ({percent(goal / 100)} wanted)")
    return texts


def campaign_notes(ended: CampaignResult, remedy: str) -> list[str]:
    """Return what is worth saying besides the headline; ``remedy``: its second line."""
    wide: Sequence[str] = _too_wide(ended)
    lines = [f"Too wide: {', '.join(wide)}."] if wide else []
    if misses := _missed(ended):
        lines.append(f"The model is incomplete: {misses}.")
    estimate = campaign_estimate(ended)
    if estimate is not None and estimate.ratios and "ratios to p1" not in remedy:
        lines.append("The values are ratios to p1: the runs so far give no scale.")
    return lines + held_out_sentences(ended.identified.held_out if ended.identified else {})


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
        named = _with_meanings(tables[0].on_page())._replace(name="parameters")
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
