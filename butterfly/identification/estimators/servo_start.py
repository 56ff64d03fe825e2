"""Where the fit of a servo in its loop starts: over short segments, driven by its drive alone.

In the loop a joint's friction decides where it stops, and descents from far end at other stops.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from butterfly.identification.estimators.free_run_residuals import (
    OF_SERVO,
    FreeRunResiduals,
    tried,
)
from butterfly.identification.estimators.gauss_newton import Minimum
from butterfly.identification.estimators.multistart import Start
from butterfly.identification.inference.term_choice import candidates
from butterfly.identification.levels import MATTERS, MOST
from butterfly.identification.servo_drive import driven_alone
from butterfly.logs.log import Log
from butterfly.model.linear import resonance_frequency
from butterfly.model.prior import Known, Prior
from butterfly.model.terms import GEAR, LOOP_TERMS

ProblemOf = Callable[[Sequence[Log], Start, Prior], FreeRunResiduals]
"""Makes the residuals of logs from a first guess and what is known."""

_PASSES = 4  # of a descent at another delay,
_PARABOLAS = 2  # and how often one is sought at the vertex of the last ones
_GEAR = 0.1  # of each of a gear's torques that friction takes, from where on it is sought


def servo_start(
    over: Callable[[Iterable[str], Iterable[str], float], ProblemOf],
    asked: tuple[Sequence[str] | None, Sequence[str]],
    logs: Sequence[Log],
    guess: Start,
    known: Prior,
) -> tuple[Start, tuple[str, ...]]:
    """Return a first guess of servos, whose friction decides where they stop, and their terms.

    Over segments of one period, or a few time constants of the speed, driven by the rebuilt drive,
    no stop is far off. ``over`` makes the problem with some terms, with what is fixed, over a
    horizon in s; ``asked`` are the terms, None to choose them, and what is fixed.
    """
    told, fixed = asked
    loaded = [guess.parameters.with_added_mass(log.added_mass) for log in logs]
    fastest = max(max(resonance_frequency(each), each.p2 / each.p1) for each in loaded)
    gear = {*GEAR} & {*(OF_SERVO if told is None else told)}
    begun = dict.fromkeys(gear - known.parameters.keys(), _GEAR)
    start = replace(guess, parameters=replace(guess.parameters, **begun))
    terms = told
    if terms is None:
        terms = candidates(tried(logs), [log.added_mass for log in logs], known)
    horizon = 2 * math.pi / fastest if fastest > 0 else math.inf
    problem_of = over(terms, {"delay", *fixed, *LOOP_TERMS}, horizon)
    scanned = "delay" not in {*known.fixed, *fixed}
    delay = 0.0 if scanned else known.fixed.get("delay", guess.parameters.delay)
    known = known | Prior({"delay": Known(value=0.0)})  # of the drive itself
    ends: list[tuple[float, float, FreeRunResiduals, Minimum]] = []

    def attempt(delay: float) -> None:
        late = replace(start.parameters, delay=delay)
        begun = replace(start, parameters=replace(late, delay=0.0))
        problem = problem_of([driven_alone(log, late) for log in logs], begun, known)
        if ends:
            at = ends[0][2].scale * ends[0][3].point / problem.scale
            end = problem.descend(at, most=_PASSES)
        else:
            end = problem.descend(problem.initial)
        ends.append((end.at.cost, delay, problem, end))
        ends.sort(key=lambda each: each[:2])

    attempt(delay)
    if scanned and any(log.rebuilt for log in logs):
        step = float(np.median([log.mean_step for log in logs]))
        while ends[0][1] == max(each[1] for each in ends) and len(ends) < MOST:
            attempt(ends[0][1] + step)
        if ends[0][1] == 0.0:
            attempt(step / 2)
        for _ in range(_PARABOLAS):
            costs, delays = np.array([each[:2] for each in ends[:3]]).T / [[ends[0][0]], [step]]
            bend, slope, _ = np.linalg.solve(np.vander(delays, 3), costs).tolist()
            lowest = max(-slope / (2 * bend), 0.0) if bend > 0 else delays[0]
            if np.abs(delays - lowest).min() < MATTERS:
                break
            attempt(lowest * step)
    _, delay, problem, end = ends[0]
    terms = told
    if terms is None:
        choice = problem.choose_terms(end.point, end.at, tuple(known.uncertain))
        problem, end, _ = problem.fitted(choice)
        terms = (*choice.terms, "latency")
    found = zip(problem.keys, (end.point * problem.scale).tolist(), strict=True)
    own = {name: value for (name, whose), value in found if whose is None} | {"delay": delay}
    zeros = dict.fromkeys(guess.zeros, own.pop("zero")) if "zero" in own else guess.zeros
    return Start(replace(problem.start, **own), zeros), tuple(terms)
