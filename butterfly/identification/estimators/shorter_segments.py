"""Segments of a joint's own time, where errors of whole logs are more than noise.

They are shorter by thirds, if such leave no more than noise.
"""

from __future__ import annotations

import math
from dataclasses import replace

from butterfly.arrays import Samples
from butterfly.identification.encoder_offset import reading_of
from butterfly.identification.estimators.start import refitted, white_cost
from butterfly.identification.fit import Fit
from butterfly.identification.free_run import is_held, own_time
from butterfly.identification.inference.blocks import CELLS
from butterfly.identification.levels import FEW, PRECISE, WEIGHED
from butterfly.identification.problem import Problem, Start
from butterfly.progress import out_of_time


def shorter_segments(every: Problem, fit: Fit) -> tuple[float, Start] | None:
    """Return the time in s of segments, and a first guess over them, if longer ones are no good.

    That is where nothing holds the joint in any log, and a fit leaves errors above white noise by
    more than this is known.
    """
    problem, end = every.of_fit(fit.plain), fit.plain
    own, whole = _time_of(problem, end), math.isinf(problem.options.horizon)
    if math.isinf(own) or _explained(end):
        return None
    own = own if whole else problem.options.horizon
    first: tuple[float, Fit] | None = None
    for part in range(0 if whole else 1, FEW + 1):
        horizon = float(f"{own / FEW**part:.2g}")
        if horizon < _shortest(problem) or out_of_time("shorter segments"):
            break
        shorter = _over(problem, end, horizon)
        if shorter is None:
            break
        end = shorter
        if _explained(end):
            return horizon, problem.start_at(end.values)
        first = first or (horizon, end)
    if first is None or not whole:
        return None
    horizon, end = first  # noise explains none: it is the model that lacks something
    return horizon, problem.start_at(end.values)


def over_shorter(problem: Problem, end: Fit) -> list[Samples]:
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


def _time_of(problem: Problem, end: Fit) -> float:
    """Return the shortest own time in s of the logs; infinite if the joint is held in any."""
    values = end.named
    bare = replace(problem.start, **{n: values[n] for n in ("p1", "p2", "p3") if n in values})
    joints = [(log, bare.with_added_mass(log.added_mass)) for log in problem.logs]
    if any(is_held(*pair, reading_of(pair[0], problem.zeros)) for pair in joints):
        return math.inf
    return min(own_time(*pair) for pair in joints)


def _explained(end: Fit) -> bool:
    """Whether white noise explains the errors at the end of a fit."""
    return end.cost <= (1 + WEIGHED) ** 2 * white_cost(end.linearisation)


def _shortest(problem: Problem) -> float:
    """Return the time in s below which a segment holds too little to tell of its start."""
    return CELLS * max(log.mean_step for log in problem.logs)


def _over(problem: Problem, end: Fit, horizon: float) -> Fit | None:
    """Return the end of a fit over segments that begins at another's; None if there is none."""
    there = replace(problem, options=replace(problem.options, horizon=horizon))
    return refitted(there.of_logs(problem.logs), end.values)
