"""Segments of a joint's own time, where no run of whole logs stays near them.

A joint that nothing holds, such as a cart or an arm without gravity in somebody's loop, integrates
twice whatever its simulation lacks: after a minute little is left to see of its inertia. Its own
time is the period of its motion, or the time in which its speed settles if that is shorter;
segments are shorter by thirds, if such leave no more than noise.
"""

from __future__ import annotations

import math
from dataclasses import replace

from butterfly.arrays import Samples
from butterfly.identification.chosen_terms import Fitted
from butterfly.identification.estimators.start import refitted, white_cost
from butterfly.identification.fit import Minimum
from butterfly.identification.inference.blocks import CELLS
from butterfly.identification.levels import FEW, PRECISE, WEIGHED
from butterfly.identification.problem import Problem, Start
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import out_of_time
from butterfly.signals.spectrum import dominant_period


def own_time(fitted: Fitted) -> tuple[float, Start] | None:
    """Return the time in s of segments, and a first guess over them, if whole logs are no good.

    That is where nothing holds the joint, and a fit of whole logs leaves errors above white noise
    by more than this is known.
    """
    problem, end = fitted.problem, fitted.end
    if _is_held(problem, end) or _explained(end):
        return None
    own, tried = _time_of(problem, end), list[tuple[float, Minimum]]()
    while not _explained(end) and len(tried) <= FEW and not out_of_time("shorter segments"):
        horizon = float(f"{own / FEW ** len(tried):.2g}")  # which hardly depends on the values
        shorter = _over(problem, end, horizon) if _shortest(problem) < horizon < math.inf else None
        if shorter is None:
            break
        end = shorter
        tried.append((horizon, end))
    if not tried:
        return None
    # where noise explains none, it is the model that lacks something
    horizon, end = tried[-1 if _explained(end) else 0]
    return horizon, problem.start_at(end.values)


def _loaded(problem: Problem, end: Minimum) -> list[LumpedParameters]:
    """Return inertia, damping and gravity that a fit gives the joint in each log."""
    values = problem.named(end.values)
    bare = replace(problem.start, **{n: values[n] for n in ("p1", "p2", "p3") if n in values})
    return [bare.with_added_mass(log.added_mass) for log in problem.logs]


def _is_held(problem: Problem, end: Minimum) -> bool:
    """Whether gravity or a servo's loop holds the joint."""
    return any(log.closed for log in problem.logs) or any(p.p3 for p in _loaded(problem, end))


def _time_of(problem: Problem, end: Minimum) -> float:
    """Return the own time in s of a joint that nothing holds."""
    settles = (2 * math.pi * each.p1 / each.p2 for each in _loaded(problem, end) if each.p2 > 0)
    return min([*settles, *(dominant_period(log.time, log.angle) for log in problem.logs)])


def _explained(end: Minimum) -> bool:
    """Whether white noise explains the errors at the end of a fit."""
    return end.at.cost <= (1 + WEIGHED) ** 2 * white_cost(end.at)


def _shortest(problem: Problem) -> float:
    """Return the time in s below which a segment holds too little to tell of its start."""
    return CELLS * max(log.mean_step for log in problem.logs)


def _over(problem: Problem, end: Minimum, horizon: float) -> Minimum | None:
    """Return the end of a fit over segments that begins at another's; None if there is none."""
    there = replace(problem, options=replace(problem.options, horizon=horizon))
    there = there.of_logs(problem.logs)
    return refitted(there, end.values)


def over_shorter(problem: Problem, end: Minimum) -> list[Samples]:
    """Return (shared,) values over a third of segments of the joint's own time, which are as right.

    Over some joints these are nearer the truth, over others not, and nothing tells which. None of
    segments that are shorter already, as noise explains only those.
    """
    horizon = problem.options.horizon
    third = horizon / FEW
    if horizon < (1 - PRECISE) * _time_of(problem, end) or third < _shortest(problem):
        return []
    found = _over(problem, end, third)
    return [found.values[: problem.shared]] if found is not None and found.converged else []
