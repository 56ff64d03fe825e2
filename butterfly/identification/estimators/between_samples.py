"""What nobody says of an input: whether it is held between its samples, or goes straight on.

A held input is late by half a sample, which the delay takes up unless it would be below 0: then
inertia, damping and friction of a joint in a loop stand in for it. Else both follow the logs, and
differ in gain by (omega T)^2 / 24 at a sampling period T.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.chosen_terms import nested_about
from butterfly.identification.data import DataSet
from butterfly.identification.estimators.start import leaves_noise, refitted
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.fit import Fit
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.inference.identifiability import is_driven
from butterfly.identification.inference.stagewise import as_good
from butterfly.identification.levels import MATERIAL, MATTERS
from butterfly.identification.problem import Problem
from butterfly.identification.servo_drive import assumes_clock, driven, undriven
from butterfly.logs.log import Intersample, Log
from butterfly.progress import out_of_time

Begun = tuple[Problem, Fit]
"""A problem with all terms that are tried, and the end of a fit in some of them."""


def straight(log: Log) -> Log:
    """Return a log whose input goes straight from sample to sample, if nobody says what it does."""
    computed = log.rebuilt and log.servo is None  # a drive: means over its steps
    if log.intersample is not None or computed or not is_driven([log]):
        return log
    lines = replace(log, intersample=Intersample.FIRST_ORDER_HOLD)
    if not log.rebuilt:
        return lines
    return driven(undriven(lines))


def held_or_straight(logs: Sequence[Log], begun: Callable[[Sequence[Log]], Begun]) -> Begun:
    """Begin the fit of logs, with straight lines instead of steps where only these follow them.

    ``begun`` fits logs in the terms of their start. Lines are tried where held inputs come so late
    that no delay is left for the joint, and leave more than noise; else both follow the logs (see
    `unsaid`). The fit has a finding of what was taken.
    """
    lines = [straight(log) for log in logs]
    open_ = _opened(logs, lines)
    if not open_:
        return begun(logs)
    try:
        first = begun(logs)
    except IdentifiabilityError:
        return _taking(FindingKind.STRAIGHT, begun(lines), open_)
    late = first[1].named.get("delay", 0.0)
    if late < _half_a_sample(logs) and not leaves_noise(first[1].linearisation):
        with suppress(IdentifiabilityError):
            other, most = begun(lines), len(first[0].keys)
            held, lined = (_errors(*each, most) for each in (first, other))
            share = 1 - float(np.sum(lined**2) / np.sum(held**2))
            if share > MATERIAL and not as_good(held, lined):
                return _taking(FindingKind.STRAIGHT, other, open_)
    return _taking(FindingKind.HELD, first, open_)


def _opened(logs: Sequence[Log], lines: Sequence[Log]) -> tuple[str, ...]:
    """Return the names of logs of which nobody says what their input does."""
    pairs = zip(logs, lines, strict=True)
    return tuple(log.name for log, line in pairs if log.intersample != line.intersample)


def _taking(kind: FindingKind, begun: Begun, names: Sequence[str]) -> Begun:
    """Return a fit, with the finding of what its inputs do between their samples."""
    taken = Finding(kind, ("delay",), logs=tuple(names))
    return begun[0], replace(begun[1], findings=(*begun[1].findings, taken))


def unsaid(problem: Problem, end: Fit) -> list[Samples]:
    """Return (shared,) values of fits that follow the logs as well, by what nobody says of them.

    These are straight lines between samples, and a loop whose clock is faster than assumed. The
    delay stays that of held inputs.
    """
    logs, found = problem.logs, list[Samples]()
    lines, fast = [straight(log) for log in logs], [_faster(log) for log in logs]
    for some, delay in ((lines, _half_a_sample(logs)), (fast, 0.0)):
        told = any(new is not old for new, old in zip(some, logs, strict=True))
        if not told or out_of_time("what nobody says of inputs"):
            continue
        there, own = problem.of_logs(some), np.array(problem.labels) == "delay"
        begun = end.values + np.where(own, delay, 0.0)
        other = refitted(there, begun, end.linearisation)
        if other is None or not other.converged:
            continue
        ends = ((there, other), (problem, end))
        if as_good(*(_errors(*each, len(begun)) for each in ends)):
            found.append(np.where(own, end.values, other.values)[: problem.shared])
    return found


def _faster(log: Log) -> Log:
    """Return a log whose loop runs faster than assumed, if nobody says how fast it does."""
    if log.servo is None or not assumes_clock(log):
        return log
    return replace(log, servo=replace(log.servo, clock=log.servo.period * MATTERS))


def _half_a_sample(logs: Sequence[Log]) -> float:
    """Time in s by which a held input is late."""
    return float(np.median([log.mean_step for log in logs])) / 2


def as_taken(data: DataSet, found: Estimate) -> tuple[DataSet, Estimate]:
    """Return the logs with their input between samples as an estimate took it, and the estimate."""
    kinds = {each.kind for each in found.findings}
    if FindingKind.STRAIGHT in kinds:
        return data.corrected(straight), found
    if FindingKind.HELD in kinds:
        return data.told(lambda log: replace(log, intersample=log.between_samples)), found
    return data, found


def _errors(problem: Problem, end: Fit, most: int) -> Samples:
    """(k,) rms errors of the cells of a fit, as many as for ``most`` unknowns."""
    return np.asarray(np.sqrt(nested_about(problem, end.linearisation, most).equations.squares))
