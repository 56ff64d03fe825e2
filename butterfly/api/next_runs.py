"""`design`: which run to do next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from butterfly.api.sources import Data
from butterfly.api.verbs import estimated
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.design import Candidate, Plan, next_experiments, wanted
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import estimate_verdict, require_possible
from butterfly.report.format import cell_text, counted
from butterfly.report.numbers import rests_on
from butterfly.report.page import Fact, PageTable, views
from butterfly.report.summary import next_run_text
from butterfly.result import Answer


@checked
def design(
    data: Data,
    *,
    goal: float | str = "1%",
    duration: float = 40.0,
    command: float | None = None,
    swing: float | None = None,
    price: float = 120.0,
    track: Track = untracked,
) -> Answer:
    """Say which run to do next: the one that reaches a goal in the least robot time.

    Candidates: sines, multisines and free decays, with each added mass and without. Each one is
    simulated with the identified parameters.

    Parameters
    ----------
    data
        As in `residual`; logs are identified by the default method.
    goal, price
        As in `campaign`. The last log's mass is taken as mounted.
    duration
        Length of a run in s; of a servo at most that of its logs.
    command
        Largest command, in units of the input. Default: the largest one logged.
    swing
        Largest allowed swing in rad (m on a slide). Default: 1; on a slide or servo, the logs'
        largest.
    track
        Progress callback.
    """
    share = share_of(goal)
    logs, estimator, estimate = estimated(data, None, {}, ())
    require_possible(estimate)
    aim = wanted(estimate.at_limit, logs.logs, share)
    limits: dict[str, Any] = {"duration": duration, "command": command, "swing": swing}
    ranked = next_experiments(logs, estimate, aim, **limits, price=price, track=track)
    now = float(np.max(estimate.farther / aim))
    return design_answer(logs, estimator, estimate, ranked, goal=share, now=share * now)


def design_answer(
    data: DataSet,
    estimator: Estimator | None,
    estimate: Estimate,
    ranked: Sequence[Plan[Candidate]],
    *,
    goal: float,
    now: float,
) -> Answer:
    """Tabulate next runs, the cheapest way first; ``goal``: share, ``now``: largest half-width."""
    verdict = estimate_verdict(estimate)
    rows = finite(
        [
            {
                "added mass": str(plan.recipe.log.added_mass),
                "input": plan.recipe.what,
                f"swing in {data.joint.way}": plan.recipe.swing,
                "runs": plan.runs,
                "robot time in s": round(plan.seconds),
                "reached in %": 100 * goal * plan.expected[1],
                **dict(zip(estimate.names, map(float, plan.errors), strict=True)),
                "warning": plan.recipe.warning,
            }
            for plan in ranked
        ]
    )
    best, title = rows[0], f"Next runs for {data.name!r}"
    title += ": standard errors after one run, relative to the present ones"
    cells = [
        (str(k), *(f"{v:.2f}" if isinstance(v, float) else cell_text(v) for v in row.values()))
        for k, row in enumerate(rows, start=1)
    ]
    reached, current, aim = map(cell_text, (best["reached in %"], 100 * now, 100 * goal))
    facts = [
        Fact("next run", best["input"], best["added mass"]),
        Fact("robot time", f"{best['robot time in s']} s", counted(best["runs"], "run")),
        Fact("largest half-width after", f"{reached} %", f"now {current} %, goal {aim} %"),
        Fact("candidates", str(len(rows))),
    ]
    return Answer(
        kind="design",
        title=title,
        summary=verdict.after(next_run_text(ranked[0], estimate.names, goal, now)),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "goal": goal,
            "half_width": now,
            "rows": rows,
            **views([PageTable(title, ("", *best), cells)], facts, "ranking"),
        },
        units={f"rows.{name}": "1" for name in estimate.names},
    )


def share_of(goal: float | str) -> float:
    """Return a goal as a share, given as one or in per cent."""
    try:
        share = (
            float(goal[:-1]) / 100 if isinstance(goal, str) and goal[-1:] == "%" else float(goal)
        )
    except ValueError:
        share = float("nan")
    if not 0 < share < 1:
        expected = "a share between 0 and 1, such as 0.01 or 1%"
        raise InputError("butterfly", "goal", goal, expected)
    return share
