"""What a fit assumes of logs where it is not specified, and what is done where that is wrong.

*Between its samples an input is held.* One that is held is late by half a sample, which the delay
takes up unless it would be below 0: then inertia, damping and friction of a joint in a loop stand
in for it. Else held inputs and straight lines both follow the logs, and differ in gain by
(omega T)^2 / 24 at a sampling period T.

*Runs of whole logs stay near them.* Where nothing holds the joint, errors of whole logs are more
than noise; then segments of the joint's own time are fitted, shorter by thirds if such leave none.

*All logs have one friction and one gain.* Where these scatter, logs are weighed by how much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.chosen_terms import nested_about
from butterfly.identification.consistency import is_driven
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.start import refitted, residuals_are_white
from butterfly.identification.fit import Fit
from butterfly.identification.free_run import is_held, own_time
from butterfly.identification.limits import CELLS, WEIGHED
from butterfly.identification.loss import Loss
from butterfly.identification.problem import Problem, Start
from butterfly.identification.scatter import Likelihood
from butterfly.identification.segments import assumes_clock, driven, undriven
from butterfly.identification.stagewise import PROMISED, as_good
from butterfly.identification.trust import FEW, MATERIAL, Finding, FindingKind
from butterfly.identification.weak_regression import reading_of
from butterfly.logs.log import Intersample, Log
from butterfly.progress import out_of_time

_FASTER = 0.01  # of the assumed period of a loop, as if it had no clock

_SAME_TIME = 0.9  # share of the own time, above which segments are as long

Begun = tuple[Problem, Fit]
"""A problem with all terms that are tried, and the end of a fit in some of them."""


def straight(log: Log) -> Log:
    """Return a log whose input goes straight from sample to sample, if this is not specified."""
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
    if late < _half_a_sample(logs) and not residuals_are_white(first[1].linearisation):
        with suppress(IdentifiabilityError):
            other, most = begun(lines), len(first[0].keys)
            held, lined = (_errors(*pair, most) for pair in (first, other))
            share = 1 - float(np.sum(lined**2) / np.sum(held**2))
            if share > MATERIAL and not as_good(held, lined):
                return _taking(FindingKind.STRAIGHT, other, open_)
    return _taking(FindingKind.HELD, first, open_)


def _opened(logs: Sequence[Log], lines: Sequence[Log]) -> tuple[str, ...]:
    """Return the names of logs that do not say what their input does between samples."""
    pairs = zip(logs, lines, strict=True)
    return tuple(log.name for log, line in pairs if log.intersample != line.intersample)


def _taking(kind: FindingKind, begun: Begun, names: Sequence[str]) -> Begun:
    """Return a fit, with the finding of what its inputs do between their samples."""
    taken = Finding(kind, ("delay",), logs=tuple(names))
    return begun[0], replace(begun[1], findings=(*begun[1].findings, taken))


def unsaid(problem: Problem, end: Fit) -> list[Samples]:
    """Return (shared,) values of fits under other assumptions that follow the logs as well.

    These are inputs that go straight between samples, and a loop whose clock is faster than
    assumed. The delay stays that of held inputs.
    """
    logs, rivals = problem.logs, list[Samples]()
    lines, fast = [straight(log) for log in logs], [_faster(log) for log in logs]
    for some, delay in ((lines, _half_a_sample(logs)), (fast, 0.0)):
        changed = any(new is not old for new, old in zip(some, logs, strict=True))
        if not changed or out_of_time("the input between samples"):
            continue
        there, mask = problem.of_logs(some, delay), np.array(problem.labels) == "delay"
        begun = end.values + np.where(mask, delay, 0.0)
        other = refitted(there, begun, end.linearisation)
        if other is None or not other.converged:
            continue
        ends = ((there, other), (problem, end))
        if as_good(*(_errors(*pair, len(begun)) for pair in ends)):
            rivals.append(np.where(mask, end.values, other.values)[: problem.shared])
    return rivals


def _faster(log: Log) -> Log:
    """Return a log whose loop runs faster than assumed, if nobody says how fast it does."""
    if log.servo is None or not assumes_clock(log):
        return log
    return replace(log, servo=replace(log.servo, clock=log.servo.period * _FASTER))


def _half_a_sample(logs: Sequence[Log]) -> float:
    """Time in s by which a held input is late."""
    return float(np.median([log.mean_step for log in logs])) / 2


def as_taken(data: DataSet, estimate: Estimate) -> tuple[DataSet, Estimate]:
    """Return the logs with their input between samples as an estimate took it, and the estimate."""
    kinds = {finding.kind for finding in estimate.findings}
    if FindingKind.STRAIGHT in kinds:
        return data.corrected(straight), estimate
    if FindingKind.HELD in kinds:
        return data.annotated(lambda log: replace(log, intersample=log.between_samples)), estimate
    return data, estimate


def _errors(problem: Problem, end: Fit, most: int) -> Samples:
    """(k,) rms errors of the cells of a fit, as many as for ``most`` unknowns."""
    return np.asarray(np.sqrt(nested_about(problem, end.linearisation, most).equations.squares))


def shorter_segments(every: Problem, fit: Fit) -> tuple[float, Start] | None:
    """Return the time in s of segments, and a first guess over them, if longer ones are no good.

    That is where nothing holds the joint in any log, and a fit leaves errors above white noise by
    more than the noise is known.
    """
    problem, end = every.of_fit(fit.plain), fit.plain
    time, whole = _time_of(problem, end), math.isinf(problem.options.horizon)
    if math.isinf(time) or _explained(end):
        return None
    time = time if whole else problem.options.horizon
    first: tuple[float, Fit] | None = None
    for part in range(0 if whole else 1, FEW + 1):
        horizon = float(f"{time / FEW**part:.2g}")
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
    """Return (shared,) values of a fit over segments of a third of the joint's own time.

    For some joints these are nearer the truth, for others not; which cannot be predicted. Empty if
    segments are shorter already, as noise explains only those.
    """
    horizon = problem.options.horizon
    third = horizon / FEW
    if horizon < _SAME_TIME * _time_of(problem, end) or third < _shortest(problem):
        return []
    shorter = _over(problem, end, third)
    return [shorter.values[: problem.shared]] if shorter is not None and shorter.converged else []


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
    return end.cost <= (1 + WEIGHED) ** 2 * end.linearisation.white_cost


def _shortest(problem: Problem) -> float:
    """Return the time in s below which a segment holds too little to tell of its start."""
    return CELLS * max(log.mean_step for log in problem.logs)


def _over(problem: Problem, end: Fit, horizon: float) -> Fit | None:
    """Return the end of a fit over segments that begins at another's; None if there is none."""
    there = replace(problem, options=replace(problem.options, horizon=horizon))
    return refitted(there.of_logs(problem.logs), end.values)


def weigh_by_scatter(every: Problem, fit: Fit) -> Fit:
    """Return the fit to logs that are weighed by their likeliest scatter (see `scatter`).

    Two steps, on all rows of each log, compressed to as many as there are values. The first leads
    from the end of the fit to the optimum of the weighed logs. There every log is simulated with
    its likeliest friction and gain, which gives a better scatter; the second step leads to the
    optimum of logs weighed by that (Lindstrom & Bates, Biometrics 46, 1990). There only the plain
    logs are simulated, to see that they are followed. Findings say which scatter is more than
    chance. The fit stays as it was if there are too few logs to tell, or no such end.
    """
    plain = _plain(every, fit)
    problem, at = every.of_fit(plain), plain.linearisation
    few = at.ends.size <= FEW or at.loss is not Loss.LINEAR  # a robust loss weighs by itself
    if few or out_of_time("weighting the logs by their scatter"):
        return plain
    try:
        begun, effects = at, np.zeros((at.ends.size, at.values.size))
        if fit.scatter:  # of other terms: each log begins with what it had of its own
            effects = np.maximum(fit.scatter.own_of(problem.labels), problem.lower - at.values)
            begun = problem.equations(at.values + effects, at)
        first = Likelihood(begun, at.values, effects, problem.prior(at.values))
        scatter = first.best()
        white = problem.knowing(first.weighed(scatter))
        step = white.step(*problem.box.about(white.values, np.inf))
        values = plain.values + step
        effects = np.maximum(scatter.random_effects(white, step), problem.lower - values)
        there = problem.equations(values + effects, at)
        if not there.is_finite:
            return plain
        second = Likelihood(there, values, effects, problem.prior(values))
        scatter = replace(second.best(), names=problem.labels, effects=effects, noise=second.noise)
        white = problem.knowing(second.weighed(scatter))
        step = white.step(*problem.box.about(values, np.inf))
    except IdentifiabilityError:
        return plain
    if white.cells(1).conditioning.singular:
        return plain
    ended = np.maximum(values + step, problem.lower)
    promised = replace(at, prior=None).moved(ended - plain.values).cost
    if not PROMISED * problem.equations(ended, there, slopes=False).cost <= promised:
        return plain
    return replace(
        plain,
        linearisation=replace(white.moved(step), values=ended),
        unweighed=at,
        scatter=scatter,
        findings=(*plain.findings, *second.findings(scatter)),
    )


def _plain(every: Problem, fit: Fit) -> Fit:
    """Return a fit with its logs unweighed again, about its present values."""
    if fit.scatter is None:
        return fit
    problem = replace(every.of_fit(fit), scatter=None)
    at = problem.with_scaled_prior(problem.equations(fit.values, fit.linearisation))
    findings = tuple(finding for finding in fit.findings if finding.kind is not FindingKind.SCATTER)
    return replace(fit, linearisation=at, unweighed=None, scatter=None, findings=findings)
