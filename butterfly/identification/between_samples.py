"""What nobody says of an input: whether it is held between its samples, or goes straight on.

A held input is late by half a sample, which the delay takes up, unless it is at its bound: then
inertia, damping and friction of a joint in a loop stand in for it. So both are fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.chosen_terms import Fitted, nested_about
from butterfly.identification.data import DataSet
from butterfly.identification.estimators.start import leaves_noise
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.inference.identifiability import is_driven
from butterfly.identification.inference.stagewise import as_good
from butterfly.identification.problem import Problem
from butterfly.identification.servo_drive import driven
from butterfly.logs.log import InputKind, Intersample, Log

Begun = tuple[Problem, Fitted]
"""A problem with all terms that are tried, and the end of a fit in those that its start has."""


def straight(log: Log) -> Log:
    """Return a log whose input goes straight from sample to sample, if nobody says what it does."""
    if log.intersample is not None or not is_driven([log]):
        return log
    lines = replace(log, intersample=Intersample.FIRST_ORDER_HOLD)
    if not log.rebuilt:
        return lines
    raw: dict[str, Any] = {"input": log.setpoint, "input_kind": InputKind.SETPOINT}
    raw |= {"setpoint": None, "rebuilt": False}
    if log.lead is not None and log.lead.setpoint is not None:
        raw["lead"] = replace(log.lead, input=log.lead.setpoint, setpoint=None)
    return driven(replace(lines, **raw))


def held_or_straight(logs: Sequence[Log], begun: Callable[[Sequence[Log]], Begun]) -> Begun:
    """Begin the fit of logs, with straight lines instead of steps where these follow them better.

    ``begun`` fits logs in the terms of their start. Where held inputs leave but noise, or each log
    says what its input does, nothing is compared. The fit has a finding of what was taken.
    """
    lines = [straight(log) for log in logs]
    open_ = tuple(
        new.name for old, new in zip(logs, lines, strict=True) if old.intersample != new.intersample
    )
    if not open_:
        return begun(logs)
    fits: list[tuple[FindingKind, Begun]] = []
    refusals: list[IdentifiabilityError] = []
    for kind, some in ((FindingKind.HELD, logs), (FindingKind.STRAIGHT, lines)):
        if fits and leaves_noise(fits[0][1][1].end.at):
            break
        try:
            fits.append((kind, begun(some)))
        except IdentifiabilityError as refusal:
            refusals.append(refusal)
    if not fits:
        raise refusals[0]
    # the last is taken if it is the only one, or the first is not as good
    first, last = (_errors(*each[1]) for each in (fits[0], fits[-1]))
    kind, (every, fitted) = fits[0] if as_good(first, last) else fits[-1]
    taken = Finding(kind, ("delay",), logs=open_)
    return every, replace(fitted, findings=(*fitted.findings, taken))


def as_taken(data: DataSet, found: Estimate) -> tuple[DataSet, Estimate]:
    """Return the logs with their input between samples as an estimate took it, and the estimate."""
    kinds = {each.kind for each in found.findings}
    if FindingKind.STRAIGHT in kinds:
        return data.corrected(straight), found
    if FindingKind.HELD in kinds:
        return data.corrected(lambda log: replace(log, intersample=log.between_samples)), found
    return data, found


def _errors(every: Problem, fitted: Fitted) -> Samples:
    """(k,) rms errors of cells, as many as for all terms."""
    cells = nested_about(fitted.problem, fitted.end.at, len(every.keys)).equations
    return np.asarray(np.sqrt(cells.cost))
