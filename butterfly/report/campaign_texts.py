"""What a campaign says at its end: the goal, what to do next, parameters and runs in per cent."""

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

from butterfly.campaigns.campaign import CampaignOptions, CampaignResult
from butterfly.campaigns.folder import Journal
from butterfly.identification.design import OF_GOAL
from butterfly.identification.estimate import Estimate
from butterfly.identification.parameter import or_nan
from butterfly.identification.physical import judge_fit
from butterfly.model.terms import TERMS
from butterfly.report.format import counted, percent, upwards
from butterfly.report.page import Fact, PageTable
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
