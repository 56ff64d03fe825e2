"""What the encoder reads where the model's angle is 0, for each log, and how that was found.

It is told; or it is the middle of the steady swings of sines with the same added mass; or the
motion itself tells it (see `zero_fit`); or it is where a hand hangs at rest, as far as friction
lets it (see `dwell`); or it is a guess. Readings that are whole turns apart are the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.dwell import rest_readings
from butterfly.identification.zero_fit import fitted_zero
from butterfly.logs.log import Log
from butterfly.model.known import Known
from butterfly.model.parameters import AddedMass
from butterfly.signals.frequency_response import ResponsePoint

_GUESSED = 0.5  # rad, largest standard uncertainty of a guess: more says no more
_SLACK = 0.1  # friction over the moment of gravity, where nothing is known of it
_APART = 3.0  # standard errors between readings that are not the same
_ALIKE = 0.005  # rad between readings that are


class ZeroKind(StrEnum):
    """How a zero was found."""

    TOLD = "told"
    SWING = "steady swing"
    FIT = "the motion itself"
    REST = "rest"
    GUESS = "a guess"


@dataclass(frozen=True, kw_only=True)
class Zero:
    """An encoder reading in rad where the model's angle is 0, and its standard uncertainty."""

    value: float  # value, uncertainty: in rad; of a steady swing's middle no uncertainty is stated
    uncertainty: float = 0.0
    kind: ZeroKind  # how it was found

    def __str__(self) -> str:
        doubt = f" ± {self.uncertainty:.1g}" if self.uncertainty else ""
        return f"{round(self.value, 4) + 0.0:.4f}{doubt} rad ({self.kind})"

    def near(self, home: float) -> Zero:
        """Return the same zero, read within half a turn of ``home`` rad."""
        return replace(self, value=near(self.value, home))


def near(reading: float, home: float) -> float:
    """Return the reading in rad, whole turns taken off, that is next to another."""
    return home + math.remainder(reading - home, 2 * math.pi)


def reading_of(log: Log, zeros: Mapping[AddedMass, float]) -> float:
    """Return a log's zero in rad: what is told of it, or that of its added mass."""
    return zeros[log.added_mass] if log.zero is None else log.zero.value


def zeros_of(logs: Sequence[Log], points: Sequence[ResponsePoint | None]) -> tuple[Zero, ...]:
    """Find the zero of each of n logs.

    ``logs``: with increasing stamps; ``points``: the steady response of each, None where the input
    is no sine.
    """
    found = [_told(log) for log in logs]
    open_ = [k for k, zero in enumerate(found) if zero is None]
    if not open_:
        return tuple(zero for zero in found if zero is not None)
    home = _home(logs, points, open_)
    masses = sorted({logs[k].added_mass for k in open_})
    of_mass = {}
    for mass in masses:
        own = [k for k in open_ if logs[k].added_mass == mass]
        of_mass[mass] = _of_mass([logs[k] for k in own], [points[k] for k in own], home)
    of_mass = _together(of_mass)
    return tuple(
        of_mass[log.added_mass] if zero is None else zero
        for log, zero in zip(logs, found, strict=True)
    )


def doubts(zeros: Sequence[Zero] | Sequence[Known]) -> NDArray[np.float64]:
    """(k, n) standard uncertainties in rad of k independent errors in the zeros of n logs.

    Logs of one zero share its error.
    """
    uncertain = sorted({zero for zero in zeros if zero.uncertainty}, key=lambda zero: zero.value)
    rows = [[each.uncertainty * (zero == each) for zero in zeros] for each in uncertain]
    return np.array(rows, dtype=float).reshape(len(uncertain), len(zeros))


def _told(log: Log) -> Zero | None:
    return None if log.zero is None else Zero(**vars(log.zero), kind=ZeroKind.TOLD)


def _turns(log: Log) -> bool:
    return float(np.ptp(log.angle)) > 2 * np.pi


def _home(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None], numbers: Sequence[int]
) -> float:
    """Return a reading in rad, within half a turn of which all zeros are given."""
    for k in numbers:
        point = points[k]
        if not _turns(logs[k]):
            return float(np.mean(logs[k].angle)) if point is None else point.angle.offset
    return float(logs[numbers[0]].angle[0])


def _of_mass(logs: Sequence[Log], points: Sequence[ResponsePoint | None], home: float) -> Zero:
    """Find what logs with one added mass share."""
    middles = [
        near(point.angle.offset, home)
        for log, point in zip(logs, points, strict=True)
        if point is not None and not _turns(log)
    ]
    if middles:
        return Zero(value=float(np.median(middles)), kind=ZeroKind.SWING)
    fitted = fitted_zero(logs)
    rests = [reading for log in logs for reading in rest_readings(log)]
    slack = math.asin(min(_SLACK if fitted is None else fitted.friction, 1.0))
    found = []
    if fitted is not None:
        found.append(Zero(value=fitted.value, uncertainty=fitted.uncertainty, kind=ZeroKind.FIT))
        rests = [each for each in rests if abs(near(each, fitted.value) - fitted.value) < np.pi / 2]
    if rests:
        middle = float(np.median([near(each, rests[0]) for each in rests]))
        found.append(Zero(value=middle, uncertainty=slack / math.sqrt(3), kind=ZeroKind.REST))
    likely = [zero for zero in found if zero.uncertainty < _GUESSED]
    best = min(likely, key=lambda zero: zero.uncertainty, default=_guess(logs, home))
    return best.near(home)


def _guess(logs: Sequence[Log], home: float) -> Zero:
    """Guess the median of what logs of small motion go about; a turning one tells its start."""
    calm = [log for log in logs if not _turns(log)]
    means = [near(float(np.mean(log.angle)), home) for log in calm]
    swings = [float(np.std(log.angle)) for log in calm]
    return Zero(
        value=float(np.median(means or [logs[0].angle[0]])),
        uncertainty=float(np.median(np.minimum(swings or [_GUESSED], _GUESSED))),
        kind=ZeroKind.GUESS,
    )


def _together(found: Mapping[AddedMass, Zero]) -> dict[AddedMass, Zero]:
    """Put the zeros that the motion told with different masses together, where they agree.

    A mass of which there is but a guess has the zero that is known best of the others.
    """
    told = {mass: zero for mass, zero in found.items() if zero.kind is ZeroKind.FIT}
    one = _shared(list(told.values()))
    joint = {**found, **dict.fromkeys(told, one)} if one else dict(found)
    best = min(joint.values(), key=lambda zero: (zero.kind is ZeroKind.GUESS, zero.uncertainty))
    return {mass: best if z.kind is ZeroKind.GUESS else z for mass, z in joint.items()}


def _shared(told: Sequence[Zero]) -> Zero | None:
    """Return the weighted mean of zeros; None if there are no two, or they do not agree."""
    if len(told) < 2:  # noqa: PLR2004 - alone it has no others
        return None
    values = np.array([near(zero.value, told[0].value) for zero in told])
    own = np.array([zero.uncertainty for zero in told])
    errors = np.hypot(own, _ALIKE)
    weights = errors**-2 / np.sum(errors**-2)
    mean = float(weights @ values)
    if (np.abs(values - mean) > _APART * errors).any():
        return None
    return Zero(value=mean, uncertainty=float(np.sqrt(weights**2 @ own**2)), kind=ZeroKind.FIT)
