"""Segments of a joint's own time, where no run of whole logs stays near them.

A joint that nothing holds, such as a cart or an arm without gravity in somebody's loop, integrates
twice whatever its simulation lacks: after a minute little is left to see of its inertia. Its own
time is the period of its motion, or the time in which its speed settles if that is shorter;
segments are shorter by thirds, if such leave no more than noise.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.chosen_terms import Fitted
from butterfly.identification.estimators.start import white_cost
from butterfly.identification.fit import Minimum
from butterfly.identification.inference.blocks import CELLS
from butterfly.identification.levels import FEW, PASSES, PRECISE, SHOWS, WEIGHED
from butterfly.identification.problem import Problem, Start
from butterfly.logs.log import Log
from butterfly.progress import out_of_time
from butterfly.signals.spectrum import resample, uniform_grid


def own_time(fitted: Fitted) -> tuple[float, Start]:
    """Return the time in s of segments, and a first guess over them.

    It is finite where nothing holds the joint, and a fit of whole logs leaves errors above white
    noise by more than this is known.
    """
    problem, end = fitted.problem, fitted.end
    own, tried = _time_of(problem, end), list[tuple[float, Minimum]]()
    while not _explained(end) and len(tried) <= FEW and not out_of_time("shorter segments"):
        horizon = float(f"{own / FEW ** len(tried):.2g}")  # which hardly depends on the values
        shorter = _over(problem, end, horizon) if _shortest(problem) < horizon < math.inf else None
        if shorter is None:
            break
        end = shorter
        tried.append((horizon, end))
    found = math.inf
    if tried:  # where the noise explains none, it is the model that lacks something
        found, end = tried[-1 if _explained(end) else 0]
    keys = zip(problem.keys, end.values.tolist(), strict=True)
    shared = {name: value for (name, whose), value in keys if whose is None and name != "zero"}
    return found, Start(replace(problem.start, **shared), problem.zeros)


def _time_of(problem: Problem, end: Minimum) -> float:
    """Return the joint's own time in s; infinite of one that gravity or a servo's loop holds."""
    values = dict(zip(problem.labels, end.values.tolist(), strict=True))
    bare = replace(problem.start, **{n: values[n] for n in ("p1", "p2", "p3") if n in values})
    loaded = [bare.with_added_mass(log.added_mass) for log in problem.logs]
    if any(log.closed for log in problem.logs) or any(each.p3 for each in loaded):
        return math.inf
    settles = (2 * math.pi * each.p1 / each.p2 for each in loaded if each.p2 > 0)
    return min([*settles, *map(_period, problem.logs)])


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
    try:
        return there.descend(there.equations(end.values), PASSES, SHOWS)
    except IdentifiabilityError:
        return None


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


def _period(log: Log) -> float:
    """Return the period in s of the peak of a log's spectrum, through a Hann window."""
    grid = uniform_grid(log.time)
    centred = resample(log.time, log.angle, grid)
    centred -= centred.mean()
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(grid.size)))
    return float(grid[-1] - grid[0]) / (1 + int(np.argmax(spectrum[1:])))
